"""Evaluate expressions of the macro language."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from math import fmod
from typing import Final

from printer_slicer.macros.functions import FUNCTIONS, MisusedFunction, matches
from printer_slicer.macros.names import FACTS, IN_LAYERS
from printer_slicer.macros.syntax import (
    Binary,
    Call,
    Choice,
    Index,
    Literal,
    Name,
    Node,
    Unary,
    Vector,
)
from printer_slicer.macros.values import (
    MOST_TEXT,
    NEARLY,
    Items,
    MacroFault,
    Pattern,
    UnknownName,
    Value,
    check_range,
    describe_kind,
    equal,
    first_item,
    format_value,
    to_whole,
)

__all__ = ["check_known", "evaluate", "is_true", "value_or_list"]
_ORDERS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "==": equal,
    "!=": lambda a, b: not equal(a, b),
    "<": lambda a, b: a < b - NEARLY,
    "<=": lambda a, b: a <= b + NEARLY,
    ">": lambda a, b: a > b + NEARLY,
    ">=": lambda a, b: a >= b - NEARLY,
}
_ORDERS_OF_TEXTS: Final[Mapping[str, Callable[[str, str], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_SUMS: Final[Mapping[str, Callable[[float, float], float]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}


def evaluate(node: Node, known: Mapping[str, Value]) -> Value:
    """Evaluate an expression; a vector gives its first item.

    Args:
        node: syntax tree of the expression.
        known: values by name.

    Raises:
        MacroFault: the expression has no value.
    """
    return first_item(value_or_list(node, known))


def value_or_list(node: Node, known: Mapping[str, Value]) -> Value:
    """Evaluate an expression; vectors stay vectors.

    Raises:
        MacroFault: the expression has no value.
    """
    match node:
        case Literal():
            return node.value
        case Name():
            return _value_of(node, known)
        case Unary():
            return _unary(node, known)
        case Choice():
            return value_or_list(node.yes if is_true(node.condition, known) else node.no, known)
        case Index():
            return _item(node, known)
        case Vector():
            return _vector([value_or_list(one, known) for one in node.items], node.at)
        case Call():
            return _call(node, known)
        case Binary():
            return _apply_binary(node, known)


def check_known(node: Name | Call, known: Collection[str]) -> None:
    """Check that a name or function exists.

    Raises:
        UnknownName: the name does not exist; the remedy suggests the most similar one.
        MacroFault: the function does not exist.
    """
    if isinstance(node, Call):
        _function(node)
    elif node.name not in known and node.name.rstrip("0123456789").removesuffix("_") not in known:
        near = get_close_matches(node.name, known, n=1)
        hint = f"Did you mean {{{near[0]}}}?" if near else _list_facts(known)
        raise UnknownName(node.name, node.at, hint)


def _list_facts(known: Collection[str]) -> str:
    """List the known facts, without the hundreds of settings."""
    facts = sorted((FACTS | IN_LAYERS).intersection(known)) or sorted(known)[:20]
    settings = any("." in name for name in known)
    return f"Choose one of: {', '.join(facts)}" + (
        ", and the settings that `printer-slicer profiles settings` lists" if settings else ""
    )


def _value_of(node: Name, known: Mapping[str, Value]) -> Value:
    """Return the value of a name; `temperature_0` is an item of a list, as in old macros."""
    check_known(node, known)
    if node.name in known:
        return known[node.name]
    base, _, index = node.name.rpartition("_")
    return _at(known[base], int(index[:9]), node.at)


def is_true(node: Node, known: Mapping[str, Value]) -> bool:
    """Evaluate a condition; 0 and 1 count as false and true, as in other slicers.

    Raises:
        MacroFault: the value is neither true nor false.
    """
    value = evaluate(node, known)
    if isinstance(value, bool) or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    raise MacroFault(node.at, f"{describe_kind(value)} is not a condition", "Compare it with another value")


def _number(node: Node, known: Mapping[str, Value]) -> float:
    value = evaluate(node, known)
    if isinstance(value, (bool, str, tuple)):
        raise MacroFault(node.at, f"expected a number, got {describe_kind(value)}")
    return value


def _unary(node: Unary, known: Mapping[str, Value]) -> Value:
    return not is_true(node.one, known) if node.sign == "not" else -_number(node.one, known)


def _apply_binary(node: Binary, known: Mapping[str, Value]) -> Value:
    """Apply a binary operator; `and` and `or` evaluate the second operand only if needed."""
    if node.sign in ("and", "or"):
        first = is_true(node.left, known)
        return is_true(node.right, known) if first == (node.sign == "and") else first
    left = evaluate(node.left, known)
    return (
        _matched(node, left)
        if node.sign in ("=~", "!~")
        else _binary(node, left, evaluate(node.right, known))
    )


def _matched(node: Binary, text: Value) -> bool:
    """Return whether a pattern matches a whole text."""
    pattern = evaluate(node.right, {}) if isinstance(node.right, Literal) else ""
    if not isinstance(pattern, Pattern):
        raise MacroFault(node.right.at, "expected a pattern", "Write it between slashes: =~ /.*PETG.*/")
    if not isinstance(text, str):
        raise MacroFault(node.at, f"cannot apply {node.sign} to {describe_kind(text)} and a pattern")
    try:
        return matches(text, pattern) == (node.sign == "=~")
    except MisusedFunction as error:
        raise MacroFault(node.right.at, str(error)) from None


def _binary(node: Binary, left: Value, right: Value) -> Value:
    """Compare, calculate, or join texts."""
    sign, texts = node.sign, [isinstance(left, str), isinstance(right, str)]
    if any(texts) and sign == "+":
        return _limit_length(format_value(left) + format_value(right), node.at)
    if isinstance(left, str) and isinstance(right, str) and sign in _ORDERS_OF_TEXTS:
        return _ORDERS_OF_TEXTS[sign](left, right)
    if isinstance(left, bool) and isinstance(right, bool) and sign in ("==", "!="):
        return (left == right) == (sign == "==")
    if isinstance(left, (bool, str, tuple)) or isinstance(right, (bool, str, tuple)):
        raise MacroFault(node.at, f"cannot apply {sign} to {describe_kind(left)} and {describe_kind(right)}")
    if sign in _ORDERS:
        return _ORDERS[sign](left, right)
    if sign in _SUMS:
        return check_range(_SUMS[sign](left, right), node.at)
    if right == 0:
        raise MacroFault(
            node.at, "division by zero", f"Guard it with a condition: {{b == 0 ? 0 : a {sign} b}}"
        )
    return check_range(_divide(left, right) if sign == "/" else _remainder(left, right), node.at)


def _divide(left: float, right: float) -> float:
    """Divide; two whole numbers give a whole number, rounded towards zero."""
    if isinstance(left, int) and isinstance(right, int):
        return (abs(left) // abs(right)) * (1 if (left < 0) == (right < 0) else -1)
    return left / right


def _remainder(left: float, right: float) -> float:
    """Return the remainder with the sign of `left`; 0 if it is 0 within rounding."""
    if isinstance(left, int) and isinstance(right, int):
        return left - right * int(_divide(left, right))
    rest = fmod(left, right)
    return 0.0 if equal(rest, 0) or equal(abs(rest), abs(right)) else rest


def _limit_length(text: str, at: int) -> str:
    if len(text) > MOST_TEXT:
        raise MacroFault(at, f"the text is longer than {MOST_TEXT} characters")
    return text


def _vector(items: Sequence[Value], at: int) -> Items:
    """Make a vector of values."""
    items = [one[0] if isinstance(one, tuple) and len(one) == 1 else one for one in items]
    if len(items) > MOST_TEXT or any(isinstance(one, tuple) for one in items):
        raise MacroFault(at, f"a list can hold up to {MOST_TEXT} numbers or texts, and no lists")
    return Items(items)  # type: ignore[arg-type]


def _item(node: Index, known: Mapping[str, Value]) -> Value:
    values, index = value_or_list(node.of, known), _number(node.index, known)
    if not isinstance(values, tuple):
        raise MacroFault(node.at, f"{describe_kind(values)} has no items")
    if not equal(index, to_whole(index)):
        raise MacroFault(node.index.at, f"{index:g} is not a valid list index", "Use a whole number")
    return _at(values, to_whole(index), node.index.at)


def _at(values: Value, index: int, at: int) -> Value:
    """Return an item of a list; for an index beyond the end of a vector, its first item."""
    values = values if isinstance(values, tuple) else (values,)
    if isinstance(values, Items) and values and index >= 0:
        return values[index if index < len(values) else 0]
    if not 0 <= index < len(values):
        raise MacroFault(at, f"no item {index} in a list of {len(values)}; items count from 0")
    return values[index]


def _call(node: Call, known: Mapping[str, Value]) -> Value:
    function = _function(node)
    values = [value_or_list(one, known) for one in node.arguments]
    if node.name == "random":  # the same print gives the same numbers: position and layer are the seed
        values.append(f"{node.at} {known.get('layer_num', 0)}")
    try:
        value = function(values)
    except MisusedFunction as error:
        raise MacroFault(node.at, f"{node.name}(): {error}") from None
    if isinstance(value, str):
        return _limit_length(value, node.at)
    return value if isinstance(value, (bool, tuple)) else check_range(value, node.at)


def _function(node: Call) -> Callable[[Sequence[Value]], Value]:
    """Return the called function."""
    function = FUNCTIONS.get(node.name)
    if function is None:
        near = get_close_matches(node.name, FUNCTIONS, n=1)
        hint = f"Did you mean {near[0]}()?" if near else f"Choose one of: {', '.join(sorted(FUNCTIONS))}"
        raise MacroFault(node.at, f"unknown function {node.name}()", hint)
    return function
