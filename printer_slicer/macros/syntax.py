"""Parse expressions of the macro language: PrusaSlicer's placeholder language with a few extensions.

Operators by precedence, lowest first:

condition ? yes : no
or  ||
and  &&
not  !
==  !=  <>  <  <=  >  >=  =~  !~     one per expression (a < b < c is an error); patterns are written between slashes
+  -
*  /  %
-  +                                 unary
name[index]  function(...)  (...)  (list, of, values)

Source: PrusaSlicer's documentation, "Macros", and its tests of the placeholder parser.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from printer_slicer.macros.values import MacroFault, Pattern, Scalar, check_range
from printer_slicer.values import Struct

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
    "find_names",
    "parse_expression",
]

_MAX_TOKENS: Final = 200
"""Maximum number of tokens in an expression; it also limits the recursion of the parser."""
_DEEPEST: Final = 30  # levels of nested expressions
_MAX_SIGNS: Final = 10  # signs in front of one operand
_COMPARISONS: Final = ("==", "!=", "<", "<=", ">", ">=", "=~", "!~")
_PRECEDENCE: Final = (("or",), ("and",), ("not",), _COMPARISONS, ("+", "-"), ("*", "/", "%"))
_NOT_LEVEL, _COMPARISON_LEVEL = 2, 3
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
_SYNONYMS: Final = {"&&": "and", "||": "or", "!": "not", "<>": "!=", "elseif": "elsif", "elif": "elsif"}
_WORDS: Final = frozenset(
    {"and", "or", "not", "if", "elsif", "elseif", "elif", "else", "endif", "then", "local", "global"}
)


class Token(NamedTuple):
    """A token of an expression.

    Attributes:
        kind: `float`, `int`, `name`, `text`, `pattern`, `sign` (including keywords) or `end`.
        text: the token as written; for a text or pattern, without its quotes or slashes.
        position: start position.
        end_position: end position.
    """

    kind: str
    text: str
    position: int
    end_position: int


class Literal(Struct, frozen=True):
    """A literal value."""

    value: Scalar
    position: int


class Name(Struct, frozen=True):
    """A setting, a fact or a variable."""

    name: str
    position: int


class Unary(Struct, frozen=True):
    """A unary operator, `-` or `not`, and its operand."""

    sign: str
    operand: Node
    position: int


class Binary(Struct, frozen=True):
    """A binary operator and its operands."""

    sign: str
    left: Node
    right: Node
    position: int


class Choice(Struct, frozen=True):
    """A conditional expression, `condition ? yes : no`."""

    condition: Node
    yes: Node
    no: Node
    position: int


class Index(Struct, frozen=True):
    """One item of a list, counted from 0."""

    container: Node
    index: Node
    position: int


class Vector(Struct, frozen=True):
    """A literal list."""

    items: tuple[Node, ...]
    position: int


class Call(Struct, frozen=True):
    """A function call."""

    name: str
    arguments: tuple[Node, ...]
    position: int


Node = Literal | Name | Unary | Binary | Choice | Index | Vector | Call


def find_names(node: Node) -> Iterator[Name | Call]:
    """Yield all names and function calls in a tree."""
    inner: tuple[Node, ...] = ()
    match node:
        case Name() | Call():
            yield node
            inner = node.arguments if isinstance(node, Call) else ()
        case Unary():
            inner = (node.operand,)
        case Binary():
            inner = (node.left, node.right)
        case Choice():
            inner = (node.condition, node.yes, node.no)
        case Index():
            inner = (node.container, node.index)
        case Vector():
            inner = node.items
    for one in inner:
        yield from find_names(one)


def parse_expression(text: str) -> Node:
    """Parse a text that is one expression, in which `=` compares.

    Raises:
        MacroFault: the text is not an expression.
    """
    reader = ExpressionReader(text, 0, equals="==")
    tree = reader.read_expression()
    if reader.next.kind != "end" or reader.next.end_position < len(text):
        raise reader.make_unexpected_fault("an operator")
    return tree


class ExpressionReader:
    """A recursive-descent parser that starts at a position of a text.

    It replaces the sign `=` by `equals`.
    """

    def __init__(self, text: str, position: int, *, equals: str = "=") -> None:
        self._text, self._synonyms = text, {**_SYNONYMS, "=": equals}
        self._begin, self._depth, self._count = position, 0, 0
        self.next = self._read_token(position, expects_value=True)

    def _read_token(self, position: int, *, expects_value: bool) -> Token:
        """Read the token at a position; if a value is expected there, a slash starts a pattern.

        Raises:
            MacroFault: an unexpected character, or an unterminated text.
        """
        found = _PATTERN.match(self._text, position) if expects_value else None
        if found:
            return Token("pattern", found[1], found.end() - len(found[0].lstrip()), found.end())
        match = _TOKEN.match(self._text, position)
        if match is None:
            raise self._explain_misread(position)
        kind = match.lastgroup or ""
        text, begin = match[kind], match.start(kind)
        if kind == "end" and not text:
            begin = len(self._text)
        if kind == "text":
            text = _ESCAPE.sub(lambda one: "\n" if one[1] == "n" else one[1], text[1:-1])
        elif text in _WORDS or kind == "sign":
            kind, text = "sign", self._synonyms.get(text, text)
        return Token(kind, text, begin, match.end())

    def _explain_misread(self, position: int) -> MacroFault:
        """Return a fault that explains why there is no valid token at a position."""
        while self._text[position].isspace():
            position += 1
        if self._text[position] in "\"'":
            return MacroFault(position, "unterminated text", f"Close it with {self._text[position]}")
        return MacroFault(
            position, f"unexpected {self._text[position]!r}", "Write {{ and }} for literal braces"
        )

    def accept(self, *texts: str) -> Token | None:
        """Read and return the next token if it is one of the given operators or keywords."""
        token = self.next
        if token.kind != "sign" or token.text not in texts:
            return None
        self._advance()
        return token

    def _advance(self) -> Token:
        """Return the next token, and read the token after it."""
        token = self.next
        self._count += 1
        if self._count > _MAX_TOKENS:
            raise MacroFault(
                self._begin,
                f"the expression has more than {_MAX_TOKENS} names, numbers and signs",
                "Split it into several",
            )
        ends_value = token.kind != "sign" or token.text in (")", "]")
        self.next = self._read_token(token.end_position, expects_value=not ends_value)
        return token

    def accept_name(self) -> Token | None:
        """Read and return the next token if it is a name."""
        return self._advance() if self.next.kind == "name" else None

    def expect(self, text: str) -> None:
        """Read a required operator or keyword."""
        if self.accept(text) is None:
            raise self.make_unexpected_fault(text)

    def make_unexpected_fault(self, wanted: str) -> MacroFault:
        """Return a fault that says that the next token is not what was expected."""
        token = self.next
        if token.kind == "sign" and token.text == "=":
            return MacroFault(
                token.position, "= is not a comparison", "Write ==, or {local name = value} for a variable"
            )
        here = "the end of the expression" if token.kind == "end" else repr(token.text)
        return MacroFault(token.position, f"expected {wanted}, got {here}")

    def read_expression(self) -> Node:
        """Parse a whole expression.

        Raises:
            MacroFault: there is no valid expression.
        """
        self._begin, self._count = self.next.position, 0
        return self._parse_choice()

    def _parse_choice(self) -> Node:
        """Parse `condition ? yes : no`, or an expression of higher precedence."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise MacroFault(
                self.next.position, f"nested deeper than {_DEEPEST} levels", "Use a simpler expression"
            )
        tree = self._parse_level(0)
        mark = self.accept("?")
        if mark is not None:
            yes = self._parse_choice()
            self.expect(":")
            tree = Choice(tree, yes, self._parse_choice(), mark.position)
        self._depth -= 1
        return tree

    def _parse_level(self, level: int) -> Node:
        """Parse operators of one level of precedence and their operands."""
        if level == len(_PRECEDENCE):
            return self._parse_signs(self._parse_indexed, "-", "+")
        if level == _NOT_LEVEL:
            return self._parse_signs(lambda: self._parse_level(_COMPARISON_LEVEL), "not")
        left = self._parse_level(level + 1)
        while (sign := self.accept(*_PRECEDENCE[level])) is not None:
            left = Binary(sign.text, left, self._parse_level(level + 1), sign.position)
            if level == _COMPARISON_LEVEL and self.next.text in _COMPARISONS and self.next.kind == "sign":
                raise MacroFault(
                    self.next.position, "chains of comparisons are not allowed", "Write a < b and b < c"
                )
        return left

    def _parse_signs(self, parse_operand: Callable[[], Node], *texts: str) -> Node:
        """Parse any number of unary operators, and the operand after them."""
        signs: list[Token] = []
        while (sign := self.accept(*texts)) is not None:
            signs.append(sign)
            if len(signs) > _MAX_SIGNS:
                raise MacroFault(sign.position, f"more than {_MAX_SIGNS} signs in front of a value")
        tree = parse_operand()
        for sign in reversed(signs):
            tree = tree if sign.text == "+" else Unary(sign.text, tree, sign.position)
        return tree

    def _parse_indexed(self) -> Node:
        """Parse a value and the indices after it."""
        tree = self._parse_atom()
        while (mark := self.accept("[")) is not None:
            tree = Index(tree, self._parse_choice(), mark.position)
            self.expect("]")
        return tree

    def _parse_atom(self) -> Node:
        """Parse a number, a text, a pattern, a name, a call, or an expression in parentheses."""
        token = self.next
        match token.kind:
            case "float":
                return Literal(check_range(float(self._advance().text), token.position), token.position)
            case "int":
                value = int(token.text) if len(token.text) < 20 else float(token.text)
                self._advance()
                return Literal(check_range(value, token.position), token.position)
            case "text":
                return Literal(self._advance().text, token.position)
            case "pattern":
                return Literal(Pattern(self._advance().text), token.position)
            case "name":
                return self._parse_named(self._advance())
        if self.accept("("):
            return self._parse_parentheses(token)
        raise self.make_unexpected_fault("a value")

    def _parse_parentheses(self, token: Token) -> Node:
        """Parse the rest of an expression or list in parentheses."""
        items = self._parse_items(")")
        return items[0] if len(items) == 1 else Vector(tuple(items), token.position)

    def _parse_items(self, end: str) -> list[Node]:
        """Parse items that are separated by commas, up to a closing sign."""
        items: list[Node] = []
        if not self.accept(end):
            items.append(self._parse_choice())
            while self.accept(","):
                items.append(self._parse_choice())
            self.expect(end)
        return items

    def _parse_named(self, token: Token) -> Node:
        """Parse a boolean, a function call or a name, after its first token was read."""
        if token.text in ("true", "false"):
            return Literal(token.text == "true", token.position)
        if self.accept("("):
            return Call(token.text, tuple(self._parse_items(")")), token.position)
        return Name(token.text, token.position)
