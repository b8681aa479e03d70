"""Expressions of other slicers' placeholder languages: words, tree.

PrusaSlicer, SuperSlicer, OrcaSlicer and BambuStudio share one language; Cura's expressions are Python's and read by
`cura_values`.

Binding, from loose to tight:

condition ? yes : no
or ||
and &&
== = != <> < <= > >= =~ !~
+ -
* / %
- + ! not (in front)
name  name[index]  function(...)  (...)

Source: PrusaSlicer's documentation, "Macros" and "List of placeholders".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

__all__ = [
    "Binary",
    "Call",
    "Choice",
    "Literal",
    "Name",
    "Node",
    "Unary",
    "Unreadable",
    "parse_foreign",
    "words_of",
]

_WORD: Final = re.compile(
    r"""\s*(?:
        (?P<float> \d+\.\d*(?:[eE][-+]?\d+)? | \.\d+(?:[eE][-+]?\d+)? | \d+[eE][-+]?\d+ )
      | (?P<int> \d+ )
      | (?P<name> [A-Za-z_]\w* )
      | (?P<text> "(?:[^"\\]|\\.)*" )
      | (?P<sign> =~ | !~ | <= | >= | == | != | <> | && | \|\| | [-+*/%<>=!()\[\],?:;] )
    )""",
    re.VERBOSE | re.ASCII,
)
_REGEX: Final = re.compile(r"\s*/((?:[^/\\]|\\.)*)/")
_SAME: Final = {"<>": "!=", "=": "==", "&&": "and", "||": "or", "!": "not"}
_LEVELS: Final = (
    ("or",),
    ("and",),
    ("==", "!=", "<", "<=", ">", ">=", "=~", "!~"),
    ("+", "-"),
    ("*", "/", "%"),
)
_DEEPEST: Final = 40
_MOST_WORDS: Final = 2000
_MOST_SIGNS: Final = 150
"""Signs between two things: each makes the tree higher, and is followed by functions that call themselves."""


class Unreadable(Exception):  # noqa: N818 - becomes a comment and a warning
    """Something in another slicer's language that has no meaning here; the reason is its text."""


@dataclass(frozen=True, slots=True)
class Literal:
    """A value; a pattern (between slashes) is one, too."""

    value: float | int | str | bool
    pattern: bool = False


@dataclass(frozen=True, slots=True)
class Name:
    """A setting or a fact, with an index where it is a list."""

    name: str
    index: Node | None = None


@dataclass(frozen=True, slots=True)
class Unary:
    """`-` or `not`."""

    sign: str
    one: Node


@dataclass(frozen=True, slots=True)
class Binary:
    """A sign between two things."""

    sign: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Choice:
    """One of two things."""

    condition: Node
    yes: Node
    no: Node


@dataclass(frozen=True, slots=True)
class Call:
    """A function."""

    name: str
    arguments: tuple[Node, ...]


Node = Literal | Name | Unary | Binary | Choice | Call


def words_of(text: str) -> list[tuple[str, str]]:
    """Kind and text of all words of an expression; behind `=~` a pattern stands between slashes.

    Raises:
        Unreadable: a character that means nothing, or too many words.
    """
    words: list[tuple[str, str]] = []
    place = 0
    text = text.rstrip()
    while place < len(text):
        wants_pattern = bool(words) and words[-1] in (("sign", "=~"), ("sign", "!~"))
        match = _REGEX.match(text, place) if wants_pattern else _WORD.match(text, place)
        if match is None or len(words) > _MOST_WORDS:
            raise Unreadable(f"{text[place:].strip()[:20]!r} is not understood")
        place = match.end()
        kind = match.lastgroup if not wants_pattern else "pattern"
        word = match[1] if wants_pattern else match[kind or ""]
        if kind == "name" and word in ("and", "or", "not"):
            kind = "sign"
        words.append((kind or "", _SAME.get(word, word) if kind == "sign" else word))
    return words


def parse_foreign(words: list[tuple[str, str]]) -> Node:
    """The tree of an expression.

    Raises:
        Unreadable: it is none.
    """
    reader = _Reader(words)
    tree = reader.choice()
    if reader.place < len(words):
        raise Unreadable(f"{words[reader.place][1]!r} is not understood")
    return tree


@dataclass(slots=True)
class _Reader:
    words: list[tuple[str, str]]
    place: int = 0
    depth: int = 0
    signs: int = 0

    def taken(self, *signs: str) -> str:
        """The next sign, read, if it is one of these; else nothing."""
        if self.place < len(self.words):
            kind, text = self.words[self.place]
            if kind == "sign" and text in signs:
                self.place += 1
                return text
        return ""

    def expect(self, sign: str) -> None:
        """Read a sign that must be there."""
        if not self.taken(sign):
            raise Unreadable(f"{sign} is missing")

    def choice(self) -> Node:
        """`condition ? yes : no`, or anything tighter."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise Unreadable("nested too deep")
        tree = self.level(0)
        if self.taken("?"):
            yes = self.choice()
            self.expect(":")
            tree = Choice(tree, yes, self.choice())
        self.depth -= 1
        return tree

    def level(self, height: int) -> Node:
        """What the signs of one level or tighter ones hold together."""
        if height == len(_LEVELS):
            return self.unary()
        left = self.level(height + 1)
        while sign := self.taken(*_LEVELS[height]):
            self.signs += 1
            if self.signs > _MOST_SIGNS:
                raise Unreadable(f"over {_MOST_SIGNS} signs between things")
            left = Binary(sign, left, self.level(height + 1))
        return left

    def unary(self) -> Node:
        """Signs in front of something."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise Unreadable("nested too deep")
        sign = self.taken("-", "+", "not")
        tree = Unary(sign, self.unary()) if sign in ("-", "not") else self.unary() if sign else self.atom()
        self.depth -= 1
        return tree

    def atom(self) -> Node:
        """A value, a name, a call, or something in parentheses."""
        if self.taken("("):
            tree = self.choice()
            self.expect(")")
            return tree
        if self.place == len(self.words):
            raise Unreadable("something is missing at the end")
        kind, text = self.words[self.place]
        self.place += 1
        if kind == "name":
            return self.named(text)
        if kind == "pattern":
            return Literal(text, pattern=True)
        if kind == "text":
            return Literal(re.sub(r"\\(.)", lambda one: "\n" if one[1] == "n" else one[1], text[1:-1]))
        if kind in ("int", "float") and len(text) < 20:
            return Literal(int(text) if kind == "int" else float(text))
        raise Unreadable(f"{text!r} is not understood")

    def named(self, name: str) -> Node:
        """What begins with a name."""
        if name in ("true", "false"):
            return Literal(name == "true")
        if self.taken("["):
            index = self.choice()
            self.expect("]")
            return Name(name, index)
        if not self.taken("("):
            return Name(name)
        arguments: list[Node] = []
        while not self.taken(")"):
            if arguments:
                self.expect(",")
            arguments.append(self.choice())
        return Call(name, tuple(arguments))
