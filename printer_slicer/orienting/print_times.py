"""Estimate the print time of a part from its surface, without layers.

The volume of a part consists of perimeters along its sides, of solid infill below and above its surfaces, and of
internal infill. Each has a flow, mm³/s, which follows from the speed, the acceleration and the flow limit for lines of
the length that such parts have. To this come the travels and the move up of each layer, and the minimum layer time.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry.raster import Float32
from printer_slicer.motion.rules import limits_of
from printer_slicer.planning.line_timing import time_moves
from printer_slicer.profile import Profile
from printer_slicer.supports.support_layers import find_height_limits

__all__ = ["PrintTimes", "ShellVolumes"]

_TRAVELS: Final = 5.0  # per layer
_TRAVEL_SHARE: Final = 0.15  # mean length of a travel, as a fraction of the width of the part
_SHORTEST_LINE: Final = 0.5  # mm
_LONGEST_LINE: Final = 300.0
_SLOPE_LINE: Final = 1.5  # mm, of the narrow solid infill along slopes
# mean length of a straight piece of a perimeter, as a fraction of the width of the part
_PERIMETER_SHARE: Final = 0.5
# length of lines in mm, and time with travels relative to that of the lines
_WIDE_SUPPORT: Final = (20.0, 1.3)
_NARROW_SUPPORT: Final = (3.0, 1.8)


class ShellVolumes(NamedTuple):
    """The volumes that are printed in different ways, all of one shape (...,), mm³.

    Attributes:
        perimeters: along the sides.
        solid: solid infill of flats.
        narrow: solid infill along slopes.
        internal: internal infill, as if it were solid.
        chord: mean length of a line across the part, mm.
    """

    perimeters: Float
    solid: Float
    narrow: Float
    internal: Float
    chord: Float


class PrintTimes:
    """Print times with one profile.

    Args:
        profile: speeds, accelerations, widths, shells and limits.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        quality = profile.quality
        self.wall_width = quality.perimeters * profile.extrusion_width
        self.top, self.bottom = quality.top_thickness, quality.bottom_thickness
        uniform = str(quality.planner.__struct_config__.tag) == "uniform"
        self.layer_height = quality.layer_height if uniform else (profile.thinnest + profile.thickest) / 2
        self.heights = (
            (self.layer_height, self.layer_height) if uniform else (profile.thinnest, profile.thickest)
        )
        self._shell_ratio = np.float32(quality.slope_shell_ratio)
        self.external_share = min(1.0, 1 / max(quality.perimeters, 1))

    def fill_shells(self, rise: Float32, sine: Float32) -> Float32:
        """Return the thickness (...,) of solid infill across surfaces, mm: of the shell, what perimeters do not fill.

        Args:
            rise: (...,) vertical component of the normals.
            sine: (...,) sine of the angle from the horizontal.
        """
        thickness = np.where(rise < 0, np.float32(self.bottom), np.float32(self.top))
        walls = sine * np.float32(self.wall_width)
        shell = np.maximum(
            np.abs(rise) * thickness, self._shell_ratio * np.minimum(thickness, np.float32(self.wall_width))
        )
        return np.asarray(np.maximum(shell - walls, np.float32(0)))

    def divide(self, sides: Float, solid: Float, narrow: Float, volume: Float | float) -> ShellVolumes:
        """Divide volumes into shells and infill.

        Args:
            sides: (...,) area of the surface, each place times the sine of its angle from the horizontal, mm².
            solid: (...,) volume of solid infill of flats if there is room for it, mm³.
            narrow: (...,) volume of solid infill along slopes if there is room for it, mm³.
            volume: (...,) volume of the part, mm³.
        """
        perimeters = np.minimum(sides * self.wall_width, volume)
        solid = np.minimum(solid, volume - perimeters)
        narrow = np.minimum(narrow, volume - perimeters - solid)
        chord = np.clip(np.pi * volume / np.maximum(sides, 1e-9), _SHORTEST_LINE, _LONGEST_LINE)
        return ShellVolumes(perimeters, solid, narrow, volume - perimeters - solid - narrow, chord)

    def compute_seconds(
        self, volumes: ShellVolumes, n_layers: Float, width: Float, height: Float | float
    ) -> Float:
        """Return the print time (...,), s.

        Args:
            volumes: of the part.
            n_layers: (...,) number of layers.
            width: (...,) width of the part, mm.
            height: (...,) layer height, mm.
        """
        density, rate = self._profile.quality.infill_density, self._compute_seconds_per_mm3
        straight = np.clip(_PERIMETER_SHARE * width, _SHORTEST_LINE, _LONGEST_LINE)
        external, inner = (rate(role, straight, height) for role in ("external_perimeter", "perimeter"))
        printing = (
            volumes.perimeters * (self.external_share * external + (1 - self.external_share) * inner)
            + volumes.solid * rate("solid_infill", volumes.chord, height)
            + volumes.narrow * rate("solid_infill", np.minimum(volumes.chord, _SLOPE_LINE), height)
            + volumes.internal * density * rate("internal_infill", volumes.chord, height)
        )
        printer = self._profile.printer
        travel = time_moves(
            _TRAVEL_SHARE * width, self._profile.speeds.travel, limits_of(printer).travel_acceleration
        )
        idle = n_layers * (
            _TRAVELS * travel + time_moves(height, printer.max_speed_z, printer.max_acceleration_z)
        )
        material = self._profile.material
        extruded = volumes.perimeters + volumes.solid + volumes.narrow + density * volumes.internal
        line = bead.cross_section(self._profile.extrusion_width, height)
        slowest = idle + extruded / line / material.min_speed
        quick = printing + idle
        return np.asarray(np.clip(n_layers * material.min_layer_time, quick, np.maximum(quick, slowest)))

    def compute_support_seconds(self, wide: Float, narrow: Float) -> Float:
        """Return the print time (...,) of supports with extruded volumes of (...,) mm³, s.

        Args:
            wide: under gentle overhangs.
            narrow: under steeper ones, which often get trees.
        """
        height = find_height_limits(self._profile)[1]
        of_wide, of_narrow = (
            travels * self._compute_seconds_per_mm3("support", line, height)
            for line, travels in (_WIDE_SUPPORT, _NARROW_SUPPORT)
        )
        return np.asarray(wide * of_wide + narrow * of_narrow)

    def _compute_seconds_per_mm3(self, role: str, chord: Float | float, height: Float | float) -> Float:
        """Return the print time of 1 mm³ in lines of length `chord` (...,) in layers of `height` (...,), s."""
        section = bead.cross_section(self._profile.extrusion_width, height)
        fastest = self._profile.max_flow / (section * self._profile.material.flow_ratio)
        acceleration = getattr(self._profile.accelerations, role, 0) or self._profile.accelerations.default
        speed = np.minimum(getattr(self._profile.speeds, role), fastest)
        return np.asarray(time_moves(chord, speed, acceleration) / (chord * section))
