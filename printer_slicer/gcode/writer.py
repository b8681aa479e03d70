"""Write a program as a G-code file: header, start G-code, moves with lines between them, end G-code, settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int
from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode.facts import collect_end_facts, collect_print_facts
from printer_slicer.gcode.inserted_lines import (
    ExtrusionComments,
    InsertedLines,
    WriteContext,
    find_firmware_retractions,
    find_macros_that_take_time,
    format_fan,
    format_first_progress,
    read_macro,
)
from printer_slicer.gcode.labels import (
    ObjectMark,
    choose_marking,
    find_moves_after_labels,
    find_object_changes,
    format_object_definitions,
)
from printer_slicer.gcode.move_text import RowPlan, RowText, format_rows, plan_rows, split_by_layers
from printer_slicer.gcode.moves import Timer
from printer_slicer.gcode.reader import MoveReader, read_moves
from printer_slicer.gcode.summary import format_footer, format_header
from printer_slicer.macros import Value
from printer_slicer.model import Labels, Program
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = ["ProgramFacts", "write_gcode", "write_program"]


class ProgramFacts(Struct, frozen=True, eq=False):
    """Facts about a program besides its moves.

    Attributes:
        seconds: (K,) estimated time of each move.
        facts: further facts for the header.
        comments: lines to insert after the first one.
        labels: which moves belong to which object.
        made: date in UTC; None: no date.
        name: name of the sliced file, without suffix.
    """

    seconds: Float | None = None
    facts: Sequence[str] = ()
    comments: Sequence[str] = ()
    labels: Labels | None = None
    made: datetime | None = None
    name: str = ""


def write_program(
    program: Program,
    profile: Profile,
    dialect: Dialect,
    facts: ProgramFacts,
) -> Iterator[bytes]:
    """Yield a program as the content of a G-code file, some layers at a time; the same arguments give the same bytes.

    Each piece ends with a line. If times are known, all macros are evaluated before the first piece.

    Args:
        program: the moves.
        profile: the profile that the program was sliced with.
        dialect: G-code dialect of the printer.
        facts: facts besides the moves.

    Raises:
        ProfileError: a macro cannot be evaluated.
    """
    file = _prepare_file(program, profile, dialect, facts)
    macro_seconds = float(file.macro_times[-1])
    if macro_seconds:
        # Macros between the moves were timed one by one, from rest to rest. The whole file gives their real time.
        known = file.with_macros(1.0)
        wanted = _estimate_file_seconds(_format_file(known), profile, dialect)
        total = float(known.context.begins[-1])
        file = file.with_macros(1 + (wanted - total) / macro_seconds)
    yield from _format_file(file)


class _File(Struct, frozen=True, eq=False):
    """A file before its text is formatted.

    Attributes:
        context: inputs of the parts of the file.
        facts: facts besides the moves.
        start: lines of the start G-code.
        end: lines of the end G-code.
        formatted: the rows of the moves.
        macro_times: (K + 1,) estimated time of all macros before each move and at the end, s; (1,) zero without macros.
    """

    context: WriteContext
    facts: ProgramFacts
    start: list[str]
    end: list[str]
    formatted: _PlannedMoves
    macro_times: Float

    def with_macros(self, factor: float) -> _File:
        """Add the times of macros between moves, multiplied by a factor, to the times of the moves."""
        return replace(
            self, context=replace(self.context, begins=self.context.begins + factor * self.macro_times)
        )


def _prepare_file(program: Program, profile: Profile, dialect: Dialect, facts: ProgramFacts) -> _File:
    """Evaluate the macros, and compute the start of each move and the rows of text."""
    seconds, labels = facts.seconds, facts.labels
    total = 0.0 if seconds is None else float(seconds.sum())
    known = collect_print_facts(program, profile, total, labels.names if labels else (), facts.name)
    shared: dict[str, Value] = {}
    start = [
        *_format_tool_selection(profile, known, shared),
        *read_macro(profile, "start_gcode").render(known, shared),
    ]
    end = read_macro(profile, "end_gcode").render(
        known | dict(collect_end_facts(program, profile)), dict(shared)
    )
    begins = np.zeros(program.n_moves + 1)
    if seconds is not None:
        np.cumsum(seconds, out=begins[1:])
        begins += _estimate_seconds(start, profile, dialect)
        begins[-1] += _estimate_seconds(end, profile, dialect, _format_approach(program, program.n_moves))
    context = WriteContext(
        program, profile, dialect, known, begins, choose_marking(profile, dialect, labels), shared
    )
    formatted = _plan_moves(context)
    taken = np.zeros(1) if seconds is None else _estimate_macro_times(context, formatted.rows)
    return _File(context, facts, start, end, formatted, taken)


def _format_file(file: _File) -> Iterator[bytes]:
    """Yield the text of the file: what stands before the moves, some layers at a time, and what stands after them."""
    context, facts = file.context, file.facts
    program, profile, dialect = context.program, context.profile, context.dialect
    total = None if facts.seconds is None else float(context.begins[-1])
    first, *others = format_header(program, total, facts.facts, facts.made)
    before = [first, *facts.comments, *others]
    before += format_first_progress(context)
    before += ["G21 ; mm", "G90", "M83", format_fan(0.0)]
    before += [*dialect.limits(profile.printer), *_format_retraction_setup(profile, dialect), *file.start]
    if profile.pressure_advance and dialect.pressure_advance:
        before.append(dialect.pressure_advance(profile.pressure_advance))
    before += format_object_definitions(context.marking)
    before += ["G90", "M83" if profile.printer.relative_extrusion else "M82", "G92 E0"]
    yield _encode_lines(before)
    yield from _format_body(context, file.formatted)
    yield _encode_lines([*file.end, *format_footer(program, profile, total)])


def _estimate_file_seconds(pieces: Iterator[bytes], profile: Profile, dialect: Dialect) -> float:
    """Estimate the time of a file in pieces, s."""
    reader, timer = MoveReader(profile.printer.corners[0], dialect), Timer(limits_of(profile.printer))
    for piece in pieces:
        commands = (line.partition(b";")[0].strip() for line in piece.split(b"\n"))
        reader.feed([command for command in commands if command])
        timer.add(reader.take_moves())
    return timer.seconds()


def _format_tool_selection(
    profile: Profile, known: Mapping[str, Value], shared: dict[str, Value]
) -> list[str]:
    """Format the commands that select the tool; the start G-code then heats it."""
    template = read_macro(profile, "tool_gcode")
    if template.is_empty:
        return [f"T{profile.printer.tool}"] if profile.printer.tool else []
    return template.render(known, shared)


def _estimate_macro_times(context: WriteContext, rows: RowPlan) -> Float:
    """Estimate the time, s, of all macros before each move and at the end, (K + 1,); (1,) zero without macros."""
    program, found = context.program, list(find_macros_that_take_time(context, rows))
    if not found:
        return np.zeros(1)
    taken = np.zeros(program.n_moves + 1)
    for move, lines in found:
        before = _format_approach(program, move)
        taken[move] += _estimate_seconds(lines, context.profile, context.dialect, before)
    return np.cumsum(taken, out=taken)


def _format_approach(program: Program, move: int) -> list[str]:
    """Format a move to the position at which the move with this index starts."""
    if not move:
        return []
    x, y, z = program.xyz[move - 1]
    return [f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f} F6000"]


def _estimate_seconds(
    lines: Sequence[str], profile: Profile, dialect: Dialect, before: Sequence[str] = ()
) -> float:
    """Estimate the time of moves and dwells in a macro, s, if it runs after the lines `before`."""

    def estimate(texts: Sequence[str]) -> float:
        """Estimate the time of lines, s, if the nozzle starts at the endstops."""
        commands = [text.partition(";")[0].strip().encode("ascii", "replace") for text in texts]
        moves = read_moves([text for text in commands if text], profile.printer.corners[0], dialect)
        return moves.seconds(limits_of(profile.printer))

    return estimate([*before, *lines]) - (estimate(before) if before else 0.0)


def _format_retraction_setup(profile: Profile, dialect: Dialect) -> list[str]:
    """Format the commands that set up firmware retraction."""
    return (
        dialect.retraction(profile.printer)
        if profile.printer.firmware_retraction and dialect.retraction
        else []
    )


def _encode_lines(lines: list[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode("ascii", "replace")


class _PlannedMoves(Struct, frozen=True, eq=False):
    """The rows of the moves, which of them are firmware retractions (K,), and where objects start and end."""

    rows: RowPlan
    retractions: NDArray[np.int8]
    marks: list[ObjectMark]


def _plan_moves(context: WriteContext) -> _PlannedMoves:
    program, profile = context.program, context.profile
    retractions = find_firmware_retractions(program, profile)
    fed = (
        replace(program, filament=np.where(retractions != 0, 0.0, program.filament))
        if retractions.any()
        else program
    )
    marks = find_object_changes(program, context.marking[0]) if context.marking else []
    rows = plan_rows(fed, relative=profile.printer.relative_extrusion, full=find_moves_after_labels(marks))
    return _PlannedMoves(rows, retractions, marks)


def _format_body(context: WriteContext, planned: _PlannedMoves) -> Iterator[bytes]:
    """Yield the rows of the moves with the lines between them, some layers at a time."""
    program, feed = context.program, -1
    lines = InsertedLines(context, planned.rows, planned.retractions, planned.marks)
    comments = ExtrusionComments(program)
    for moves in split_by_layers(program):
        rows = format_rows(planned.rows, moves, feed)
        feed = rows.feed
        yield _insert_lines(rows, moves.start, lines.take_before(moves.stop), comments.take(moves))
    yield _encode_lines(lines.take_before(program.n_moves + 1).get(program.n_moves, []))


def _insert_lines(
    rows: RowText, first: int, notes: Mapping[int, list[str]], comments: tuple[Int, list[bytes]]
) -> bytes:
    """Return the rows of the moves from `first` on, with the lines and the comments of extrusions between them."""
    others = sorted(notes)
    beads, more = comments
    texts = [*(_encode_lines(notes[index]) for index in others), *more]
    index = np.concatenate([np.array(others, np.int64), beads]) - first
    order = np.argsort(index, kind="stable")  # comments of extrusions come last
    places = [0, *rows.start[index[order]].tolist(), len(rows.text)]
    between = [rows.text[begin:end] for begin, end in pairwise(places)]
    inserted = [*map(texts.__getitem__, order.tolist()), b""]
    return b"".join(chain.from_iterable(zip(between, inserted, strict=True)))


def write_gcode(  # noqa: PLR0913 - facts about a program
    program: Program,
    profile: Profile,
    seconds: Float | None = None,
    facts: Sequence[str] = (),
    *,
    comments: Sequence[str] = (),
    labels: Labels | None = None,
    dialect: Dialect | None = None,
    made: datetime | None = None,
    name: str = "",
) -> bytes:
    """Write a program in the printer's dialect, with the settings as comments.

    Args:
        program: the moves.
        profile: the profile it was sliced with, including the macros.
        seconds: (K,) estimated time of each move; None: unknown, and lines that need it are left out.
        facts: further facts for the header.
        comments: lines to insert after the first one.
        labels: which moves belong to which object.
        dialect: G-code dialect; None: that of the profile's flavour.
        made: date in UTC for the first line; None: no date.
        name: name of the sliced file, without suffix, for macros.

    Raises:
        ProfileError: a macro cannot be evaluated.
    """
    dialect = dialect or FLAVOURS[profile.printer.flavour]
    facts_besides = ProgramFacts(seconds, facts, comments, labels, made, name)
    return b"".join(write_program(program, profile, dialect, facts_besides))
