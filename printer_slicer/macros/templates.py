"""Macros: lines of G-code with expressions in braces and conditional blocks, as in PrusaSlicer.

    {name} {a + b}          the value of an expression
    [name] [name[0]]        the value of a name
    {if a} ... {elsif b} ... {else} ... {endif}
                            over several lines or within one; a line with nothing else is removed
    {local x = 1} {global x = 1} {x = 2} {x[0] = 2}
                            variables of this macro, or of all macros of a print; no output
    {if a then x = 1; else x = 2; endif}
                            several of these statements in the same braces
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
from typing import Final, Never

from printer_slicer.errors import ProfileError
from printer_slicer.macros.evaluation import check_name_exists, evaluate, evaluate_with_vectors, is_true
from printer_slicer.macros.syntax import ExpressionReader, Index, Literal, Name, Node, Token, find_names
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, format_value
from printer_slicer.values import Struct, field

__all__ = ["Template", "escape_braces", "read_template"]

_LONGEST_MACRO: Final = 300_000  # characters
_DEEPEST_BLOCKS: Final = 20  # levels of nested blocks
_MAX_CHARACTERS: Final = 1_000_000  # characters of output
_LONGEST_PREFIX: Final = 500  # characters of a line before a block that are repeated for each branch
_MAX_SHOWN: Final = 100  # characters of a line in a message, around the error
_MARKS: Final = ("if", "elsif", "else", "endif")
_BRACE: Final = re.compile(r"[{\[}\n]")
_SQUARE: Final = re.compile(r"\[\s*([A-Za-z_]\w*)\s*(?:\[\s*(\w+)\s*\]\s*)?\]", re.ASCII)


class _Mark(Struct, frozen=True):
    """The start of a branch or the end of a block: `if`, `elsif`, `else` or `endif`."""

    word: str
    condition: Node | None
    position: int


class _Insertion(Struct, frozen=True):
    """An expression whose value is inserted; in a comment, `source` is inserted if a name is unknown."""

    tree: Node
    source: str
    is_in_comment: bool


class _Assignment(Struct, frozen=True):
    """An assignment to a variable; `scope` is `local` or `global`, or empty for an existing variable."""

    scope: str
    name: Token
    index: Node | None
    tree: Node


class _Block(Struct, frozen=True):
    """The branches of an `if`; the first one whose condition is true is used. `else` has the condition None."""

    branches: tuple[tuple[_Mark, tuple[_Piece, ...]], ...]


_Piece = str | _Insertion | _Assignment | _Block
_FlatPiece = str | _Insertion | _Assignment | _Mark


class Template(Struct, frozen=True):
    """A parsed macro.

    Attributes:
        place: name of the setting that holds the macro, for errors.
        source: text of the macro.
        pieces: texts, expressions, assignments and blocks.
    """

    place: str
    source: str
    pieces: tuple[_Piece, ...]

    @property
    def is_empty(self) -> bool:
        """Whether the macro can never produce output."""
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
        renderer = _Renderer(known, {} if shared is None else shared)
        try:
            for part in renderer.render_pieces(self.pieces):
                size += len(part)
                if size > _MAX_CHARACTERS:
                    raise ProfileError(
                        f"{self.place}: the result is longer than {_MAX_CHARACTERS} characters",
                        remedy="Use shorter lists and texts in the expressions of the macro",
                    )
                text.append(part)
        except MacroFault as fault:
            _raise_error(fault, self.place, self.source)
        return "".join(text).strip("\n").splitlines()

    def list_possible_lines(self, known: Mapping[str, Value], unknown: str = "0") -> list[str]:
        """Return the lines of all branches that may be used.

        Conditions that depend only on the macro itself are evaluated; all others may be true or false.

        Args:
            known: values to insert; they do not decide conditions.
            unknown: text to insert for unknown values.
        """
        branch_renderer = _BranchRenderer(known, {}, unknown=unknown)
        return "".join(branch_renderer.render_pieces(self.pieces)).splitlines()

    def check(self, known: Collection[str]) -> None:
        """Check that all names and functions exist, including those in unused blocks.

        Raises:
            ProfileError: a name or function is unknown; names setting, line and column.
        """
        for fault in self.find_faults(known):
            _raise_error(fault, self.place, self.source)

    def find_faults(self, known: Collection[str]) -> Iterator[MacroFault]:
        """Yield every unknown name and function, except names in comments."""
        variables = {piece.name.text for piece in _walk_pieces(self.pieces) if isinstance(piece, _Assignment)}
        defined = {*known, *variables}
        for piece in _walk_pieces(self.pieces):
            trees = (
                [piece.tree, *([piece.index] if piece.index else [])]
                if isinstance(piece, _Assignment)
                else [mark.condition for mark, _ in piece.branches if mark.condition]
                if isinstance(piece, _Block)
                else [piece.tree]
            )
            for one in (one for tree in trees for one in find_names(tree)):
                try:
                    check_name_exists(one, defined)
                except UnknownName as fault:
                    if not (isinstance(piece, _Insertion) and piece.is_in_comment):
                        yield fault
                except MacroFault as fault:
                    yield fault

    def line_of(self, fault: MacroFault) -> int:
        """Return the line of a fault, from 1."""
        return self.source.count("\n", 0, fault.position) + 1


def _walk_pieces(pieces: tuple[_Piece, ...]) -> Iterator[_Insertion | _Assignment | _Block]:
    """Yield all pieces except texts, including those in blocks."""
    for piece in pieces:
        if not isinstance(piece, str):
            yield piece
        if isinstance(piece, _Block):
            for _, inner in piece.branches:
                yield from _walk_pieces(inner)


class _Renderer(Struct):
    """Evaluates a macro with known values and with variables."""

    known: Mapping[str, Value]
    shared: dict[str, Value]
    own: dict[str, Value] = field(default_factory=dict)

    @property
    def names(self) -> Mapping[str, Value]:
        """All current values by name."""
        return ChainMap(self.own, self.shared, self.known)  # type: ignore[arg-type]

    def render_pieces(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """Yield the output of pieces, part by part."""
        for piece in pieces:
            match piece:
                case str():
                    yield piece
                case _Insertion():
                    yield self.render_insertion(piece)
                case _Assignment():
                    self.assign(piece)
                case _Block():
                    yield from self.render_block(piece)

    def render_insertion(self, piece: _Insertion) -> str:
        """Return the value of an expression as text."""
        try:
            value = evaluate_with_vectors(piece.tree, self.names)
        except UnknownName:
            if piece.is_in_comment:
                return piece.source
            raise
        if isinstance(value, tuple) and sum(len(str(one)) for one in value) > _MAX_CHARACTERS:
            raise MacroFault(piece.tree.position, f"the list is longer than {_MAX_CHARACTERS} characters")
        return format_value(value)

    def render_block(self, block: _Block) -> Iterator[str]:
        """Yield the output of the first branch whose condition is true."""
        for mark, pieces in block.branches:
            if mark.condition is None or is_true(mark.condition, self.names):
                yield from self.render_pieces(pieces)
                return

    def assign(self, piece: _Assignment) -> None:
        """Assign a value to a variable."""
        name, value = piece.name.text, evaluate_with_vectors(piece.tree, self.names)
        where = {"local": self.own, "global": self.shared}.get(piece.scope)
        if where is None:
            where = self.own if name in self.own else self.shared
            if name not in where:
                raise MacroFault(
                    piece.name.position, f"unknown variable {name}", f"Define it with {{local {name} = ...}}"
                )
        if piece.index is not None:
            value = self._replace_item(where[name], piece.index, value)
        where[name] = value

    def _replace_item(self, values: Value, index_node: Node, value: Value) -> Items:
        """Return a list with one item replaced."""
        index = evaluate(index_node, self.names)
        if not isinstance(values, tuple) or isinstance(value, tuple) or not isinstance(index, int):
            raise MacroFault(
                index_node.position,
                "an assignment to an item needs a list, a whole-number index and a single value",
            )
        if not 0 <= index < len(values):
            raise MacroFault(
                index_node.position, f"no item {index} in a list of {len(values)}; the first item is item 0"
            )
        return Items([*values[:index], value, *values[index + 1 :]])


class _BranchRenderer(_Renderer, Struct):
    """Renders all branches that may be used.

    Attributes:
        unknown: text to insert for unknown values.
        certain: variables whose value depends only on the macro; they decide conditions.
        line: the beginning of the current line, which is repeated before each branch of a block.
        open_branches: number of enclosing branches that may be unused.
    """

    unknown: str = "0"
    certain: dict[str, Value] = field(default_factory=dict)
    line: str = ""
    open_branches: int = 0

    def render_pieces(self, pieces: tuple[_Piece, ...]) -> Iterator[str]:
        """Yield the output of all branches."""
        for text in _Renderer.render_pieces(self, pieces):
            self.line = (self.line + text).rpartition("\n")[2][:_LONGEST_PREFIX]
            yield text

    def render_insertion(self, piece: _Insertion) -> str:
        """Return the value of an expression as text."""
        try:
            return _Renderer.render_insertion(self, piece)
        except MacroFault:
            return self.unknown

    def assign(self, piece: _Assignment) -> None:
        """Assign a value to a variable, and to `certain` if it depends only on the macro."""
        with suppress(MacroFault):
            _Renderer.assign(self, piece)
        self.certain.pop(piece.name.text, None)
        with suppress(MacroFault):
            if not (self.open_branches or piece.index):
                self.certain[piece.name.text] = evaluate_with_vectors(piece.tree, self.certain)

    def render_block(self, block: _Block) -> Iterator[str]:
        """Yield the branches that may be used, each on a line of its own with the start of the current line."""
        begin, number = self.line, 0
        for mark, pieces in block.branches:
            is_used = self._is_branch_used(mark)
            if is_used is not False:
                if number:
                    yield f"\n{begin}"
                self.line, number = begin, number + 1
                self.open_branches += is_used is None or number > 1
                yield from self.render_pieces(pieces)
                self.open_branches -= is_used is None or number > 1
            if is_used:
                return

    def _is_branch_used(self, mark: _Mark) -> bool | None:
        """Return whether the condition of a branch is true; None if that depends on the print."""
        try:
            return mark.condition is None or is_true(mark.condition, self.certain)
        except MacroFault:
            return None


def read_template(text: str, place: str) -> Template:
    """Parse a macro.

    Args:
        text: the macro.
        place: name of the setting that holds the macro, for errors.

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


def _split_pieces(source: str) -> Iterator[_FlatPiece]:
    """Yield texts, insertions, assignments and marks in order; each line of text is a separate piece."""
    if len(source) > _LONGEST_MACRO:
        raise MacroFault(0, f"the macro is longer than {_LONGEST_MACRO} characters", "Shorten it")
    place, doubled, is_in_comment = 0, False, False
    while place < len(source):
        found = _BRACE.search(source, place)
        end = found.start() if found else len(source)
        if end > place:
            yield source[place:end]
            is_in_comment = is_in_comment or ";" in source[place:end]
        sign = source[end : end + 1]
        square = _SQUARE.match(source, end) if sign == "[" else None
        place = end + 1
        if sign == "\n":
            yield sign
            doubled = is_in_comment = False
        elif sign == "{" and not source.startswith("{{", end):
            pieces, place = _parse_braces(source, end, is_in_comment=is_in_comment)
            yield from pieces
        elif square:
            tree: Node = Name(square[1], end + 1)
            if square[2] is not None:
                index = Literal(int(square[2]), end) if square[2].isdigit() else Name(square[2], end)
                tree = Index(tree, index, end)
            yield _Insertion(tree, square[0], is_in_comment)
            place = square.end()
        elif sign:
            pair = sign == "{" or (sign == "}" and doubled and source.startswith("}}", end))
            doubled = sign == "{" if pair else doubled
            yield sign
            place += pair


def _parse_braces(source: str, begin: int, *, is_in_comment: bool) -> tuple[list[_FlatPiece], int]:
    """Parse the braces that start at a position; return their pieces and the position after them."""
    reader = ExpressionReader(source, begin + 1)
    found: list[Node | _Mark | _Assignment] = []
    if reader.next.kind == "end" and reader.next.text:
        raise MacroFault(begin + 1, "nothing between the braces", "Write {name}, or {{}} for literal braces")
    while reader.next.kind != "end":
        if not reader.accept(";"):
            found.append(_parse_statement(reader))
    if not reader.next.text:
        raise MacroFault(begin, "unmatched brace", "Write {name}, or {{ for a literal brace")
    end = reader.next.end_position
    if found and isinstance(found[0], _Mark):
        found[0] = _Mark(found[0].word, found[0].condition, begin)
    pieces = [
        one if isinstance(one, _Mark | _Assignment) else _Insertion(one, source[begin:end], is_in_comment)
        for one in found
    ]
    return [*pieces], end


def _parse_statement(reader: ExpressionReader) -> Node | _Mark | _Assignment:
    """Parse one mark, assignment or expression."""
    if mark := reader.accept("else", "endif"):
        return _Mark(mark.text, None, mark.position)
    if mark := reader.accept("if", "elsif"):
        if reader.next.kind == "end":
            raise MacroFault(
                reader.next.position, f"{mark.text} without a condition", f"Write {{{mark.text} a > b}}"
            )
        found: Node | _Mark | _Assignment = _Mark(mark.text, reader.read_expression(), mark.position)
        if reader.accept("then"):
            return found
    else:
        found = _parse_assignment_or_value(reader)
    if reader.next.kind != "end" and reader.next.text not in (";", *_MARKS):
        raise reader.make_unexpected_fault("an operator or }")
    return found


def _parse_assignment_or_value(reader: ExpressionReader) -> Node | _Assignment:
    """Parse `local x = 1`, `global x = 1`, `x = 1`, `x[0] = 1`, or an expression."""
    if scope := reader.accept("local", "global"):
        name = reader.accept_name()
        if name is None:
            raise reader.make_unexpected_fault("the name of a variable")
        reader.expect("=")
        return _Assignment(scope.text, name, None, reader.read_expression())
    first = reader.next
    tree = reader.read_expression()
    target, index = (tree.container, tree.index) if isinstance(tree, Index) else (tree, None)
    if isinstance(target, Name) and reader.accept("="):
        return _Assignment("", first, index, reader.read_expression())
    return tree


def _drop_silent_lines(flat: Iterator[_FlatPiece]) -> list[_FlatPiece]:
    """Return the pieces without the spaces and line breaks of lines that hold only marks and assignments."""
    kept: list[_FlatPiece] = []
    line: list[_FlatPiece] = []
    for piece in (*flat, ""):
        line.append(piece)
        if piece not in ("\n", ""):
            continue
        silent = [one for one in line if isinstance(one, _Mark | _Assignment)]
        others = [one for one in line if not isinstance(one, _Mark | _Assignment)]
        blank = silent and all(isinstance(one, str) and not one.strip() for one in others)
        kept += silent if blank else line
        line = []
    return kept


def _nest_blocks(
    flat: list[_FlatPiece], place: int, open_marks: list[_Mark]
) -> tuple[tuple[_Piece, ...], int]:
    """Nest the pieces up to the end of a branch or of the macro into blocks; also return the index of that end."""
    pieces: list[_Piece] = []
    while place < len(flat):
        piece = flat[place]
        if not isinstance(piece, _Mark):
            pieces.append(piece)
            place += 1
        elif piece.word == "if":
            if len(open_marks) == _DEEPEST_BLOCKS:
                raise MacroFault(piece.position, f"blocks are nested deeper than {_DEEPEST_BLOCKS} levels")
            block, place = _parse_block(flat, place, [*open_marks, piece])
            pieces.append(block)
        elif not open_marks:
            raise MacroFault(piece.position, f"{{{piece.word}}} without {{if ...}}")
        else:
            break
    return tuple(pieces), place


def _parse_block(flat: list[_FlatPiece], place: int, open_marks: list[_Mark]) -> tuple[_Block, int]:
    """Return the block that starts at an index, and the index after its end."""
    first = mark = open_marks[-1]
    branches: list[tuple[_Mark, tuple[_Piece, ...]]] = []
    while mark.word != "endif":
        pieces, place = _nest_blocks(flat, place + 1, open_marks)
        branches.append((mark, pieces))
        if place == len(flat):
            raise MacroFault(first.position, "{if ...} without {endif}", "End the block with {endif}")
        following = flat[place]
        assert isinstance(following, _Mark)
        if mark.word == "else" and following.word != "endif":
            raise MacroFault(following.position, f"{{{following.word}}} after {{else}}")
        mark = following
    return _Block(tuple(branches)), place + 1


def _raise_error(fault: MacroFault, place: str, source: str) -> Never:
    """Raise an error that shows the line of a fault, with a mark under its position."""
    position = min(fault.position, len(source))
    start = source.rfind("\n", 0, position) + 1
    line = source[start:].partition("\n")[0]
    text = "".join(letter if letter.isprintable() else " " for letter in line)
    column = position - start
    begin = max(0, column - _MAX_SHOWN // 2)
    shown = text[begin : begin + _MAX_SHOWN]
    raise ProfileError(
        f"{place}: line {source.count(chr(10), 0, position) + 1}, column {column + 1}: {fault.problem}\n"
        f"  {shown}\n  {' ' * (column - begin)}^",
        remedy=fault.remedy,
    ) from None
