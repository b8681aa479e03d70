"""A program as the text of a file: header, start, moves with what stands between them, end, settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import chain, pairwise

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode.facts import end_facts, print_facts
from printer_slicer.gcode.labels import ObjectMark, definitions, fresh_rows, marking, marks_of
from printer_slicer.gcode.notes import (
    Writing,
    bead_notes,
    begins_with,
    fan_line,
    macro_of,
    macros_between,
    notes_of,
    retracted_by_firmware,
)
from printer_slicer.gcode.reader import read_moves
from printer_slicer.gcode.rows import MoveText, rows_of
from printer_slicer.gcode.summary import first_lines, last_lines
from printer_slicer.macros import Value
from printer_slicer.model import Labels, Program
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile

__all__ = ["ProgramFacts", "write_gcode", "write_program"]


@dataclass(frozen=True, slots=True, eq=False)
class ProgramFacts:
    """What is known of a program besides its moves.

    Attributes:
        seconds: (K,) modelled time of each move.
        facts: more to tell at the top.
        comments: lines that stand behind the first one as they are.
        labels: which moves lay which of several things.
        made: date in UTC; None: no date.
        name: of the file that was sliced, without its suffix.
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
    told: ProgramFacts,
) -> bytes:
    """The whole file; nothing in it depends on when or where it was made, but for the time that `told` may hold.

    Args:
        program: the moves.
        profile: what they were made with.
        dialect: how the printer wants them said.
        told: what else is known.
    """
    text, total, taken = _file(program, profile, dialect, told)
    if not taken:
        return text
    # Macros between the moves were timed one by one, from rest to rest; how they meet the moves the file itself tells.
    wanted = _seconds_of(text.decode("ascii").split("\n"), profile, dialect)
    return _file(program, profile, dialect, told, macros=1 + (wanted - total) / taken)[0]


def _file(
    program: Program, profile: Profile, dialect: Dialect, told: ProgramFacts, *, macros: float = 1.0
) -> tuple[bytes, float, float]:
    """The text, its modelled time, and how much of that macros between moves take: `macros` times what they seem to."""
    seconds, labels = told.seconds, told.labels
    each = np.zeros(program.n_moves) if seconds is None else seconds
    known = print_facts(program, profile, float(each.sum()), labels.names if labels else (), told.name)
    shared: dict[str, Value] = {}
    start = [*_tool(profile, known, shared), *macro_of(profile, "start_gcode").filled(known, shared)]
    end = macro_of(profile, "end_gcode").filled(known | dict(end_facts(program, profile)), dict(shared))
    begins, taken = np.concatenate([[0.0], np.cumsum(each)]), np.zeros(1)
    if seconds is not None:
        begins += _seconds_of(start, profile, dialect)
        begins[-1] += _seconds_of(end, profile, dialect, _goes_on(program, program.n_moves))
    writing = Writing(program, profile, dialect, known, begins, marking(profile, dialect, labels), shared)
    spelt = _spelt(writing)
    if seconds is not None:
        taken = macros * _of_macros(writing, spelt.rows)
        begins += taken
    total = None if seconds is None else float(begins[-1])
    first, *others = first_lines(program, total, told.facts, told.made)
    before = [first, *told.comments, *others]
    before += begins_with(writing)
    before += ["G21 ; mm", "G90", "M83", fan_line(0.0)]
    before += [*dialect.limits(profile.printer), *_retraction(profile, dialect), *start]
    if profile.pressure_advance and dialect.pressure_advance:
        before.append(dialect.pressure_advance(profile.pressure_advance))
    before += definitions(writing.marking)
    before += ["G90", "M83" if profile.printer.relative_extrusion else "M82", "G92 E0"]
    after = [*end, *last_lines(program, profile, total)]
    return b"".join([_lines(before), *_body(writing, spelt), _lines(after)]), total or 0.0, float(taken[-1])


def _tool(profile: Profile, known: Mapping[str, Value], shared: dict[str, Value]) -> list[str]:
    """What selects the tool that prints; start G-code then heats it."""
    template = macro_of(profile, "tool_gcode")
    if template.empty:
        return [f"T{profile.printer.tool}"] if profile.printer.tool else []
    return template.filled(known, shared)


def _of_macros(writing: Writing, rows: MoveText) -> Float:
    """(K + 1,) what macros between the moves take until each of these begins, s."""
    program, taken = writing.program, np.zeros(writing.program.n_moves + 1)
    for move, lines in macros_between(writing, rows):
        before = _goes_on(program, move)
        taken[move] += _seconds_of(lines, writing.profile, writing.dialect, before)
    return np.asarray(np.cumsum(taken))


def _goes_on(program: Program, move: int) -> list[str]:
    """A move to where so many moves of the program end."""
    if not move:
        return []
    x, y, z = program.xyz[move - 1]
    return [f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f} F6000"]


def _seconds_of(
    lines: Sequence[str], profile: Profile, dialect: Dialect, before: Sequence[str] = ()
) -> float:
    """Modelled time of the moves and dwells of a macro that runs behind others."""

    def seconds(texts: Sequence[str]) -> float:
        """Of all of them, from the endstops on."""
        commands = [text.partition(";")[0].strip().encode("ascii", "replace") for text in texts]
        moves = read_moves([text for text in commands if text], profile.printer.corners[0], dialect)
        return moves.seconds(limits_of(profile.printer))

    return seconds([*before, *lines]) - (seconds(before) if before else 0.0)


def _retraction(profile: Profile, dialect: Dialect) -> list[str]:
    """What the firmware must know to retract as the moves would."""
    return (
        dialect.retraction(profile.printer)
        if profile.printer.firmware_retraction and dialect.retraction
        else []
    )


def _lines(lines: list[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode("ascii", "replace")


@dataclass(frozen=True, slots=True, eq=False)
class _Spelt:
    """The moves as text, which of them the firmware makes (K,), and where things begin and end."""

    rows: MoveText
    turns: Int
    marks: list[ObjectMark]


def _spelt(writing: Writing) -> _Spelt:
    program, profile = writing.program, writing.profile
    turns = retracted_by_firmware(program, profile)
    fed = replace(program, filament=np.where(turns != 0, 0.0, program.filament)) if turns.any() else program
    marks = marks_of(program, writing.marking[0]) if writing.marking else []
    rows = rows_of(fed, relative=profile.printer.relative_extrusion, fresh=fresh_rows(marks))
    return _Spelt(rows, turns, marks)


def _body(writing: Writing, spelt: _Spelt) -> Iterator[bytes]:
    """The rows of the moves with comments, events and macros between them."""
    rows = spelt.rows
    notes = notes_of(writing, rows, spelt.turns, spelt.marks)
    others = sorted(notes)
    beads, told = bead_notes(writing.program)
    texts = [*(_lines(notes[index]) for index in others), *told]
    index = np.concatenate([np.array(others, np.int64), beads])
    order = np.argsort(index, kind="stable")  # what is told of beads comes last
    places = [0, *rows.start[index[order]].tolist()]
    between = [rows.text[begin:end] for begin, end in pairwise(places)]
    yield from chain.from_iterable(zip(between, map(texts.__getitem__, order.tolist()), strict=True))
    yield rows.text[places[-1] :]


def write_gcode(  # noqa: PLR0913 - what else is known of a program
    program: Program,
    profile: Profile,
    seconds: Float | None = None,
    facts: Sequence[str] = (),
    *,
    comments: Sequence[str] = (),
    labels: Labels | None = None,
    flavour: Dialect | None = None,
    made: datetime | None = None,
    name: str = "",
) -> bytes:
    """Write a program in the printer's dialect, with the settings as comments.

    Args:
        program: the moves.
        profile: the profile it was sliced with, including the macros.
        seconds: (K,) modelled time of each move; what needs it is left out if it is not known.
        facts: further facts for the header.
        comments: lines to insert after the first one.
        labels: which moves belong to which object.
        flavour: overrides that of the profile.
        made: date in UTC for the first line; None: no date.
        name: of the file that was sliced, without its suffix, for macros.

    Raises:
        ProfileError: a macro cannot be evaluated.
    """
    dialect = flavour or FLAVOURS[profile.printer.flavour]
    return write_program(
        program, profile, dialect, ProgramFacts(seconds, facts, comments, labels, made, name)
    )
