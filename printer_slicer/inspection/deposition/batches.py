"""Moves of one height of a print, in columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.motion.flow import flow_of

__all__ = ["COMMAND", "END", "FED", "NOTHING", "START", "Laid", "MoveBatch", "runs_of"]

COMMAND, START, END, FED = 0, slice(1, 4), slice(4, 7), 7
"""Columns of the rows that a printer keeps of its moves: see `sim.track`."""

NOTHING: Final = 1e-9
"""mm³ or mm: less is rounding."""

_COLUMNS: Final = ("command", "start", "end", "volume", "flat", "lays", "role")
_FLATTEST: Final = 3.0  # times as thick as its bead is the thread of the flattest: six times as wide as high
_LEVEL: Final = 0.02  # mm: what lies so near in z is looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """Moves of one height, and which of them extrude.

    Attributes:
        command: (n,) command of each move, counted from 1.
        start, end: (n, 3) mm.
        volume: (n,) mm³ extruded.
        flat: (n,) mm, length in x and y.
        lays: (n,) whether the move extrudes.
        role: (n,) role, see `Marks.role`.
    """

    command: Int
    start: Float
    end: Float
    volume: Float
    flat: Float
    lays: Bool
    role: Int

    @property
    def thread(self) -> Float:
        """(n,) mm, diameter of the extruded strand before it is pressed flat."""
        return np.asarray(2.0 * np.sqrt(self.volume / np.maximum(self.flat, NOTHING) / pi))

    @property
    def sideways(self) -> Float:
        """(n, 2) unit vector perpendicular to each move."""
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

    def between(self, first: int, last: int) -> Laid:
        """Return the moves from `first` up to `last`, exclusive."""
        return Laid(*(getattr(self, name)[first:last] for name in _COLUMNS))

    @classmethod
    def joined(cls, parts: Sequence[Laid]) -> Laid:
        """Concatenate consecutive moves."""
        return Laid(*(np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS))


@dataclass(frozen=True, slots=True, eq=False)
class MoveBatch(Laid):
    """Moves of one height as a printer executed them.

    Attributes:
        fed: (n,) mm of filament fed.
        seconds: (n,) that each takes.
        flow: (n,) mm³/s.
    """

    fed: Float
    seconds: Float
    flow: Float

    @classmethod
    def of(cls, rows: Float, seconds: Float, fresh: Float, marks: Marks) -> MoveBatch:
        """Make a batch from rows of executed moves."""
        command = rows[:, COMMAND].astype(np.int64)
        start, end = rows[:, START], rows[:, END]
        flat = np.hypot(*(end - start)[:, :2].T)
        lays = (fresh > NOTHING) & (flat > NOTHING)
        flow = np.zeros(len(rows))
        flow[lays] = flow_of(fresh[lays], seconds[lays])
        return cls(command, start, end, fresh, flat, lays, marks.role(command), rows[:, FED], seconds, flow)

    @property
    def empty(self) -> Bool:
        """(n,) whether filament is fed but nothing is extruded."""
        return (self.fed > NOTHING) & ~self.lays

    def mishap(self, kind: str, at: int, numbers: Int, amount: float) -> Defect:
        """What went wrong at one of the moves, where it ends."""
        x, y, z = self.end[at].tolist()
        return Defect(kind, int(self.command[at]), int(numbers[at]), z, x, y, amount)


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
