"""Expressions of the macro language: text -> tokens -> trees. PrusaSlicer's placeholder language and a little more.

Binding, from loose to tight:

condition ? yes : no
or  ||
and  &&
not  !
==  !=  <>  <  <=  >  >=  =~  !~     one of them, not in a chain; a pattern stands between slashes
+  -
*  /  %
-  +                                 in front
name[index]  function(...)  (...)  (list, of, values)

Source: PrusaSlicer's documentation, "Macros", and its tests of the placeholder parser.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from printer_slicer.macros.values import MacroFault, Pattern, Scalar, kept

__all__ = [
    "Binary",
    "Call",
    "Choice",
    "ExpressionReader",
    "Index",
    "Literal",
    "Name",
    "Node",
    "Token",
    "Unary",
    "Vector",
    "names_in",
    "parse_expression",
]

_MOST_TOKENS: Final = 200
"""In one expression: what is read and evaluated by functions that call themselves stays shallow."""
_DEEPEST: Final = 30
_MOST_SIGNS: Final = 10  # in front of one thing
_COMPARISONS: Final = ("==", "!=", "<", "<=", ">", ">=", "=~", "!~")
_LEVELS: Final = (("or",), ("and",), ("not",), _COMPARISONS, ("+", "-"), ("*", "/", "%"))
_NOT, _COMPARING = 2, 3
_TOKEN: Final = re.compile(
    r"""\s*(?:
        (?P<float> [0-9]+\.[0-9]*(?:[eE][-+]?[0-9]+)? | \.[0-9]+(?:[eE][-+]?[0-9]+)? | [0-9]+[eE][-+]?[0-9]+ )
      | (?P<int> [0-9]+ )
      | (?P<name> [A-Za-z_] \w* (?: \.\w+ )* )
      | (?P<text> "(?:[^"\\]|\\.)*" | '(?:[^'\\]|\\.)*' )
      | (?P<sign> =~ | !~ | <> | <= | >= | == | != | && | \|\| | [-+*/%<>=!()\[\],?:;] )
      | (?P<end> \} | \Z )
    )""",
    re.VERBOSE | re.ASCII | re.DOTALL,
)
_PATTERN: Final = re.compile(r"\s*/((?:[^/\\\n]|\\.)*)/")
_ESCAPE: Final = re.compile(r"\\(.)", re.DOTALL)
_SAME: Final = {"&&": "and", "||": "or", "!": "not", "<>": "!=", "elseif": "elsif", "elif": "elsif"}
_WORDS: Final = frozenset(
    {"and", "or", "not", "if", "elsif", "elseif", "elif", "else", "endif", "then", "local", "global"}
)


class Token(NamedTuple):
    """One token.

    Attributes:
        kind: `float`, `int`, `name`, `text`, `pattern`, `sign` (words of the language, too) or `end`.
        text: as written; of a text or pattern what is between its marks.
        at: where it begins.
        behind: where it ends.
    """

    kind: str
    text: str
    at: int
    behind: int


@dataclass(frozen=True, slots=True)
class Literal:
    """A value as it is written."""

    value: Scalar
    at: int


@dataclass(frozen=True, slots=True)
class Name:
    """A setting, a fact or a variable."""

    name: str
    at: int


@dataclass(frozen=True, slots=True)
class Unary:
    """`-` or `not` in front of something."""

    sign: str
    one: Node
    at: int


@dataclass(frozen=True, slots=True)
class Binary:
    """A sign between two things."""

    sign: str
    left: Node
    right: Node
    at: int


@dataclass(frozen=True, slots=True)
class Choice:
    """One of two things."""

    condition: Node
    yes: Node
    no: Node
    at: int


@dataclass(frozen=True, slots=True)
class Index:
    """One item of a list, counted from 0."""

    of: Node
    index: Node
    at: int


@dataclass(frozen=True, slots=True)
class Vector:
    """A list as it is written."""

    items: tuple[Node, ...]
    at: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function of some things."""

    name: str
    arguments: tuple[Node, ...]
    at: int


Node = Literal | Name | Unary | Binary | Choice | Index | Vector | Call


def names_in(node: Node) -> Iterator[Name | Call]:
    """All names and calls of functions in a tree."""
    inner: tuple[Node, ...] = ()
    match node:
        case Name() | Call():
            yield node
            inner = node.arguments if isinstance(node, Call) else ()
        case Unary():
            inner = (node.one,)
        case Binary():
            inner = (node.left, node.right)
        case Choice():
            inner = (node.condition, node.yes, node.no)
        case Index():
            inner = (node.of, node.index)
        case Vector():
            inner = node.items
    for one in inner:
        yield from names_in(one)


def parse_expression(text: str) -> Node:
    """The tree of a text that is one expression, in which `=` compares.

    Raises:
        Fault: it is none.
    """
    reader = ExpressionReader(text, 0, equals="==")
    tree = reader.expression()
    if reader.next.kind != "end" or reader.next.behind < len(text):
        raise reader.unexpected("an operator")
    return tree


class ExpressionReader:
    """Reads expressions from a place on, by descending through the levels of binding; `equals` is what `=` means."""

    def __init__(self, text: str, at: int, *, equals: str = "=") -> None:
        self._text, self._same = text, {**_SAME, "=": equals}
        self._begin, self._depth, self._count = at, 0, 0
        self.next = self._token(at, value_wanted=True)

    def _token(self, at: int, *, value_wanted: bool) -> Token:
        """The token from here on; where a value is wanted a slash begins a pattern.

        Raises:
            Fault: a character that means nothing, or a text that does not end.
        """
        found = _PATTERN.match(self._text, at) if value_wanted else None
        if found:
            return Token("pattern", found[1], found.end() - len(found[0].lstrip()), found.end())
        match = _TOKEN.match(self._text, at)
        if match is None:
            raise self._misread(at)
        kind = match.lastgroup or ""
        text, begin = match[kind], match.start(kind)
        if kind == "end" and not text:
            begin = len(self._text)
        if kind == "text":
            text = _ESCAPE.sub(lambda one: "\n" if one[1] == "n" else one[1], text[1:-1])
        elif text in _WORDS or kind == "sign":
            kind, text = "sign", self._same.get(text, text)
        return Token(kind, text, begin, match.end())

    def _misread(self, at: int) -> MacroFault:
        """Why no token begins here."""
        while self._text[at].isspace():
            at += 1
        if self._text[at] in "\"'":
            return MacroFault(at, "a text that does not end", f"close it with {self._text[at]}")
        return MacroFault(
            at, f"{self._text[at]!r} means nothing here", "write {{ and }} for braces themselves"
        )

    def taken(self, *texts: str) -> Token | None:
        """The next token, read, if it is one of these signs or words."""
        token = self.next
        if token.kind != "sign" or token.text not in texts:
            return None
        self._read()
        return token

    def _read(self) -> Token:
        token = self.next
        self._count += 1
        if self._count > _MOST_TOKENS:
            raise MacroFault(self._begin, f"an expression of more than {_MOST_TOKENS} words", "use several")
        ends_value = token.kind != "sign" or token.text in (")", "]")
        self.next = self._token(token.behind, value_wanted=not ends_value)
        return token

    def taken_name(self) -> Token | None:
        """The next token, read, if it is a name."""
        return self._read() if self.next.kind == "name" else None

    def expect(self, text: str) -> None:
        """Read a sign that must be there."""
        if self.taken(text) is None:
            raise self.unexpected(text)

    def unexpected(self, wanted: str) -> MacroFault:
        """What is wrong where something else had to stand."""
        token = self.next
        if token.kind == "sign" and token.text == "=":
            return MacroFault(
                token.at, "= is no comparison", "write ==, or {local name = value} for a variable"
            )
        here = "the end of the expression" if token.kind == "end" else repr(token.text)
        return MacroFault(token.at, f"{here} where {wanted} was expected")

    def expression(self) -> Node:
        """A whole expression.

        Raises:
            Fault: there is none.
        """
        self._begin, self._count = self.next.at, 0
        return self._choice()

    def _choice(self) -> Node:
        """`condition ? yes : no`, or anything that binds tighter."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise MacroFault(self.next.at, f"nested deeper than {_DEEPEST} times", "use a simpler expression")
        tree = self._level(0)
        mark = self.taken("?")
        if mark is not None:
            yes = self._choice()
            self.expect(":")
            tree = Choice(tree, yes, self._choice(), mark.at)
        self._depth -= 1
        return tree

    def _level(self, height: int) -> Node:
        """What the signs of one level, or of tighter ones, hold together."""
        if height == len(_LEVELS):
            return self._signed(self._indexed, "-", "+")
        if height == _NOT:
            return self._signed(lambda: self._level(_COMPARING), "not")
        left = self._level(height + 1)
        while (sign := self.taken(*_LEVELS[height])) is not None:
            left = Binary(sign.text, left, self._level(height + 1), sign.at)
            if height == _COMPARING and self.next.text in _COMPARISONS and self.next.kind == "sign":
                raise MacroFault(self.next.at, "comparisons do not make chains", "write a < b and b < c")
        return left

    def _signed(self, what: Callable[[], Node], *texts: str) -> Node:
        """Any number of these signs, then what stands behind them."""
        signs: list[Token] = []
        while (sign := self.taken(*texts)) is not None:
            signs.append(sign)
            if len(signs) > _MOST_SIGNS:
                raise MacroFault(sign.at, f"more than {_MOST_SIGNS} signs in front of one thing")
        tree = what()
        for sign in reversed(signs):
            tree = tree if sign.text == "+" else Unary(sign.text, tree, sign.at)
        return tree

    def _indexed(self) -> Node:
        """Something and the indices behind it."""
        tree = self._atom()
        while (mark := self.taken("[")) is not None:
            tree = Index(tree, self._choice(), mark.at)
            self.expect("]")
        return tree

    def _atom(self) -> Node:
        """A number, a text, a pattern, a name, a call, or something in parentheses."""
        token = self.next
        match token.kind:
            case "float":
                return Literal(kept(float(self._read().text), token.at), token.at)
            case "int":
                value = int(token.text) if len(token.text) < 20 else float(token.text)
                self._read()
                return Literal(kept(value, token.at), token.at)
            case "text":
                return Literal(self._read().text, token.at)
            case "pattern":
                return Literal(Pattern(self._read().text), token.at)
            case "name":
                return self._named(self._read())
        if self.taken("("):
            return self._parenthesised(token)
        raise self.unexpected("a value")

    def _parenthesised(self, token: Token) -> Node:
        """What follows a parenthesis: one thing, or a list."""
        items = self._rest(")")
        return items[0] if len(items) == 1 else Vector(tuple(items), token.at)

    def _rest(self, end: str) -> list[Node]:
        """Things between commas up to a sign."""
        items: list[Node] = []
        if not self.taken(end):
            items.append(self._choice())
            while self.taken(","):
                items.append(self._choice())
            self.expect(end)
        return items

    def _named(self, token: Token) -> Node:
        """What begins with a name that was just read."""
        if token.text in ("true", "false"):
            return Literal(token.text == "true", token.at)
        if self.taken("("):
            return Call(token.text, tuple(self._rest(")")), token.at)
        return Name(token.text, token.at)
