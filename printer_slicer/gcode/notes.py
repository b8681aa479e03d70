"""What stands between the moves: layer changes and macros, fans and heaters, what previewers read about beads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from heapq import merge
from itertools import chain
from math import ceil
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct, run_starts, unique_inverse
from printer_slicer.errors import ProfileError
from printer_slicer.firmware import Dialect
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.facts import layer_facts
from printer_slicer.gcode.labels import Marking, ObjectMark, for_all, start_notes, stop_notes
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.rows import E_DECIMALS, XY_DECIMALS, Z_DECIMALS, MoveText
from printer_slicer.gcode.state import uses_inches
from printer_slicer.macros import Template, Value, read_template
from printer_slicer.model import Acceleration, Event, Fan, Heat, PressureAdvance, Program, ToolChange
from printer_slicer.profile import Profile
from printer_slicer.roles import ROLES, Role
from printer_slicer.texts import number

__all__ = [
    "TYPE_NAMES",
    "Writing",
    "bead_notes",
    "begins_with",
    "fan_line",
    "macro_of",
    "macros_between",
    "notes_of",
    "retracted_by_firmware",
]

# The names that PrusaSlicer's and OrcaSlicer's viewers know.
TYPE_NAMES: Final[dict[Role, str]] = {role: ROLES[role].type_comment for role in Role if role != Role.TRAVEL}
_MOVING: Final = commands_that(Effect.MOVES | Effect.HOMES)
_MODES: Final = commands_that(Effect.UNITS | Effect.MODE | Effect.SETS_POSITION)
_TAKING_TIME: Final = _MOVING | {b"G4"}
_HAIR: Final = 1e-9  # so that rounding does not make the last percent 99
_SELDOM: Final = 5.0  # s: the share done is not told more often, however short the print is
_Note = tuple[int, list[str]]


@dataclass(frozen=True, slots=True, eq=False)
class Writing:
    """What the parts of a file are written from.

    Attributes:
        program: the moves.
        profile: what they were made with.
        dialect: how the printer wants it said.
        known: what macros may speak of.
        begins: (K + 1,) modelled time at which each move begins, s, counted from the start G-code, and at last that at
            which all is done; zeros where it is not known.
        marking: things that are marked, and how.
        shared: global variables of macros, as the start G-code leaves them.
    """

    program: Program
    profile: Profile
    dialect: Dialect
    known: dict[str, Value]
    begins: Float
    marking: Marking | None = None
    shared: Mapping[str, Value] = field(default_factory=dict)


def macro_of(profile: Profile, name: str) -> Template:
    """A macro of the printer.

    Raises:
        ProfileError: it cannot be read.
    """
    printer = profile.printer
    return read_template(getattr(printer, name), f"printer {printer.name!r}: {name}")


def notes_of(writing: Writing, rows: MoveText, turns: Int, marks: list[ObjectMark]) -> dict[int, list[str]]:
    """The lines that stand before each move, and after the last one, but for what `bead_notes` tells.

    Args:
        writing: what they are written from.
        rows: the moves as text.
        turns: (K,) which of them the firmware makes; see `retracted_by_firmware`.
        marks: where things begin and end.

    Raises:
        ProfileError: a macro cannot be filled in, or a pause lies above the part.
    """
    notes: dict[int, list[str]] = {}
    relative, marking = writing.profile.printer.relative_extrusion, writing.marking
    layers, arrivals = _macros(writing, rows)
    sources = (
        stop_notes(marks, marking, rows, relative=relative) if marking else (),
        _said_again(writing, marks),
        for_all(iter(layers), marks),
        for_all(_events(writing), marks),
        start_notes(marks, marking) if marking else (),
        arrivals,
        _progress(writing),
        _retractions(turns),
    )
    for source in sources:
        for index, lines in source:
            notes.setdefault(index, []).extend(lines)
    return notes


def _macros(writing: Writing, rows: MoveText) -> tuple[list[_Note], list[_Note]]:
    """Changes of layer and arrivals; their macros run in the order of the print, which global variables hang on."""
    shared = dict(writing.shared)
    found: tuple[list[_Note], list[_Note]] = [], []
    layers = ((found[0], note) for note in _layers(writing, rows, shared))
    arrivals = ((found[1], note) for note in _arrivals(writing, rows, shared))
    for notes, note in merge(layers, arrivals, key=lambda one: one[1][0]):
        notes.append(note)
    return found


def _layers(writing: Writing, rows: MoveText, shared: dict[str, Value]) -> Iterator[_Note]:
    """Every change of layer, and the macro before it."""
    program, template = writing.program, macro_of(writing.profile, "before_layer_gcode")
    height = _layer_heights(program)
    for move in np.flatnonzero(run_starts(program.layer)).tolist():
        layer = int(program.layer[move])
        yield (
            move,
            [
                ";LAYER_CHANGE",
                f";Z:{number(float(program.plan.top[layer]))}",
                f";HEIGHT:{number(float(height[layer]))}",
                ";BEFORE_LAYER_CHANGE",
                f";{number(float(program.plan.top[layer]))}",
                *_in_layer(template, writing, rows, move, layer, shared),
            ],
        )


def _arrivals(writing: Writing, rows: MoveText, shared: dict[str, Value]) -> Iterator[_Note]:
    """Pauses and the macro of each layer, once the nozzle is at its height."""
    program = writing.program
    template = macro_of(writing.profile, "layer_gcode")
    pauses = _pauses(writing)
    if template.empty and not pauses:
        return
    pause = macro_of(writing.profile, "pause_gcode")
    if pause.empty:
        pause = read_template(writing.dialect.pause, "pause")
    high = program.xyz[:, 2] >= program.z_top - 1e-6
    arrived = np.flatnonzero(high)
    arrived = arrived[run_starts(program.layer[arrived])]
    for layer, place in zip(program.layer[arrived].tolist(), arrived.tolist(), strict=True):
        lines = _in_layer(pause, writing, rows, place + 1, layer, shared) if layer in pauses else []
        yield place + 1, lines + _in_layer(template, writing, rows, place + 1, layer, shared)


def macros_between(writing: Writing, rows: MoveText) -> Iterator[_Note]:
    """What layer and pause macros say before which move, where that moves the machine or lets it stand."""
    names = "before_layer_gcode", "layer_gcode"
    if all(macro_of(writing.profile, name).empty for name in names) and not writing.profile.quality.pause_at:
        return
    for move, lines in chain(*_macros(writing, rows)):
        if not _TAKING_TIME.isdisjoint(_codes(lines)):
            yield move, lines


def _codes(lines: list[str]) -> set[bytes]:
    """The codes of some commands."""
    return {parse(line.encode())[0] for line in lines}


def _pauses(writing: Writing) -> set[int]:
    """The layers before which the print pauses.

    Raises:
        ProfileError: a pause above the part.
    """
    program, tops = writing.program, writing.program.plan.top
    layers = distinct(program.layer)
    pauses = set()
    for z in writing.profile.quality.pause_at:
        later = layers[tops[layers] > z + 1e-6]
        if not len(later):
            raise ProfileError(
                f"quality.pause_at: {z:g} mm, but the part ends at {tops[-1]:g} mm",
                remedy="pause below the last layer",
            )
        pauses.add(int(later[0]))
    return pauses


def _in_layer(  # noqa: PLR0917 - where and with what
    template: Template, writing: Writing, rows: MoveText, move: int, layer: int, shared: dict[str, Value]
) -> list[str]:
    """A macro that runs before a move; the printer is then as it was before."""
    if template.empty:
        return []
    laid = float(rows.fed[move - 1]) / 10**E_DECIMALS if move else 0.0
    facts = layer_facts(writing.program, layer, laid, float(writing.begins[move]))
    lines = template.filled(writing.known | dict(facts), shared)
    return lines + _restored(lines, writing, rows, move)


def _restored(lines: list[str], writing: Writing, rows: MoveText, move: int) -> list[str]:
    """What puts modes, position and speed back to where the moves go on, if a macro may have changed them.

    Rows say only what differs from the row before: a macro that moves would lead the next one astray.
    """
    codes = _codes(lines)
    if not codes & (_MOVING | _MODES):
        return []
    printer = writing.profile.printer
    back = ["G21"] if uses_inches(line.encode() for line in lines) else []
    back += ["G90", "M83" if printer.relative_extrusion else "M82"]
    fed = rows.fed[move - 1] if move else 0
    back += [] if printer.relative_extrusion else [f"G92 E{number(fed / 10**E_DECIMALS)}"]
    if move and codes & _MOVING:
        x, y, z = writing.program.xyz[move - 1]
        travel = round(writing.profile.speeds.travel * 60)
        back += [f"G0 X{x:z.{XY_DECIMALS}f} Y{y:z.{XY_DECIMALS}f} F{travel}", f"G0 Z{z:z.{Z_DECIMALS}f}"]
        back += [f"G1 F{rows.feed[move - 1]}"]
    return back


def _said_again(writing: Writing, marks: list[ObjectMark]) -> Iterator[_Note]:
    """Behind a thing, what was changed within it and goes on to hold: it holds too if the thing is given up."""
    changes = [event for event in writing.program.events if isinstance(event, Fan | Acceleration)]
    begun = 0
    for mark in marks:
        if mark.stop >= 0:
            within = {type(event): event for event in changes if begun < event.index < mark.after}
            yield (
                mark.index,
                [line for event in within.values() for line in _lines_of(event, writing)],
            )
        begun = mark.until


def _events(writing: Writing) -> Iterator[_Note]:
    """Fans, heaters, accelerations."""
    for event in writing.program.events:
        yield event.index, _lines_of(event, writing)


def fan_line(ratio: float) -> str:
    """M106 with the fan at a ratio from 0 to 1, M107 for off; all firmwares know S as a share of 255."""
    return f"M106 S{round(ratio * 255)}" if ratio > 0 else "M107"


def _nozzle_line(temperature: float, tool: int | None) -> str:
    """M104: heat, do not wait; the nozzle of a tool, or of the one in use."""
    return f"M104{'' if tool is None else f' T{tool}'} S{number(temperature)}"


def _lines_of(event: Event, writing: Writing) -> list[str]:
    """What an event says."""
    dialect, extruders = writing.dialect, writing.profile.extruders
    match event:
        case Fan():
            return [fan_line(event.ratio)]
        case Heat():
            tool = extruders[event.tool].tool if len(extruders) > 1 else None
            nozzle = [_nozzle_line(event.nozzle, tool)] if event.nozzle is not None else []
            return nozzle + ([f"M140 S{number(event.bed)}"] if event.bed is not None else [])
        case Acceleration():
            return [dialect.acceleration(event.value)]
        case PressureAdvance():
            return [dialect.pressure_advance(event.seconds)] if dialect.pressure_advance is not None else []
        case ToolChange():
            return [f"T{extruders[event.tool].tool}"]


def begins_with(writing: Writing) -> list[str]:
    """What the display shall show before the first move."""
    tell, total = writing.dialect.progress, float(writing.begins[-1])
    if not (writing.profile.printer.progress and tell and total > 0):
        return []
    return [tell(0, ceil(total / 60 - _HAIR))]


def _progress(writing: Writing) -> Iterator[_Note]:
    """Share of the time and minutes left, where one of them has changed."""
    begins, tell = writing.begins, writing.dialect.progress
    shown = begins_with(writing)
    if not (shown and tell):
        return
    total = float(begins[-1])
    step = max(ceil(100 * _SELDOM / total), 1)
    percent = np.floor(100 * begins / total + _HAIR).astype(np.int64)
    percent = np.where(percent < 100, percent // step * step, 100)
    minutes = np.ceil((total - begins) / 60 - _HAIR).astype(np.int64)
    changed = (np.diff(percent, prepend=0) != 0) | (np.diff(minutes, prepend=minutes[0]) != 0)
    for move in np.flatnonzero(changed).tolist():
        line = tell(int(percent[move]), int(minutes[move]))
        if line not in shown:  # not every display shows the minutes
            yield move, [line]
        shown = [line]


def _retractions(turns: Int) -> Iterator[_Note]:
    """G10 and G11 in the place of moves that only turn the extruder."""
    for move in np.flatnonzero(turns).tolist():
        yield move, ["G10" if turns[move] < 0 else "G11"]


def retracted_by_firmware(program: Program, profile: Profile) -> Int:
    """(K,) -1 for moves that G10 makes, 1 for those that G11 makes, 0 for all others.

    The firmware knows one length: if some retractions have another, or do not take turns, all are left to E words.
    """
    none = np.zeros(program.n_moves, np.int64)
    if not profile.printer.firmware_retraction:
        return none
    fed = program.filament
    alone = (program.role == Role.TRAVEL) & (fed != 0)
    signs = np.sign(fed[alone]).astype(np.int64)
    printer = profile.printer
    length = np.where(signs < 0, printer.retract_length, printer.retract_length + printer.deretract_extra)
    equal = np.abs(np.abs(fed[alone]) - length) < 1e-6
    stands = (program.xyz == program.start).all(axis=1)[alone]
    turns = np.where(np.arange(len(signs)) % 2 == 0, -1, 1)
    if not (equal.all() and stands.all() and (signs == turns).all()):
        return none
    none[alone] = signs
    return none


def bead_notes(program: Program) -> tuple[Int, list[bytes]]:
    """The moves (n,) before which role, width or height of the beads changes, and n texts that tell it.

    Beads of varying width change at every point: what is told is spelt once for all alike.
    """
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    role, width, thick = program.role[beads], program.width[beads], _told_heights(program, beads)
    new_role = np.diff(role, prepend=-1) != 0
    new_width = np.diff(width, prepend=-1.0) != 0
    of_layer, first_of_layer = program.layer[beads], _layer_heights(program)
    begins = np.diff(of_layer, prepend=-1) > 0
    usual = np.where(begins, first_of_layer[of_layer], np.append(0.0, thick[:-1]))
    new_height = thick != usual  # a new layer has told its own
    changed = np.flatnonzero(new_role | new_width | new_height)
    heights, height = _numbered(thick[changed], new_height[changed])
    roles, kind = _numbered(role[changed].astype(np.float64), new_role[changed])
    widths, wide = _numbered(width[changed], new_width[changed])
    every = (height * (len(roles) + 1) + kind) * (len(widths) + 1) + wide
    keys, alike = unique_inverse(every)
    example = np.zeros(len(keys), np.int64)
    example[alike] = np.arange(len(changed))
    texts = []
    for h, r, w in zip(*(some[example].tolist() for some in (height, kind, wide)), strict=True):
        lines = [f";HEIGHT:{number(heights[h - 1])}\n"] if h else []
        lines += [f";TYPE:{TYPE_NAMES[Role(int(roles[r - 1]))]}\n"] if r else []
        lines += [f";WIDTH:{number(widths[w - 1])}\n"] if w else []
        texts.append("".join(lines).encode("ascii"))
    return beads[changed], [texts[one] for one in alike.tolist()]


def _numbered(values: Float, told: Bool) -> tuple[list[float], Int]:
    """The different ones of those values (n,) that are told, and (n,) which of them each is, from 1; 0: not told."""
    different, which = unique_inverse(values[told])
    result = np.zeros(len(values), np.int64)
    result[told] = which + 1
    return different.tolist(), result


def _layer_heights(program: Program) -> Float:
    """(L,) how high the first bead of each layer is: over the air of a raft less than the layer."""
    height = program.plan.height
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    first = beads[run_starts(program.layer[beads])]
    height[program.layer[first]] = _told_heights(program, first)
    return height


def _told_heights(program: Program, beads: Int) -> Float:
    """(n,) how high beads are; those that climb, and grow on the way, as high as their layer."""
    climbs = np.abs(program.xyz[beads, 2] - program.start[beads, 2]) > 1e-9
    return np.where(climbs, program.plan.height[program.layer[beads]], program.height[beads])
