"""Macros: lines of G-code with expressions in braces and conditional blocks, as in PrusaSlicer.

    {name} {a + b}          the value of an expression
    [name] [name[0]]        the value of a name
    {if a} ... {elsif b} ... {else} ... {endif}
                            over several lines or within one; a line with nothing else is removed
    {local x = 1} {global x = 1} {x = 2} {x[0] = 2}
                            variables of this macro, or of all macros of a print; no output
    {if a then x = 1; else x = 2; endif}
                            several of these in the same braces
    {{ }}                   literal braces (an extension of PrusaSlicer's language)

After a semicolon, unknown names stay as they are, because they belong to a comment. Python's `eval` is never used. All
costs are limited: length of a macro, tokens of an expression, nesting of expressions and blocks, texts and lists, and
characters of output. There are no loops.
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
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, format_value

__all__ = ["Template", "escape_braces", "read_template"]

_LONGEST: Final = 300_000
_DEEPEST: Final = 20
_MOST_CHARACTERS: Final = 1_000_000
_LONGEST_PREFIX: Final = 500  # characters of a line before a block that are repeated for each branch
_SHOWN: Final = 100  # characters of a line in a message, around the error
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
    """An expression whose value is inserted; in a comment, unknown names leave `source`."""

    tree: Node
    source: str
    remark: bool


@dataclass(frozen=True, slots=True)
class _Assign:
    """An assignment to a variable: `local`, `global`, or neither for an existing variable."""

    scope: str
    name: Token
    index: Node | None
    tree: Node


@dataclass(frozen=True, slots=True)
class _Block:
    """The branches of an `if`; the first one whose condition is true is used. `else` has the condition None."""

    branches: tuple[tuple[_Mark, tuple[_Piece, ...]], ...]


_Piece = str | _Show | _Assign | _Block
_Flat = str | _Show | _Assign | _Mark


@dataclass(frozen=True, slots=True)
class Template:
    """A parsed macro.

    Attributes:
        place: name of its setting, for errors.
        source: its text.
        pieces: text, expressions, assignments, blocks.
    """

    place: str
    source: str
    pieces: tuple[_Piece, ...]

    @property
    def empty(self) -> bool:
        """Whether it never gives output."""
        return not any(not isinstance(piece, str) or piece.strip() for piece in self.pieces)

    def render(self, known: Mapping[str, Value], shared: dict[str, Value] | None = None) -> list[str]:
        """Evaluate the macro and return its lines, without empty lines at both ends.

        Args:
            known: values by name; see `check`.
            shared: global variables, changed in place.

        Raises:
            ProfileError: the macro cannot be evaluated; names setting, line and column.
        """
        text, size = [], 0
        filling = _Renderer(known, {} if shared is None else shared)
        try:
            for part in filling.parts(self.pieces):
                size += len(part)
                if size > _MOST_CHARACTERS:
                    raise ProfileError(
                        f"{self.place}: the result is longer than {_MOST_CHARACTERS} characters",
                        remedy="Shorten lists and texts that it repeats",
                    )
                text.append(part)
        except MacroFault as fault:
            _raise_error(fault, self.place, self.source)
        return "".join(text).strip("\n").splitlines()

    def possible_lines(self, known: Mapping[str, Value], unknown: str = "0") -> list[str]:
        """Return the lines of every branch that may be used.

        Conditions that depend only on the macro itself are evaluated; all others may be true or false.

        Args:
            known: values to insert; they do not decide conditions.
            unknown: text to insert for unknown values.
        """
        survey = _BranchRenderer(known, {}, unknown=unknown)
        return "".join(survey.parts(self.pieces)).splitlines()

    def check(self, known: Collection[str]) -> None:
        """Check that every name and function exists, also in unused blocks.

        Raises:
            ProfileError: a name or function is unknown; names setting, line and column.
        """
        for fault in self.faults(known):
            _raise_error(fault, self.place, self.source)

    def faults(self, known: Collection[str]) -> Iterator[MacroFault]:
        """Yield every unknown name and function, except names in comments."""
        variables = {piece.name.text for piece in _walk(self.pieces) if isinstance(piece, _Assign)}
        there = {*known, *variables}
        for piece in _walk(self.pieces):
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
        """Return the line of a fault, from 1."""
        return self.source.count("\n", 0, fault.at) + 1


def _walk(pieces: tuple[_Piece, ...]) -> Iterator[_Show | _Assign | _Block]:
    """Yield all pieces except texts, including those in blocks."""
    for piece in pieces:
        if not isinstance(piece, str):
            yield piece
        if isinstance(piece, _Block):
            for _, inner in piece.branches:
                yield from _walk(inner)


@dataclass(slots=True)
class _Renderer:
    """Evaluates a macro with known values and its variables."""

    known: Mapping[str, Value]
    shared: dict[str, Value]
    own: dict[str, Value] = field(default_factory=dict)

    @property
    def names(self) -> Mapping[str, Value]:
        """All current values by name."""
        return ChainMap(self.own, self.shared, self.known)  # type: ignore[arg-type]

    def parts(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """Yield the parts of the output."""
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
        """Return the value of an expression as text."""
        try:
            value = value_or_list(piece.tree, self.names)
        except UnknownName:
            if piece.remark:
                return piece.source
            raise
        if isinstance(value, tuple) and sum(len(str(one)) for one in value) > _MOST_CHARACTERS:
            raise MacroFault(piece.tree.at, f"the list is longer than {_MOST_CHARACTERS} characters")
        return format_value(value)

    def block(self, block: _Block) -> Iterator[str]:
        """Yield the output of the branch whose condition is true."""
        for mark, pieces in block.branches:
            if mark.condition is None or is_true(mark.condition, self.names):
                yield from self.parts(pieces)
                return

    def assign(self, piece: _Assign) -> None:
        """Assign a value to a variable."""
        name, value = piece.name.text, value_or_list(piece.tree, self.names)
        where = {"local": self.own, "global": self.shared}.get(piece.scope)
        if where is None:
            where = self.own if name in self.own else self.shared
            if name not in where:
                raise MacroFault(
                    piece.name.at, f"no variable {name}", f"Define it with {{local {name} = ...}}"
                )
        if piece.index is not None:
            value = self._replaced(where[name], piece.index, value)
        where[name] = value

    def _replaced(self, values: Value, at: Node, value: Value) -> Items:
        """Return a list with one item replaced."""
        index = evaluate(at, self.names)
        if not isinstance(values, tuple) or isinstance(value, tuple) or not isinstance(index, int):
            raise MacroFault(at.at, "only an item of a list, with a whole number as index, can be assigned")
        if not 0 <= index < len(values):
            raise MacroFault(at.at, f"no item {index} in a list of {len(values)}; items count from 0")
        return Items([*values[:index], value, *values[index + 1 :]])


@dataclass(slots=True)
class _BranchRenderer(_Renderer):
    """Returns the lines of every branch that may be used.

    Attributes:
        unknown: text to insert for unknown values.
        sure: variables whose value depends only on the macro; they decide conditions.
        line: the current line so far, repeated before each branch of a block.
        open: number of enclosing branches that may be unused.
    """

    unknown: str = "0"
    sure: dict[str, Value] = field(default_factory=dict)
    line: str = ""
    open: int = 0

    def parts(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """Yield the output of all branches."""
        for text in _Renderer.parts(self, pieces):
            self.line = (self.line + text).rpartition("\n")[2][:_LONGEST_PREFIX]
            yield text

    def shown(self, piece: _Show) -> str:
        """Return the value of an expression as text."""
        try:
            return _Renderer.shown(self, piece)
        except MacroFault:
            return self.unknown

    def assign(self, piece: _Assign) -> None:
        """Assign a value to a variable, and to `sure` if it depends only on the macro."""
        with suppress(MacroFault):
            _Renderer.assign(self, piece)
        self.sure.pop(piece.name.text, None)
        with suppress(MacroFault):
            if not (self.open or piece.index):
                self.sure[piece.name.text] = value_or_list(piece.tree, self.sure)

    def block(self, block: _Block) -> Iterator[str]:
        """Yield the branches that may be used, each on a line of its own with the start of the current line."""
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
        """Return whether a branch is used if no earlier one is; None: that depends on the print."""
        try:
            return mark.condition is None or is_true(mark.condition, self.sure)
        except MacroFault:
            return None


def read_template(text: str, place: str) -> Template:
    """Parse a macro.

    Args:
        text: the macro.
        place: name of its setting, for errors.

    Raises:
        ProfileError: the macro has a syntax error; names setting, line and column.
    """
    source = text.replace("\r\n", "\n")
    try:
        flat = _drop_silent_lines(_split_pieces(source))
        pieces, _ = _nest_blocks(flat, 0, [])
    except MacroFault as fault:
        _raise_error(fault, place, source)
    return Template(place, source, pieces)


def escape_braces(text: str) -> str:
    """Escape braces and square brackets, so that a macro gives the text unchanged."""
    return re.sub(r"[{\[]", lambda one: f'{{"{one[0]}"}}', text)


def _split_pieces(source: str) -> Iterator[_Flat]:
    """Yield text, values, assignments and marks in order; every line of text is a separate piece."""
    if len(source) > _LONGEST:
        raise MacroFault(0, f"the macro is longer than {_LONGEST} characters", "Shorten it")
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
            pieces, place = _parse_braces(source, end, remark=remark)
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


def _parse_braces(source: str, begin: int, *, remark: bool) -> tuple[list[_Flat], int]:
    """Parse the braces that start here; return their pieces and the position after them."""
    reader = ExpressionReader(source, begin + 1)
    found: list[Node | _Mark | _Assign] = []
    if reader.next.kind == "end" and reader.next.text:
        raise MacroFault(begin + 1, "nothing between the braces", "Write {name}, or {{}} for literal braces")
    while reader.next.kind != "end":
        if not reader.accept(";"):
            found.append(_statement(reader))
    if not reader.next.text:
        raise MacroFault(begin, "unmatched brace", "Write {name}, or {{ for a literal brace")
    end = reader.next.behind
    if found and isinstance(found[0], _Mark):
        found[0] = _Mark(found[0].word, found[0].condition, begin)
    pieces = [
        one if isinstance(one, _Mark | _Assign) else _Show(one, source[begin:end], remark) for one in found
    ]
    return [*pieces], end


def _statement(reader: ExpressionReader) -> Node | _Mark | _Assign:
    """Parse one mark, assignment or expression."""
    if mark := reader.accept("else", "endif"):
        return _Mark(mark.text, None, mark.at)
    if mark := reader.accept("if", "elsif"):
        if reader.next.kind == "end":
            raise MacroFault(
                reader.next.at, f"{mark.text} without a condition", f"Write {{{mark.text} a > b}}"
            )
        found: Node | _Mark | _Assign = _Mark(mark.text, reader.expression(), mark.at)
        if reader.accept("then"):
            return found
    else:
        found = _assignment_or_value(reader)
    if reader.next.kind != "end" and reader.next.text not in (";", *_MARKS):
        raise reader.unexpected("an operator or }")
    return found


def _assignment_or_value(reader: ExpressionReader) -> Node | _Assign:
    """Parse `local x = 1`, `global x = 1`, `x = 1`, `x[0] = 1`, or an expression."""
    if scope := reader.accept("local", "global"):
        name = reader.accept_name()
        if name is None:
            raise reader.unexpected("the name of a variable")
        reader.expect("=")
        return _Assign(scope.text, name, None, reader.expression())
    first = reader.next
    tree = reader.expression()
    target, index = (tree.of, tree.index) if isinstance(tree, Index) else (tree, None)
    if isinstance(target, Name) and reader.accept("="):
        return _Assign("", first, index, reader.expression())
    return tree


def _drop_silent_lines(flat: Iterator[_Flat]) -> list[_Flat]:
    """Return the pieces without blanks and line breaks of lines that hold only marks and assignments."""
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


def _nest_blocks(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[tuple[_Piece, ...], int]:
    """Return the pieces up to the end of their block or of the macro, and the position of that end."""
    pieces: list[_Piece] = []
    while place < len(flat):
        piece = flat[place]
        if not isinstance(piece, _Mark):
            pieces.append(piece)
            place += 1
        elif piece.word == "if":
            if len(open_marks) == _DEEPEST:
                raise MacroFault(piece.at, f"blocks are nested deeper than {_DEEPEST} levels")
            block, place = _block(flat, place, [*open_marks, piece])
            pieces.append(block)
        elif not open_marks:
            raise MacroFault(piece.at, f"{{{piece.word}}} without {{if ...}}")
        else:
            break
    return tuple(pieces), place


def _block(flat: list[_Flat], place: int, open_marks: list[_Mark]) -> tuple[_Block, int]:
    """Return the block that starts here, and the position after its end."""
    first = mark = open_marks[-1]
    branches: list[tuple[_Mark, tuple[_Piece, ...]]] = []
    while mark.word != "endif":
        pieces, place = _nest_blocks(flat, place + 1, open_marks)
        branches.append((mark, pieces))
        if place == len(flat):
            raise MacroFault(first.at, "{if ...} without {endif}", "End the block with {endif}")
        following = flat[place]
        assert isinstance(following, _Mark)
        if mark.word == "else" and following.word != "endif":
            raise MacroFault(following.at, f"{{{following.word}}} after {{else}}")
        mark = following
    return _Block(tuple(branches)), place + 1


def _raise_error(fault: MacroFault, place: str, source: str) -> Never:
    """Raise an error that shows the line with a mark under the position."""
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
