"""Merge and slow down short moves that a slow link cannot deliver in time.

A file is sent line by line, at a limited number of lines per second, and the firmware buffers some lines. A buffer
underrun occurs where the executed lines exceed the delivered lines by more than the buffer holds. Cumulative sums of
the lines sent and the lines executed show where. Lines that are no moves count too: fans, accelerations, progress, and
the macros at each layer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, distinct, run_starts
from printer_slicer.curves import merge_moves
from printer_slicer.extrusion import extrude
from printer_slicer.extrusion.move_rows import list_moves
from printer_slicer.extrusion.timing import move_seconds
from printer_slicer.link_model import compute_lateness
from printer_slicer.model import Program, Sections, Toolpaths, Travels
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.travels import travel
from printer_slicer.values import Struct, replace

__all__ = ["LinkReport", "find_underruns", "limit_link"]

_BUFFER_RATIO = 0.5  # fraction of the firmware's planner blocks on which the computation relies
_MAX_ROUNDS = 32
_SPEED_MARGIN = 1.02  # factor by which moves stay slower than the link allows
_MIN_SPEED = 0.1  # mm/s; no move is slowed down below this speed
_MAX_RESTORE_LINES = 4  # maximum number of lines that restore the state after a macro


class LinkReport(Struct, frozen=True):
    """The changes that keep a program within the throughput of the link.

    Attributes:
        lines_per_second: throughput of the link, lines/s.
        layers: numbers, from 1, of the layers where the machine would have waited without the changes.
        merged: number of lines saved by merging moves.
        slowed: number of moves that were slowed down.
        seconds: increase of the print time, s.
        waits: numbers, from 1, of the layers where the machine still waits, because no move can be slowed down more.
    """

    lines_per_second: float
    layers: tuple[int, ...] = ()
    merged: int = 0
    slowed: int = 0
    seconds: float = 0.0
    waits: tuple[int, ...] = ()


def find_underruns(program: Program, profile: Profile) -> Bool:
    """Return a mask (K,) of the moves in buffer underruns; an underrun starts with the first late line."""
    if not profile.printer.link_lines_per_second or not program.n_moves:
        return np.zeros(program.n_moves, np.bool_)
    return _find_underrun_moves(program, profile, _count_lines(program, profile))


def _find_underrun_moves(program: Program, profile: Profile, lines: Float) -> Bool:
    """Return the mask (K,) of `find_underruns`, given the number of lines (K,) of each move."""
    rate, seconds = profile.printer.link_lines_per_second, move_seconds(program, profile)
    late = compute_lateness(np.cumsum(seconds) - seconds, lines / rate)
    short = late > max(_BUFFER_RATIO * profile.printer.firmware.planner_blocks, 1) / rate
    if not short.any():
        return short
    # Each underrun starts after the last line that arrived in time.
    begins = np.flatnonzero(late == 0)
    since = begins[np.searchsorted(begins, np.flatnonzero(short), side="right") - 1]
    change = np.zeros(program.n_moves + 1, np.int64)
    np.add.at(change, since, 1)
    np.add.at(change, np.flatnonzero(short) + 1, -1)
    return np.asarray(np.cumsum(change)[:-1] > 0)


_Moves = tuple[Toolpaths, Travels, Program]


def limit_link(
    moves: _Moves, printed: Sections, profile: Profile, profiles: Sequence[Profile]
) -> tuple[Toolpaths, Travels, Program, LinkReport | None]:
    """Fit a program to the throughput of the link: merge short moves, then slow moves down.

    Args:
        moves: paths in printing order, the travels between them, and the program.
        printed: the sections that the nozzle must avoid.
        profile: profile with `printer.link_lines_per_second`; 0: nothing changes, and the report is None.
        profiles: the profiles to which the paths refer by index.
    """
    toolpaths, travels, program = moves
    rate = profile.printer.link_lines_per_second
    busy = find_underruns(program, profile)
    if not rate or not busy.any():
        return *moves, LinkReport(rate) if rate else None
    has_underrun = _find_underrun_paths(toolpaths, travels, busy, profile)
    toolpaths = merge_moves(toolpaths, has_underrun, profile.quality.link_tolerance)
    travels = travel(toolpaths, printed, profile)
    slower, report = _slow_down(extrude(toolpaths, travels, profile, profiles), program, busy, profile)
    return toolpaths, travels, slower, report


def _find_underrun_paths(paths: Toolpaths, travels: Travels, busy: Bool, profile: Profile) -> Bool:
    """Return a mask (M,) of the paths with a move in the mask `busy` (K,)."""
    found = np.zeros(paths.n_paths, np.bool_)
    found[list_moves(paths, travels, profile).path[busy]] = True
    return found


def _slow_down(program: Program, before: Program, busy: Bool, profile: Profile) -> tuple[Program, LinkReport]:
    """Slow the moves of a program down until the link can deliver them; return the program and a report.

    Args:
        program: the program; its short moves are already merged.
        before: the program before merging.
        busy: mask (K,) of the moves of `before` in buffer underruns.
        profile: profile of both programs.
    """
    rate = profile.printer.link_lines_per_second
    delta = program.xyz - program.start
    length = np.sqrt((delta * delta).sum(axis=1))
    length = np.where(length > 0, length, np.abs(program.filament))
    first = program
    for _ in range(_MAX_ROUNDS):
        lines = _count_lines(program, profile)
        short = _find_underrun_moves(program, profile, lines) & (program.role != Role.TRAVEL)
        most = length * rate / (_spread_arc_lines(program, lines) * _SPEED_MARGIN)
        slower = np.where(short, np.minimum(program.speed, most), program.speed)
        slower = np.maximum(slower, np.minimum(program.speed, _MIN_SPEED))
        if (slower >= program.speed).all():
            break
        program = replace(program, speed=slower)
    seconds = (float(move_seconds(one, profile).sum()) for one in (program, before))
    return program, LinkReport(
        rate,
        _find_layer_numbers(before, busy),
        before.n_moves - program.n_moves,
        int((program.speed < first.speed).sum()),
        next(seconds) - next(seconds),
        _find_layer_numbers(program, find_underruns(program, profile)),
    )


def _find_layer_numbers(program: Program, moves: Bool) -> tuple[int, ...]:
    """Return the numbers, from 1, of the layers with a move in the mask `moves` (K,)."""
    return tuple((distinct(program.layer[moves]) + 1).tolist())


def _count_lines(program: Program, profile: Profile) -> Float:
    """Return the number of lines (K,) for each move and the other lines before it; an arc counts at its first chord."""
    lines = (~program.on_same_arc).astype(np.float64)
    for event in program.events:
        lines[min(event.index, program.n_moves - 1)] += 1
    lines[run_starts(program.layer)] += _count_macro_lines(profile)
    if profile.printer.progress:
        done = np.cumsum(move_seconds(program, profile))
        lines[1:] += np.diff(done // 60) > 0
        lines[1:] += np.diff(done // max(float(done[-1]) / 100, 1.0)) > 0
    return lines


def _count_macro_lines(profile: Profile) -> int:
    """Return the maximum number of lines that the layer macros add at each layer."""
    count = 0
    for text in (profile.printer.before_layer_gcode, profile.printer.layer_gcode):
        lines = [line.strip() for line in text.split("\n") if line.partition(";")[0].strip()]
        count += len(lines) + (_MAX_RESTORE_LINES if any(line[:1] in "Gg" for line in lines) else 0)
    return count


def _spread_arc_lines(program: Program, lines: Float) -> Float:
    """Return the number of lines (K,) of each move; each chord gets the mean over the chords of its arc."""
    number = np.cumsum(~program.on_same_arc) - 1
    return np.asarray((np.bincount(number, weights=lines) / np.bincount(number))[number])
