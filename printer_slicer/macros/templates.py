"""A macro: lines with expressions in braces, and blocks that are there or not. PrusaSlicer's placeholder language.

    {name} {a + b}          the value of an expression
    [name] [name[0]]        the value of a name
    {if a} ... {elsif b} ... {else} ... {endif}
                            over lines or within one; a line that holds nothing but these disappears
    {local x = 1} {global x = 1} {x = 2} {x[0] = 2}
                            variables of this macro, of all macros of a print; no text comes out
    {if a then x = 1; else x = 2; endif}
                            several of these between the same braces
    {{ }}                   braces themselves (not known to PrusaSlicer)

Behind a semicolon a name that means nothing stays as it is written: it is in a remark. Nothing here calls Python's own
evaluation. What a template may cost is bounded: its length, words in an expression, nesting of expressions and of
blocks, texts and lists, characters that come out. There are no loops.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final, Never

from printer_slicer.errors import ProfileError
from printer_slicer.macros.evaluation import check_known, evaluate, is_true, value_or_list
from printer_slicer.macros.syntax import ExpressionReader, Index, Literal, Name, Node, Token, names_in
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, text_of

__all__ = ["Template", "escaped", "read_template"]

_LONGEST: Final = 300_000
_DEEPEST: Final = 20
_MOST_CHARACTERS: Final = 1_000_000
_LONGEST_PREFIX: Final = 500  # characters of a line before a block that are repeated for each branch
_SHOWN: Final = 100  # characters of a line, around the place that is wrong
_MARKS: Final = ("if", "elsif", "else", "endif")
_BRACE: Final = re.compile(r"[{\[}\n]")
_SQUARE: Final = re.compile(r"\[\s*([A-Za-z_]\w*)\s*(?:\[\s*(\w+)\s*\]\s*)?\]", re.ASCII)


@dataclass(frozen=True, slots=True)
class _Mark:
    """`if`, `elsif`, `else` or `endif`."""

    word: str
    condition: Node | None
    at: int


@dataclass(frozen=True, slots=True)
class _Show:
    """An expression whose value stands in the text; `source` is what stays of it in a remark."""

    tree: Node
    source: str
    remark: bool


@dataclass(frozen=True, slots=True)
class _Assign:
    """A variable that gets a value: `local`, `global` or, where it exists, neither."""

    scope: str
    name: Token
    index: Node | None
    tree: Node


@dataclass(frozen=True, slots=True)
class _Block:
    """Branches, of which the first whose condition holds is there; `else` has the condition None."""

    branches: tuple[tuple[_Mark, tuple[_Piece, ...]], ...]


_Piece = str | _Show | _Assign | _Block
_Flat = str | _Show | _Assign | _Mark


@dataclass(frozen=True, slots=True)
class Template:
    """A macro that was read.

    Attributes:
        place: says in errors which setting it is.
        source: its text.
        pieces: text, expressions, assignments, blocks.
    """

    place: str
    source: str
    pieces: tuple[_Piece, ...]

    @property
    def empty(self) -> bool:
        """Whether nothing can come out."""
        return not any(not isinstance(piece, str) or piece.strip() for piece in self.pieces)

    def filled(self, known: Mapping[str, Value], shared: dict[str, Value] | None = None) -> list[str]:
        """The lines that come out, without empty ones at both ends.

        Args:
            known: what names stand for; see `check`.
            shared: global variables, which are added and changed.

        Raises:
            ProfileError: naming setting, line and column.
        """
        text, size = [], 0
        filling = _Filling(known, {} if shared is None else shared)
        try:
            for part in filling.parts(self.pieces):
                size += len(part)
                if size > _MOST_CHARACTERS:
                    raise ProfileError(
                        f"{self.place}: more than {_MOST_CHARACTERS} characters come out",
                        remedy="look for lists and texts that it says over and over",
                    )
                text.append(part)
        except MacroFault as fault:
            _refuse(fault, self.place, self.source)
        return "".join(text).strip("\n").splitlines()

    def possible_lines(self, known: Mapping[str, Value], unknown: str = "0") -> list[str]:
        """The lines of every branch that may be taken; what the macro itself says decides which may not.

        Args:
            known: values that stand in the lines and decide nothing.
            unknown: stands where there is no value.
        """
        survey = _Survey(known, {}, unknown=unknown)
        return "".join(survey.parts(self.pieces)).splitlines()

    def check(self, known: Collection[str]) -> None:
        """Check that every name and function exists, also in blocks that are left out.

        Raises:
            ProfileError: one is unknown; naming setting, line and column.
        """
        for fault in self.faults(known):
            _refuse(fault, self.place, self.source)

    def faults(self, known: Collection[str]) -> Iterator[MacroFault]:
        """Every name and function that does not exist, but for names in remarks."""
        variables = {piece.name.text for piece in _all(self.pieces) if isinstance(piece, _Assign)}
        there = {*known, *variables}
        for piece in _all(self.pieces):
            trees = (
                [piece.tree, *([piece.index] if piece.index else [])]
                if isinstance(piece, _Assign)
                else [mark.condition for mark, _ in piece.branches if mark.condition]
                if isinstance(piece, _Block)
                else [piece.tree]
            )
            for one in (one for tree in trees for one in names_in(tree)):
                try:
                    check_known(one, there)
                except UnknownName as fault:
                    if not (isinstance(piece, _Show) and piece.remark):
                        yield fault
                except MacroFault as fault:
                    yield fault

    def line_of(self, fault: MacroFault) -> int:
        """The line of a fault, from 1."""
        return self.source.count("\n", 0, fault.at) + 1


def _all(pieces: tuple[_Piece, ...]) -> Iterator[_Show | _Assign | _Block]:
    """All pieces but texts, those in blocks behind their block."""
    for piece in pieces:
        if not isinstance(piece, str):
            yield piece
        if isinstance(piece, _Block):
            for _, inner in piece.branches:
                yield from _all(inner)


@dataclass(slots=True)
class _Filling:
    """Fills in a template: what is known, and the variables so far."""

    known: Mapping[str, Value]
    shared: dict[str, Value]
    own: dict[str, Value] = field(default_factory=dict)

    @property
    def names(self) -> Mapping[str, Value]:
        """What names stand for now."""
        return ChainMap(self.own, self.shared, self.known)  # type: ignore[arg-type]

    def parts(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """The texts that come out, one after the other."""
        for piece in pieces:
            match piece:
                case str():
                    yield piece
                case _Show():
                    yield self.shown(piece)
                case _Assign():
                    self.assign(piece)
                case _Block():
                    yield from self.block(piece)

    def shown(self, piece: _Show) -> str:
        """The value of an expression as text."""
        try:
            value = value_or_list(piece.tree, self.names)
        except UnknownName:
            if piece.remark:
                return piece.source
            raise
        if isinstance(value, tuple) and sum(len(str(one)) for one in value) > _MOST_CHARACTERS:
            raise MacroFault(piece.tree.at, f"a list of more than {_MOST_CHARACTERS} characters")
        return text_of(value)

    def block(self, block: _Block) -> Iterator[str]:
        """The branch that is there."""
        for mark, pieces in block.branches:
            if mark.condition is None or is_true(mark.condition, self.names):
                yield from self.parts(pieces)
                return

    def assign(self, piece: _Assign) -> None:
        """Give a variable its value."""
        name, value = piece.name.text, value_or_list(piece.tree, self.names)
        where = {"local": self.own, "global": self.shared}.get(piece.scope)
        if where is None:
            where = self.own if name in self.own else self.shared
            if name not in where:
                raise MacroFault(
                    piece.name.at, f"there is no variable {name}", f"write {{local {name} = ...}}"
                )
        if piece.index is not None:
            value = self._replaced(where[name], piece.index, value)
        where[name] = value

    def _replaced(self, values: Value, at: Node, value: Value) -> Items:
        """A list with another item in one place."""
        index = evaluate(at, self.names)
        if not isinstance(values, tuple) or isinstance(value, tuple) or not isinstance(index, int):
            raise MacroFault(at.at, "only an item of a list can be given a value, by a whole number")
        if not 0 <= index < len(values):
            raise MacroFault(at.at, f"there is no item {index} in a list of {len(values)}, counted from 0")
        return Items([*values[:index], value, *values[index + 1 :]])


@dataclass(slots=True)
class _Survey(_Filling):
    """Gives the lines of every branch that may be taken.

    Attributes:
        unknown: stands where there is no value.
        sure: variables whose value hangs on nothing but the macro; they decide conditions.
        line: what the line has so far; it stands before each branch of a block.
        open: how many branches around may be taken or not.
    """

    unknown: str = "0"
    sure: dict[str, Value] = field(default_factory=dict)
    line: str = ""
    open: int = 0

    def parts(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """The texts of all branches."""
        for text in _Filling.parts(self, pieces):
            self.line = (self.line + text).rpartition("\n")[2][:_LONGEST_PREFIX]
            yield text

    def shown(self, piece: _Show) -> str:
        """The value of an expression as text."""
        try:
            return _Filling.shown(self, piece)
        except MacroFault:
            return self.unknown

    def assign(self, piece: _Assign) -> None:
        """Give a variable its value, which is sure where it hangs on nothing unsure."""
        with suppress(MacroFault):
            _Filling.assign(self, piece)
        self.sure.pop(piece.name.text, None)
        with suppress(MacroFault):
            if not (self.open or piece.index):
                self.sure[piece.name.text] = value_or_list(piece.tree, self.sure)

    def block(self, block: _Block) -> Iterator[str]:
        """The branches that may be taken, each with the begin of its line, all but the last with an end of it."""
        begin, number = self.line, 0
        for mark, pieces in block.branches:
            taken = self._taken(mark)
            if taken is not False:
                if number:
                    yield f"\n{begin}"
                self.line, number = begin, number + 1
                self.open += taken is None or number > 1
                yield from self.parts(pieces)
                self.open -= taken is None or number > 1
            if taken:
                return

    def _taken(self, mark: _Mark) -> bool | None:
        """Whether a branch is taken if none before it is; None: that hangs on the print."""
        try:
            return mark.condition is None or is_true(mark.condition, self.sure)
        except MacroFault:
            return None


def read_template(text: str, place: str) -> Template:
    """The template that a macro is.

    Args:
        text: the macro.
        place: which setting holds it, for errors.

    Raises:
        ProfileError: naming setting, line and column of what cannot be read.
    """
    source = text.replace("\r\n", "\n")
    try:
        flat = _without_marks_alone(_flat(source))
        pieces, _ = _nested(flat, 0, [])
    except MacroFault as fault:
        _refuse(fault, place, source)
    return Template(place, source, pieces)


def escaped(text: str) -> str:
    """A macro that comes out as this text: braces and square brackets stand for themselves."""
    return re.sub(r"[{\[]", lambda one: f'{{"{one[0]}"}}', text)


def _flat(source: str) -> Iterator[_Flat]:
    """Text, values, assignments and marks one after the other; every line of text is a piece of its own."""
    if len(source) > _LONGEST:
        raise MacroFault(0, f"a macro of more than {_LONGEST} characters", "put less into it")
    place, doubled, remark = 0, False, False
    while place < len(source):
        found = _BRACE.search(source, place)
        end = found.start() if found else len(source)
        if end > place:
            yield source[place:end]
            remark = remark or ";" in source[place:end]
        sign = source[end : end + 1]
        square = _SQUARE.match(source, end) if sign == "[" else None
        place = end + 1
        if sign == "\n":
            yield sign
            doubled = remark = False
        elif sign == "{" and not source.startswith("{{", end):
            pieces, place = _braced(source, end, remark=remark)
            yield from pieces
        elif square:
            tree: Node = Name(square[1], end + 1)
            if square[2] is not None:
                index = Literal(int(square[2]), end) if square[2].isdigit() else Name(square[2], end)
                tree = Index(tree, index, end)
            yield _Show(tree, square[0], remark)
            place = square.end()
        elif sign:
            pair = sign == "{" or (sign == "}" and doubled and source.startswith("}}", end))
            doubled = sign == "{" if pair else doubled
            yield sign
            place += pair


def _braced(source: str, begin: int, *, remark: bool) -> tuple[list[_Flat], int]:
    """What stands between the braces that begin here, and the place behind them."""
    reader = ExpressionReader(source, begin + 1)
    found: list[Node | _Mark | _Assign] = []
    if reader.next.kind == "end" and reader.next.text:
        raise MacroFault(
            begin + 1, "nothing between the braces", "write {name}, or {{}} for braces themselves"
        )
    while reader.next.kind != "end":
        if not reader.taken(";"):
            found.append(_statement(reader))
    if not reader.next.text:
        raise MacroFault(begin, "a brace without its partner", "write {name}, or {{ for a brace itself")
    end = reader.next.behind
    if found and isinstance(found[0], _Mark):
        found[0] = _Mark(found[0].word, found[0].condition, begin)
    pieces = [
        one if isinstance(one, _Mark | _Assign) else _Show(one, source[begin:end], remark) for one in found
    ]
    return [*pieces], end


def _statement(reader: ExpressionReader) -> Node | _Mark | _Assign:
    """One mark, assignment or expression, and that it ends there."""
    if mark := reader.taken("else", "endif"):
        return _Mark(mark.text, None, mark.at)
    if mark := reader.taken("if", "elsif"):
        if reader.next.kind == "end":
            raise MacroFault(
                reader.next.at, f"{mark.text} without a condition", f"write {{{mark.text} a > b}}"
            )
        found: Node | _Mark | _Assign = _Mark(mark.text, reader.expression(), mark.at)
        if reader.taken("then"):
            return found
    else:
        found = _assignment_or_value(reader)
    if reader.next.kind != "end" and reader.next.text not in (";", *_MARKS):
        raise reader.unexpected("an operator or }")
    return found


def _assignment_or_value(reader: ExpressionReader) -> Node | _Assign:
    """`local x = 1`, `global x = 1`, `x = 1`, `x[0] = 1`, or an expression."""
    if scope := reader.taken("local", "global"):
        name = reader.taken_name()
        if name is None:
            raise reader.unexpected("the name of a variable")
        reader.expect("=")
        return _Assign(scope.text, name, None, reader.expression())
    first = reader.next
    tree = reader.expression()
    target, index = (tree.of, tree.index) if isinstance(tree, Index) else (tree, None)
    if isinstance(target, Name) and reader.taken("="):
        return _Assign("", first, index, reader.expression())
    return tree


def _without_marks_alone(flat: Iterator[_Flat]) -> list[_Flat]:
    """The pieces without the blanks and ends of lines that hold nothing but marks and assignments."""
    kept: list[_Flat] = []
    line: list[_Flat] = []
    for piece in (*flat, ""):
        line.append(piece)
        if piece not in ("\n", ""):
            continue
        silent = [one for one in line if isinstance(one, _Mark | _Assign)]
        others = [one for one in line if not isinstance(one, _Mark | _Assign)]
        blank = silent and all(isinstance(one, str) and not one.strip() for one in others)
        kept += silent if blank else line
        line = []
    return kept


def _nested(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[tuple[_Piece, ...], int]:
    """The pieces up to a mark that ends the block they are in, or to the end of the macro; and where that is."""
    pieces: list[_Piece] = []
    while place < len(flat):
        piece = flat[place]
        if not isinstance(piece, _Mark):
            pieces.append(piece)
            place += 1
        elif piece.word == "if":
            if len(open_marks) == _DEEPEST:
                raise MacroFault(piece.at, f"blocks nested deeper than {_DEEPEST} times")
            block, place = _block(flat, place, [*open_marks, piece])
            pieces.append(block)
        elif not open_marks:
            raise MacroFault(piece.at, f"{{{piece.word}}} without {{if ...}}")
        else:
            break
    return tuple(pieces), place


def _block(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[_Block, int]:
    """A whole block that begins here, and the place behind its end."""
    first = mark = open_marks[-1]
    branches: list[tuple[_Mark, tuple[_Piece, ...]]] = []
    while mark.word != "endif":
        pieces, place = _nested(flat, place + 1, open_marks)
        branches.append((mark, pieces))
        if place == len(flat):
            raise MacroFault(first.at, "{if ...} without {endif}", "end the block with {endif}")
        following = flat[place]
        assert isinstance(following, _Mark)
        if mark.word == "else" and following.word != "endif":
            raise MacroFault(following.at, f"{{{following.word}}} behind {{else}}")
        mark = following
    return _Block(tuple(branches)), place + 1


def _refuse(fault: MacroFault, place: str, source: str) -> Never:
    """Raise with the line and a mark under the place that is wrong."""
    at = min(fault.at, len(source))
    start = source.rfind("\n", 0, at) + 1
    line = source[start:].partition("\n")[0]
    text = "".join(letter if letter.isprintable() else " " for letter in line)
    column = at - start
    begin = max(0, column - _SHOWN // 2)
    shown = text[begin : begin + _SHOWN]
    raise ProfileError(
        f"{place}: line {source.count(chr(10), 0, at) + 1}, column {column + 1}: {fault.problem}\n"
        f"  {shown}\n  {' ' * (column - begin)}^",
        remedy=fault.remedy,
    ) from None
