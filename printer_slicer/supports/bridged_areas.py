"""Find areas that need no supports because bridge lines with both ends on the part cross them.

Two kinds of lines are tested: those of bridge regions, in the rows in which infill lays them, and external perimeters.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.bridges import bridge_line_gap, count_supported_ends
from printer_slicer.geometry import (
    Areas,
    Lines,
    Polylines,
    contain_points,
    depths,
    hatch_evenly,
    normalize,
    offset,
    outlines_within,
    split_connected,
    stroke_lines,
    unite_row_rectangles,
)
from printer_slicer.model import Regions
from printer_slicer.profile import Profile

__all__ = ["find_bridged_areas"]

_CARRIED_BESIDE = 2.5  # extrusion widths beside the outermost bridge line that need no supports
_MAX_SHORTFALL = (
    1.0  # extrusion widths by which a row may end before the part below; infill extends into the wall
)
_TOLERANCE = 0.01  # mm by which spans may exceed the maximum, because areas are rounded
_MAX_BEND_RATIO = 1.01  # length of a perimeter divided by the distance of its ends; a curved perimeter sags
_MAX_RECESS = 1.0  # mm; a larger distance by which the part recedes below the end of a line counts as this
_STRIP_DISTANCE = 1.0  # extrusion widths, largest between strips of one slope in neighbouring layers


def find_bridged_areas(air: Areas, below: Areas, solid: Areas, regions: Regions, profile: Profile) -> Areas:
    """Return the areas that lines carry which are supported at both ends; they may reach beyond `air`.

    Args:
        air: part of each section outside the section below, on the layers to be tested.
        below: section below each layer.
        solid: section of each layer.
        regions: bridges and their directions.
        profile: `quality.support_max_bridge` limits the free length of lines.
    """
    longest = profile.quality.support_max_bridge
    if not longest or not air.n_rings:
        return Areas.empty(air.n_layers)
    return normalize(
        _cover_bridge_lines(air, below, regions, profile).merge(_cover_perimeters(air, below, solid, profile))
    )


def _cover_bridge_lines(air: Areas, below: Areas, regions: Regions, profile: Profile) -> Areas:
    """Return the area under bridge lines that are supported at both ends, and under the walls beside them."""
    here = air.used[regions.bridge.ring_layer]
    pieces = split_connected(regions.bridge.select(here))
    if not pieces.count:
        return Areas.empty(air.n_layers)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.bridge_angle[here]
    usual = bridge_line_gap(profile, regions.plan.height[pieces.layer])
    rows, _, gap, grid = hatch_evenly(pieces.areas, angle, usual)
    spans = grid.clip_rows(pieces.select_nearby_rings(air))
    supported = count_supported_ends(spans, grid.clip_rows(pieces.select_nearby_rings(below))) == 2
    layer = pieces.layer[spans.layer]
    free = _measure_free_lengths(spans.length(), spans.ends, layer, below)
    short = free <= profile.quality.support_max_bridge + _TOLERANCE
    covered = _are_covered(spans, rows, _MAX_SHORTFALL * profile.extrusion_width)
    held = spans.take(np.flatnonzero(supported & short & covered))
    area = unite_row_rectangles(held, held.u, angle=angle, half=gap / 2, n_layers=pieces.count)
    area = offset(area, _CARRIED_BESIDE * profile.extrusion_width)
    return area.restacked(np.arange(area.n_rings), pieces.layer[area.ring_layer], air.n_layers)


def _are_covered(spans: Lines, rows: Lines, tolerance: float) -> Bool:
    """Return a mask (S,) of spans along which a row of the same piece and number runs, up to a tolerance in mm."""
    if not (spans.n_lines and rows.n_lines):
        return np.zeros(spans.n_lines, np.bool_)
    number = np.concatenate([spans.row, rows.row])
    u = np.concatenate([spans.u, rows.u])
    low, pitch = float(u.min()) - 1.0, float(np.ptp(u)) + 2.0
    place = np.concatenate([spans.layer, rows.layer]) * (np.ptp(number) + 1) + number - number.min()
    key = place[:, None] * pitch + (u - low)
    own, other = key[: spans.n_lines], key[spans.n_lines :]
    at = np.maximum(np.searchsorted(other[:, 0], own.mean(axis=1), side="right") - 1, 0)
    reaches = (other[at, 0] <= own[:, 0] + tolerance) & (other[at, 1] >= own[:, 1] - tolerance)
    return np.asarray(reaches)


def _cover_perimeters(air: Areas, below: Areas, solid: Areas, profile: Profile) -> Areas:
    """Return the area under perimeters that run straight from support to support, as in narrow walls."""
    count, width = profile.quality.perimeters, profile.extrusion_width
    if not count:
        return Areas.empty(air.n_layers)
    runs = Polylines.of(*outlines_within(offset(solid.of_layers(air.used), -width / 2), air))
    length, ends = runs.length(), np.stack([runs.xy[runs.start[:-1]], runs.xy[runs.start[1:] - 1]])
    way = ends[1] - ends[0]
    chord = np.maximum(np.hypot(*way.T), _TOLERANCE)
    free = _measure_free_lengths(length, np.swapaxes(ends, 0, 1), runs.layer, below)
    straight = (length <= _MAX_BEND_RATIO * chord) & (free <= profile.quality.support_max_bridge + _TOLERANCE)
    beyond = width * way / chord[:, None]
    held = [depths(below, points, runs.layer, width) > 0 for points in (ends[0] - beyond, ends[1] + beyond)]
    held_runs = runs.take(np.flatnonzero(straight & held[0] & held[1]))
    held_runs = held_runs.take(np.flatnonzero(~_follow_slopes(held_runs, air, width)))
    radius = np.full(held_runs.n_lines, (count + 0.5) * width)
    return stroke_lines(held_runs.xy, held_runs.start, held_runs.layer, radius, air.n_layers)


def _measure_free_lengths(length: Float, ends: Float, layer: Int, below: Areas) -> Float:
    """Return the free length (n,) of lines between the parts of the model below their ends, mm.

    Sections are cut within each layer. Walls that lean towards each other are farther apart below the upper
    cut, by up to the distance that they recede to the lower cut. That distance is added at each end.

    Args:
        length: (n,) of the lines between the sections below, mm.
        ends: (n, 2, 2) of the lines, mm.
        layer: (n,) of the lines.
        below: section below each layer.
    """
    lower = below.shift_layers(1)
    free = length.copy()
    for end in (0, 1):
        away = -depths(lower, ends[:, end], layer, _MAX_RECESS)
        far = np.flatnonzero(np.isnan(away) & (layer > 1))
        far = far[np.argsort(layer[far], kind="stable")]
        far = far[~contain_points(lower, ends[far, end], layer[far])]
        free += np.maximum(np.nan_to_num(away), 0.0)
        free[far] += _MAX_RECESS
    return free


def _follow_slopes(runs: Polylines, air: Areas, width: float) -> Bool:
    """Return a mask (N,) of runs that have a strip of the same slope beside them, in the layer below or above.

    Strips of a slope are about as wide as a bead. Whether the middle of a perimeter lies in one depends on the layers,
    so some strips of a slope would be carried and others not.
    """
    if not runs.n_lines:
        return np.zeros(0, np.bool_)
    first, last = runs.start[:-1], runs.start[1:] - 1
    middle = (runs.xy[(first + last) // 2] + runs.xy[(first + last + 1) // 2]) / 2
    reach = _STRIP_DISTANCE * width
    beside = [depths(air.shift_layers(rise), middle, runs.layer, reach) > -reach for rise in (1, -1)]
    return np.asarray(beside[0] | beside[1])
