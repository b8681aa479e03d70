"""Write a program as a G-code file: header, start G-code, moves with lines between them, end G-code, settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain, pairwise

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode.facts import collect_end_facts, collect_print_facts
from printer_slicer.gcode.inserted_lines import (
    WriteContext,
    collect_insertions,
    find_firmware_retractions,
    find_macros_that_take_time,
    format_extrusion_comments,
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
from printer_slicer.gcode.move_text import MoveText, format_moves
from printer_slicer.gcode.reader import read_moves
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
) -> bytes:
    """Return a program as the content of a G-code file; the same arguments give the same bytes.

    Args:
        program: the moves.
        profile: the profile that the program was sliced with.
        dialect: G-code dialect of the printer.
        facts: facts besides the moves.
    """
    text, total, taken = _format_file(program, profile, dialect, facts)
    if not taken:
        return text
    # Macros between the moves were timed one by one, from rest to rest. The whole file gives their real time.
    wanted = _estimate_seconds(text.decode("ascii").split("\n"), profile, dialect)
    return _format_file(program, profile, dialect, facts, macro_factor=1 + (wanted - total) / taken)[0]


def _format_file(
    program: Program, profile: Profile, dialect: Dialect, facts: ProgramFacts, *, macro_factor: float = 1.0
) -> tuple[bytes, float, float]:
    """Return the content of the file, its estimated time, s, and the time of macros between moves, s.

    `macro_factor` is a factor for the estimated time of macros between moves.
    """
    seconds, labels = facts.seconds, facts.labels
    each = np.zeros(program.n_moves) if seconds is None else seconds
    known = collect_print_facts(
        program, profile, float(each.sum()), labels.names if labels else (), facts.name
    )
    shared: dict[str, Value] = {}
    start = [
        *_format_tool_selection(profile, known, shared),
        *read_macro(profile, "start_gcode").render(known, shared),
    ]
    end = read_macro(profile, "end_gcode").render(
        known | dict(collect_end_facts(program, profile)), dict(shared)
    )
    begins, taken = np.concatenate([[0.0], np.cumsum(each)]), np.zeros(1)
    if seconds is not None:
        begins += _estimate_seconds(start, profile, dialect)
        begins[-1] += _estimate_seconds(end, profile, dialect, _format_approach(program, program.n_moves))
    context = WriteContext(
        program, profile, dialect, known, begins, choose_marking(profile, dialect, labels), shared
    )
    formatted = _format_moves(context)
    if seconds is not None:
        taken = macro_factor * _estimate_macro_times(context, formatted.rows)
        begins += taken
    total = None if seconds is None else float(begins[-1])
    first, *others = format_header(program, total, facts.facts, facts.made)
    before = [first, *facts.comments, *others]
    before += format_first_progress(context)
    before += ["G21 ; mm", "G90", "M83", format_fan(0.0)]
    before += [*dialect.limits(profile.printer), *_format_retraction_setup(profile, dialect), *start]
    if profile.pressure_advance and dialect.pressure_advance:
        before.append(dialect.pressure_advance(profile.pressure_advance))
    before += format_object_definitions(context.marking)
    before += ["G90", "M83" if profile.printer.relative_extrusion else "M82", "G92 E0"]
    after = [*end, *format_footer(program, profile, total)]
    return (
        b"".join([_encode_lines(before), *_format_body(context, formatted), _encode_lines(after)]),
        total or 0.0,
        float(taken[-1]),
    )


def _format_tool_selection(
    profile: Profile, known: Mapping[str, Value], shared: dict[str, Value]
) -> list[str]:
    """Format the commands that select the tool; the start G-code then heats it."""
    template = read_macro(profile, "tool_gcode")
    if template.is_empty:
        return [f"T{profile.printer.tool}"] if profile.printer.tool else []
    return template.render(known, shared)


def _estimate_macro_times(context: WriteContext, rows: MoveText) -> Float:
    """Estimate the time, s, of all macros before each move and at the end, (K + 1,)."""
    program, taken = context.program, np.zeros(context.program.n_moves + 1)
    for move, lines in find_macros_that_take_time(context, rows):
        before = _format_approach(program, move)
        taken[move] += _estimate_seconds(lines, context.profile, context.dialect, before)
    return np.asarray(np.cumsum(taken))


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


class _FormattedMoves(Struct, frozen=True, eq=False):
    """The moves as text, which of them are firmware retractions (K,), and where objects start and end."""

    rows: MoveText
    retractions: Int
    marks: list[ObjectMark]


def _format_moves(context: WriteContext) -> _FormattedMoves:
    program, profile = context.program, context.profile
    retractions = find_firmware_retractions(program, profile)
    fed = (
        replace(program, filament=np.where(retractions != 0, 0.0, program.filament))
        if retractions.any()
        else program
    )
    marks = find_object_changes(program, context.marking[0]) if context.marking else []
    rows = format_moves(fed, relative=profile.printer.relative_extrusion, full=find_moves_after_labels(marks))
    return _FormattedMoves(rows, retractions, marks)


def _format_body(context: WriteContext, formatted: _FormattedMoves) -> Iterator[bytes]:
    """Yield the rows of the moves with the lines between them."""
    rows = formatted.rows
    notes = collect_insertions(context, rows, formatted.retractions, formatted.marks)
    others = sorted(notes)
    beads, comments = format_extrusion_comments(context.program)
    texts = [*(_encode_lines(notes[index]) for index in others), *comments]
    index = np.concatenate([np.array(others, np.int64), beads])
    order = np.argsort(index, kind="stable")  # comments of extrusions come last
    places = [0, *rows.start[index[order]].tolist()]
    between = [rows.text[begin:end] for begin, end in pairwise(places)]
    yield from chain.from_iterable(zip(between, map(texts.__getitem__, order.tolist()), strict=True))
    yield rows.text[places[-1] :]


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
    return write_program(
        program, profile, dialect, ProgramFacts(seconds, facts, comments, labels, made, name)
    )
