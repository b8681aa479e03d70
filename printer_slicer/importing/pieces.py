"""A macro of another slicer as text, placeholders and blocks; every piece knows what it was written as."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass
from typing import Final

from printer_slicer.importing.foreign import Node, Unreadable, parse_foreign, words_of

__all__ = ["Block", "Broken", "Piece", "Shown", "pieces_of"]

_SQUARE: Final = re.compile(r"\[([A-Za-z]\w*)(?:\[(\w+)\])?(?:\]|(?=$))", re.ASCII)
_MARKS: Final = {
    "if": "if",
    "elsif": "elif",
    "elseif": "elif",
    "elif": "elif",
    "else": "else",
    "endif": "endif",
}
_QUOTE_OR_BRACE: Final = re.compile(r'(?<!\\)"|\}')
_DEEPEST: Final = 15
_OF_EXTRUDER: Final = re.compile(r"^(\w+)\s*,\s*(\w+)$", re.ASCII)  # Cura's {name, extruder}


@dataclass(frozen=True, slots=True)
class Shown:
    """A value that stands in the text."""

    tree: Node
    source: str


@dataclass(frozen=True, slots=True)
class Broken:
    """Something that cannot be read, and why."""

    why: str
    source: str


@dataclass(frozen=True, slots=True)
class Block:
    """Branches; that of `else` has no condition. `source` is all of it as written."""

    branches: tuple[tuple[Node | Broken | None, tuple[Piece, ...]], ...]
    source: str


@dataclass(frozen=True, slots=True)
class _Mark:
    word: str
    tree: Node | Broken | None
    source: str


Piece = str | Shown | Broken | Block
_Flat = str | Shown | Broken | _Mark


def pieces_of(text: str, *, square: bool = True) -> tuple[Piece, ...]:
    """The pieces of a macro; what is wrong in it becomes a piece that says so.

    Args:
        text: the macro.
        square: whether names stand in square brackets, too.
    """
    flat = _flat(text, square=square)
    pieces: list[Piece] = []
    place = 0
    while place < len(flat):
        inner, place = _nested(flat, place, 0)
        pieces += inner
        if place < len(flat):  # {else} or {endif} without {if}
            pieces.append(Broken("a block that does not begin", _source(flat[place])))
            place += 1
    return tuple(pieces)


def _flat(text: str, *, square: bool) -> list[_Flat]:
    """Text, values and marks one after the other."""
    found: list[_Flat] = []
    place, begin, braces = 0, 0, _Braces(text)
    while place < len(text):
        match = _SQUARE.match(text, place) if square and text[place] == "[" else None
        if match or text[place] == "{":
            if place > begin:
                found.append(text[begin:place])
            end = match.end() if match else braces.behind(place)
            found.append(_in_square(match) if match else _in_braces(text[place:end]))
            place = begin = end
        else:
            place += 1
    return [*found, text[begin:]] if begin < len(text) else found


class _Braces:
    """Where the braces of a macro close; texts in quotes may hold braces.

    Of every quotation mark and closing brace the place is found once, so that the time grows with the length only.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._quotes: list[int] = []
        self._closing: tuple[list[int], list[int]] = (
            [],
            [],
        )  # behind an even number of quotation marks, an odd one
        for found in _QUOTE_OR_BRACE.finditer(text):
            if found[0] == '"':
                self._quotes.append(found.start())
            else:
                self._closing[len(self._quotes) % 2].append(found.start())

    def behind(self, place: int) -> int:
        """The place behind the brace that closes the one here, or the end of the line."""
        closing = self._closing[bisect_right(self._quotes, place) % 2]
        number = bisect_right(closing, place)
        if number < len(closing):
            return closing[number] + 1
        end = self._text.find("\n", place)
        return len(self._text) if end < 0 else end


def _in_square(match: re.Match[str]) -> _Flat:
    name = f"{match[1]}[{match[2]}]" if match[2] else match[1]
    try:
        return Shown(parse_foreign(words_of(name)), match[0])
    except Unreadable as error:
        return Broken(str(error), match[0])


def _in_braces(source: str) -> _Flat:
    """A value or a mark."""
    inner = source[1:-1].strip() if source.endswith("}") else source[1:]
    inner = _OF_EXTRUDER.sub(r"\1[\2]", inner)
    first = re.match(r"[a-z]+\b", inner)
    word = _MARKS.get(first[0], "") if first else ""
    if word in ("else", "endif"):
        return _Mark(word, None, source)
    tree: Node | Broken
    if not source.endswith("}"):
        return Broken("a brace that is not closed", source)
    try:
        tree = parse_foreign(words_of(inner[len(first[0]) :] if word and first else inner))
    except (Unreadable, RecursionError) as error:
        tree = Broken(str(error), source)
    if word:
        return _Mark(word, tree, source)
    return tree if isinstance(tree, Broken) else Shown(tree, source)


def _nested(flat: list[_Flat], place: int, depth: int) -> tuple[list[Piece], int]:
    """The pieces up to a mark that ends the block around, and where that is."""
    pieces: list[Piece] = []
    while place < len(flat):
        piece = flat[place]
        if isinstance(piece, _Mark):
            if piece.word != "if":
                break
            block, place = _block(flat, place, depth)
            pieces.append(block)
        else:
            pieces.append(piece)
            place += 1
    return pieces, place


def _block(flat: list[_Flat], place: int, depth: int) -> tuple[Block | Broken, int]:
    """A block from {if} to {endif}, and the place behind it."""
    begin, branches, mark = place, [], flat[place]
    while isinstance(mark, _Mark) and mark.word != "endif":
        if depth == _DEEPEST:
            return Broken("blocks nested too deep", _source(mark)), place + 1
        inner, place = _nested(flat, place + 1, depth + 1)
        branches.append((mark.tree, tuple(inner)))
        if place == len(flat):
            whole = "".join(map(_source, flat[begin:]))
            return Broken("{if} without {endif}", whole), place
        mark = flat[place]
    whole = "".join(map(_source, flat[begin : place + 1]))
    return Block(tuple(branches), whole), place + 1


def _source(piece: _Flat) -> str:
    return piece if isinstance(piece, str) else piece.source
