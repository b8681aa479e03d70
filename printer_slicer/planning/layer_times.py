"""Estimate the print time of layers before slicing, for planners that weigh time.

A layer consists of perimeters, solid infill (within the shell thickness of a surface), internal infill, top solid
infill, bridges, travels, and the move up to it. The motion model of the slicer (`line_timing`) times the contours of
the part and rows of lines of typical lengths. It uses the speeds, accelerations and limits of the profile, and the flow
that hotend and material allow at that layer height. The minimum layer time applies as far as the minimum speed allows.
The first layer has its own speeds.

The number of travels and retractions is a fit to sliced programs of eight parts. Print times shown to the user come
from the program itself; docs/layer-planning.md compares both.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.motion.rules import limits_of
from printer_slicer.planning.line_timing import (
    InfillRowTimes,
    LineMotion,
    LineTimes,
    time_contours,
    time_moves,
    time_rows,
)
from printer_slicer.planning.sections import measure_sections
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface

__all__ = ["LayerTimes"]

_TRAVELS_PER_LINE: Final = (
    3.5,
    0.03,
    0.25,
)  # travels per contour, per line of solid infill, per line of internal infill
_TRAVEL_LENGTH_RATIO: Final = 0.15  # mean length of a travel, as a fraction of the section's extent
_RETRACTIONS_PER_CONTOUR: Final = 0.75  # retractions per contour after the first
_ROUNDING: Final = 1e-6  # mm


class _LayerLineTimes(NamedTuple):
    """Times of lines, in the first layer or above it.

    Attributes:
        external, inner: (P,) s, one perimeter along every contour.
        rows: lines of solid infill, internal infill, top solid infill, bridges, internal bridges.
        flow: flow limit, mm³/s.
    """

    external: LineTimes
    inner: LineTimes
    rows: list[InfillRowTimes]
    flow: float


class LayerTimes:
    """The modelled time of the layers of one part.

    Args:
        surface: surface of the part.
        profile: speeds, accelerations, widths, shells, limits.
        z: (n,) possible cut heights, mm, ascending.
    """

    def __init__(self, surface: Surface, profile: Profile, z: Float) -> None:
        self._profile, self._z = profile, z
        self._sections = at = measure_sections(surface, profile)
        self._chord = np.clip(np.pi * at.area / np.maximum(at.length, 1e-9), 0.3, 500.0)
        self._infill_spacing = profile.extrusion_width / max(profile.quality.infill_density, 0.01)
        place = np.interp(z, at.z, np.arange(len(at.z)))
        self._below = np.minimum(place.astype(np.int64), max(len(at.z) - 2, 0))
        self._share = place - self._below
        self._above, self._on_bed = (self._time_lines(first=first) for first in (False, True))
        self._travel_seconds = self._time_travels()
        self._cached_times: dict[tuple[float, bool], Float] = {}

    def prepare(self, heights: Float) -> None:
        """Compute the times of layers above the first for heights (H,), mm, at once, which `seconds` uses."""
        times = self._compute_level_times(heights, self._above)
        self._cached_times |= {
            (height, False): row for height, row in zip(heights.tolist(), times, strict=True)
        }

    def seconds(self, indices: Int, height: float) -> Float:
        """Return the time of layers (m,) of `height` mm that are cut at the heights `z[indices]`, s."""
        found = self._interpolate(self._level_times(height, self._above), indices)
        on_bed = self._z.take(indices) <= height / 2 + _ROUNDING
        if on_bed.any():
            found[on_bed] = self._interpolate(self._level_times(height, self._on_bed), indices[on_bed])
        return found

    def seconds_per_mm3(self, height: float) -> float:
        """Return the time per mm³ of extruded material, s, in layers of `height` mm above the first."""
        (length,), _ = self._measure_lines(np.array([height]), self._above)
        gap = float(bead.spacing(self._profile.extrusion_width, height))
        return float(self._level_times(height, self._above).sum() / max(length.sum() * gap * height, 1e-9))

    def _interpolate(self, values: Float, indices: Int) -> Float:
        """Interpolate values (L,) of the levels at the heights `z[indices]` (m,)."""
        below, share = self._below.take(indices), self._share.take(indices)
        low = values.take(below)
        return np.asarray(low + share * (values.take(np.minimum(below + 1, len(values) - 1)) - low))

    def _level_times(self, height: float, times: _LayerLineTimes) -> Float:
        """Return the time (L,) of a layer of `height` mm at each level, s; computed once for each height."""
        known = self._cached_times.get((height, times is self._on_bed))
        if known is None:
            (known,) = self._compute_level_times(np.array([height]), times)
            self._cached_times[height, times is self._on_bed] = known
        return known

    def _compute_level_times(self, heights: Float, times: _LayerLineTimes) -> Float:
        """Compute the times (H, L) of layers of heights (H,), mm, at each level, s."""
        material, printer = self._profile.material, self._profile.printer
        length, printing = self._measure_lines(heights, times)
        lift = time_moves(heights, printer.max_speed_z, printer.max_acceleration_z)
        idle = self._travel_seconds + lift[:, None]
        quick = printing + idle
        slowest = length / material.min_speed + idle
        return np.asarray(np.clip(material.min_layer_time, quick, np.maximum(slowest, quick)))

    def _measure_lines(self, heights: Float, times: _LayerLineTimes) -> tuple[Float, Float]:
        """Return the length of all extrusions of layers of heights (H,) at each level, mm, and their print time, s.

        Both are (H, L).
        """
        quality, at, chord = self._profile.quality, self._sections, self._chord
        gap = bead.spacing(self._profile.extrusion_width, heights)
        fastest = times.flow / (gap * heights * self._profile.material.flow_ratio)
        external, inner = min(quality.perimeters, 1), max(quality.perimeters - 1, 0)
        kinds = self._infill_lengths(heights, gap[:, None], first=times is self._on_bed)
        printing = at.at_levels(
            external * times.external.at_speeds(fastest) + inner * times.inner.at_speeds(fastest)
        )
        for kind, rows in zip(kinds, times.rows, strict=True):
            printing += kind * rows.seconds_per_mm(chord, fastest)
        return (external + inner) * at.length + sum(kinds), printing

    def _infill_lengths(self, heights: Float, gap: Float, *, first: bool) -> tuple[Float, ...]:
        """Return the length (H, L) of each kind of infill in layers of heights (H,) at each level, mm.

        `gap` (H, 1) is the spacing of lines.

        The kinds are solid, internal and top solid infill, bridges and internal bridges.
        """
        at, nozzle = self._sections, self._profile.printer.nozzle_diameter
        density = self._profile.quality.infill_density / gap
        if first:
            none = np.zeros(len(at.z))
            return at.inside / gap, none, none, none, none
        solid = at.solid_areas(heights)
        top, bridges, internal_bridges = at.exposed_areas(heights, solid)
        left = solid - top - bridges - internal_bridges
        # Bridge lines are as wide as the nozzle.
        return (
            left / gap,
            (at.inside - solid) * density,
            top / gap,
            bridges / nozzle,
            internal_bridges / nozzle,
        )

    def _time_lines(self, *, first: bool) -> _LayerLineTimes:
        """Compute the times of lines in the first layer, or in the layers above it."""
        profile, at = self._profile, self._sections
        speeds, hard, limits = profile.speeds, profile.accelerations, limits_of(profile.printer)
        thickest, width = profile.printer.max_layer, profile.extrusion_width
        flow = profile.max_flow * (profile.material.first_layer_max_flow_ratio if first else 1.0)
        slowest = flow / (float(bead.spacing(width, thickest)) * thickest * profile.material.flow_ratio)

        def line_motion(role: str, acceleration_role: str = "") -> LineMotion:
            """Return speed and acceleration of a role; the acceleration may be that of another role."""
            speed, acceleration = getattr(speeds, role), getattr(hard, acceleration_role or role)
            if not first:
                return LineMotion(speed, acceleration)
            most = speeds.first_layer if role.endswith("perimeter") else speeds.first_layer_infill
            return LineMotion(min(speed, most), hard.first_layer or acceleration)

        external, inner = (
            time_contours(at.contours, line_motion(role), slowest, limits)
            for role in ("external_perimeter", "perimeter")
        )
        rows = (
            (width, line_motion("solid_infill")),
            (self._infill_spacing, line_motion("internal_infill")),
            (width, line_motion("top_solid_infill")),
            (width, line_motion("bridge")),
            (width, line_motion("internal_bridge", "bridge")),
        )
        return _LayerLineTimes(
            external, inner, [time_rows(connection, one, slowest, limits) for connection, one in rows], flow
        )

    def _time_travels(self) -> Float:
        """Return the time of travels and retractions in a layer at each level (L,), s."""
        printer, at = self._profile.printer, self._sections
        limits = limits_of(printer)
        travel = time_moves(
            _TRAVEL_LENGTH_RATIO * at.extent, self._profile.speeds.travel, limits.travel_acceleration
        )
        pulled = sum(
            float(time_moves(printer.retract_length, speed, limits.retract_acceleration))
            for speed in (printer.retract_speed, printer.deretract_speed)
        )
        hop = float(time_moves(printer.z_hop, printer.max_speed_z, printer.max_acceleration_z))
        (area,) = at.solid_areas(np.array([self._profile.quality.layer_height]))
        solid, infill = area / self._profile.extrusion_width, (at.inside - area) / self._infill_spacing
        by_loop, by_solid, by_infill = _TRAVELS_PER_LINE
        count = by_loop * at.loops + (by_solid * solid + by_infill * infill) / self._chord
        return np.asarray(
            count * travel + _RETRACTIONS_PER_CONTOUR * np.maximum(at.loops - 1, 0) * (pulled + 2 * hop)
        )
