"""Lines between the moves: layer changes, macros, fans, heaters, progress, and comments for G-code viewers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from heapq import merge
from itertools import chain
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, distinct, run_starts, unique_inverse
from printer_slicer.errors import ProfileError
from printer_slicer.firmware import Dialect
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.facts import collect_layer_facts
from printer_slicer.gcode.labels import (
    Marking,
    ObjectMark,
    format_start_labels,
    format_stop_labels,
    move_lines_outside_objects,
)
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.move_text import E_DECIMALS, XY_DECIMALS, Z_DECIMALS, RowPlan, split_by_layers
from printer_slicer.gcode.state import uses_inches
from printer_slicer.macros import Template, Value, read_template
from printer_slicer.model import Acceleration, Event, Fan, Heat, PressureAdvance, Program, ToolChange
from printer_slicer.profile import Profile
from printer_slicer.roles import ROLES, Role
from printer_slicer.texts import format_number
from printer_slicer.values import Struct, field

__all__ = [
    "TYPE_NAMES",
    "ExtrusionComments",
    "InsertedLines",
    "WriteContext",
    "find_firmware_retractions",
    "find_macros_that_take_time",
    "format_fan",
    "format_first_progress",
    "read_macro",
]

# The role names of PrusaSlicer's and OrcaSlicer's viewers.
TYPE_NAMES: Final[dict[Role, str]] = {role: ROLES[role].type_comment for role in Role if role != Role.TRAVEL}
_MOVING: Final = find_codes(Effect.MOVES | Effect.HOMES)
_MODES: Final = find_codes(Effect.UNITS | Effect.MODE | Effect.SETS_POSITION)
_TIMED: Final = _MOVING | {b"G4"}
_ROUNDING_MARGIN: Final = 1e-9  # keeps rounding from making the last percent 99
_PROGRESS_INTERVAL: Final = 5.0  # s: minimum time between updates of the percentage
_MOVES_AT_ONCE: Final = 8192  # whose progress is computed
_Insertion = tuple[int, list[str]]


class WriteContext(Struct, frozen=True, eq=False):
    """The inputs from which the parts of a file are written.

    Attributes:
        program: the moves.
        profile: the profile that the program was sliced with.
        dialect: G-code dialect of the printer.
        known: placeholders of macros and their values.
        begins: (K + 1,) estimated start time of each move, s, counted from the start G-code; the last entry is the end
            of the print. Zeros if unknown.
        marking: labelled objects and the label format; None: no labels.
        shared: global variables of macros, with their values after the start G-code.
    """

    program: Program
    profile: Profile
    dialect: Dialect
    known: dict[str, Value]
    begins: Float
    marking: Marking | None = None
    shared: Mapping[str, Value] = field(default_factory=dict)


def read_macro(profile: Profile, name: str) -> Template:
    """Read a macro of the printer.

    Raises:
        ProfileError: the macro has a syntax error.
    """
    printer = profile.printer
    return read_template(getattr(printer, name), f"printer {printer.name!r}: {name}")


class InsertedLines:
    """The lines before each move and after the last one, except the comments of extrusions, taken in print order.

    Args:
        context: inputs of the file.
        rows: the rows of the moves.
        retractions: (K,) which moves are firmware retractions, see `find_firmware_retractions`.
        marks: where objects start and end.
    """

    def __init__(
        self, context: WriteContext, rows: RowPlan, retractions: NDArray[np.int8], marks: list[ObjectMark]
    ) -> None:
        relative, marking = context.profile.printer.relative_extrusion, context.marking
        layers, arrivals = _render_layer_macros(context, rows)
        sources: Iterable[Iterable[_Insertion]] = (
            format_stop_labels(marks, marking, rows, relative=relative) if marking else (),
            _repeat_last_changes(context, marks),
            move_lines_outside_objects(layers, marks),
            move_lines_outside_objects(_format_events(context), marks),
            format_start_labels(marks, marking) if marking else (),
            arrivals,
            _format_progress_updates(context),
            _format_retractions(retractions),
        )
        self._sources = [iter(source) for source in sources]
        self._next = [next(source, None) for source in self._sources]

    def take_before(self, move: int) -> dict[int, list[str]]:
        """Return the lines before each move, up to those before the move before this one, that were not yet taken.

        Raises:
            ProfileError: a macro cannot be evaluated, or a pause lies above the part.
        """
        notes: dict[int, list[str]] = {}
        for place, source in enumerate(self._sources):
            note = self._next[place]
            while note is not None and note[0] < move:
                notes.setdefault(note[0], []).extend(note[1])
                note = next(source, None)
            self._next[place] = note
        return notes


def _render_layer_macros(
    context: WriteContext, rows: RowPlan
) -> tuple[Iterator[_Insertion], Iterator[_Insertion]]:
    """Return the lines before each layer, and those after the nozzle has reached the height of each layer.

    Macros are evaluated in print order, because they share global variables.
    """
    shared = dict(context.shared)
    waiting: tuple[deque[_Insertion], deque[_Insertion]] = (deque(), deque())
    layers = ((waiting[0], note) for note in _format_layer_changes(context, rows, shared))
    if not _has_layer_start_macros(context):
        return (note for _, note in layers), iter(())
    arrivals = ((waiting[1], note) for note in _format_layer_start_macros(context, rows, shared))
    both = merge(layers, arrivals, key=lambda one: one[1][0])

    def take(own: deque[_Insertion]) -> Iterator[_Insertion]:
        """Yield the lines of one kind; those of the other kind wait until they are taken."""
        while True:
            while not own:
                if (following := next(both, None)) is None:
                    return
                following[0].append(following[1])
            yield own.popleft()

    return take(waiting[0]), take(waiting[1])


def _has_layer_start_macros(context: WriteContext) -> bool:
    """Return whether there are lines after the nozzle has reached a layer: a macro or a pause."""
    profile = context.profile
    return not read_macro(profile, "layer_gcode").is_empty or bool(profile.quality.pause_at)


def _format_layer_changes(
    context: WriteContext, rows: RowPlan, shared: dict[str, Value]
) -> Iterator[_Insertion]:
    """Yield the comments and the macro before every layer change."""
    program, template = context.program, read_macro(context.profile, "before_layer_gcode")
    height = _find_first_extrusion_heights(program)
    for move in np.flatnonzero(run_starts(program.layer)).tolist():
        layer = int(program.layer[move])
        yield (
            move,
            [
                ";LAYER_CHANGE",
                f";Z:{format_number(float(program.plan.top[layer]))}",
                f";HEIGHT:{format_number(float(height[layer]))}",
                ";BEFORE_LAYER_CHANGE",
                f";{format_number(float(program.plan.top[layer]))}",
                *_render_macro_before_move(template, context, rows, move, layer, shared),
            ],
        )


def _format_layer_start_macros(
    context: WriteContext, rows: RowPlan, shared: dict[str, Value]
) -> Iterator[_Insertion]:
    """Yield the pause and the macro of each layer, after the move with which the nozzle reaches the layer's height."""
    program = context.program
    template = read_macro(context.profile, "layer_gcode")
    pauses = _find_pause_layers(context)
    pause = read_macro(context.profile, "pause_gcode")
    if pause.is_empty:
        pause = read_template(context.dialect.pause, "pause")
    high = program.xyz[:, 2] >= program.z_top - 1e-6
    arrived = np.flatnonzero(high)
    arrived = arrived[run_starts(program.layer[arrived])]
    for layer, place in zip(program.layer[arrived].tolist(), arrived.tolist(), strict=True):
        lines = (
            _render_macro_before_move(pause, context, rows, place + 1, layer, shared)
            if layer in pauses
            else []
        )
        yield place + 1, lines + _render_macro_before_move(template, context, rows, place + 1, layer, shared)


def find_macros_that_take_time(context: WriteContext, rows: RowPlan) -> Iterator[_Insertion]:
    """Yield the layer and pause macros that take time, because they move, home or dwell."""
    names = "before_layer_gcode", "layer_gcode"
    if (
        all(read_macro(context.profile, name).is_empty for name in names)
        and not context.profile.quality.pause_at
    ):
        return
    for move, lines in chain(*_render_layer_macros(context, rows)):
        if not _TIMED.isdisjoint(_find_codes(lines)):
            yield move, lines


def _find_codes(lines: list[str]) -> set[bytes]:
    """Return the codes of the commands in these lines."""
    return {parse(line.encode())[0] for line in lines}


def _find_pause_layers(context: WriteContext) -> set[int]:
    """Return the layers before which the print pauses; each object that is printed on its own pauses at each height.

    Raises:
        ProfileError: a pause lies above the part.
    """
    program, tops = context.program, context.program.plan.top
    layers = distinct(program.layer)
    stack = np.searchsorted(program.plan.stack_starts, layers, side="right")
    pauses = set[int]()
    for z in context.profile.quality.pause_at:
        later = np.flatnonzero(tops[layers] > z + 1e-6)
        if not len(later):
            raise ProfileError(
                f"quality.pause_at: {z:g} mm is above the top of the part at {program.plan.highest:g} mm",
                remedy="Choose a height below the last layer",
            )
        pauses.update(layers[later[run_starts(stack[later])]].tolist())
    return pauses


def _render_macro_before_move(  # noqa: PLR0917 - position and inputs
    template: Template, context: WriteContext, rows: RowPlan, move: int, layer: int, shared: dict[str, Value]
) -> list[str]:
    """Return the lines of a macro that runs before a move, and lines that restore the printer's state after it."""
    if template.is_empty:
        return []
    filament = float(rows.fed[move - 1]) / 10**E_DECIMALS if move else 0.0
    facts = collect_layer_facts(context.program, layer, filament, float(context.begins[move]))
    lines = template.render(context.known | dict(facts), shared)
    return lines + _format_restoring_commands(lines, context, rows, move)


def _format_restoring_commands(
    lines: list[str], context: WriteContext, rows: RowPlan, move: int
) -> list[str]:
    """Return commands that restore modes, position and speed if a macro may have changed them.

    Each row of a move holds only the words that differ from the previous row, so the state after that row must return.
    """
    codes = _find_codes(lines)
    if not codes & (_MOVING | _MODES):
        return []
    printer = context.profile.printer
    back = ["G21"] if uses_inches(line.encode() for line in lines) else []
    back += ["G90", "M83" if printer.relative_extrusion else "M82"]
    fed = rows.fed[move - 1] if move else 0
    back += [] if printer.relative_extrusion else [f"G92 E{format_number(fed / 10**E_DECIMALS)}"]
    if move and codes & _MOVING:
        x, y, z = context.program.xyz[move - 1]
        travel = round(context.profile.speeds.travel * 60)
        back += [f"G0 X{x:z.{XY_DECIMALS}f} Y{y:z.{XY_DECIMALS}f} F{travel}", f"G0 Z{z:z.{Z_DECIMALS}f}"]
        back += [f"G1 F{rows.feed_before(move)}"]
    return back


def _repeat_last_changes(context: WriteContext, marks: list[ObjectMark]) -> Iterator[_Insertion]:
    """Yield, after each object, its last fan and acceleration commands again, in case the object is cancelled."""
    changes = [event for event in context.program.events if isinstance(event, Fan | Acceleration)]
    start = 0
    for mark in marks:
        if mark.stop >= 0:
            within = {type(event): event for event in changes if start < event.index < mark.after}
            yield (
                mark.index,
                [line for event in within.values() for line in _format_event(event, context)],
            )
        start = mark.until


def _format_events(context: WriteContext) -> Iterator[_Insertion]:
    """Yield the lines that change fans, heaters, accelerations and other states."""
    for event in sorted(context.program.events, key=lambda one: one.index):
        yield event.index, _format_event(event, context)


def format_fan(ratio: float) -> str:
    """Format M106 for a fan speed from 0 to 1, or M107 for off; S255 is full speed in all firmwares."""
    return f"M106 S{round(ratio * 255)}" if ratio > 0 else "M107"


def _format_nozzle_target(temperature: float, tool: int | None) -> str:
    """Format M104 (heat without waiting) for a tool; None: the active tool."""
    return f"M104{'' if tool is None else f' T{tool}'} S{format_number(temperature)}"


def _format_event(event: Event, context: WriteContext) -> list[str]:
    """Format an event as lines."""
    dialect, extruders = context.dialect, context.profile.extruders
    match event:
        case Fan():
            return [format_fan(event.ratio)]
        case Heat():
            tool = extruders[event.tool].tool if len(extruders) > 1 else None
            nozzle = [_format_nozzle_target(event.nozzle, tool)] if event.nozzle is not None else []
            return nozzle + ([f"M140 S{format_number(event.bed)}"] if event.bed is not None else [])
        case Acceleration():
            return [dialect.acceleration(event.value)]
        case PressureAdvance():
            return [dialect.pressure_advance(event.seconds)] if dialect.pressure_advance is not None else []
        case ToolChange():
            return [f"T{extruders[event.tool].tool}"]


def format_first_progress(context: WriteContext) -> list[str]:
    """Format the progress before the first move."""
    format_progress, total = context.dialect.progress, float(context.begins[-1])
    if not (context.profile.printer.progress and format_progress and total > 0):
        return []
    return [format_progress(0, ceil(total / 60 - _ROUNDING_MARGIN))]


def _format_progress_updates(context: WriteContext) -> Iterator[_Insertion]:
    """Yield the progress, in percent and remaining minutes, wherever one of the two has changed."""
    begins, format_progress = context.begins, context.dialect.progress
    shown = format_first_progress(context)
    if not (shown and format_progress):
        return
    total = float(begins[-1])
    step = max(ceil(100 * _PROGRESS_INTERVAL / total), 1)
    last_percent, last_minutes = 0, ceil((total - float(begins[0])) / 60 - _ROUNDING_MARGIN)
    for first in range(0, len(begins), _MOVES_AT_ONCE):
        some = begins[first : first + _MOVES_AT_ONCE]
        percent = np.floor(100 * some / total + _ROUNDING_MARGIN).astype(np.int64)
        percent = np.where(percent < 100, percent // step * step, 100)
        minutes = np.ceil((total - some) / 60 - _ROUNDING_MARGIN).astype(np.int64)
        changed = (np.diff(percent, prepend=last_percent) != 0) | (
            np.diff(minutes, prepend=last_minutes) != 0
        )
        last_percent, last_minutes = int(percent[-1]), int(minutes[-1])
        for move in np.flatnonzero(changed).tolist():
            line = format_progress(int(percent[move]), int(minutes[move]))
            if line not in shown:  # some dialects have no remaining minutes
                yield first + move, [line]
            shown = [line]


def _format_retractions(retractions: NDArray[np.int8]) -> Iterator[_Insertion]:
    """Yield G10 and G11, which replace moves of the extruder alone."""
    for move in np.flatnonzero(retractions).tolist():
        yield move, ["G10" if retractions[move] < 0 else "G11"]


def find_firmware_retractions(program: Program, profile: Profile) -> NDArray[np.int8]:
    """Return -1 for each move (K,) that G10 replaces, 1 for each that G11 replaces, and 0 for all others.

    The firmware has one retraction length. If lengths differ, or retractions and deretractions do not alternate, all
    entries are 0, and retractions are written as moves with E words.
    """
    none = np.zeros(program.n_moves, np.int8)
    if not profile.printer.firmware_retraction:
        return none
    fed = program.filament
    alone = (program.role == Role.TRAVEL) & (fed != 0)
    signs = np.sign(fed[alone]).astype(np.int64)
    printer = profile.printer
    length = np.where(signs < 0, printer.retract_length, printer.retract_length + printer.deretract_extra)
    equal = np.abs(np.abs(fed[alone]) - length) < 1e-6
    stands = (program.xyz == program.start).all(axis=1)[alone]
    retractions = np.where(np.arange(len(signs)) % 2 == 0, -1, 1)
    if not (equal.all() and stands.all() and (signs == retractions).all()):
        return none
    none[alone] = signs
    return none


class ExtrusionComments:
    """The comments that announce a new role, width or height of extrusions, taken in print order.

    Args:
        program: the moves.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._first_of_layer = _find_first_extrusion_heights(program)
        self._last = -1  # the last extrusion so far

    def take(self, moves: slice) -> tuple[Int, list[bytes]]:
        """Return the moves (n,) before which comments stand, and n comments, in the range after the last one."""
        program = self._program
        beads = np.flatnonzero(program.role[moves] != Role.TRAVEL) + moves.start
        if not len(beads):
            return beads, []
        known = self._last >= 0
        if known:
            beads = np.append(self._last, beads)
        self._last = int(beads[-1])
        role, width, thick = program.role[beads], program.width[beads], _find_comment_heights(program, beads)
        new_role = np.diff(role, prepend=-1) != 0
        new_width = np.diff(width, prepend=-1.0) != 0
        of_layer = program.layer[beads]
        begins = np.diff(of_layer, prepend=-1) > 0
        usual = np.where(begins, self._first_of_layer[of_layer], np.append(0.0, thick[:-1]))
        new_height = thick != usual  # layer changes have comments of their own
        changed = np.flatnonzero(new_role | new_width | new_height)
        changed = changed[changed >= known]
        return beads[changed], _format_comments(
            (thick[changed], new_height[changed]),
            (role[changed], new_role[changed]),
            (width[changed], new_width[changed]),
        )


def _format_comments(
    heights_and: tuple[Float, Bool], roles_and: tuple[Int, Bool], widths_and: tuple[Float, Bool]
) -> list[bytes]:
    """Format comments of extrusions (n,), from height, role and width, and which of them are new.

    Extrusions of variable width change at every point, so equal comments are formatted once.
    """
    heights, height = _number_distinct_values(*heights_and)
    roles, kind = _number_distinct_values(roles_and[0].astype(np.float64), roles_and[1])
    widths, wide = _number_distinct_values(*widths_and)
    every = (height * (len(roles) + 1) + kind) * (len(widths) + 1) + wide
    keys, alike = unique_inverse(every)
    example = np.zeros(len(keys), np.int64)
    example[alike] = np.arange(len(every))
    texts = []
    for h, r, w in zip(*(some[example].tolist() for some in (height, kind, wide)), strict=True):
        lines = [f";HEIGHT:{format_number(heights[h - 1])}\n"] if h else []
        lines += [f";TYPE:{TYPE_NAMES[Role(int(roles[r - 1]))]}\n"] if r else []
        lines += [f";WIDTH:{format_number(widths[w - 1])}\n"] if w else []
        texts.append("".join(lines).encode("ascii"))
    return [texts[one] for one in alike.tolist()]


def _number_distinct_values(values: Float, chosen: Bool) -> tuple[list[float], Int]:
    """Return the distinct values among the chosen ones; for each value (n,), its number from 1, or 0 if not chosen."""
    different, which = unique_inverse(values[chosen])
    result = np.zeros(len(values), np.int64)
    result[chosen] = which + 1
    return different.tolist(), result


def _find_first_extrusion_heights(program: Program) -> Float:
    """Return the height of the first extrusion of each layer (L,); above a raft gap it is below the layer height."""
    height = program.plan.height
    for moves in split_by_layers(program):
        beads = np.flatnonzero(program.role[moves] != Role.TRAVEL) + moves.start
        first = beads[run_starts(program.layer[beads])]
        height[program.layer[first]] = _find_comment_heights(program, first)
    return height


def _find_comment_heights(program: Program, beads: Int) -> Float:
    """Return the heights (n,) of extrusions for comments; an extrusion with rising z gets the height of its layer."""
    begins = np.where(beads > 0, program.xyz[beads - 1, 2], program.origin[2])
    climbs = np.abs(program.xyz[beads, 2] - begins) > 1e-9
    return np.where(climbs, program.plan.height[program.layer[beads]], program.height[beads])
