"""The value of a tree."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from math import fmod
from typing import Final

from printer_slicer.macros.functions import FUNCTIONS, Misused, matches
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
    equal,
    kept,
    kind_of,
    one_of_items,
    text_of,
    whole,
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
    """The value of an expression; of a vector its first item.

    Args:
        node: its tree.
        known: what names stand for.

    Raises:
        Fault: it has none.
    """
    return one_of_items(value_or_list(node, known))


def value_or_list(node: Node, known: Mapping[str, Value]) -> Value:
    """The value of an expression, vectors as they are.

    Raises:
        Fault: it has none.
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
            return _called(node, known)
        case Binary():
            return _joined(node, known)


def check_known(node: Name | Call, known: Collection[str]) -> None:
    """Check that a name or function exists.

    Raises:
        UnknownName: the name does not; the remedy offers the nearest.
        Fault: the function does not.
    """
    if isinstance(node, Call):
        _function(node)
    elif node.name not in known and node.name.rstrip("0123456789").removesuffix("_") not in known:
        near = get_close_matches(node.name, known, n=1)
        hint = f"did you mean {{{near[0]}}}?" if near else _listed(known)
        raise UnknownName(node.name, node.at, hint)


def _listed(known: Collection[str]) -> str:
    """List the known facts; settings are hundreds and left out."""
    facts = sorted((FACTS | IN_LAYERS).intersection(known)) or sorted(known)[:20]
    settings = any("." in name for name in known)
    return f"known: {', '.join(facts)}" + (
        ", and what `printer-slicer profiles settings` lists" if settings else ""
    )


def _value_of(node: Name, known: Mapping[str, Value]) -> Value:
    """What a name stands for; `temperature_0` is an item, as old macros write it."""
    check_known(node, known)
    if node.name in known:
        return known[node.name]
    base, _, index = node.name.rpartition("_")
    return _at(known[base], int(index[:9]), node.at)


def is_true(node: Node, known: Mapping[str, Value]) -> bool:
    """The value of a condition; 0 and 1 are switches of other slicers.

    Raises:
        Fault: it is neither true nor false.
    """
    value = evaluate(node, known)
    if isinstance(value, bool) or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    raise MacroFault(node.at, f"{kind_of(value)} is no condition", "compare it with something")


def _number(node: Node, known: Mapping[str, Value]) -> float:
    value = evaluate(node, known)
    if isinstance(value, (bool, str, tuple)):
        raise MacroFault(node.at, f"a number was expected, this is {kind_of(value)}")
    return value


def _unary(node: Unary, known: Mapping[str, Value]) -> Value:
    return not is_true(node.one, known) if node.sign == "not" else -_number(node.one, known)


def _joined(node: Binary, known: Mapping[str, Value]) -> Value:
    """What a sign makes of two things; of `and` and `or` the second is only looked at where it decides."""
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
    """Whether a pattern matches a whole text."""
    pattern = evaluate(node.right, {}) if isinstance(node.right, Literal) else ""
    if not isinstance(pattern, Pattern):
        raise MacroFault(node.right.at, "a pattern was expected", "write it between slashes: =~ /.*PETG.*/")
    if not isinstance(text, str):
        raise MacroFault(node.at, f"{kind_of(text)} {node.sign} a pattern makes no sense")
    try:
        return matches(text, pattern) == (node.sign == "=~")
    except Misused as error:
        raise MacroFault(node.right.at, str(error)) from None


def _binary(node: Binary, left: Value, right: Value) -> Value:
    """A comparison, a sum, or texts one after the other."""
    sign, texts = node.sign, [isinstance(left, str), isinstance(right, str)]
    if any(texts) and sign == "+":
        return _limited(text_of(left) + text_of(right), node.at)
    if isinstance(left, str) and isinstance(right, str) and sign in _ORDERS_OF_TEXTS:
        return _ORDERS_OF_TEXTS[sign](left, right)
    if isinstance(left, bool) and isinstance(right, bool) and sign in ("==", "!="):
        return (left == right) == (sign == "==")
    if isinstance(left, (bool, str, tuple)) or isinstance(right, (bool, str, tuple)):
        raise MacroFault(node.at, f"{kind_of(left)} {sign} {kind_of(right)} makes no sense")
    if sign in _ORDERS:
        return _ORDERS[sign](left, right)
    if sign in _SUMS:
        return kept(_SUMS[sign](left, right), node.at)
    if right == 0:
        raise MacroFault(node.at, "division by zero", f"guard it: {{b == 0 ? 0 : a {sign} b}}")
    return kept(_divided(left, right) if sign == "/" else _remainder(left, right), node.at)


def _divided(left: float, right: float) -> float:
    """The quotient; whole numbers divide to a whole number, towards zero."""
    if isinstance(left, int) and isinstance(right, int):
        return (abs(left) // abs(right)) * (1 if (left < 0) == (right < 0) else -1)
    return left / right


def _remainder(left: float, right: float) -> float:
    """What is left of `left` after whole `right`s, with the sign of `left`; nothing where it is nearly nothing."""
    if isinstance(left, int) and isinstance(right, int):
        return left - right * int(_divided(left, right))
    rest = fmod(left, right)
    return 0.0 if equal(rest, 0) or equal(abs(rest), abs(right)) else rest


def _limited(text: str, at: int) -> str:
    if len(text) > MOST_TEXT:
        raise MacroFault(at, f"a text of more than {MOST_TEXT} characters")
    return text


def _vector(items: Sequence[Value], at: int) -> Items:
    """A vector of values."""
    items = [one[0] if isinstance(one, tuple) and len(one) == 1 else one for one in items]
    if len(items) > MOST_TEXT or any(isinstance(one, tuple) for one in items):
        raise MacroFault(at, f"a list holds up to {MOST_TEXT} numbers or texts, and no lists")
    return Items(items)  # type: ignore[arg-type]


def _item(node: Index, known: Mapping[str, Value]) -> Value:
    values, index = value_or_list(node.of, known), _number(node.index, known)
    if not isinstance(values, tuple):
        raise MacroFault(node.at, f"{kind_of(values)} has no items")
    if not equal(index, whole(index)):
        raise MacroFault(node.index.at, f"{index:g} is no place in a list", "take a whole number")
    return _at(values, whole(index), node.index.at)


def _at(values: Value, index: int, at: int) -> Value:
    """An item; of a vector the first, where it has not so many."""
    values = values if isinstance(values, tuple) else (values,)
    if isinstance(values, Items) and values and index >= 0:
        return values[index if index < len(values) else 0]
    if not 0 <= index < len(values):
        raise MacroFault(at, f"there is no item {index} in a list of {len(values)}, counted from 0")
    return values[index]


def _called(node: Call, known: Mapping[str, Value]) -> Value:
    function = _function(node)
    values = [value_or_list(one, known) for one in node.arguments]
    if node.name == "random":  # a print is the same each time: chance hangs on the place and the layer
        values.append(f"{node.at} {known.get('layer_num', 0)}")
    try:
        value = function(values)
    except Misused as error:
        raise MacroFault(node.at, f"{node.name}(): {error}") from None
    if isinstance(value, str):
        return _limited(value, node.at)
    return value if isinstance(value, (bool, tuple)) else kept(value, node.at)


def _function(node: Call) -> Callable[[Sequence[Value]], Value]:
    """The function that is called."""
    function = FUNCTIONS.get(node.name)
    if function is None:
        near = get_close_matches(node.name, FUNCTIONS, n=1)
        hint = f"did you mean {near[0]}()?" if near else f"known: {', '.join(sorted(FUNCTIONS))}"
        raise MacroFault(node.at, f"unknown function {node.name}()", hint)
    return function
