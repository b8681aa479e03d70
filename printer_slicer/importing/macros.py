"""Macros of other slicers as ours: line by line, block by block; what has no counterpart stays as a comment.

A line is the least that is kept or becomes a comment: half a command is none. A block whose conditions have a
counterpart stays a block even if some of its lines become comments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from printer_slicer.errors import ProfileError
from printer_slicer.importing.foreign import Unreadable
from printer_slicer.importing.pieces import Block, Broken, Piece, Shown, pieces_of
from printer_slicer.importing.report import Note
from printer_slicer.importing.translation import Said, Translator, plain_text
from printer_slicer.macros import read_template

__all__ = ["Translated", "translated"]


@dataclass(slots=True)
class Translated:
    """A macro of ours.

    Attributes:
        text: of it.
        notes: what became a comment, and why.
    """

    text: str
    notes: list[Note] = field(default_factory=list)


def translated(text: str, translator: Translator, place: str, *, square: bool = True) -> Translated:
    """The macro that does the same.

    Args:
        text: the other slicer's macro.
        translator: of its expressions.
        place: file, line and setting, for notes.
        square: whether names stand in square brackets, too.
    """
    plain = text.replace("\r\n", "\n").replace("\r", "\n").replace("\x00", "")
    writer = _Writer(translator, place)
    made = Translated("".join(writer.lines_of(pieces_of(plain, square=square))), writer.notes)
    made.notes += [Note(place, note) for note in sorted(translator.notes)]
    try:
        read_template(made.text, place)
    except ProfileError as error:  # our own parser has the last word
        made.text = "".join(_comment(plain))
        made.notes = [Note(place, f"all of it kept as comments: {str(error.args[0]).splitlines()[0]}")]
    return made


def _comment(source: str) -> Iterator[str]:
    """Lines as comments that come out as they were written."""
    for line in source.strip("\n").split("\n"):
        yield f"; not translated: {_doubled(line.strip())}\n"


def _doubled(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


@dataclass(slots=True)
class _Writer:
    translator: Translator
    place: str
    notes: list[Note] = field(default_factory=list)

    def lines_of(self, pieces: Sequence[Piece]) -> Iterator[str]:
        """The text of pieces that begin and end with a line."""
        for line in _lines(pieces):
            yield from self._line(line)

    def _line(self, line: list[Piece]) -> Iterator[str]:
        """A line, or what spans several, as ours or as comments."""
        kept = len(self.notes)
        try:
            yield "".join([self._piece(piece) for piece in _remarks_kept(line, self.translator)])
        except Unreadable as error:
            del self.notes[kept:]
            source = "".join(piece if isinstance(piece, str) else piece.source for piece in line)
            first, *rest = source.strip().split("\n")
            shown = repr(first if len(first) <= 70 else f"{first[:67]}...")
            shown += f" and {len(rest)} more line{'s' if len(rest) > 1 else ''}" if rest else ""
            self.notes.append(Note(self.place, f"{shown} kept as a comment: {error}"))
            ends = source.endswith("\n") or _closes(line)
            yield "".join(_comment(source)) if ends else "".join(_comment(source)).rstrip("\n")

    def _piece(self, piece: Piece) -> str:
        if isinstance(piece, str):
            return _doubled(piece)
        if isinstance(piece, Shown):
            said = self.translator.said(piece.tree)
            plain = plain_text(said)
            return f"{{{said.text}}}" if plain is None else _doubled(plain)
        if isinstance(piece, Broken):
            raise Unreadable(piece.why)
        return self._block(piece)

    def _block(self, block: Block) -> str:
        """A block without the branches that are known never to be taken."""
        made: list[str] = []
        for tree, pieces in block.branches:
            if isinstance(tree, Broken):
                raise Unreadable(tree.why)
            condition = Said("true", "bool") if tree is None else self.translator.condition(tree)
            if condition.text == "false":
                continue
            inner = self._branch(pieces)
            if condition.text == "true":
                return "".join([*made, "{else}", inner, "{endif}"]) if made else inner
            made += [f"{{{'elif' if made else 'if'} {condition.text}}}", inner]
        return "".join([*made, "{endif}"]) if made else ""

    def _branch(self, pieces: Sequence[Piece]) -> str:
        """A branch; only whole lines in it may become comments."""
        lines = _lines(pieces)
        texts: list[str] = []
        for number, line in enumerate(lines):
            last = line[-1]
            whole = number > 0 and ((isinstance(last, str) and last.endswith("\n")) or _closes(line))
            texts += self._line(line) if whole else [self._piece(piece) for piece in line]
        return "".join(texts)


def _lines(pieces: Sequence[Piece]) -> list[list[Piece]]:
    """Pieces line by line; a block that spans lines belongs to the line in which it begins and ends.

    A block that ends with a line is a line: what stands behind its {endif} begins the next one.
    """
    lines: list[list[Piece]] = [[]]
    for piece in pieces:
        parts = piece.split("\n") if isinstance(piece, str) else []
        if _closes(lines[-1]) and not (parts[1:] and not parts[0].strip()):
            lines.append([])
        if not isinstance(piece, str):
            lines[-1].append(piece)
            continue
        for part in parts[:-1]:
            lines[-1].append(f"{part}\n")
            lines.append([])
        if parts[-1]:
            lines[-1].append(parts[-1])
    return [line for line in lines if line]


def _closes(line: Sequence[Piece]) -> bool:
    """Whether a line is nothing but a block all of whose branches end with a line."""
    *before, last = line or [""]
    alone = all(isinstance(piece, str) and not piece.strip() for piece in before)
    return isinstance(last, Block) and alone and all(map(_ends, last.branches))


def _ends(branch: tuple[object, tuple[Piece, ...]]) -> bool:
    """Whether the last piece of a branch ends a line."""
    last = branch[1][-1] if branch[1] else ""
    return isinstance(last, str) and last.rstrip(" \t").endswith("\n")


def _remarks_kept(line: list[Piece], translator: Translator) -> Iterator[Piece]:
    """The line; behind a semicolon, names that mean nothing here stay as they are."""
    remark = False
    for piece in line:
        if remark and isinstance(piece, (Shown, Broken)):
            try:
                if isinstance(piece, Shown):
                    translator.said(piece.tree)
            except Unreadable:
                yield piece.source
                continue
            if isinstance(piece, Broken):
                yield piece.source
                continue
        if isinstance(piece, str):
            remark = (";" in piece.rpartition("\n")[2]) or (remark and "\n" not in piece)
        yield piece
