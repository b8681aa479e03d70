"""Moves of one height of a print, in columns."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from printer_slicer.geometry import Bool, Float, Int
from printer_slicer.ledger.executed import Marks, Mishap
from printer_slicer.motion.flow import flow_of

__all__ = ["COMMAND", "END", "FED", "NOTHING", "START", "Batch", "runs_of"]

COMMAND, START, END, FED = 0, slice(1, 4), slice(4, 7), 7
"""Columns of the rows that a printer keeps of its moves: see `sim.track`."""

NOTHING: Final = 1e-9
"""mm³ or mm: less is rounding."""

_FLATTEST: Final = 3.0  # times as thick as its bead is the thread of the flattest: six times as wide as high
_LEVEL: Final = 0.02  # mm: what lies so near in z is looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Moves of one height: columns of their rows, and what follows from them."""

    command: Int
    start: Float
    end: Float
    fed: Float
    seconds: Float
    volume: Float
    flat: Float
    lays: Bool
    role: Int
    flow: Float

    @classmethod
    def of(cls, rows: Float, seconds: Float, fresh: Float, marks: Marks) -> Batch:
        """The batch that some rows are."""
        command = rows[:, COMMAND].astype(np.int64)
        start, end = rows[:, START], rows[:, END]
        flat = np.hypot(*(end - start)[:, :2].T)
        lays = (fresh > NOTHING) & (flat > NOTHING)
        flow = np.zeros(len(rows))
        flow[lays] = flow_of(fresh[lays], seconds[lays])
        return cls(command, start, end, rows[:, FED], seconds, fresh, flat, lays, marks.role(command), flow)

    @property
    def empty(self) -> Bool:
        """(n,) whether filament is pushed and nothing comes out."""
        return (self.fed > NOTHING) & ~self.lays

    @property
    def thread(self) -> Float:
        """(n,) mm, how thick what leaves the nozzle is before it is pressed flat."""
        return np.asarray(2.0 * np.sqrt(self.volume / np.maximum(self.flat, NOTHING) / pi))

    @property
    def sideways(self) -> Float:
        """(n, 2) across each move, of length 1."""
        way = (self.end - self.start)[:, :2] / np.maximum(self.flat, NOTHING)[:, None]
        return np.stack([-way[:, 1], way[:, 0]], axis=1)

    def width(self, room: Float) -> Float:
        """(n,) mm from bead to bead where they lie side by side as wide as these.

        Args:
            room: mm, how far down plastic or bed are under some places of them.
        """
        free = room[room > _LEVEL]
        height = float(np.median(free)) if len(free) else 0.0
        thread = np.maximum(self.thread, NOTHING)
        return np.asarray(thread**2 * (pi / 4) / np.clip(height, thread / _FLATTEST, thread))

    def mishap(self, kind: str, at: int, numbers: Int, amount: float) -> Mishap:
        """What went wrong at one of the moves, where it ends."""
        x, y, z = self.end[at].tolist()
        return Mishap(kind, int(self.command[at]), int(numbers[at]), z, x, y, amount)


def runs_of(at: Int, z: Float, before: float) -> tuple[list[int], list[float]]:
    """Where something is laid at another height than at the beginning of its run, and that height."""
    firsts, heights = [], []
    changes = np.flatnonzero(np.diff(z, prepend=np.nan) != 0)
    for place, height in zip(at[changes].tolist(), z[changes].tolist(), strict=True):
        if not abs(height - before) <= _LEVEL:
            firsts.append(place)
            heights.append(height)
            before = height
    return firsts, heights
