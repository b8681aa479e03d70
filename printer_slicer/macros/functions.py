"""Functions of the macro language. Each takes values, including vectors, and returns one value."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import copysign, sqrt
from typing import Final

from printer_slicer.macros.values import (
    MOST_TEXT,
    NEARLY,
    Items,
    Pattern,
    Value,
    describe_kind,
    equal,
    first_item,
    format_value,
    to_whole,
)

__all__ = ["FUNCTIONS", "MisusedFunction", "matches"]

_Function = Callable[[Sequence[Value]], Value]
_MOST_DIGITS: Final = 20
_WIDEST: Final = 100  # characters of a number
_LONGEST_PATTERN: Final = 10_000
_MOST_STEPS: Final = 10_000_000
"""Limit of text length times pattern length; it corresponds to seconds in the worst case."""
_PATTERN_BYTES: Final = 1 << 23
"""Memory limit for a pattern; nested repetitions exceed it."""


class MisusedFunction(Exception):  # noqa: N818 - becomes a MacroFault once its position is known
    """A function was called with invalid arguments."""


def matches(text: str, pattern: str) -> bool:
    """Return whether a pattern matches a whole text, in linear time.

    Patterns are untrusted, and Python's engine can take exponential time. RE2 has Perl's syntax without lookaround and
    backreferences, which no vendor's profiles use.

    Raises:
        MisusedFunction: the pattern is invalid, or too long by itself or for the text.
    """
    import re2  # noqa: PLC0415 - few macros have a pattern

    if len(pattern) > _LONGEST_PATTERN:
        raise MisusedFunction(
            f"the pattern has {len(pattern)} characters; at most {_LONGEST_PATTERN} are allowed"
        )
    if len(text) * len(pattern) > _MOST_STEPS:
        raise MisusedFunction(f"a pattern of {len(pattern)} characters is too long for a text of {len(text)}")
    options = re2.Options()
    options.dot_nl, options.log_errors, options.max_mem = True, False, _PATTERN_BYTES
    try:
        return re2.compile(str(pattern), options).fullmatch(text) is not None  # type: ignore[no-untyped-call]
    except (re2.error, UnicodeEncodeError):
        raise MisusedFunction(f"the pattern /{pattern[:80]}/ is invalid") from None


def _numbers(values: Sequence[Value]) -> list[float]:
    """Return arguments as numbers, given one by one or as one list."""
    flat: Sequence[Value] = values
    if len(values) == 1 and isinstance(values[0], tuple):
        flat = values[0]
    numbers: list[float] = []
    for value in map(first_item, flat):
        if isinstance(value, (bool, str, tuple)):
            raise MisusedFunction(f"expected a number, got {describe_kind(value)}")
        numbers.append(value)
    return numbers


def _of_numbers(least: int, most: int, function: Callable[..., Value]) -> _Function:
    """Wrap a function that takes `least` to `most` numbers."""

    def run(values: Sequence[Value]) -> Value:
        """Check the arguments and call the function."""
        numbers = _numbers(values)
        if not least <= len(numbers) <= most:
            wanted = f"{least}" if least == most else f"{least} or more" if most > 3 else f"{least} or {most}"
            raise MisusedFunction(f"expected {wanted} arguments, got {len(numbers)}")
        return function(*numbers)

    return run


def _of_values(count: int, function: Callable[..., Value], kinds: type = object) -> _Function:
    """Wrap a function that takes `count` values, all of one type."""

    def run(values: Sequence[Value]) -> Value:
        """Check the arguments and call the function."""
        if len(values) != count:
            raise MisusedFunction(f"expected {count} arguments, got {len(values)}")
        values = [first_item(one) for one in values] if kinds is str else values
        for value in values:
            if not isinstance(value, kinds):
                raise MisusedFunction(f"expected a text, got {describe_kind(value)}")
        return function(*values)

    return run


def _least_or_most(choose: Callable[[tuple[float, ...]], float]) -> Callable[..., Value]:
    """Wrap `min` or `max`: the result is a whole number only if all values are, which matters for divisions."""

    def run(*values: float) -> float:
        """Return the smallest or largest value."""
        found = choose(values)
        return found if all(isinstance(one, int) for one in values) else float(found)

    return run


def _rounded(value: float, digits: float | None = None) -> float:
    """Round to so many decimals; halves are rounded away from zero."""
    scale = 10.0 ** _count(digits or 0)
    found = copysign(to_whole(abs(value) * scale + 0.5) / scale, value)
    return int(found) if digits is None else found


def _count(digits: float, most: int = _MOST_DIGITS) -> int:
    if not equal(digits, to_whole(digits)) or not 0 <= digits <= most:
        raise MisusedFunction(f"{digits:g} is not a valid number of digits; use 0 to {most}")
    return to_whole(digits)


def _digits(fill: str) -> Callable[..., str]:
    """Return a function that formats a number with a width and a number of decimals."""
    return lambda value, width, decimals=0: f"{value:{fill}{_count(width, _WIDEST)}.{_count(decimals)}f}"


def _root(value: float) -> float:
    if value < -NEARLY:
        raise MisusedFunction(f"{value:g} has no square root")
    return sqrt(max(value, 0.0))


def _size(value: Value) -> int:
    if not isinstance(value, (str, tuple)):
        raise MisusedFunction(f"{describe_kind(value)} has no size")
    return len(value)


def _cut(value: float) -> int:
    """Round to a whole number towards zero."""
    return to_whole(value, up=value < 0)


def _random(values: Sequence[Value]) -> Value:
    """Return a random number between two limits, both included; the seed comes last."""
    *limits, seed = values
    numbers = _numbers(limits)
    if len(numbers) != 2 or numbers[0] > numbers[1]:
        raise MisusedFunction("expected the smallest and the largest number")
    low, high = numbers
    from hashlib import sha256  # noqa: PLC0415 - few macros use random numbers

    share = int.from_bytes(sha256(f"{low} {high} {seed}".encode()).digest()[:6], "big") / 2**48
    if isinstance(low, int) and isinstance(high, int):
        return low + int(share * (high - low + 1))
    return low + share * (high - low)


def _repeated(values: Sequence[Value]) -> Value:
    """Return a list that repeats a value."""
    count, value = map(first_item, values) if len(values) == 2 else ("", "")
    if isinstance(count, (bool, str, tuple)) or not 0 <= count <= MOST_TEXT or isinstance(value, tuple):
        raise MisusedFunction(f"expected a count up to {MOST_TEXT} and a value")
    return Items([value] * int(count))


def _interpolated(values: Sequence[Value]) -> Value:
    """Interpolate a table of points (x, y) at x; beyond its ends, return the first or last y."""
    points = [_numbers([one]) for one in values[1:]]
    x = _numbers([first_item(values[0])])[0] if values else 0.0
    if not points or any(len(one) != 2 for one in points) or any(a[0] >= b[0] for a, b in pairwise(points)):
        raise MisusedFunction("expected x and points (x, y) sorted by x")
    if x <= points[0][0]:
        return float(points[0][1])
    for (x0, y0), (x1, y1) in pairwise(points):
        if x <= x1:
            return float(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
    return float(points[-1][1])


def _one_of(values: Sequence[Value]) -> Value:
    """Return whether a text equals one of the texts or matches one of the patterns."""
    texts = [first_item(value) for value in values]
    if len(texts) < 2 or not all(isinstance(one, str) for one in texts):
        raise MisusedFunction("expected texts or patterns")
    text, *others = map(str, texts)
    kinds = values[1:]
    return any(
        matches(text, one) if isinstance(kind, Pattern) else text == one
        for one, kind in zip(others, kinds, strict=True)
    )


FUNCTIONS: Final[Mapping[str, _Function]] = {
    "min": _of_numbers(1, 1000, _least_or_most(min)),
    "max": _of_numbers(1, 1000, _least_or_most(max)),
    "abs": _of_numbers(1, 1, abs),
    "round": _of_numbers(1, 2, _rounded),
    "floor": _of_numbers(1, 1, to_whole),
    "ceil": _of_numbers(1, 1, lambda value: to_whole(value, up=True)),
    "int": _of_numbers(1, 1, _cut),
    "sqrt": _of_numbers(1, 1, _root),
    "digits": _of_numbers(2, 3, _digits(">")),
    "zdigits": _of_numbers(2, 3, _digits("0")),
    "fixed": _of_numbers(2, 2, lambda value, digits: f"{value:z.{_count(digits)}f}"),
    "padded": _of_numbers(2, 2, lambda value, digits: f"{_cut(value):0{_count(digits)}d}"),
    "random": _random,
    "interpolate_table": _interpolated,
    "text": _of_values(1, format_value),
    "size": _of_values(1, _size),
    "empty": _of_values(1, lambda value: _size(value) == 0),
    "is_nil": _of_values(1, lambda _: False),  # every setting has a value here
    "repeat": _repeated,
    "one_of": _one_of,
    "contains": _of_values(2, lambda text, part: part in text, str),
    "begins": _of_values(2, str.startswith, str),
    "ends": _of_values(2, str.endswith, str),
}
