"""The value of a tree."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Final

from printer_slicer.macros.expressions import Binary, Call, Choice, Index, Literal, Name, Node, Unary
from printer_slicer.macros.functions import FUNCTIONS, Misused
from printer_slicer.macros.values import NEARLY, Fault, Value, equal, kept, kind_of, whole

__all__ = ["check_known", "evaluate", "is_true"]
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
    """The value of an expression.

    Args:
        node: its tree.
        known: what names stand for.

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
            chosen = node.yes if is_true(node.condition, known) else node.no
            return evaluate(chosen, known)
        case Index():
            return _item(node, known)
        case Call():
            return _called(node, known)
        case Binary() if node.sign in ("and", "or"):
            first = is_true(node.left, known)
            return is_true(node.right, known) if first == (node.sign == "and") else first
        case Binary():
            return _binary(node, evaluate(node.left, known), evaluate(node.right, known))


def check_known(node: Name | Call, known: Collection[str]) -> None:
    """Check that a name or function exists.

    Raises:
        Fault: it does not; the remedy offers the nearest name.
    """
    if isinstance(node, Call):
        _function(node)
    elif node.name not in known:
        near = get_close_matches(node.name, known, n=1)
        hint = f"did you mean {{{near[0]}}}?" if near else _listed(known)
        raise Fault(node.column, f"unknown placeholder {{{node.name}}}", hint)


def _listed(known: Collection[str]) -> str:
    """List the known names; settings, which also have a name with a section, are hundreds and left out."""
    settings = {name.rpartition(".")[2] for name in known if "." in name}
    facts = ", ".join(sorted(name for name in known if "." not in name and name not in settings))
    return f"known: {facts}" + (", and what `printer-slicer profiles settings` lists" if settings else "")


def _value_of(node: Name, known: Mapping[str, Value]) -> Value:
    """What a name stands for."""
    check_known(node, known)
    return known[node.name]


def is_true(node: Node, known: Mapping[str, Value]) -> bool:
    """The value of a condition.

    Raises:
        Fault: it is neither true nor false.
    """
    value = evaluate(node, known)
    if isinstance(value, bool):
        return value
    raise Fault(node.column, f"{kind_of(value)} is no condition", "compare it with something")


def _number(node: Node, known: Mapping[str, Value]) -> float:
    value = evaluate(node, known)
    if isinstance(value, (bool, str, tuple)):
        raise Fault(node.column, f"a number was expected, this is {kind_of(value)}")
    return value


def _unary(node: Unary, known: Mapping[str, Value]) -> Value:
    if node.sign == "not":
        return not is_true(node.one, known)
    value = _number(node.one, known)
    return -value if node.sign == "-" else value


def _binary(node: Binary, left: Value, right: Value) -> Value:
    """A comparison, a sum, or texts one after the other."""
    sign = node.sign
    if isinstance(left, str) and isinstance(right, str):
        if sign == "+":
            return left + right
        if sign in _ORDERS_OF_TEXTS:
            return _ORDERS_OF_TEXTS[sign](left, right)
    if isinstance(left, bool) and isinstance(right, bool) and sign in ("==", "!="):
        return (left == right) == (sign == "==")
    if isinstance(left, (bool, str, tuple)) or isinstance(right, (bool, str, tuple)):
        both = f"{kind_of(left)} {sign} {kind_of(right)}"
        either = isinstance(left, str) or isinstance(right, str)
        raise Fault(node.column, f"{both} makes no sense", "text(x) is a number as text" if either else "")
    if sign in _ORDERS:
        return _ORDERS[sign](left, right)
    if sign in _SUMS:
        return kept(_SUMS[sign](left, right), node.column)
    if right == 0:
        raise Fault(node.column, "division by zero", f"guard it: {{b == 0 ? 0 : a {sign} b}}")
    return kept(left / right if sign == "/" else _remainder(left, right), node.column)


def _remainder(left: float, right: float) -> float:
    """What is left of `left` after whole `right`s, with the sign of `right`; nothing where it is nearly nothing."""
    rest = left % right
    return 0.0 if equal(rest, 0) or equal(rest, right) else rest


def _item(node: Index, known: Mapping[str, Value]) -> Value:
    values, at = evaluate(node.of, known), _number(node.at, known)
    if not isinstance(values, tuple):
        raise Fault(node.column, f"{kind_of(values)} has no items")
    if not equal(at, whole(at)):
        raise Fault(node.at.column, f"{at:g} is no place in a list", "take a whole number")
    if not 0 <= whole(at) < len(values):
        raise Fault(
            node.at.column, f"there is no item {whole(at):g} in a list of {len(values)}, counted from 0"
        )
    return values[int(whole(at))]


def _called(node: Call, known: Mapping[str, Value]) -> Value:
    function = _function(node)
    try:
        value = function([evaluate(one, known) for one in node.arguments])
    except Misused as error:
        raise Fault(node.column, f"{node.name}(): {error}") from None
    return value if isinstance(value, (bool, str, tuple)) else kept(value, node.column)


def _function(node: Call) -> Callable[[Sequence[Value]], Value]:
    """The function that is called."""
    function = FUNCTIONS.get(node.name)
    if function is None:
        near = get_close_matches(node.name, FUNCTIONS, n=1)
        hint = f"did you mean {near[0]}()?" if near else f"known: {', '.join(sorted(FUNCTIONS))}"
        raise Fault(node.column, f"unknown function {node.name}()", hint)
    return function
