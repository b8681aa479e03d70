"""Find where a print continues without extrusion: the nozzle climbs through layers, or filament is fed in vain."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.inspection.deposition.height_map import COMMAND, END, FED, NOTHING, START
from printer_slicer.inspection.deposition.record import MissingExtrusion

__all__ = ["MissingExtrusionFinder"]

_STEP: Final = 1.0  # mm; no layer is higher
_STEPS: Final = 3  # one after the other: what stands between layers or ends a print does not climb like that
_WORTH: Final = 20.0  # mm that are gone at each height
_PUSHED: Final = (
    100.0  # mm gone while filament is pushed, in vain: nobody puts back what was pulled back on such a way
)
_MANY: Final = 20  # moves: most travel is shorter


class MissingExtrusionFinder:
    """Finds the first stretch without extrusion in batches of moves.

    Attributes:
        first: the first stretch; None if there is none so far.
    """

    def __init__(self) -> None:
        self.first: MissingExtrusion | None = None
        self._laid = False
        self._now: MissingExtrusion | None = None  # what may become one
        self._steps, self._since = 0, 0.0

    def feed(self, rows: Float, extrudes: Bool) -> None:
        """Add moves, as rows of `sim.move_log`, and which of them extrude."""
        if self.first is not None and (self._now is None or self.first.command != self._now.command):
            return  # it has ended
        edges = np.concatenate([[-1], np.flatnonzero(extrudes), [len(rows)]])
        worth = np.diff(edges) > _MANY
        worth[[0, -1]] = True  # they may begin earlier, or go on
        for gap in np.flatnonzero(worth).tolist():
            if gap:
                self._laid, self._now, self._steps = True, None, 0
            if self.first is None or self._now is not None:
                self._go_on(rows[edges[gap] + 1 : edges[gap + 1]])

    def _go_on(self, rows: Float) -> None:
        """Add moves that do not extrude."""
        if not len(rows):
            return
        flat = np.hypot(*(rows[:, END] - rows[:, START])[:, :2].T)
        if self._now is None:
            command, begin = int(rows[0, COMMAND]), float(rows[0, 3])
            self._now, self._since = MissingExtrusion(command, command, 0, 0.0, begin, begin), 0.0
        shows, high = self._climbed(rows, np.cumsum(flat))
        pushes = (rows[:, FED] > NOTHING) & (flat > NOTHING)
        pushed = self._now.pushed + float(flat[pushes].sum())
        wrong = self._now.wrong or (int(rows[pushes.argmax(), COMMAND]) if pushes.any() else 0)
        back = self._now.back + float(flat[rows[:, FED] < -NOTHING].sum())
        last = int(rows[-1, COMMAND])
        if not shows and pushed > _PUSHED:
            shows = last
        length = self._now.length + float(flat.sum())
        self._now = self._now._replace(
            last=last, shows=shows, length=length, high=high, pushed=pushed, back=back, wrong=wrong
        )
        if shows:
            self.first = self._now

    def _climbed(self, rows: Float, gone: Float) -> tuple[int, float]:
        """Return the command that proves a climb without extrusion, 0 if none does, and the height reached.

        Args:
            rows: moves.
            gone: (n,) mm at the end of each.
        """
        assert self._now is not None
        shows, high = self._now.shows, self._now.high
        z, before = rows[:, 6], -self._since
        rises = np.flatnonzero(np.diff(np.maximum.accumulate(np.append(high, z))) > 0)
        for at in rises.tolist():
            if gone[at] - before < _WORTH or z[at] - high > _STEP:
                continue  # a hop, or it leaves the part
            self._steps += 1
            high, before = float(z[at]), float(gone[at])
            if self._steps >= _STEPS and self._laid and not shows:
                shows = int(rows[at, COMMAND])
        self._since = float(gone[-1]) - before
        return shows, high
