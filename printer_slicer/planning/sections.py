"""Measure the sections of a part at several heights: printed contours, lengths, areas."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, interpolate_rows, next_in_ring
from printer_slicer.geometry import Areas, simplify
from printer_slicer.geometry.plane_sections import section_contours
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface
from printer_slicer.values import Struct

__all__ = ["SectionSums", "Shadows", "measure_sections"]

_MAX_PLANES: Final = 60  # maximum number of heights at which contours are cut
_MAX_LEVELS: Final = 240  # maximum number of heights for all other values
_MIN_DISTANCE: Final = 0.1  # mm, minimum distance between these heights
_COVERED_WIDTH: Final = 1.0  # mm of width per mm of height: perimeters cover the area under steeper slopes


class Shadows(Struct, frozen=True, eq=False):
    """Upward and downward facing areas of a part below some heights.

    Attributes:
        z: (n,) mm, ascending.
        up, down: (n,) mm², projected area of upward and downward facets, without those on the bed.
    """

    z: Float
    up: Float
    down: Float

    @classmethod
    def of(cls, surface: Surface, n: int) -> Shadows:
        """Measure the areas of a part at the borders of `n` levels of equal height."""
        z = np.linspace(0.0, surface.height, n + 1)
        up, down = (shadow.area_below(z, including=True) for shadow in (surface.up, surface.down))
        return cls(z, up, down - down[0])

    def up_between(self, low: Float, high: Float) -> Float:
        """Return the area that faces up between two heights, mm², in the shape of the heights."""
        return np.asarray(np.interp(high, self.z, self.up) - np.interp(low, self.z, self.up))

    def down_between(self, low: Float, high: Float) -> Float:
        """Return the area that faces down between two heights, mm², in the shape of the heights."""
        return np.asarray(np.interp(high, self.z, self.down) - np.interp(low, self.z, self.down))


class SectionSums(Struct, frozen=True, eq=False):
    """Sums over the sections at L heights, and contours at P heights.

    Attributes:
        z: (L,) mm, ascending.
        planes: (P,) mm, ascending, heights of the contours.
        contours: one layer per plane, simplified as in the slicer.
        length: (L,) mm, of all contours.
        loops: (L,) number of contours.
        extent: (L,) mm, side of the square whose outline has the same mean distance from its centre as the contours.
        area: (L,) mm², of the section.
        inside: (L,) mm², area inside the perimeters.
        shadows: upward and downward facing areas.
        shell: thickness of solid top and bottom, mm.
    """

    z: Float
    planes: Float
    contours: Areas
    length: Float
    loops: Float
    extent: Float
    area: Float
    inside: Float
    shadows: Shadows
    shell: tuple[float, float]

    def at_levels(self, values: Float) -> Float:
        """Interpolate values of the planes (H, P) at the levels, (H, L)."""
        return interpolate_rows(self.z, self.planes, values)

    def solid_areas(self, heights: Float) -> Float:
        """Return the area (H, L) of solid infill in layers of heights (H,), mm²: the area within the shell."""
        z, (top, bottom), height = self.z, self.shell, heights[:, None]
        near = self.shadows.up_between(z, z + height / 2 + top)
        near += self.shadows.down_between(z - height / 2 - bottom, z)
        near += (z - height / 2 < bottom) * self.area
        # Only part of this area lies inside the perimeters.
        return np.asarray(np.minimum(near * np.sqrt(self.inside / np.maximum(self.area, 1e-9)), self.inside))

    def exposed_areas(self, heights: Float, solid: Float) -> tuple[Float, Float, Float]:
        """Return the areas (H, L) of top solid infill, bridges and internal bridges in layers of heights (H,), mm²."""
        height, begins = heights[:, None], self.z + self.shell[0]
        infill_below = np.zeros(solid.shape)
        for row, one, infill in zip(infill_below, heights, self.inside - solid, strict=True):
            row[:] = np.interp(self.z - one, self.z, infill)
        left, areas = solid, []
        for found in (
            self.shadows.up_between(self.z, self.z + height),
            self.shadows.down_between(self.z - height, self.z),
            np.minimum(self.shadows.up_between(begins - height / 2, begins + height / 2), infill_below),
        ):
            # Perimeters cover the area under steep slopes.
            areas.append(np.clip(found - _COVERED_WIDTH * height * self.length, 0.0, left))
            left = left - areas[-1]
        return areas[0], areas[1], areas[2]


def measure_sections(surface: Surface, profile: Profile) -> SectionSums:
    """Measure sections at evenly spaced heights.

    Args:
        surface: surface of the part.
        profile: perimeters and their width, thickness of the solid shell, resolution.
    """
    quality = profile.quality
    planes, z = _sample_heights(surface, profile, _MAX_PLANES), _sample_heights(surface, profile, _MAX_LEVELS)
    n = len(planes)
    contours = simplify(section_contours(surface.triangles, planes), quality.resolution)
    loops = np.bincount(contours.ring_layer, minlength=n).astype(np.float64)
    length, loops, extent, area = (
        np.interp(z, planes, values)
        for values in (contours.length(), loops, _contour_extents(contours), np.maximum(contours.area(), 0.0))
    )
    inside = np.maximum(area - length * quality.perimeters * profile.extrusion_width, 0.0)
    shadows = Shadows.of(surface, len(z))
    shell = quality.top_thickness, quality.bottom_thickness
    return SectionSums(z, planes, contours, length, loops, extent, area, inside, shadows, shell)


def _sample_heights(surface: Surface, profile: Profile, max_heights: int) -> Float:
    """Return up to `max_heights` evenly spaced heights and one in the first layer (n,), mm."""
    n = int(np.clip(surface.height / _MIN_DISTANCE, 1, max_heights))
    z: Float = (np.arange(n, dtype=np.float64) + 0.5) * (surface.height / n)
    on_bed = (profile.quality.first_layer_height or profile.thinnest) / 2
    return np.append(on_bed, z) if on_bed < z[0] else z


def _contour_extents(contours: Areas) -> Float:
    """Return the extents of the contours (P,), mm, see `SectionSums`; 0 where there are no contours."""
    xy, n = contours.xy, contours.n_layers
    after = xy.take(next_in_ring(contours.ring_start), axis=0)
    weight = np.hypot(*(after - xy).T)
    plane = np.repeat(contours.ring_layer, np.diff(contours.ring_start))
    total = np.maximum(np.bincount(plane, weights=weight, minlength=n), 1e-9)
    spread = np.zeros(n)
    for middle, delta in zip(((xy + after) / 2).T, (after - xy).T, strict=True):
        mean = np.bincount(plane, weights=weight * middle, minlength=n) / total
        off = (middle - mean.take(plane)) ** 2 + delta**2 / 12
        spread += np.bincount(plane, weights=weight * off, minlength=n) / total
    return np.asarray(np.sqrt(3 * spread))
