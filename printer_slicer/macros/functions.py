"""Functions of the macro language; each one takes a list of values, which may be vectors, and returns one value."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import copysign, sqrt
from typing import Final

from printer_slicer.macros.values import (
    LONGEST_TEXT,
    TOLERANCE,
    Items,
    Pattern,
    Value,
    describe_kind,
    format_value,
    get_first_item,
    is_equal,
    round_to_whole,
)

__all__ = ["FUNCTIONS", "MisusedFunction", "matches"]

_Function = Callable[[Sequence[Value]], Value]
_MAX_DIGITS: Final = 20  # decimals
_WIDEST: Final = 100  # characters of a formatted number
_LONGEST_PATTERN: Final = 10_000  # characters
_MAX_STEPS: Final = 10_000_000
"""Limit of text length times pattern length; a match at this limit takes seconds in the worst case."""
_PATTERN_BYTES: Final = 1 << 23
"""Memory limit for a pattern; nested repetitions exceed it."""


class MisusedFunction(Exception):  # noqa: N818 - becomes a MacroFault once its position is known
    """Raised when a function is called with invalid arguments."""


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
    if len(text) * len(pattern) > _MAX_STEPS:
        raise MisusedFunction(f"a pattern of {len(pattern)} characters is too long for a text of {len(text)}")
    options = re2.Options()
    options.dot_nl, options.log_errors, options.max_mem = True, False, _PATTERN_BYTES
    try:
        return re2.compile(str(pattern), options).fullmatch(text) is not None  # type: ignore[no-untyped-call]
    except (re2.error, UnicodeEncodeError):
        raise MisusedFunction(f"the pattern /{pattern[:80]}/ is invalid") from None


def _flatten_numbers(values: Sequence[Value]) -> list[float]:
    """Convert arguments, given one by one or as one list, to a list of numbers."""
    flat: Sequence[Value] = values
    if len(values) == 1 and isinstance(values[0], tuple):
        flat = values[0]
    numbers: list[float] = []
    for value in map(get_first_item, flat):
        if isinstance(value, (bool, str, tuple)):
            raise MisusedFunction(f"expected a number, got {describe_kind(value)}")
        numbers.append(value)
    return numbers


def _wrap_number_function(least: int, most: int, function: Callable[..., Value]) -> _Function:
    """Wrap a function of `least` to `most` numbers, so that it takes and checks a list of values."""

    def run(values: Sequence[Value]) -> Value:
        """Check the arguments and call the function."""
        numbers = _flatten_numbers(values)
        if not least <= len(numbers) <= most:
            wanted = f"{least}" if least == most else f"{least} or more" if most > 3 else f"{least} or {most}"
            raise MisusedFunction(f"expected {wanted} arguments, got {len(numbers)}")
        return function(*numbers)

    return run


def _wrap_value_function(count: int, function: Callable[..., Value], kinds: type = object) -> _Function:
    """Wrap a function of `count` values of one type, so that it takes and checks a list of values."""

    def run(values: Sequence[Value]) -> Value:
        """Check the arguments and call the function."""
        if len(values) != count:
            raise MisusedFunction(f"expected {count} arguments, got {len(values)}")
        values = [get_first_item(one) for one in values] if kinds is str else values
        for value in values:
            if not isinstance(value, kinds):
                raise MisusedFunction(f"expected a text, got {describe_kind(value)}")
        return function(*values)

    return run


def _wrap_min_or_max(choose: Callable[[tuple[float, ...]], float]) -> Callable[..., Value]:
    """Wrap `min` or `max`: the result is a whole number only if all values are, which matters for divisions."""

    def run(*values: float) -> float:
        """Return the smallest or largest value."""
        found = choose(values)
        return found if all(isinstance(one, int) for one in values) else float(found)

    return run


def _round(value: float, digits: float | None = None) -> float:
    """Round to a number of decimals; halves are rounded away from zero."""
    scale = 10.0 ** _check_digit_count(digits or 0)
    found = copysign(round_to_whole(abs(value) * scale + 0.5) / scale, value)
    return int(found) if digits is None else found


def _check_digit_count(digits: float, most: int = _MAX_DIGITS) -> int:
    """Return a number of digits as an integer, or raise an error if it is not valid."""
    if not is_equal(digits, round_to_whole(digits)) or not 0 <= digits <= most:
        raise MisusedFunction(f"{digits:g} is not a valid number of digits; use 0 to {most}")
    return round_to_whole(digits)


def _make_number_formatter(fill: str) -> Callable[..., str]:
    """Return a function that formats a number with a width and a number of decimals."""
    return lambda value, width, decimals=0: (
        f"{value:{fill}{_check_digit_count(width, _WIDEST)}.{_check_digit_count(decimals)}f}"
    )


def _compute_square_root(value: float) -> float:
    """Return the square root of a number that is not negative."""
    if value < -TOLERANCE:
        raise MisusedFunction(f"{value:g} has no square root")
    return sqrt(max(value, 0.0))


def _get_size(value: Value) -> int:
    """Return the number of characters of a text, or of items of a list."""
    if not isinstance(value, (str, tuple)):
        raise MisusedFunction(f"{describe_kind(value)} has no size")
    return len(value)


def _truncate(value: float) -> int:
    """Round to a whole number towards zero."""
    return round_to_whole(value, up=value < 0)


def _choose_random_number(values: Sequence[Value]) -> Value:
    """Return a random number from the first to the second argument, both included; the third one is the seed."""
    *limits, seed = values
    numbers = _flatten_numbers(limits)
    if len(numbers) != 2 or numbers[0] > numbers[1]:
        raise MisusedFunction("expected the smallest and the largest number")
    low, high = numbers
    from hashlib import sha256  # noqa: PLC0415 - few macros use random numbers

    share = int.from_bytes(sha256(f"{low} {high} {seed}".encode()).digest()[:6], "big") / 2**48
    if isinstance(low, int) and isinstance(high, int):
        return low + int(share * (high - low + 1))
    return low + share * (high - low)


def _repeat(values: Sequence[Value]) -> Value:
    """Return a list with a value repeated; the arguments are the count and the value."""
    count, value = map(get_first_item, values) if len(values) == 2 else ("", "")
    if isinstance(count, (bool, str, tuple)) or not 0 <= count <= LONGEST_TEXT or isinstance(value, tuple):
        raise MisusedFunction(f"expected a count of at most {LONGEST_TEXT} and a value")
    return Items([value] * int(count))


def _interpolate(values: Sequence[Value]) -> Value:
    """Interpolate a table of points (x, y) at x; beyond its ends, return the first or last y."""
    points = [_flatten_numbers([one]) for one in values[1:]]
    x = _flatten_numbers([get_first_item(values[0])])[0] if values else 0.0
    if not points or any(len(one) != 2 for one in points) or any(a[0] >= b[0] for a, b in pairwise(points)):
        raise MisusedFunction("expected x and points (x, y) sorted by x")
    if x <= points[0][0]:
        return float(points[0][1])
    for (x0, y0), (x1, y1) in pairwise(points):
        if x <= x1:
            return float(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
    return float(points[-1][1])


def _matches_any(values: Sequence[Value]) -> Value:
    """Return whether a text equals one of the texts or matches one of the patterns."""
    texts = [get_first_item(value) for value in values]
    if len(texts) < 2 or not all(isinstance(one, str) for one in texts):
        raise MisusedFunction("expected texts or patterns")
    text, *others = map(str, texts)
    kinds = values[1:]
    return any(
        matches(text, one) if isinstance(kind, Pattern) else text == one
        for one, kind in zip(others, kinds, strict=True)
    )


FUNCTIONS: Final[Mapping[str, _Function]] = {
    "min": _wrap_number_function(1, 1000, _wrap_min_or_max(min)),
    "max": _wrap_number_function(1, 1000, _wrap_min_or_max(max)),
    "abs": _wrap_number_function(1, 1, abs),
    "round": _wrap_number_function(1, 2, _round),
    "floor": _wrap_number_function(1, 1, round_to_whole),
    "ceil": _wrap_number_function(1, 1, lambda value: round_to_whole(value, up=True)),
    "int": _wrap_number_function(1, 1, _truncate),
    "sqrt": _wrap_number_function(1, 1, _compute_square_root),
    "digits": _wrap_number_function(2, 3, _make_number_formatter(">")),
    "zdigits": _wrap_number_function(2, 3, _make_number_formatter("0")),
    "fixed": _wrap_number_function(2, 2, lambda value, digits: f"{value:z.{_check_digit_count(digits)}f}"),
    "padded": _wrap_number_function(
        2, 2, lambda value, digits: f"{_truncate(value):0{_check_digit_count(digits)}d}"
    ),
    "random": _choose_random_number,
    "interpolate_table": _interpolate,
    "text": _wrap_value_function(1, format_value),
    "size": _wrap_value_function(1, _get_size),
    "empty": _wrap_value_function(1, lambda value: _get_size(value) == 0),
    "is_nil": _wrap_value_function(1, lambda _: False),  # every setting has a value here
    "repeat": _repeat,
    "one_of": _matches_any,
    "contains": _wrap_value_function(2, lambda text, part: part in text, str),
    "begins": _wrap_value_function(2, str.startswith, str),
    "ends": _wrap_value_function(2, str.endswith, str),
}
