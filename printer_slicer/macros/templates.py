"""A macro: lines with expressions in braces, and blocks that are there or not.

    {name} {a + b}          the value of an expression
    {{ }}                   braces themselves
    {if a} ... {elif b} ... {else} ... {endif}
                            over lines or within one; a line that holds nothing but these disappears

Nothing here calls Python's own evaluation. What a template may cost is bounded: words in an expression, nesting of
expressions and of blocks, characters that come out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Never

from printer_slicer.errors import ProfileError
from printer_slicer.macros.evaluation import check_known, evaluate, is_true
from printer_slicer.macros.expressions import Node, named_in, parse
from printer_slicer.macros.tokens import tokens_of
from printer_slicer.macros.values import Fault, Value, text_of

__all__ = ["Template", "read_template"]

_DEEPEST: Final = 20
_MOST_CHARACTERS: Final = 1_000_000
_SHOWN: Final = 100  # characters of a line, around the place that is wrong
_MARKS: Final = ("if", "elif", "else", "endif")
_LIKE_ELIF: Final = ("elsif", "elseif")


@dataclass(frozen=True, slots=True)
class _Mark:
    """`{if ...}`, `{elif ...}`, `{else}` or `{endif}`."""

    word: str
    condition: Node | None
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class _Show:
    """An expression whose value stands in the text."""

    tree: Node
    line: int


@dataclass(frozen=True, slots=True)
class _Block:
    """Branches, of which the first whose condition holds is there; `else` has the condition None."""

    branches: tuple[tuple[_Mark, tuple[_Piece, ...]], ...]


_Piece = str | _Show | _Block
_Flat = str | _Show | _Mark


@dataclass(frozen=True, slots=True)
class Template:
    """A macro that was read.

    Attributes:
        place: says in errors which setting it is.
        source: its lines.
        pieces: text, expressions, blocks.
    """

    place: str
    source: tuple[str, ...]
    pieces: tuple[_Piece, ...]

    @property
    def empty(self) -> bool:
        """Whether nothing can come out."""
        return not any(not isinstance(piece, str) or piece.strip() for piece in self.pieces)

    def filled(self, known: Mapping[str, Value]) -> list[str]:
        """The lines that come out, without empty ones at both ends.

        Args:
            known: what names stand for; see `check`.

        Raises:
            ProfileError: naming setting, line and column.
        """
        self.check(known)
        text, size = [], 0
        for part in self._parts(self.pieces, known):
            size += len(part)
            if size > _MOST_CHARACTERS:
                raise ProfileError(
                    f"{self.place}: more than {_MOST_CHARACTERS} characters come out",
                    remedy="look for lists and texts that it says over and over",
                )
            text.append(part)
        return "".join(text).strip("\n").splitlines()

    def check(self, known: Collection[str]) -> None:
        """Check that every name and function exists, also in blocks that are left out.

        Raises:
            ProfileError: one is unknown; naming setting, line and column.
        """
        self._check(self.pieces, known)

    def _parts(self, pieces: tuple[_Piece, ...], known: Mapping[str, Value]) -> Iterator[str]:
        for piece in pieces:
            if isinstance(piece, str):
                yield piece
            elif isinstance(piece, _Show):
                yield text_of(self._value(piece, known))
            else:
                yield from self._parts(self._chosen(piece, known), known)

    def _value(self, piece: _Show, known: Mapping[str, Value]) -> Value:
        try:
            return evaluate(piece.tree, known)
        except Fault as fault:
            _refuse(fault, self.place, self.source, piece.line)

    def _chosen(self, block: _Block, known: Mapping[str, Value]) -> tuple[_Piece, ...]:
        """The pieces of the branch that is there."""
        for mark, pieces in block.branches:
            try:
                if mark.condition is None or is_true(mark.condition, known):
                    return pieces
            except Fault as fault:
                _refuse(fault, self.place, self.source, mark.line)
        return ()

    def _check(self, pieces: tuple[_Piece, ...], known: Collection[str]) -> None:
        """Raise for a name that is not known, wherever it stands."""
        for piece in pieces:
            if isinstance(piece, _Show):
                self._check_names(piece.tree, piece.line, known)
            elif isinstance(piece, _Block):
                for mark, inner in piece.branches:
                    if mark.condition is not None:
                        self._check_names(mark.condition, mark.line, known)
                    self._check(inner, known)

    def _check_names(self, tree: Node, line: int, known: Collection[str]) -> None:
        try:
            for one in named_in(tree):
                check_known(one, known)
        except Fault as fault:
            _refuse(fault, self.place, self.source, line)


def read_template(text: str, place: str) -> Template:
    """The template that a macro is.

    Args:
        text: the macro.
        place: which setting holds it, for errors.

    Raises:
        ProfileError: naming setting, line and column of what cannot be read.
    """
    source = tuple(text.replace("\r\n", "\n").split("\n"))
    flat: list[_Flat] = []
    for number, line in enumerate(source):
        try:
            flat += _flat(line, number)
        except Fault as fault:
            _refuse(fault, place, source, number)
    open_marks: list[_Mark] = []
    try:
        pieces, place_after = _nested(flat, 0, open_marks)
        assert place_after == len(flat)
    except Fault as fault:
        _refuse(fault, place, source, open_marks[-1].line)
    return Template(place, source, pieces)


def _flat(line: str, number: int) -> list[_Flat]:
    """The pieces of one line, its end included unless nothing but marks stands in it."""
    pieces: list[_Flat] = []
    place = 0
    while place < len(line):
        begin = place
        while place < len(line) and line[place] not in "{}":
            place += 1
        if place > begin:
            pieces.append(line[begin:place])
        if line[place : place + 2] in ("{{", "}}"):
            pieces.append(line[place])
            place += 2
        elif place < len(line):
            piece, place = _braced(line, place, number)
            pieces.append(piece)
    marks = [piece for piece in pieces if isinstance(piece, _Mark)]
    rest = [piece for piece in pieces if not isinstance(piece, _Mark)]
    if marks and all(isinstance(piece, str) and not piece.strip() for piece in rest):
        return [*marks]
    return [*pieces, "\n"]


def _braced(line: str, place: int, number: int) -> tuple[_Show | _Mark, int]:
    """What stands between the braces that begin here, and where it ends."""
    if line[place] == "}":
        raise Fault(place, "a brace without its partner", "write {name}, or }} for a brace itself")
    tokens, after = tokens_of(line, place + 1)
    first = tokens[0]
    if first.kind == "name" and first.text in _LIKE_ELIF and len(tokens) > 2:
        raise Fault(first.column, f"{first.text} is unknown", "write {elif ...}")
    if first.kind != "name" or first.text not in _MARKS:
        return _Show(parse(tokens), number), after
    if first.text in ("else", "endif"):
        if len(tokens) > 2:
            raise Fault(tokens[1].column, f"nothing may follow {first.text}", f"write {{{first.text}}}")
        return _Mark(first.text, None, number, place), after
    if len(tokens) == 2:
        raise Fault(tokens[1].column, f"{first.text} without a condition", f"write {{{first.text} a > b}}")
    return _Mark(first.text, parse(tokens[1:]), number, place), after


def _nested(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[tuple[_Piece, ...], int]:
    """The pieces up to a mark that ends the block they are in, or to the end of the macro; and where that is.

    `open_marks` are those of the blocks around; the last of them is where a fault is.
    """
    pieces: list[_Piece] = []
    depth = len(open_marks)
    while place < len(flat):
        piece = flat[place]
        if not isinstance(piece, _Mark):
            pieces.append(piece)
            place += 1
        elif piece.word == "if":
            open_marks.append(piece)
            if depth == _DEEPEST:
                raise Fault(piece.column, f"blocks nested deeper than {_DEEPEST} times")
            block, place = _block(flat, place, open_marks)
            pieces.append(block)
            open_marks.pop()
        elif depth == 0:
            open_marks.append(piece)
            raise Fault(piece.column, f"{{{piece.word}}} without {{if ...}}")
        else:
            break
    return tuple(pieces), place


def _block(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[_Block, int]:
    """A whole block that begins here, and the place behind its end."""
    first = flat[place]
    assert isinstance(first, _Mark)
    branches: list[tuple[_Mark, tuple[_Piece, ...]]] = []
    mark = first
    while mark.word != "endif":
        pieces, place = _nested(flat, place + 1, open_marks)
        branches.append((mark, pieces))
        if place == len(flat):
            raise Fault(first.column, "{if ...} without {endif}", "end the block with {endif}")
        following = flat[place]
        assert isinstance(following, _Mark)
        if mark.word == "else" and following.word != "endif":
            open_marks.append(following)
            raise Fault(following.column, f"{{{following.word}}} behind {{else}}")
        mark = following
    return _Block(tuple(branches)), place + 1


def _refuse(fault: Fault, place: str, source: tuple[str, ...], line: int) -> Never:
    """Raise with the line and a mark under the place that is wrong."""
    text = "".join(letter if letter.isprintable() else " " for letter in source[line])
    begin = max(0, fault.column - _SHOWN // 2)
    shown = text[begin : begin + _SHOWN]
    raise ProfileError(
        f"{place}: line {line + 1}, column {fault.column + 1}: {fault.problem}\n"
        f"  {shown}\n  {' ' * (fault.column - begin)}^",
        remedy=fault.remedy,
    ) from None
