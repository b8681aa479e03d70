"""Values of expressions: whole numbers, fractions, true and false, texts, lists of these; and what can be wrong."""

from __future__ import annotations

from math import ceil, floor, isfinite

from printer_slicer.texts import number

__all__ = [
    "MOST",
    "MOST_TEXT",
    "NEARLY",
    "Items",
    "MacroFault",
    "Pattern",
    "Scalar",
    "UnknownName",
    "Value",
    "equal",
    "kept",
    "kind_of",
    "literal",
    "one_of_items",
    "text_of",
    "whole",
]

Scalar = int | float | bool | str
Value = Scalar | tuple[Scalar, ...]

NEARLY = 1e-9
"""Numbers closer than this are equal, so that 0.1 + 0.2 == 0.3 and int(0.6 / 0.2) is 3."""

MOST = 1e15
"""No number may be larger: beyond, not every whole number has a value of its own."""

MOST_TEXT = 10_000
"""Characters of a text, and items of a list, that an expression may make."""


class Items(tuple[Scalar, ...]):
    """A vector as PrusaSlicer has them, one item per extruder.

    Where a single value is wanted it stands for its first item, and so does an index behind its end.
    """

    __slots__ = ()


class Pattern(str):
    """A regular expression, as it stands between slashes."""

    __slots__ = ()


class MacroFault(Exception):  # noqa: N818 - becomes a ProfileError once line and setting are known
    """Something wrong at a place (characters from the begin) of a macro."""

    def __init__(self, at: int, problem: str, remedy: str = "") -> None:
        super().__init__(problem)
        self.at, self.problem, self.remedy = at, problem, remedy


class UnknownName(MacroFault):
    """A name that stands for nothing."""

    def __init__(self, name: str, at: int, remedy: str) -> None:
        super().__init__(at, f"unknown placeholder {{{name}}}", remedy)
        self.name = name


def text_of(value: Value) -> str:
    """A value as it stands in G-code."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, Items):
        return text_of(one_of_items(value))
    if isinstance(value, tuple):
        return ", ".join(text_of(item) for item in value)
    return str(value) if isinstance(value, int) else number(value)


def literal(value: Value) -> str:
    """A value as it is written in an expression."""
    if isinstance(value, tuple):
        return literal(value[0]) if len(value) == 1 else f"({', '.join(map(literal, value))})"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    return f"{value:.10f}".rstrip("0") if isinstance(value, float) else text_of(value)


def one_of_items(value: Value) -> Value:
    """What stands where a single value is wanted: the first item of a vector, an empty text if it has none."""
    if isinstance(value, Items):
        return value[0] if value else ""
    return value


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


def whole(value: float, *, up: bool = False) -> int:
    """The next whole number below, or above; a number that is nearly whole is that."""
    return ceil(value - NEARLY) if up else floor(value + NEARLY)


def kept(value: float, at: int) -> float:
    """A number that stayed within bounds.

    Raises:
        Fault: it is too large.
    """
    if not (isfinite(value) and abs(value) <= MOST):
        raise MacroFault(at, f"the result is beyond {MOST:g}")
    return value
