"""A line of a macro as tokens: names, numbers, texts and signs between `{` and `}`."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from printer_slicer.macros.values import Fault

__all__ = ["MOST_TOKENS", "Token", "tokens_of"]

MOST_TOKENS: Final = 200
"""In one expression: what is read and evaluated by functions that call themselves stays shallow."""

_TOKEN: Final = re.compile(
    r"""\s*(?:
        (?P<number> (?: [0-9]+\.?[0-9]* | \.[0-9]+ ) (?: [eE][-+]?[0-9]+ )? )
      | (?P<name> [A-Za-z_] \w* (?: \.\w+ )* )
      | (?P<text> "(?:[^"\\]|\\.)*" | '(?:[^'\\]|\\.)*' )
      | (?P<sign> <= | >= | == | != | && | \|\| | [-+*/%<>!()\[\],?:] )
      | (?P<end> \} )
    )""",
    re.VERBOSE | re.ASCII,
)
_ESCAPE: Final = re.compile(r"\\(.)")
_WORDS: Final = {"and": "and", "or": "or", "not": "not", "&&": "and", "||": "or", "!": "not"}


class Token(NamedTuple):
    """One token.

    Attributes:
        kind: `number`, `name`, `text`, `sign` or `end`.
        text: as written; of a text what is between the quotes; `and`, `or` and `not` are signs.
        column: where it begins in its line, from 0.
    """

    kind: str
    text: str
    column: int


def tokens_of(line: str, begin: int) -> tuple[list[Token], int]:
    """The tokens from a place behind `{` to the `}` that ends the expression, itself included, and the place behind it.

    Raises:
        Fault: a character that means nothing, a text that does not end, no `}`, or too many tokens.
    """
    tokens: list[Token] = []
    place = begin
    while True:
        match = _TOKEN.match(line, place)
        if match is None:
            raise _misread(line, place, begin)
        place = match.end()
        tokens.append(_token(match))
        if tokens[-1].kind == "end":
            return tokens, place
        if len(tokens) > MOST_TOKENS:
            raise Fault(begin - 1, f"an expression of more than {MOST_TOKENS} words", "use several")


def _token(match: re.Match[str]) -> Token:
    kind = match.lastgroup or ""
    text, column = match[kind], match.start(kind)
    if kind == "text":
        return Token(kind, _ESCAPE.sub(lambda one: "\n" if one[1] == "n" else one[1], text[1:-1]), column)
    if text in _WORDS:
        return Token("sign", _WORDS[text], column)
    return Token(kind, text, column)


def _misread(line: str, place: int, begin: int) -> Fault:
    """Why no token begins here."""
    while place < len(line) and line[place].isspace():
        place += 1
    if place == len(line):
        return Fault(begin - 1, "a brace without its partner", "write {name}, or {{ for a brace itself")
    if line[place] in "\"'":
        return Fault(place, "a text that does not end", f"close it with {line[place]} in the same line")
    if line[place] == "=":
        return Fault(place, "= is no comparison", "write ==")
    return Fault(place, f"{line[place]!r} means nothing here", "write {{ and }} for braces themselves")
