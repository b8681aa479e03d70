"""What a link can carry: stretches of short moves that would make the machine wait for lines.

A file is sent line by line, at some lines a second; the firmware holds some lines ahead. It has none left where it has
printed more lines than the link has brought, by as many as it holds. Whether that happens is a matter of sums: lines
sent less lines printed, seen from where that was least. Lines that are no moves count too: fans, accelerations,
progress, and what macros say at each layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Bool, Float, distinct, run_starts
from printer_slicer.curves import merge_moves
from printer_slicer.extrusion import extrude
from printer_slicer.extrusion.move_rows import move_rows
from printer_slicer.extrusion.timing import move_seconds
from printer_slicer.link_model import lateness
from printer_slicer.model import Program, Sections, Toolpaths, Travels
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.travels import travel

__all__ = ["LinkReport", "crowded", "limit_link"]

_AHEAD = 0.5  # of the moves that a firmware plans ahead are counted on
_ROUNDS = 32
_SPARE = 1.02  # slower than the link by this
_SLOWEST = 0.1  # mm/s
_PUT_BACK = 4  # lines at most that put back what a macro has changed


@dataclass(frozen=True, slots=True)
class LinkReport:
    """What it took to stay under the link.

    Attributes:
        lines_per_second: of the link.
        layers: numbers, from 1, of the layers where the machine would have waited.
        merged: lines fewer, for moves were merged.
        slowed: moves that are slower.
        seconds: longer than without.
        waits: numbers, from 1, of the layers where it will wait all the same: nothing there can be slower.
    """

    lines_per_second: float
    layers: tuple[int, ...] = ()
    merged: int = 0
    slowed: int = 0
    seconds: float = 0.0
    waits: tuple[int, ...] = ()


def crowded(program: Program, profile: Profile) -> Bool:
    """(K,) moves of stretches in which the machine would run out of lines."""
    if not profile.printer.link_lines_per_second or not program.n_moves:
        return np.zeros(program.n_moves, np.bool_)
    return _crowded(program, profile, _lines(program, profile))


def _crowded(program: Program, profile: Profile, lines: Float) -> Bool:
    """The same, of moves that bring so many lines (K,)."""
    rate, seconds = profile.printer.link_lines_per_second, move_seconds(program, profile)
    late = lateness(np.cumsum(seconds) - seconds, lines / rate)
    short = late > max(_AHEAD * profile.printer.firmware.planner_blocks, 1) / rate
    if not short.any():
        return short
    # From where the lines began to run short.
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
    """The same with moves that the link to the printer can carry: merged where they are short, then slowed down.

    Args:
        moves: paths in the order of printing, the ways between them, and their moves.
        printed: the sections that the nozzle sees.
        profile: `printer.link_lines_per_second`; where that is 0 nothing is changed, and there is no report.
        profiles: those whose numbers the paths have.
    """
    toolpaths, travels, program = moves
    rate = profile.printer.link_lines_per_second
    busy = crowded(program, profile)
    if not rate or not busy.any():
        return *moves, LinkReport(rate) if rate else None
    dense = _crowded_paths(toolpaths, travels, busy, profile)
    toolpaths = merge_moves(toolpaths, dense, profile.quality.link_tolerance)
    travels = travel(toolpaths, printed, profile)
    slower, report = _paced(extrude(toolpaths, travels, profile, profiles), program, busy, profile)
    return toolpaths, travels, slower, report


def _crowded_paths(paths: Toolpaths, travels: Travels, busy: Bool, profile: Profile) -> Bool:
    """(M,) the paths that moves `busy` (K,) belong to."""
    found = np.zeros(paths.n_paths, np.bool_)
    found[move_rows(paths, travels, profile).path[busy]] = True
    return found


def _paced(program: Program, before: Program, busy: Bool, profile: Profile) -> tuple[Program, LinkReport]:
    """The program slowed down until the link can follow, and what that and merging took.

    Args:
        program: to be slowed down; its short moves are merged already.
        before: as it was.
        busy: (K,) which moves of that would have made the machine wait.
        profile: of both.
    """
    rate = profile.printer.link_lines_per_second
    way = program.xyz - program.start
    length = np.sqrt((way * way).sum(axis=1))
    length = np.where(length > 0, length, np.abs(program.filament))
    first = program
    for _ in range(_ROUNDS):
        lines = _lines(program, profile)
        short = _crowded(program, profile, lines) & (program.role != Role.TRAVEL)
        most = length * rate / (_share(program, lines) * _SPARE)
        slower = np.where(short, np.minimum(program.speed, most), program.speed)
        slower = np.maximum(slower, np.minimum(program.speed, _SLOWEST))
        if (slower >= program.speed).all():
            break
        program = replace(program, speed=slower)
    seconds = (float(move_seconds(one, profile).sum()) for one in (program, before))
    return program, LinkReport(
        rate,
        _numbers(before, busy),
        before.n_moves - program.n_moves,
        int((program.speed < first.speed).sum()),
        next(seconds) - next(seconds),
        _numbers(program, crowded(program, profile)),
    )


def _numbers(program: Program, moves: Bool) -> tuple[int, ...]:
    """Numbers, from 1, of the layers of some moves (K,)."""
    return tuple((distinct(program.layer[moves]) + 1).tolist())


def _lines(program: Program, profile: Profile) -> Float:
    """(K,) lines that each move brings, with those in front of it; of an arc its first chord brings the line."""
    lines = (~program.on_same_arc).astype(np.float64)
    for event in program.events:
        lines[min(event.index, program.n_moves - 1)] += 1
    lines[run_starts(program.layer)] += _of_macros(profile)
    if profile.printer.progress:
        done = np.cumsum(move_seconds(program, profile))
        lines[1:] += np.diff(done // 60) > 0
        lines[1:] += np.diff(done // max(float(done[-1]) / 100, 1.0)) > 0
    return lines


def _of_macros(profile: Profile) -> int:
    """Lines that macros say at each layer, at most."""
    count = 0
    for text in (profile.printer.before_layer_gcode, profile.printer.layer_gcode):
        said = [line.strip() for line in text.split("\n") if line.partition(";")[0].strip()]
        count += len(said) + (_PUT_BACK if any(line[:1] in "Gg" for line in said) else 0)
    return count


def _share(program: Program, lines: Float) -> Float:
    """(K,) of the lines that an arc brings, for each of its chords."""
    number = np.cumsum(~program.on_same_arc) - 1
    return np.asarray((np.bincount(number, weights=lines) / np.bincount(number))[number])
