"""What print time, support and surface deviation cost, in minutes of print time."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry.raster import Float32
from printer_slicer.orienting.print_times import PrintTimes
from printer_slicer.profile import Profile
from printer_slicer.supports.slopes import limit_threshold

__all__ = ["FLAT", "GENTLE", "CostModel", "measure_stairs"]

FLAT: Final = 0.9995
"""Cosine of the angle from the horizontal below which a surface is flat: layers can end on it, so it has no stairs."""

GENTLE: Final = 0.985
"""Cosine of the angle from the horizontal below which supports under an overhang are as wide as under a flat one."""

_SLOPE_SUPPORT: Final = 1.2  # volume of supports under slopes, which are narrow, relative to wide ones
_SMALLEST_STEP: Final = 0.5  # of a layer height; lower places count as lying on the bed


def measure_stairs(slope: Float32, sine: Float32) -> Float32:
    """Return the mean distance (...,) of a slope from its stairs, for stairs that cross it at every half of a step.

    It is a multiple of `CostModel.stair_share` times the layer height: from 0 on walls to 1 on flats. A point of the
    slope is nearest to the wall or to the tread of a step.

    Args:
        slope: (...,) cosine of the angle of the surface from the horizontal.
        sine: (...,) its sine.
    """
    return np.asarray(slope / (slope + sine))


class CostModel:
    """Print times and prices with one profile.

    Args:
        profile: gives the speeds, the settings of supports, and the prices.
    """

    def __init__(self, profile: Profile) -> None:
        quality = profile.quality
        self.times = PrintTimes(profile)
        self.gram_price = quality.support_minutes_per_gram
        self.surface_price = quality.surface_price / 60
        self.overhang_cosine = float(np.cos(np.radians(limit_threshold(quality.support_threshold_deg))))
        self.max_bridge = quality.support_max_bridge
        self.lands_on_part = not quality.support_on_bed_only
        self.on_bed = _SMALLEST_STEP * self.times.layer_height
        self.gap = quality.support_gap
        self.stair_share = 1 / 4 if quality.containment == "mid" else 1 / 2
        width = profile.extrusion_width
        self._density = profile.material.density / 1000  # g/mm³
        self._share = min(1.0, width / quality.support_spacing)
        dense = float(bead.spacing(width, self.times.layer_height)) / (
            width + quality.support_interface_spacing
        )
        self._roof = quality.support_interface_layers * self.times.layer_height * min(1.0, dense)

    def compute_support_volume(self, space: Float, area: Float) -> Float:
        """Return the volume (2, ...) extruded for supports of gentle and of steeper overhangs, mm³.

        Args:
            space: (2, ...) between overhangs and what is below them, mm³.
            area: (2, ...) of the overhangs seen from above, mm².
        """
        wide, narrow = space * self._share + area * self._roof
        return np.stack([wide, narrow * _SLOPE_SUPPORT])

    def compute_grams(self, extruded: Float | float) -> Float:
        """Return the weight (...,) of an extruded volume (...,) in mm³, g."""
        return np.asarray(extruded * self._density)

    def compute_cost(
        self, minutes: Float | float, grams: Float | float, deviation_volume: Float | float
    ) -> Float:
        """Return the cost (...,), min.

        Args:
            minutes: (...,) print time including supports, min.
            grams: (...,) filament of supports, g.
            deviation_volume: (...,) mean deviation times area of the surface, mm³.
        """
        return np.asarray(minutes + self.gram_price * grams + self.surface_price * deviation_volume)
