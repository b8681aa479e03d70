"""Values of the macro language: whole numbers, fractions, booleans, texts, lists of these; and its errors."""

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
    "check_range",
    "describe_kind",
    "equal",
    "first_item",
    "format_value",
    "literal",
    "to_whole",
]

Scalar = int | float | bool | str
Value = Scalar | tuple[Scalar, ...]

NEARLY = 1e-9
"""Numbers closer than this are equal, so that 0.1 + 0.2 == 0.3 is true and int(0.6 / 0.2) is 3."""

MOST = 1e15
"""Maximum absolute value of numbers; floats beyond it cannot represent every whole number."""

MOST_TEXT = 10_000
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
    """An error at a position of a macro, in characters from its start."""

    def __init__(self, at: int, problem: str, remedy: str = "") -> None:
        super().__init__(problem)
        self.at, self.problem, self.remedy = at, problem, remedy


class UnknownName(MacroFault):
    """An unknown name in a macro."""

    def __init__(self, name: str, at: int, remedy: str) -> None:
        super().__init__(at, f"unknown placeholder {{{name}}}", remedy)
        self.name = name


def format_value(value: Value) -> str:
    """Format a value for G-code."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, Items):
        return format_value(first_item(value))
    if isinstance(value, tuple):
        return ", ".join(format_value(item) for item in value)
    return str(value) if isinstance(value, int) else number(value)


def literal(value: Value) -> str:
    """Format a value as a literal of the macro language."""
    if isinstance(value, tuple):
        return literal(value[0]) if len(value) == 1 else f"({', '.join(map(literal, value))})"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    return f"{value:.10f}".rstrip("0") if isinstance(value, float) else format_value(value)


def first_item(value: Value) -> Value:
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


def equal(one: float, other: float) -> bool:
    """Return whether two numbers are equal within rounding."""
    return abs(one - other) <= NEARLY


def to_whole(value: float, *, up: bool = False) -> int:
    """Round down, or up, to a whole number; a number within rounding of a whole number becomes that number."""
    return ceil(value - NEARLY) if up else floor(value + NEARLY)


def check_range(value: float, at: int) -> float:
    """Return a number after a check of its size.

    Raises:
        MacroFault: it is too large.
    """
    if not (isfinite(value) and abs(value) <= MOST):
        raise MacroFault(at, f"the result is larger than {MOST:g}")
    return value
