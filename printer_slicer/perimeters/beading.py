"""Number and width of the beads that fit side by side into a thickness.

Only the innermost beads change their width; the outer ones keep the usual width, so that visible surfaces are even. All
values are spacings, the share of the thickness that a bead takes. `room` is the thickness without the gaps beside the
round outer sides of the outermost beads.

Source: the "inward distributed" scheme of Kuipers, Doubrovski, Wu, Wang: A framework for adaptive width control of
dense contour-parallel toolpaths in fused deposition modeling, 2020 (arXiv 2004.13497), with limits of widths worked in.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.values import Struct

__all__ = ["Beading"]

_ROUNDING = 1e-4  # mm; rounding must not decide over walls of exactly the least thickness
_TWO_BEADS_FROM = 1.5  # spacings of room from which on two beads replace one
_THIN_RATIO = 0.6  # of the thinnest feature; beads continue through dips down to this thickness
_MIN_MIDDLE_BEAD = 0.3  # spacings, least width of a middle bead


class Beading(Struct, frozen=True, eq=False):
    """Rules for the beads across an area, for each layer.

    Attributes:
        loops: most loops.
        has_middle: whether one more bead in the middle of all loops is allowed.
        spacing: (L,) of a usual bead.
        rounding: (L,) width minus spacing of a bead.
        margin: (L,) distance from the outline to the outer border of the outermost bead's spacing.
        narrowest: (L,) spacing of the narrowest bead.
        widest: (L,) spacing of the widest bead.
        thinnest: (L,) mm; thinner places stay empty.
    """

    loops: int
    has_middle: bool
    spacing: Float
    rounding: Float
    margin: Float
    narrowest: Float
    widest: Float
    thinnest: Float

    @property
    def full_count(self) -> int:
        """Number of beads that stands for all loops with space left inside them."""
        return 2 * self.loops + 1 + self.has_middle

    def room(self, radius: Float, layer: Int) -> Float:
        """Return the thickness available for beads (n,), mm, where the distance to the outlines is `radius` (n,)."""
        return np.asarray(2 * (radius - self.margin[layer]))

    def thresholds(self) -> Float:
        """Return the least radii (full_count, L) at which 1, 2, ..., `full_count` beads fit."""
        one = self.spacing
        pair = np.clip(_TWO_BEADS_FROM * one, 2 * self.narrowest, np.maximum(self.widest, 2 * self.narrowest))
        middle = np.clip(self.narrowest, _MIN_MIDDLE_BEAD * one, one)
        rows = [self.thinnest / 2 + _ROUNDING]
        for count in range(1, self.full_count):
            below = 2 * (count // 2) * one
            rows.append((below + (pair if count % 2 else middle)) / 2 + self.margin)
        return np.maximum.accumulate(np.array(rows), axis=0)

    def spacings(self, room: Float, count: Int, layer: Int) -> Float:
        """Return the spacing (loops + 1, n) of each loop, from the outside inward, followed by that of the middle bead.

        Rows of beads that do not exist have the usual spacing. Where loops leave less than the narrowest middle bead
        needs, the innermost loop becomes narrower, within its limits.
        """
        usual, narrowest = self.spacing[layer], self.narrowest[layer]
        result = np.repeat(usual[None], self.loops + 1, axis=0)
        pairs, middle = np.minimum(count // 2, self.loops), (count % 2 == 1) & (count < self.full_count)
        left = room - 2 * pairs * usual
        alone = np.where(pairs == 0, narrowest, 0.0)  # a single bead is never narrower
        given = np.clip((narrowest - left) / 2, 0.0, np.maximum(usual - narrowest, 0.0))
        gives = np.flatnonzero((pairs > 0) & (middle | (count >= self.full_count)))
        result[pairs[gives] - 1, gives] -= given[gives]
        left[gives] += 2 * given[gives]
        result[-1] = np.where(middle, np.maximum(left, alone), usual)
        even = np.flatnonzero((count > 0) & ~middle & (count < self.full_count))
        result[pairs[even] - 1, even] = room[even] / 2 - (pairs[even] - 1) * usual[even]
        return np.maximum(result, 0.0)

    def max_dip_excess(self, layer: Int) -> Float:
        """Return the largest excess (see `width_excess`) at which the middle bead continues through a short thin run.

        Up to it, the loops beside the middle bead stay within their limits, and closer to their usual width than
        without the bead: with it they give up half of the missing width, without it they take half of the rest.
        """
        narrowest, usual = self.narrowest[layer], self.spacing[layer]
        short = np.minimum(narrowest / 2, 2 * np.maximum(usual - narrowest, 0.0))
        return np.asarray(short / usual)

    def width_excess(self, radius: Float, count: Int, layer: Int) -> Float:
        """Return how far the width of the adapted bead is outside its limits, as a fraction of the usual spacing."""
        room = self.room(radius, layer)
        spacings = self.spacings(room, count, layer)
        pairs, odd = np.minimum(count // 2, self.loops), count % 2 == 1
        own = np.take_along_axis(spacings, np.where(odd, self.loops, pairs - 1)[None], axis=0)[0]
        inmost = (odd & (pairs > 0)) | (count >= self.full_count)
        own = np.where(inmost, room - 2 * pairs * self.spacing[layer], own)
        low = self.narrowest[layer]
        over = np.where(count >= self.full_count, 0.0, own - self.widest[layer])
        excess = np.maximum(np.maximum(low - own, over), 0.0) / self.spacing[layer]
        hopeless = (count <= 0) | (2 * radius < _THIN_RATIO * self.thinnest[layer])
        return np.asarray(np.where(hopeless, np.inf, excess))
