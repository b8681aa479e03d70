"""What expressions are about: numbers, yes or no, texts, lists of numbers or texts; and what can be wrong with them."""

from __future__ import annotations

from math import ceil, floor, isfinite

__all__ = ["MOST", "NEARLY", "Fault", "Value", "equal", "kept", "kind_of", "number", "text_of", "whole"]

Value = float | bool | str | tuple[float, ...] | tuple[str, ...]

NEARLY = 1e-9
"""Numbers closer than this are equal, so that 0.1 + 0.2 == 0.3 and int(0.6 / 0.2) is 3."""

MOST = 1e15
"""No number may be larger: beyond, not every whole number has a value of its own."""


class Fault(Exception):  # noqa: N818 - becomes a ProfileError once line and setting are known
    """Something wrong at a column (from 0) of a line."""

    def __init__(self, column: int, problem: str, remedy: str = "") -> None:
        super().__init__(problem)
        self.column, self.problem, self.remedy = column, problem, remedy


def number(value: float) -> str:
    """A number without needless zeros and without an exponent."""
    return f"{value:z.5f}".rstrip("0").rstrip(".")


def text_of(value: Value) -> str:
    """A value as it stands in G-code."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return ", ".join(text_of(item) for item in value)
    return number(value)


def kind_of(value: Value) -> str:
    """What people call this kind of value."""
    if isinstance(value, bool):
        return "yes or no"
    if isinstance(value, str):
        return "a text"
    return "a list" if isinstance(value, tuple) else "a number"


def equal(one: float, other: float) -> bool:
    """Whether two numbers are the same but for rounding."""
    return abs(one - other) <= NEARLY


def whole(value: float, *, up: bool = False) -> float:
    """The next whole number below, or above; a number that is nearly whole is that."""
    return float(ceil(value - NEARLY) if up else floor(value + NEARLY))


def kept(value: float, column: int) -> float:
    """A number that stayed within bounds.

    Raises:
        Fault: it is too large.
    """
    if not (isfinite(value) and abs(value) <= MOST):
        raise Fault(column, f"the result is beyond {MOST:g}")
    return value
