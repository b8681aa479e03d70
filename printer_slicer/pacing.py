"""What a link can carry: stretches of short moves that would make the machine wait for lines.

A file is sent line by line, at some lines a second; the firmware holds some lines ahead. It has none left where it has
printed more lines than the link has brought, by as many as it holds. Whether that happens is a matter of sums: lines
sent less lines printed, seen from where that was least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.extrusion.rows import rows_of
from printer_slicer.extrusion.timing import move_seconds
from printer_slicer.geometry.areas import distinct
from printer_slicer.model import Bool, Float, Program, Role, Toolpaths, Travels
from printer_slicer.profile import Profile

__all__ = ["LinkReport", "crowded", "crowded_paths", "paced"]

_AHEAD = 0.5  # of the moves that a firmware plans ahead are counted on
_ROUNDS = 8
_SPARE = 1.02  # slower than the link by this


@dataclass(frozen=True, slots=True)
class LinkReport:
    """What it took to stay under the link.

    Attributes:
        lines_per_second: of the link.
        layers: numbers, from 1, of the layers where the machine would have waited.
        merged: lines fewer, for moves were merged.
        slowed: moves that are slower.
        seconds: longer than without.
    """

    lines_per_second: float
    layers: tuple[int, ...] = ()
    merged: int = 0
    slowed: int = 0
    seconds: float = 0.0


def crowded(program: Program, profile: Profile) -> Bool:
    """(K,) moves of stretches in which the machine would run out of lines."""
    rate = profile.printer.link_lines_per_second
    if not rate or not program.n_moves:
        return np.zeros(program.n_moves, np.bool_)
    seconds = move_seconds(program, profile)
    # The chords of an arc are one line.
    behind = np.cumsum(~program.on_same_arc) / rate - (np.cumsum(seconds) - seconds)
    least = np.minimum.accumulate(behind)
    short = behind - least > max(_AHEAD * profile.printer.firmware.planner_blocks, 1) / rate
    if not short.any():
        return short
    # From where the lines began to run short.
    begins = np.flatnonzero(behind == least)
    since = begins[np.searchsorted(begins, np.flatnonzero(short), side="right") - 1]
    change = np.zeros(program.n_moves + 1, np.int64)
    np.add.at(change, since, 1)
    np.add.at(change, np.flatnonzero(short) + 1, -1)
    return np.asarray(np.cumsum(change)[:-1] > 0)


def crowded_paths(paths: Toolpaths, travels: Travels, busy: Bool, profile: Profile) -> Bool:
    """(M,) the paths that moves `busy` (K,) belong to."""
    found = np.zeros(paths.n_paths, np.bool_)
    found[rows_of(paths, travels, profile).path[busy]] = True
    return found


def paced(program: Program, before: Program, busy: Bool, profile: Profile) -> tuple[Program, LinkReport]:
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
        short = crowded(program, profile) & (program.role != Role.TRAVEL)
        slower = np.where(
            short, np.minimum(program.speed, length * _per_line(program) * rate / _SPARE), program.speed
        )
        if (slower >= program.speed).all():
            break
        program = replace(program, speed=np.maximum(slower, 0.1))
    seconds = (float(move_seconds(one, profile).sum()) for one in (program, before))
    layers = distinct(before.layer[busy]) + 1
    return program, LinkReport(
        rate,
        tuple(layers.tolist()),
        before.n_moves - program.n_moves,
        int((program.speed < first.speed).sum()),
        next(seconds) - next(seconds),
    )


def _per_line(program: Program) -> Float:
    """(K,) how many moves stand in one line: the chords of an arc."""
    number = np.cumsum(~program.on_same_arc) - 1
    return np.asarray(np.bincount(number)[number], np.float64)
