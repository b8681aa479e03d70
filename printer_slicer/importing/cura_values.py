"""Evaluate the expressions of Cura's definitions, a subset of Python, without executing them as code.

Source: Cura's documentation of definition files ("value", "resolve") and of the functions in them.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final

__all__ = ["CuraExpressionError", "evaluate_cura"]

_LONGEST: Final = 4000  # characters of an expression, or items of a list
_LARGEST: Final = 1e12  # absolute value of a number
_ARITHMETIC: Final[Mapping[type, Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
_COMPARISONS: Final[Mapping[type, Callable[[Any, Any], Any]]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda item, items: item in items,
    ast.NotIn: lambda item, items: item not in items,
}
_FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {
    "abs": abs,
    "all": all,
    "any": any,
    "bool": bool,
    "float": float,
    "int": int,
    "len": len,
    "max": max,
    "min": min,
    "round": round,
    "str": str,
    "sum": sum,
    "math.ceil": math.ceil,
    "math.floor": math.floor,
    "math.sqrt": math.sqrt,
    "math.tan": math.tan,
    "math.sin": math.sin,
    "math.cos": math.cos,
    "math.radians": math.radians,
    "math.log": math.log,
}


class CuraExpressionError(Exception):
    """An expression or setting in the definitions of Cura that cannot be evaluated."""


def evaluate_cura(text: str, setting: Callable[[str], Any]) -> Any:
    """Return the value of an expression: a number, a text, a boolean, or a list of these.

    Args:
        text: the expression.
        setting: function that returns the value of another setting.

    Raises:
        CuraExpressionError: it is not supported, or has no value.
    """
    if len(text) > _LONGEST:
        raise CuraExpressionError("the expression is too long")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _check_size(_Evaluation(setting).evaluate(tree.body))
    except (
        SyntaxError,
        ValueError,
        TypeError,
        ArithmeticError,
        LookupError,
        RecursionError,
        MemoryError,
    ) as error:
        raise CuraExpressionError(f"{text[:40]!r}: {error}") from None


def _check_size(value: Any) -> Any:
    """Return a value unchanged, or raise an error if it is too large or too long."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and not abs(value) < _LARGEST:
        raise CuraExpressionError("the number is too large")
    if isinstance(value, (str, list, tuple)) and len(value) > _LONGEST:
        raise CuraExpressionError("the value is too long")
    return value


class _Evaluation:
    """Evaluates a syntax tree; unknown kinds of nodes are errors."""

    def __init__(self, setting: Callable[[str], Any]) -> None:
        self._setting = setting

    def evaluate(self, node: ast.expr) -> Any:
        """Return the value of a node."""
        match node:
            case ast.Constant(value=bool() | int() | float() | str() as constant):
                return _check_size(constant)
            case ast.Name(id=name):
                return self._setting(name)
            case ast.List(elts=items) | ast.Tuple(elts=items):
                return [self.evaluate(item) for item in items]
            case ast.IfExp():
                return self.evaluate(node.body if self.evaluate(node.test) else node.orelse)
            case ast.Subscript():
                return self.evaluate(node.value)[self.evaluate(node.slice)]
            case ast.Attribute(value=ast.Name(id="math"), attr="pi"):
                return math.pi
        return self._evaluate_operation(node)

    def _evaluate_operation(self, node: ast.expr) -> Any:
        """Evaluate an operator or a function call."""
        match node:
            case ast.BoolOp():
                return self._evaluate_boolean(node)
            case ast.UnaryOp():
                return self._evaluate_unary(node)
            case ast.BinOp():
                return self._evaluate_binary(node)
            case ast.Compare():
                return self._evaluate_comparison(node)
            case ast.Call():
                return self._evaluate_call(node)
        raise CuraExpressionError(f"{type(node).__name__} is not supported")

    def _evaluate_boolean(self, node: ast.BoolOp) -> Any:
        """Return the first operand of `and` or `or` that decides the result."""
        value: Any = None
        for one in node.values:
            value = self.evaluate(one)
            if bool(value) != isinstance(node.op, ast.And):
                return value
        return value

    def _evaluate_unary(self, node: ast.UnaryOp) -> Any:
        """Evaluate `not`, a minus sign or a plus sign."""
        value = self.evaluate(node.operand)
        if isinstance(node.op, ast.Not):
            return not value
        if isinstance(node.op, ast.USub):
            return -value
        if isinstance(node.op, ast.UAdd):
            return +value
        raise CuraExpressionError("~ is not supported")

    def _evaluate_binary(self, node: ast.BinOp) -> Any:
        """Evaluate an arithmetic operator, with limits on the size of the result."""
        left, right = self.evaluate(node.left), self.evaluate(node.right)
        numeric = (int, float)
        if isinstance(node.op, ast.Pow) and isinstance(left, numeric) and isinstance(right, numeric):
            return (
                _check_size(float(left) ** float(right))
                if abs(right) <= 10
                else _raise_error("the power is too large")
            )
        function = _ARITHMETIC.get(type(node.op))
        if function is None or (
            isinstance(node.op, (ast.Mult, ast.Mod))
            and not (isinstance(left, numeric) and isinstance(right, numeric))
        ):
            raise CuraExpressionError(f"{type(node.op).__name__} is not supported")
        return _check_size(function(left, right))

    def _evaluate_comparison(self, node: ast.Compare) -> bool:
        """Evaluate a chain of comparisons."""
        left = self.evaluate(node.left)
        for sign, other in zip(node.ops, node.comparators, strict=True):
            right = self.evaluate(other)
            if type(sign) not in _COMPARISONS:
                raise CuraExpressionError(f"{type(sign).__name__} is not supported")
            if not _COMPARISONS[type(sign)](left, right):
                return False
            left = right
        return True

    def _evaluate_call(self, node: ast.Call) -> Any:
        """Call a function. The values of an extruder are those of the machine, because it has only one extruder."""
        name = node.func.id if isinstance(node.func, ast.Name) else ast.unparse(node.func)
        if node.keywords:
            raise CuraExpressionError(f"{name}(): keyword arguments are not supported")
        if name == "map" and len(node.args) == 2 and isinstance(node.args[0], ast.Name):
            function = _FUNCTIONS.get(node.args[0].id) or _raise_error(f"{node.args[0].id}() is unknown")
            return [function(one) for one in self.evaluate(node.args[1])]
        values = [self.evaluate(one) for one in node.args]
        if (
            name in ("resolveOrValue", "extruderValue", "valueFromContainer")
            and values
            and isinstance(values[-1], str)
        ):
            return self._setting(values[-1])
        if name in ("extruderValues", "anyExtruderWithMaterial") and values and isinstance(values[-1], str):
            return [self._setting(values[-1])]
        if name in ("defaultExtruderPosition", "anyExtruderNrWithOrDefault"):
            return 0
        if name not in _FUNCTIONS:
            raise CuraExpressionError(f"{name}() is unknown")
        return _FUNCTIONS[name](*values)


def _raise_error(problem: str) -> Any:
    """Raise a CuraExpressionError; for use inside expressions, which cannot contain `raise`."""
    raise CuraExpressionError(problem)
