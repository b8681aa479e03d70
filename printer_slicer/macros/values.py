"""Values of the macro language (whole numbers, fractions, booleans, texts and lists of these), and its errors."""

from __future__ import annotations

from math import ceil, floor, isfinite

from printer_slicer.texts import format_number

__all__ = [
    "LARGEST_NUMBER",
    "LONGEST_TEXT",
    "TOLERANCE",
    "Items",
    "MacroFault",
    "Pattern",
    "Scalar",
    "UnknownName",
    "Value",
    "check_range",
    "describe_kind",
    "format_literal",
    "format_value",
    "get_first_item",
    "is_equal",
    "round_to_whole",
]

Scalar = int | float | bool | str
Value = Scalar | tuple[Scalar, ...]

TOLERANCE = 1e-9
"""Numbers that differ by less than this are equal, so that 0.1 + 0.2 == 0.3 is true and int(0.6 / 0.2) is 3."""

LARGEST_NUMBER = 1e15
"""Maximum absolute value of numbers; floats beyond it cannot represent every whole number."""

LONGEST_TEXT = 10_000
"""Maximum number of characters in a text and of items in a list."""


class Items(tuple[Scalar, ...]):
    """A vector as in PrusaSlicer, with one item per extruder.

    Its first item is used where a single value is expected, and for an index beyond its end.
    """

    __slots__ = ()


class Pattern(str):
    """A regular expression, as written between slashes."""

    __slots__ = ()


class MacroFault(Exception):  # noqa: N818 - becomes a ProfileError once line and setting are known
    """An error in a macro; its position is the number of characters before it."""

    def __init__(self, position: int, problem: str, remedy: str = "") -> None:
        super().__init__(problem)
        self.position, self.problem, self.remedy = position, problem, remedy


class UnknownName(MacroFault):
    """An unknown name in a macro."""

    def __init__(self, name: str, position: int, remedy: str) -> None:
        super().__init__(position, f"unknown placeholder {{{name}}}", remedy)
        self.name = name


def format_value(value: Value) -> str:
    """Format a value for G-code."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, Items):
        return format_value(get_first_item(value))
    if isinstance(value, tuple):
        return ", ".join(format_value(item) for item in value)
    return str(value) if isinstance(value, int) else format_number(value)


def format_literal(value: Value) -> str:
    """Format a value as a literal of the macro language."""
    if isinstance(value, tuple):
        return format_literal(value[0]) if len(value) == 1 else f"({', '.join(map(format_literal, value))})"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    return f"{value:.10f}".rstrip("0") if isinstance(value, float) else format_value(value)


def get_first_item(value: Value) -> Value:
    """Return a single value: the first item of a vector, or an empty text if the vector is empty."""
    if isinstance(value, Items):
        return value[0] if value else ""
    return value


def describe_kind(value: Value) -> str:
    """Describe the type of a value for messages."""
    if isinstance(value, bool):
        return "a boolean"
    if isinstance(value, str):
        return "a text"
    return "a list" if isinstance(value, tuple) else "a number"


def is_equal(one: float, other: float) -> bool:
    """Return whether two numbers are equal within rounding errors."""
    return abs(one - other) <= TOLERANCE


def round_to_whole(value: float, *, up: bool = False) -> int:
    """Round down, or up, to a whole number; a number that is almost a whole number becomes that number."""
    return ceil(value - TOLERANCE) if up else floor(value + TOLERANCE)


def check_range(value: float, position: int) -> float:
    """Return a number unchanged after checking that it is not too large.

    Raises:
        MacroFault: it is too large.
    """
    if not (isfinite(value) and abs(value) <= LARGEST_NUMBER):
        raise MacroFault(position, f"the result is larger than {LARGEST_NUMBER:g}")
    return value
