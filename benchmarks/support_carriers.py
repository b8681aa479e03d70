"""What lies below the extrusions of supports: other supports, the part, and the extrusions of the part.

A grid tells it for all samples at once. Samples near the limit are measured again on the extrusions themselves, because
the cells of the grid are a quarter of an extrusion wide, and because an extrusion of the part may end up to a layer
higher than the model does on a slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.support_beads import SupportFile, draw_beads
from benchmarks.support_solid import Solid
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.coverage.extrusions import Extrusions

__all__ = ["TOUCHES", "Carriers", "SupportLayer", "find_carriers", "list_layers"]

TOUCHES: Final = 0.05  # mm between a support and the one below it
_LANDS: Final = 0.45  # mm between a support and the part below it
_ABOVE: Final = 0.02  # mm; the part may reach this far above the bottom of a support that lies on it
_ACROSS: Final = (-0.4, -0.2, 0.0, 0.2, 0.4)  # widths from the middle of an extrusion
_FINE: Final = (np.arange(20) + 0.5) / 20 - 0.5  # the same, on extrusions near the limit
_SURE: Final = 0.7  # share of the width over something, from which the grid decides
_ALONG: Final = 0.05  # mm between points along the extrusions below
_AROUND: Final = 1.0  # mm around samples in which extrusions are sought
_ROUNDING: Final = 1e-6  # mm
_SAME_WIDTH: Final = 0.02  # mm; extrusions whose widths differ by less are measured together


@dataclass(frozen=True, eq=False)
class SupportLayer:
    """Support extrusions of one top and one bottom.

    Attributes:
        bottom, top: mm.
        members: indices of the extrusions.
        drawn: cells under them.
    """

    bottom: float
    top: float
    members: Int
    drawn: Bool


def list_layers(beads: Extrusions, solid: Solid) -> list[SupportLayer]:
    """Return the layers of supports, from below."""
    bottom, top = np.round(beads.z_top - beads.height, 3), np.round(beads.z_top, 3)
    keys, which = np.unique(np.column_stack([top, bottom]), axis=0, return_inverse=True)
    members = [np.flatnonzero(which.ravel() == number) for number in range(len(keys))]
    return [
        SupportLayer(float(low), float(high), some, draw_beads(beads.take(some), solid.grid))
        for (high, low), some in zip(keys, members, strict=True)
    ]


def find_carriers(layers: Sequence[SupportLayer], z: float, solid: Solid) -> tuple[Bool, Bool]:
    """Return the cells under supports that end at a height, and those under which the part is."""
    below = np.zeros(solid.grid.shape, np.bool_)
    for other in layers:
        if abs(other.top - z) <= TOUCHES:
            below |= other.drawn
    return below, solid.within(z - _LANDS, z + _ABOVE)


@dataclass(frozen=True, eq=False)
class Carriers:
    """What is below the supports that begin at a height.

    Attributes:
        solid: the part.
        supports: cells under supports that end there.
        part: cells under which the part is.
        beads: extrusions of these supports and of the part.
    """

    solid: Solid
    supports: Bool
    part: Bool
    beads: tuple[Extrusions, Extrusions]

    @classmethod
    def below(cls, z: float, layers: Sequence[SupportLayer], file: SupportFile, solid: Solid) -> Carriers:
        """Return what is below a height, mm."""
        near = np.abs(file.support.z_top - z) <= TOUCHES
        printed = (file.part.z_top >= z - _LANDS - _ROUNDING) & (file.part.z_top <= z + _ABOVE)
        beads = file.support.take(np.flatnonzero(near)), file.part.take(np.flatnonzero(printed))
        return cls(solid, *find_carriers(layers, z, solid), beads)

    def measure_share(self, points: Float, across: Float) -> Float:
        """Return the share (n,) of the width of extrusions that lies over something.

        Args:
            points: (n, 2) mm, on their centre lines.
            across: (n, 2) mm, their width as a vector to the left.
        """
        grid, flat = self.solid.grid, (self.supports | self.part).ravel()
        share = np.mean([flat[grid.index(points + side * across)] for side in _ACROSS], axis=0)
        near = np.flatnonzero(share < _SURE)
        fine = (points[near, None] + _FINE[None, :, None] * across[near, None]).reshape(-1, 2)
        carried = self.part.ravel()[grid.index(fine)]
        for beads in self.beads:
            left = np.flatnonzero(~carried)
            carried[left] = _lie_under(beads, fine[left])
        share[near] = carried.reshape(len(near), len(_FINE)).mean(axis=1)
        return np.asarray(share)


def _lie_under(beads: Extrusions, points: Float) -> Bool:
    """Return which points (n, 2) lie under extrusions."""
    found = np.zeros(len(points), np.bool_)
    if not len(points):
        return found
    low, high = points.min(axis=0) - _AROUND, points.max(axis=0) + _AROUND
    first, last = np.minimum(beads.begin, beads.end), np.maximum(beads.begin, beads.end)
    beads = beads.take(np.flatnonzero((last > low).all(axis=1) & (first < high).all(axis=1)))
    number = np.floor(beads.width / _SAME_WIDTH)
    for one in np.unique(number).tolist():
        some = beads.take(np.flatnonzero(number == one))
        count = np.maximum(np.ceil(some.length / _ALONG), 1).astype(np.int64)
        bead = np.repeat(np.arange(some.n_beads), count + 1)
        step = np.arange(len(bead)) - np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
        along = some.begin[bead] + (some.end - some.begin)[bead] * (step / count[bead])[:, None]
        radius = float(some.width.mean()) / 2
        left = np.flatnonzero(~found)
        away, _ = cKDTree(along).query(points[left], distance_upper_bound=radius)
        found[left] = np.isfinite(away)
    return found
