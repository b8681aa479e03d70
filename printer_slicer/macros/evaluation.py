"""Evaluate expressions of the macro language."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from math import fmod
from typing import Final

from printer_slicer.macros.functions import FUNCTIONS, MisusedFunction, matches
from printer_slicer.macros.names import FACTS, LAYER_FACTS
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
    LONGEST_TEXT,
    TOLERANCE,
    Items,
    MacroFault,
    Pattern,
    UnknownName,
    Value,
    check_range,
    describe_kind,
    format_value,
    get_first_item,
    is_equal,
    round_to_whole,
)
from printer_slicer.texts import find_similar_words

__all__ = ["check_name_exists", "evaluate", "evaluate_with_vectors", "is_true"]
_COMPARISONS: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "==": is_equal,
    "!=": lambda a, b: not is_equal(a, b),
    "<": lambda a, b: a < b - TOLERANCE,
    "<=": lambda a, b: a <= b + TOLERANCE,
    ">": lambda a, b: a > b + TOLERANCE,
    ">=": lambda a, b: a >= b - TOLERANCE,
}
_TEXT_COMPARISONS: Final[Mapping[str, Callable[[str, str], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_ARITHMETIC: Final[Mapping[str, Callable[[float, float], float]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}


def evaluate(node: Node, known: Mapping[str, Value]) -> Value:
    """Return the value of an expression; for a vector, its first item.

    Args:
        node: syntax tree of the expression.
        known: values by name.

    Raises:
        MacroFault: the expression has no value.
    """
    return get_first_item(evaluate_with_vectors(node, known))


def evaluate_with_vectors(node: Node, known: Mapping[str, Value]) -> Value:
    """Return the value of an expression, which may be a vector.

    Raises:
        MacroFault: the expression has no value.
    """
    match node:
        case Literal():
            return node.value
        case Name():
            return _look_up_name(node, known)
        case Unary():
            return _apply_unary(node, known)
        case Choice():
            return evaluate_with_vectors(node.yes if is_true(node.condition, known) else node.no, known)
        case Index():
            return _evaluate_index(node, known)
        case Vector():
            return _make_vector([evaluate_with_vectors(one, known) for one in node.items], node.position)
        case Call():
            return _call_function(node, known)
        case Binary():
            return _apply_binary(node, known)


def check_name_exists(node: Name | Call, known: Collection[str]) -> None:
    """Check that a name or function exists.

    Raises:
        UnknownName: the name does not exist; the remedy suggests the most similar one.
        MacroFault: the function does not exist.
    """
    if isinstance(node, Call):
        _find_function(node)
    elif node.name not in known and node.name.rstrip("0123456789").removesuffix("_") not in known:
        near = find_similar_words(node.name, known, most=1)
        hint = f"Did you mean {{{near[0]}}}?" if near else _suggest_facts(known)
        raise UnknownName(node.name, node.position, hint)


def _suggest_facts(known: Collection[str]) -> str:
    """Return a remedy that lists the known facts, and names the command that lists the hundreds of settings."""
    facts = sorted((FACTS | LAYER_FACTS).intersection(known)) or sorted(known)[:20]
    settings = any("." in name for name in known)
    return f"Choose one of: {', '.join(facts)}" + (
        ", or a setting that `ps.find_settings()` lists" if settings else ""
    )


def _look_up_name(node: Name, known: Mapping[str, Value]) -> Value:
    """Return the value of a name; `temperature_0` means item 0 of a list, as in old macros."""
    check_name_exists(node, known)
    if node.name in known:
        return known[node.name]
    base, _, index = node.name.rpartition("_")
    return _select_item(known[base], int(index[:9]), node.position)


def is_true(node: Node, known: Mapping[str, Value]) -> bool:
    """Evaluate a condition; 0 and 1 count as false and true, as in other slicers.

    Raises:
        MacroFault: the value is neither true nor false.
    """
    value = evaluate(node, known)
    if isinstance(value, bool) or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    raise MacroFault(
        node.position, f"{describe_kind(value)} is not a condition", "Compare it with another value"
    )


def _evaluate_number(node: Node, known: Mapping[str, Value]) -> float:
    """Return the value of an expression that must be a number."""
    value = evaluate(node, known)
    if isinstance(value, (bool, str, tuple)):
        raise MacroFault(node.position, f"expected a number, got {describe_kind(value)}")
    return value


def _apply_unary(node: Unary, known: Mapping[str, Value]) -> Value:
    """Apply `not` or a minus sign."""
    return not is_true(node.operand, known) if node.sign == "not" else -_evaluate_number(node.operand, known)


def _apply_binary(node: Binary, known: Mapping[str, Value]) -> Value:
    """Apply a binary operator; `and` and `or` evaluate the second operand only if it is needed."""
    if node.sign in ("and", "or"):
        first = is_true(node.left, known)
        return is_true(node.right, known) if first == (node.sign == "and") else first
    left = evaluate(node.left, known)
    return (
        _match_pattern(node, left)
        if node.sign in ("=~", "!~")
        else _combine_values(node, left, evaluate(node.right, known))
    )


def _match_pattern(node: Binary, text: Value) -> bool:
    """Apply `=~` or `!~`: return whether a pattern matches, or does not match, a whole text."""
    pattern = evaluate(node.right, {}) if isinstance(node.right, Literal) else ""
    if not isinstance(pattern, Pattern):
        raise MacroFault(node.right.position, "expected a pattern", "Write it between slashes: =~ /.*PETG.*/")
    if not isinstance(text, str):
        raise MacroFault(node.position, f"cannot apply {node.sign} to {describe_kind(text)} and a pattern")
    try:
        return matches(text, pattern) == (node.sign == "=~")
    except MisusedFunction as error:
        raise MacroFault(node.right.position, str(error)) from None


def _combine_values(node: Binary, left: Value, right: Value) -> Value:
    """Compare, calculate with or join two values."""
    sign, texts = node.sign, [isinstance(left, str), isinstance(right, str)]
    if any(texts) and sign == "+":
        return _check_length(format_value(left) + format_value(right), node.position)
    if isinstance(left, str) and isinstance(right, str) and sign in _TEXT_COMPARISONS:
        return _TEXT_COMPARISONS[sign](left, right)
    if isinstance(left, bool) and isinstance(right, bool) and sign in ("==", "!="):
        return (left == right) == (sign == "==")
    if isinstance(left, (bool, str, tuple)) or isinstance(right, (bool, str, tuple)):
        raise MacroFault(
            node.position, f"cannot apply {sign} to {describe_kind(left)} and {describe_kind(right)}"
        )
    if sign in _COMPARISONS:
        return _COMPARISONS[sign](left, right)
    if sign in _ARITHMETIC:
        return check_range(_ARITHMETIC[sign](left, right), node.position)
    if right == 0:
        raise MacroFault(
            node.position, "division by zero", f"Guard it with a condition: {{b == 0 ? 0 : a {sign} b}}"
        )
    return check_range(
        _divide(left, right) if sign == "/" else _compute_remainder(left, right), node.position
    )


def _divide(left: float, right: float) -> float:
    """Divide; two whole numbers give a whole number, rounded towards zero."""
    if isinstance(left, int) and isinstance(right, int):
        return (abs(left) // abs(right)) * (1 if (left < 0) == (right < 0) else -1)
    return left / right


def _compute_remainder(left: float, right: float) -> float:
    """Return the remainder of a division, with the sign of `left`; 0 if it is 0 within rounding errors."""
    if isinstance(left, int) and isinstance(right, int):
        return left - right * int(_divide(left, right))
    rest = fmod(left, right)
    return 0.0 if is_equal(rest, 0) or is_equal(abs(rest), abs(right)) else rest


def _check_length(text: str, position: int) -> str:
    """Return a text unchanged, or raise an error if it is too long."""
    if len(text) > LONGEST_TEXT:
        raise MacroFault(position, f"the text is longer than {LONGEST_TEXT} characters")
    return text


def _make_vector(items: Sequence[Value], position: int) -> Items:
    """Make a vector from values; vectors of one item count as their item."""
    items = [one[0] if isinstance(one, tuple) and len(one) == 1 else one for one in items]
    if len(items) > LONGEST_TEXT or any(isinstance(one, tuple) for one in items):
        raise MacroFault(position, f"a list can hold up to {LONGEST_TEXT} numbers or texts, but no lists")
    return Items(items)  # type: ignore[arg-type]


def _evaluate_index(node: Index, known: Mapping[str, Value]) -> Value:
    """Return the list item that an index expression selects."""
    values, index = evaluate_with_vectors(node.container, known), _evaluate_number(node.index, known)
    if not isinstance(values, tuple):
        raise MacroFault(node.position, f"{describe_kind(values)} has no items")
    if not is_equal(index, round_to_whole(index)):
        raise MacroFault(node.index.position, f"{index:g} is not a valid list index", "Use a whole number")
    return _select_item(values, round_to_whole(index), node.index.position)


def _select_item(values: Value, index: int, position: int) -> Value:
    """Return an item of a list; an index beyond the end of a vector gives its first item."""
    values = values if isinstance(values, tuple) else (values,)
    if isinstance(values, Items) and values and index >= 0:
        return values[index if index < len(values) else 0]
    if not 0 <= index < len(values):
        raise MacroFault(position, f"no item {index} in a list of {len(values)}; the first item is item 0")
    return values[index]


def _call_function(node: Call, known: Mapping[str, Value]) -> Value:
    """Evaluate the arguments of a call, and return the result of the function."""
    function = _find_function(node)
    values = [evaluate_with_vectors(one, known) for one in node.arguments]
    if node.name == "random":  # the same print gives the same numbers: position and layer are the seed
        values.append(f"{node.position} {known.get('layer_num', 0)}")
    try:
        value = function(values)
    except MisusedFunction as error:
        raise MacroFault(node.position, f"{node.name}(): {error}") from None
    if isinstance(value, str):
        return _check_length(value, node.position)
    return value if isinstance(value, (bool, tuple)) else check_range(value, node.position)


def _find_function(node: Call) -> Callable[[Sequence[Value]], Value]:
    """Return the function that a call names.

    Raises:
        MacroFault: the function does not exist.
    """
    function = FUNCTIONS.get(node.name)
    if function is None:
        near = find_similar_words(node.name, FUNCTIONS, most=1)
        hint = f"Did you mean {near[0]}()?" if near else f"Choose one of: {', '.join(sorted(FUNCTIONS))}"
        raise MacroFault(node.position, f"unknown function {node.name}()", hint)
    return function
