"""Values of other slicers' expressions where all that they speak of is known: which presets suit which printer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from math import isfinite
from typing import Final

from printer_slicer.importing.foreign import (
    Binary,
    Call,
    Choice,
    Literal,
    Name,
    Node,
    Unary,
    Unreadable,
    parse_foreign,
    words_of,
)
from printer_slicer.importing.ini import split_texts, unescaped
from printer_slicer.importing.presets import number_in
from printer_slicer.importing.vocabulary import ABOUT_FILES

__all__ = ["Plain", "holds", "known_setting", "matches", "value_of"]

Plain = float | int | str | bool
_LONGEST_PATTERN: Final = 10_000
"""characters"""
_MOST_STEPS: Final = 10_000_000
"""Limit of text length times pattern length; it corresponds to seconds in the worst case."""
_PATTERN_BYTES: Final = 1 << 23
"""Memory limit for a pattern; nested repetitions exceed it."""


def holds(condition: str, known: Mapping[str, str]) -> bool | None:
    """Whether a condition holds for these settings; None where that cannot be said.

    Args:
        condition: as `compatible_printers_condition` has it.
        known: settings as written.
    """
    with suppress(Unreadable, RecursionError):
        value = value_of(parse_foreign(words_of(condition)), known)
        if isinstance(value, bool):
            return value
        if isinstance(value, int):
            return value != 0
    return None


def value_of(node: Node, known: Mapping[str, str]) -> Plain:
    """The value of an expression.

    Args:
        node: its tree.
        known: settings as the source has them.

    Raises:
        Unreadable: it speaks of something that is not known, or makes no sense.
    """
    match node:
        case Literal():
            return node.value
        case Name():
            return known_setting(node.name, _index(node, known), known)
        case Unary(sign="not"):
            return not _truth(node.one, known)
        case Unary():
            return -_number(value_of(node.one, known))
        case Choice():
            return value_of(node.yes if _truth(node.condition, known) else node.no, known)
        case Binary(sign="and"):
            return _truth(node.left, known) and _truth(node.right, known)
        case Binary(sign="or"):
            return _truth(node.left, known) or _truth(node.right, known)
        case Binary():
            return _binary(node.sign, value_of(node.left, known), value_of(node.right, known))
        case Call():
            return _called(node.name, [_number(value_of(one, known)) for one in node.arguments])


def known_setting(name: str, index: int, known: Mapping[str, str]) -> Plain:
    """One item of a setting, as a number where it is one.

    Raises:
        Unreadable: the settings do not hold it.
    """
    if name == "num_extruders":
        return len(known.get("nozzle_diameter", "0").split(","))
    if name not in known:
        raise Unreadable(f"{name} is not known here")
    text = known[name]
    if ABOUT_FILES.fullmatch(name) or name.endswith("_gcode"):
        return unescaped(text)
    items = text.split(",") if ";" not in text else split_texts(text)
    word = items[index if index < len(items) else 0].strip().strip('"')
    found = number_in(word)
    if found is None:
        return word
    if found.percent:
        raise Unreadable(f"{name} is a percentage")
    return int(word) if re.fullmatch(r"-?\d{1,15}", word) else found.value


def _index(node: Name, known: Mapping[str, str]) -> int:
    if node.index is None:
        return 0
    if isinstance(node.index, Name) and node.index.name in (
        "initial_tool",
        "initial_extruder",
        "current_extruder",
    ):
        return 0
    value = value_of(node.index, known)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise Unreadable(f"{value!r} is no index")
    return value


def _truth(node: Node, known: Mapping[str, str]) -> bool:
    value = value_of(node, known)
    if isinstance(value, str) or value not in (0, 1):
        raise Unreadable(f"{value!r} is neither true nor false")
    return bool(value)


def _number(value: Plain) -> float | int:
    if isinstance(value, str):
        raise Unreadable(f"{value!r} is no number")
    return value


def _binary(sign: str, left: Plain, right: Plain) -> Plain:
    if sign in ("=~", "!~"):
        return matches(str(left), str(right)) == (sign == "=~")
    if sign == "+" and (isinstance(left, str) or isinstance(right, str)):
        return f"{left}{right}"
    if sign in ("==", "!="):
        return (left == right) == (sign == "==")
    first, second = _number(left), _number(right)
    if sign in ("<", "<=", ">", ">="):
        return {"<": first < second, "<=": first <= second, ">": first > second, ">=": first >= second}[sign]
    return _sum(sign, first, second)


def _sum(sign: str, first: float, second: float) -> float | int:
    """A sum; of whole numbers the quotient is one, too, cut towards zero."""
    if sign in ("/", "%") and second == 0:
        raise Unreadable("division by zero")
    whole = isinstance(first, int) and isinstance(second, int)
    quotient = int(first / second) if whole and second else 0
    result: float | int
    if sign == "/":
        result = quotient if whole else first / second
    elif sign == "%":
        result = first - second * quotient if whole else first % second
    else:
        result = {"+": first + second, "-": first - second, "*": first * second}[sign]
    if not isfinite(result) or abs(result) > 1e15:
        raise Unreadable("a number too large")
    return result


def _called(name: str, values: list[float | int]) -> Plain:
    if name in ("min", "max") and len(values) >= 2:
        chosen = min(values) if name == "min" else max(values)
        # Among fractions a whole number is a fraction, too, which matters to a division by it.
        return chosen if all(isinstance(one, int) for one in values) else float(chosen)
    if name == "int" and len(values) == 1:
        return int(values[0])
    if name == "round" and len(values) == 1:
        return int(abs(values[0]) + 0.5) * (1 if values[0] >= 0 else -1)
    raise Unreadable(f"{name}() has no counterpart")


def matches(text: str, pattern: str) -> bool:
    """Whether a pattern matches a whole text, in linear time.

    The patterns are untrusted, and Python's own engine can take exponential time. RE2 has Perl's syntax without
    lookaround and backreferences, which no vendor's bundle uses.

    Raises:
        Unreadable: the pattern cannot be read, or is too long, by itself or for the text.
    """
    import re2  # noqa: PLC0415 - few imports have a pattern

    if len(pattern) > _LONGEST_PATTERN:
        raise Unreadable(f"a pattern of {len(pattern)} characters; at most {_LONGEST_PATTERN} are allowed")
    if len(text) * len(pattern) > _MOST_STEPS:
        raise Unreadable(f"a pattern of {len(pattern)} characters on a text of {len(text)}")
    options = re2.Options()
    options.dot_nl, options.log_errors, options.max_mem = True, False, _PATTERN_BYTES
    try:
        return re2.compile(pattern, options).fullmatch(text) is not None  # type: ignore[no-untyped-call]
    except (re2.error, UnicodeEncodeError):
        raise Unreadable(f"the pattern /{pattern[:80]}/ is invalid") from None
