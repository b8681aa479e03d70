"""Parse expressions of the macro language: PrusaSlicer's placeholder language with a few extensions.

Operators by precedence, lowest first:

condition ? yes : no
or  ||
and  &&
not  !
==  !=  <>  <  <=  >  >=  =~  !~     no chains; patterns are written between slashes
+  -
*  /  %
-  +                                 unary
name[index]  function(...)  (...)  (list, of, values)

Source: PrusaSlicer's documentation, "Macros", and its tests of the placeholder parser.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from printer_slicer.macros.values import MacroFault, Pattern, Scalar, check_range

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
"""Maximum number of tokens in an expression; it limits the depth of recursive functions."""
_DEEPEST: Final = 30
_MOST_SIGNS: Final = 10  # in front of one operand
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
        kind: `float`, `int`, `name`, `text`, `pattern`, `sign` (including keywords) or `end`.
        text: the token as written; for a text or pattern, without its quotes or slashes.
        at: start position.
        behind: end position.
    """

    kind: str
    text: str
    at: int
    behind: int


@dataclass(frozen=True, slots=True)
class Literal:
    """A literal value."""

    value: Scalar
    at: int


@dataclass(frozen=True, slots=True)
class Name:
    """A setting, a fact or a variable."""

    name: str
    at: int


@dataclass(frozen=True, slots=True)
class Unary:
    """A unary operator, `-` or `not`, and its operand."""

    sign: str
    one: Node
    at: int


@dataclass(frozen=True, slots=True)
class Binary:
    """A binary operator and its operands."""

    sign: str
    left: Node
    right: Node
    at: int


@dataclass(frozen=True, slots=True)
class Choice:
    """A conditional expression, `condition ? yes : no`."""

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
    """A literal list."""

    items: tuple[Node, ...]
    at: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function call."""

    name: str
    arguments: tuple[Node, ...]
    at: int


Node = Literal | Name | Unary | Binary | Choice | Index | Vector | Call


def names_in(node: Node) -> Iterator[Name | Call]:
    """Yield all names and function calls in a tree."""
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
    """Parse a text that is one expression, in which `=` compares.

    Raises:
        MacroFault: the text is not an expression.
    """
    reader = ExpressionReader(text, 0, equals="==")
    tree = reader.expression()
    if reader.next.kind != "end" or reader.next.behind < len(text):
        raise reader.unexpected("an operator")
    return tree


class ExpressionReader:
    """A recursive-descent parser that starts at a position of a text; `equals` is the meaning of `=`."""

    def __init__(self, text: str, at: int, *, equals: str = "=") -> None:
        self._text, self._same = text, {**_SAME, "=": equals}
        self._begin, self._depth, self._count = at, 0, 0
        self.next = self._token(at, value_wanted=True)

    def _token(self, at: int, *, value_wanted: bool) -> Token:
        """Read the token at a position; if a value is expected, a slash starts a pattern.

        Raises:
            MacroFault: an unexpected character, or an unterminated text.
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
        """Explain why there is no token here."""
        while self._text[at].isspace():
            at += 1
        if self._text[at] in "\"'":
            return MacroFault(at, "unterminated text", f"Close it with {self._text[at]}")
        return MacroFault(at, f"unexpected {self._text[at]!r}", "Write {{ and }} for literal braces")

    def accept(self, *texts: str) -> Token | None:
        """Read and return the next token if it is one of these operators or keywords."""
        token = self.next
        if token.kind != "sign" or token.text not in texts:
            return None
        self._read()
        return token

    def _read(self) -> Token:
        token = self.next
        self._count += 1
        if self._count > _MOST_TOKENS:
            raise MacroFault(
                self._begin, f"the expression has more than {_MOST_TOKENS} words", "Split it into several"
            )
        ends_value = token.kind != "sign" or token.text in (")", "]")
        self.next = self._token(token.behind, value_wanted=not ends_value)
        return token

    def accept_name(self) -> Token | None:
        """Read and return the next token if it is a name."""
        return self._read() if self.next.kind == "name" else None

    def expect(self, text: str) -> None:
        """Read a required operator or keyword."""
        if self.accept(text) is None:
            raise self.unexpected(text)

    def unexpected(self, wanted: str) -> MacroFault:
        """Return the fault of an unexpected token."""
        token = self.next
        if token.kind == "sign" and token.text == "=":
            return MacroFault(
                token.at, "= is not a comparison", "Write ==, or {local name = value} for a variable"
            )
        here = "the end of the expression" if token.kind == "end" else repr(token.text)
        return MacroFault(token.at, f"expected {wanted}, got {here}")

    def expression(self) -> Node:
        """Parse a whole expression.

        Raises:
            MacroFault: there is no valid expression.
        """
        self._begin, self._count = self.next.at, 0
        return self._choice()

    def _choice(self) -> Node:
        """Parse `condition ? yes : no`, or an expression of higher precedence."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise MacroFault(
                self.next.at, f"nested deeper than {_DEEPEST} levels", "Use a simpler expression"
            )
        tree = self._level(0)
        mark = self.accept("?")
        if mark is not None:
            yes = self._choice()
            self.expect(":")
            tree = Choice(tree, yes, self._choice(), mark.at)
        self._depth -= 1
        return tree

    def _level(self, height: int) -> Node:
        """Parse the operators of one level of precedence."""
        if height == len(_LEVELS):
            return self._signed(self._indexed, "-", "+")
        if height == _NOT:
            return self._signed(lambda: self._level(_COMPARING), "not")
        left = self._level(height + 1)
        while (sign := self.accept(*_LEVELS[height])) is not None:
            left = Binary(sign.text, left, self._level(height + 1), sign.at)
            if height == _COMPARING and self.next.text in _COMPARISONS and self.next.kind == "sign":
                raise MacroFault(
                    self.next.at, "chains of comparisons are not allowed", "Write a < b and b < c"
                )
        return left

    def _signed(self, what: Callable[[], Node], *texts: str) -> Node:
        """Parse any number of unary operators and their operand."""
        signs: list[Token] = []
        while (sign := self.accept(*texts)) is not None:
            signs.append(sign)
            if len(signs) > _MOST_SIGNS:
                raise MacroFault(sign.at, f"more than {_MOST_SIGNS} signs in front of a value")
        tree = what()
        for sign in reversed(signs):
            tree = tree if sign.text == "+" else Unary(sign.text, tree, sign.at)
        return tree

    def _indexed(self) -> Node:
        """Parse a value and its indices."""
        tree = self._atom()
        while (mark := self.accept("[")) is not None:
            tree = Index(tree, self._choice(), mark.at)
            self.expect("]")
        return tree

    def _atom(self) -> Node:
        """Parse a number, a text, a pattern, a name, a call, or an expression in parentheses."""
        token = self.next
        match token.kind:
            case "float":
                return Literal(check_range(float(self._read().text), token.at), token.at)
            case "int":
                value = int(token.text) if len(token.text) < 20 else float(token.text)
                self._read()
                return Literal(check_range(value, token.at), token.at)
            case "text":
                return Literal(self._read().text, token.at)
            case "pattern":
                return Literal(Pattern(self._read().text), token.at)
            case "name":
                return self._named(self._read())
        if self.accept("("):
            return self._parenthesised(token)
        raise self.unexpected("a value")

    def _parenthesised(self, token: Token) -> Node:
        """Parse the rest of an expression or list in parentheses."""
        items = self._rest(")")
        return items[0] if len(items) == 1 else Vector(tuple(items), token.at)

    def _rest(self, end: str) -> list[Node]:
        """Parse items separated by commas up to a closing sign."""
        items: list[Node] = []
        if not self.accept(end):
            items.append(self._choice())
            while self.accept(","):
                items.append(self._choice())
            self.expect(end)
        return items

    def _named(self, token: Token) -> Node:
        """Parse what starts with a name that was just read."""
        if token.text in ("true", "false"):
            return Literal(token.text == "true", token.at)
        if self.accept("("):
            return Call(token.text, tuple(self._rest(")")), token.at)
        return Name(token.text, token.at)
