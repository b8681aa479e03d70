"""Find missing extrusion: the nozzle climbs by layers, or filament is fed, but no material comes out."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.inspection.deposition.height_map import COMMAND, END, FED, NEGLIGIBLE, START
from printer_slicer.inspection.deposition.record import MissingExtrusion

__all__ = ["MissingExtrusionFinder"]

_MAX_LAYER_HEIGHT: Final = 1.0  # mm
_MIN_CLIMBS: Final = 3  # consecutive layers; only a print climbs like this
_MIN_LENGTH: Final = 20.0  # mm moved at each height
# mm moved while filament is fed without extruding; a deretraction takes less
_MAX_IN_VAIN: Final = 100.0
_MIN_TRAVELS: Final = 20  # consecutive moves; most travels have fewer


class MissingExtrusionFinder:
    """Finds the first range of moves with missing extrusion; moves are added in batches.

    Attributes:
        first: the first range; None if there is none so far.
    """

    def __init__(self) -> None:
        self.first: MissingExtrusion | None = None
        self._has_extruded = False
        self._current: MissingExtrusion | None = None  # the range without extrusion that may still grow
        self._climbs, self._since_climb = 0, 0.0

    def add_moves(self, rows: Float, extrudes: Bool) -> None:
        """Add executed moves, as rows of `sim.move_log`, with a mask of those that extrude."""
        if self.first is not None and (self._current is None or self.first.command != self._current.command):
            return  # the first range has ended
        edges = np.concatenate([[-1], np.flatnonzero(extrudes), [len(rows)]])
        is_checked = np.diff(edges) > _MIN_TRAVELS
        is_checked[[0, -1]] = True  # such ranges may extend into adjacent batches
        for gap in np.flatnonzero(is_checked).tolist():
            if gap:
                self._has_extruded, self._current, self._climbs = True, None, 0
            if self.first is None or self._current is not None:
                self._extend_range(rows[edges[gap] + 1 : edges[gap + 1]])

    def _extend_range(self, rows: Float) -> None:
        """Extend the current range by moves that do not extrude."""
        if not len(rows):
            return
        xy_length = np.hypot(*(rows[:, END] - rows[:, START])[:, :2].T)
        if self._current is None:
            command, begin = int(rows[0, COMMAND]), float(rows[0, 3])
            self._current, self._since_climb = MissingExtrusion(command, command, 0, 0.0, begin, begin), 0.0
        proven_at, high = self._find_climb(rows, np.cumsum(xy_length))
        in_vain = (rows[:, FED] > NEGLIGIBLE) & (xy_length > NEGLIGIBLE)
        empty_length = self._current.empty_length + float(xy_length[in_vain].sum())
        first_empty = self._current.first_empty or (
            int(rows[in_vain.argmax(), COMMAND]) if in_vain.any() else 0
        )
        retracted_length = self._current.retracted_length + float(xy_length[rows[:, FED] < -NEGLIGIBLE].sum())
        last = int(rows[-1, COMMAND])
        if not proven_at and empty_length > _MAX_IN_VAIN:
            proven_at = last
        length = self._current.length + float(xy_length.sum())
        self._current = self._current._replace(
            last=last,
            proven_at=proven_at,
            length=length,
            high=high,
            empty_length=empty_length,
            retracted_length=retracted_length,
            first_empty=first_empty,
        )
        if proven_at:
            self.first = self._current

    def _find_climb(self, rows: Float, moved: Float) -> tuple[int, float]:
        """Return the command, or 0, that proves a climb without extrusion, and the height reached, mm.

        Args:
            rows: moves.
            moved: (n,) mm, distance at the end of each move.
        """
        assert self._current is not None
        proven_at, high = self._current.proven_at, self._current.high
        z, before = rows[:, 6], -self._since_climb
        rises = np.flatnonzero(np.diff(np.maximum.accumulate(np.append(high, z))) > 0)
        for index in rises.tolist():
            if moved[index] - before < _MIN_LENGTH or z[index] - high > _MAX_LAYER_HEIGHT:
                continue  # a z hop, or the nozzle leaves the part
            self._climbs += 1
            high, before = float(z[index]), float(moved[index])
            if self._climbs >= _MIN_CLIMBS and self._has_extruded and not proven_at:
                proven_at = int(rows[index, COMMAND])
        self._since_climb = float(moved[-1]) - before
        return proven_at, high
