"""Tokens -> a tree.

Binding, from loose to tight:

condition ? yes : no
or
and
not
== != < <= > >=         one of them, not in a chain
+ -
* / %
- (in front)
name[index]  function(...)  (...)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from printer_slicer.macros.tokens import Token
from printer_slicer.macros.values import Fault, Value, kept

__all__ = ["Binary", "Call", "Choice", "Index", "Literal", "Name", "Node", "Unary", "named_in", "parse"]

_DEEPEST: Final = 30
_MOST_SIGNS: Final = 10  # in front of one thing
_COMPARISONS: Final = ("==", "!=", "<", "<=", ">", ">=")
_LEVELS: Final = (("or",), ("and",), ("not",), _COMPARISONS, ("+", "-"), ("*", "/", "%"))
_NOT, _COMPARING = 2, 3


@dataclass(frozen=True, slots=True)
class Literal:
    """A value as it is written."""

    value: Value
    column: int


@dataclass(frozen=True, slots=True)
class Name:
    """A setting or a fact."""

    name: str
    column: int


@dataclass(frozen=True, slots=True)
class Unary:
    """`-` or `not` in front of something."""

    sign: str
    one: Node
    column: int


@dataclass(frozen=True, slots=True)
class Binary:
    """A sign between two things."""

    sign: str
    left: Node
    right: Node
    column: int


@dataclass(frozen=True, slots=True)
class Choice:
    """One of two things."""

    condition: Node
    yes: Node
    no: Node
    column: int


@dataclass(frozen=True, slots=True)
class Index:
    """One item of a list, counted from 0."""

    of: Node
    at: Node
    column: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function of some things."""

    name: str
    arguments: tuple[Node, ...]
    column: int


Node = Literal | Name | Unary | Binary | Choice | Index | Call


def named_in(node: Node) -> Iterator[Name | Call]:
    """All names and calls of functions in a tree."""
    match node:
        case Name():
            yield node
        case Unary():
            yield from named_in(node.one)
        case Binary():
            yield from named_in(node.left)
            yield from named_in(node.right)
        case Choice():
            for one in (node.condition, node.yes, node.no):
                yield from named_in(one)
        case Index():
            yield from named_in(node.of)
            yield from named_in(node.at)
        case Call():
            yield node
            for one in node.arguments:
                yield from named_in(one)


def parse(tokens: list[Token]) -> Node:
    """The tree of an expression whose last token ends it.

    Raises:
        Fault: it is no expression.
    """
    reader = _Reader(tokens)
    if reader.next.kind == "end":
        raise Fault(
            reader.next.column, "nothing between the braces", "write {name}, or {{}} for braces themselves"
        )
    tree = reader.choice()
    if reader.next.kind != "end":
        raise reader.unexpected("an operator or }")
    return tree


@dataclass(slots=True)
class _Reader:
    """Reads an expression by descending through the levels of binding."""

    tokens: list[Token]
    place: int = 0
    depth: int = 0

    @property
    def next(self) -> Token:
        """The token that is not read yet."""
        return self.tokens[self.place]

    def taken(self, *texts: str) -> Token | None:
        """The next token, read, if it is one of these signs."""
        token = self.next
        if token.kind != "sign" or token.text not in texts:
            return None
        self.place += 1
        return token

    def expect(self, text: str) -> None:
        """Read a sign that must be there."""
        if self.taken(text) is None:
            raise self.unexpected(text)

    def unexpected(self, wanted: str) -> Fault:
        """What is wrong where something else had to stand."""
        token = self.next
        here = "the end of the expression" if token.kind == "end" else repr(token.text)
        return Fault(token.column, f"{here} where {wanted} was expected")

    def choice(self) -> Node:
        """`condition ? yes : no`, or anything that binds tighter."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise Fault(self.next.column, f"nested deeper than {_DEEPEST} times", "use a simpler expression")
        tree = self.level(0)
        mark = self.taken("?")
        if mark is not None:
            yes = self.choice()
            self.expect(":")
            tree = Choice(tree, yes, self.choice(), mark.column)
        self.depth -= 1
        return tree

    def level(self, height: int) -> Node:
        """What the signs of one level, or of tighter ones, hold together."""
        if height == len(_LEVELS):
            return self.negated()
        if height == _NOT:
            return self.denied()
        left = self.level(height + 1)
        while (sign := self.taken(*_LEVELS[height])) is not None:
            left = Binary(sign.text, left, self.level(height + 1), sign.column)
            if height == _COMPARING and (second := self.taken(*_COMPARISONS)) is not None:
                raise Fault(second.column, "comparisons do not make chains", "write a < b and b < c")
        return left

    def signs(self, *texts: str) -> list[Token]:
        """All of these signs that stand here one after the other."""
        signs: list[Token] = []
        while (sign := self.taken(*texts)) is not None:
            signs.append(sign)
            if len(signs) > _MOST_SIGNS:
                raise Fault(sign.column, f"more than {_MOST_SIGNS} signs in front of one thing")
        return signs

    def denied(self) -> Node:
        """Any number of `not`, then a comparison."""
        signs = self.signs("not")
        tree = self.level(_COMPARING)
        for sign in reversed(signs):
            tree = Unary("not", tree, sign.column)
        return tree

    def negated(self) -> Node:
        """Any number of `-` or `+`, then what stands for itself."""
        signs = self.signs("-", "+")
        tree = self.indexed()
        for sign in reversed(signs):
            tree = Unary(sign.text, tree, sign.column)
        return tree

    def indexed(self) -> Node:
        """Something and the indices behind it."""
        tree = self.atom()
        while (mark := self.taken("[")) is not None:
            tree = Index(tree, self.choice(), mark.column)
            self.expect("]")
        return tree

    def atom(self) -> Node:
        """A number, a text, a name, a call, or something in parentheses."""
        token = self.next
        if token.kind == "number":
            self.place += 1
            return Literal(kept(float(token.text), token.column), token.column)
        if token.kind == "text":
            self.place += 1
            return Literal(token.text, token.column)
        if token.kind == "name":
            self.place += 1
            return self.named(token)
        if self.taken("("):
            tree = self.choice()
            self.expect(")")
            return tree
        raise self.unexpected("a value")

    def named(self, token: Token) -> Node:
        """What begins with a name that was just read."""
        if token.text in ("true", "false"):
            return Literal(token.text == "true", token.column)
        if not self.taken("("):
            return Name(token.text, token.column)
        arguments: list[Node] = []
        if not self.taken(")"):
            arguments.append(self.choice())
            while self.taken(","):
                arguments.append(self.choice())
            self.expect(")")
        return Call(token.text, tuple(arguments), token.column)
