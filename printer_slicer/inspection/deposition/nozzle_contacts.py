"""Find extrusions of contoured layers that were laid under the level underside of the nozzle.

The nozzle ends in a level ring, wider than an extrusion. Where a layer follows the surface in z, a lower extrusion that
is laid after a higher one beside it presses into the higher one. Layers count from the first extrusion that descends:
without one, all extrusions of a layer are at one height, or rise in a spiral or a scarf seam.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.inspection.deposition.height_map import HeightMap, MoveBatch, MovePieces
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.unsupported import MIN_REPORTED_LENGTH

__all__ = ["NozzleContactFinder"]

_TOLERANCE: Final = 0.05  # mm; hot plastic yields by this much
_MIN_DESCENT: Final = 0.05  # mm, total descent of the extrusions of a contoured print
_MIN_STEP: Final = 1e-4  # mm, change of z along an extrusion
_MAX_GRADIENT: Final = 0.5  # mm per mm along an extrusion


class NozzleContactFinder:
    """Finds plastic of the same layer under the underside of the nozzle, from batches in printing order.

    Args:
        height_map: everything printed before the batch.
        diameter: mm, of the underside of the nozzle.
    """

    def __init__(self, height_map: HeightMap, diameter: float) -> None:
        self._height_map, self._radius = height_map, diameter / 2
        self._descent = 0.0
        self._layer, self._top = -1, -np.inf
        """The last layer, and its highest extrusion so far, mm."""
        self._found: Defect | None = None
        """All contacts in this layer."""

    def check(self, batch: MoveBatch, pieces: MovePieces, layers: Int) -> Defect | None:
        """Return the contacts in the layer so far, if this batch adds to them and they are long enough.

        Args:
            batch: moves of one height.
            pieces: (P,) pieces of its extruding moves.
            layers: (n,) layer number of each move.
        """
        rise = np.where(batch.extrudes, batch.end[:, 2] - batch.start[:, 2], 0.0)
        self._descent -= float(rise[rise < -_MIN_STEP].sum())
        if int(layers[-1]) != self._layer:
            self._layer, self._top, self._found = int(layers[-1]), -np.inf, None
        highest, self._top = self._top, max(self._top, float(pieces.z.max()))
        if self._descent < _MIN_DESCENT:
            return None
        low = np.flatnonzero(pieces.z < highest - _TOLERANCE)
        if not len(low):
            return None
        gradient = np.minimum(np.abs(rise) / np.maximum(batch.xy_length, 1e-9), _MAX_GRADIENT)
        return self._find(batch, pieces.take(low), gradient[pieces.move[low]], layers)

    def _find(self, batch: MoveBatch, pieces: MovePieces, gradient: Float, layers: Int) -> Defect | None:
        """Return the contacts in the layer, with those of pieces (P,) of extrusions with a gradient, mm per mm."""
        cell = self._height_map.cells(pieces)
        depth = self._height_map.max_depth_below_print_within(cell, pieces.z, self._radius)
        # Behind the nozzle, a descending extrusion is higher by its gradient.
        hit = np.flatnonzero(
            (depth > _TOLERANCE + gradient * self._radius) & (pieces.z + depth < self._top + _TOLERANCE)
        )
        if not len(hit):
            return None
        length, most = float(pieces.length[hit].sum()), float(depth[hit].max())
        found = self._found
        if found is None:
            found = batch.make_defect("pressed", int(pieces.move[hit[0]]), layers, 0.0)
        self._found = found._replace(amount=found.amount + length, depth=max(found.depth, most))
        return self._found if self._found.amount > MIN_REPORTED_LENGTH else None
