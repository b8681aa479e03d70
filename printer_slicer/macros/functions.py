"""The functions of expressions: one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import copysign, sqrt
from typing import Final

from printer_slicer.macros.values import NEARLY, Value, equal, kind_of, text_of, whole

__all__ = ["FUNCTIONS", "Misused"]

_Function = Callable[[Sequence[Value]], Value]
_MOST_DIGITS = 20


class Misused(Exception):  # noqa: N818 - becomes a fault of the expression once its column is known
    """A function that cannot work with what it is given."""


def _numbers(values: Sequence[Value]) -> list[float]:
    """Numbers, given one by one or as a list of them."""
    flat = values[0] if len(values) == 1 and isinstance(values[0], tuple) else values
    numbers = [value for value in flat if not isinstance(value, (bool, str, tuple))]
    if len(numbers) < len(flat):
        wrong = next(value for value in flat if isinstance(value, (bool, str, tuple)))
        raise Misused(f"a number was expected, this is {kind_of(wrong)}")
    return numbers


def _of_numbers(least: int, most: int, function: Callable[..., Value]) -> _Function:
    """A function of so many numbers."""

    def run(values: Sequence[Value]) -> Value:
        """The function of these values."""
        numbers = _numbers(values)
        if not least <= len(numbers) <= most:
            wanted = f"{least}" if least == most else f"{least} or more" if most > 2 else f"{least} or {most}"
            raise Misused(f"takes {wanted}, got {len(numbers)}")
        return function(*numbers)

    return run


def _of_one(function: Callable[[Value], Value]) -> _Function:
    """A function of one value of any kind."""

    def run(values: Sequence[Value]) -> Value:
        """The function of this value."""
        if len(values) != 1:
            raise Misused(f"takes 1, got {len(values)}")
        return function(values[0])

    return run


def _rounded(value: float, digits: float = 0) -> float:
    """The nearest number with so many decimals; of two the one farther from zero."""
    scale = 10.0 ** _count(digits)
    return copysign(whole(abs(value) * scale + 0.5) / scale, value)


def _count(digits: float) -> int:
    if not equal(digits, whole(digits)) or not 0 <= digits <= _MOST_DIGITS:
        raise Misused(f"{digits:g} is no number of digits; take 0 to {_MOST_DIGITS}")
    return int(whole(digits))


def _root(value: float) -> float:
    if value < -NEARLY:
        raise Misused(f"{value:g} has no square root")
    return sqrt(max(value, 0.0))


def _size(value: Value) -> float:
    if not isinstance(value, (str, tuple)):
        raise Misused(f"{kind_of(value)} has no size")
    return float(len(value))


def _of_texts(function: Callable[[str, str], bool]) -> _Function:
    """A function of two texts."""

    def run(values: Sequence[Value]) -> Value:
        """The function of these values."""
        if len(values) != 2:
            raise Misused(f"takes 2, got {len(values)}")
        text, part = values
        if not isinstance(text, str) or not isinstance(part, str):
            wrong = part if isinstance(text, str) else text
            raise Misused(f"a text was expected, this is {kind_of(wrong)}")
        return function(text, part)

    return run


def _cut(value: float) -> float:
    """The whole number next towards zero."""
    return whole(value, up=value < 0)


FUNCTIONS: Final[Mapping[str, _Function]] = {
    "min": _of_numbers(1, 1000, lambda *values: min(values)),
    "max": _of_numbers(1, 1000, lambda *values: max(values)),
    "abs": _of_numbers(1, 1, abs),
    "round": _of_numbers(1, 2, _rounded),
    "floor": _of_numbers(1, 1, whole),
    "ceil": _of_numbers(1, 1, lambda value: whole(value, up=True)),
    "int": _of_numbers(1, 1, _cut),
    "sqrt": _of_numbers(1, 1, _root),
    "fixed": _of_numbers(2, 2, lambda value, digits: f"{value:z.{_count(digits)}f}"),
    "padded": _of_numbers(2, 2, lambda value, digits: f"{_cut(value):0{_count(digits)}.0f}"),
    "text": _of_one(text_of),
    "size": _of_one(_size),
    "contains": _of_texts(lambda text, part: part in text),
    "begins": _of_texts(str.startswith),
    "ends": _of_texts(str.endswith),
}
