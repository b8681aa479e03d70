"""Make the brim: loops on the first layer, outside of the part, in its holes, or at its corners.

The outlines of the first layer divide the bed into zones: one around everything, and one in each hole. Bodies that
stand in a hole of another body have their outside there, so each zone has its own loops, and loops never leave their
zone. Each zone is one layer of the stacks in this module, so that all are processed at once.
"""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.adhesion.loops import is_on_bed, loop_paths
from printer_slicer.arrays import Bool, Float, Int, polyline_lengths
from printer_slicer.errors import PartError
from printer_slicer.geometry import (
    clip_outlines,
    difference,
    find_enclosing_rings,
    intersection,
    normalize,
    offset,
    offset_open,
    union,
)
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.profile import Profile, Quality
from printer_slicer.roles import Role
from printer_slicer.values import Struct

__all__ = ["brim_paths", "brim_reach"]

# Loops that would be closer than this share of the spacing are left out, because they would overlap.
_CLOSEST_RATIO = 0.6
_EAR_CORNERS = 48  # corners of an ear


class _BrimZones(Struct, frozen=True, eq=False):
    """Zones in which the brim may lie on the first layer: zone 0 is outside of all parts, the other zones are holes.

    Attributes:
        bodies: the bodies in each zone, without their holes.
        holes: the area of each hole; empty in zone 0.
    """

    bodies: Areas
    holes: Areas


def brim_reach(profile: Profile) -> float:
    """Return how far the brim extends beyond the part at most, mm; 0 without a brim."""
    quality = profile.quality
    return quality.brim_gap + quality.brim_width + profile.width_on_bed if quality.brim_width else 0.0


def brim_paths(sections: Sections, profile: Profile) -> Toolpaths:
    """Return the brim loops of the first layer, body by body, from the outside toward the part.

    With mouse ears, the loops are cut to discs around corners.

    Raises:
        PartError: the brim leaves the bed.
    """
    quality, plan, width = profile.quality, sections.plan, profile.width_on_bed
    gap = float(bead.spacing(width, float(plan.height[0])))
    count = int(np.ceil(quality.brim_width / gap - 1e-6))
    first = sections.solid.select(sections.solid.ring_layer == 0)
    if not (count and first.n_rings):
        return loop_paths(plan, [], np.zeros(0, np.int64), Role.BRIM, width)
    zones = _find_zones(first)
    out = quality.brim_gap + width / 2 + gap * np.arange(count)
    reach = float(out[-1]) + width / 2
    within = _limit_areas(zones, reach, width, quality)
    cuts = [
        _clip_loops(_make_loops(zones, float(distance), _CLOSEST_RATIO * gap / 2, quality), within, width)
        for distance in out[::-1]
    ]
    lines = [line for some, _, _ in cuts for line in some]
    zone, closed = (np.concatenate([cut[i] for cut in cuts]) for i in (1, 2))
    if not is_on_bed(lines, profile, width):
        where = " or enters an excluded area" if profile.printer.excluded_areas else ""
        raise PartError(
            f"a brim of {quality.brim_width:g} mm around the part leaves the bed of {profile.printer.name!r}{where}",
            remedy="Lower quality.brim_width",
        )
    around = union(offset(zones.bodies, reach, join="round"), zones.holes)
    areas = within if quality.brim_type == "ears" else around
    order = _order_by_body(lines, zone, areas.select(areas.ring_area() > 0))
    return loop_paths(
        plan,
        [lines[i] for i in order],
        np.zeros(len(order), np.int64),
        Role.BRIM,
        width,
        closed=closed[order],
    )


def _find_zones(first: Areas) -> _BrimZones:
    """Divide the bed into zones at the outlines of the first layer."""
    solid = first.ring_area() > 0
    bodies, holes = first.select(solid), first.select(~solid)
    # Test the middle of a side, which lies on no other ring even where two touch at a corner.
    middle = (bodies.xy + bodies.xy[bodies.following])[bodies.ring_start[:-1]] / 2
    zone = find_enclosing_rings(
        Areas(holes.xy, holes.ring_start, holes.ring_layer, first.n_layers), middle, bodies.ring_layer
    )
    n_zones = holes.n_rings + 1
    order = np.argsort(zone, kind="stable")
    placed = bodies.take(order)
    filled = [ring[::-1] for ring in holes.rings(0)]
    return _BrimZones(
        Areas(placed.xy, placed.ring_start, zone[order] + 1, n_zones),
        Areas.from_rings([[], *([ring] for ring in filled)]),
    )


def _make_loops(zones: _BrimZones, distance: float, half_gap: float, quality: Quality) -> Areas:
    """Return the centre lines of the loops at a distance from the bodies, mm, zone by zone.

    Lines that would come closer to each other than twice `half_gap` mm are left out.
    """
    kind = quality.brim_type
    if kind == "inner":
        return offset_open(offset(zones.holes, -distance, join="round"), half_gap)
    # Growing too far and shrinking back closes gaps that are too narrow for two extrusions.
    around = offset(offset(zones.bodies, distance + half_gap, join="round"), -half_gap, join="round")
    if kind != "both":
        return around
    free = offset_open(offset(difference(zones.holes, zones.bodies), -distance, join="round"), half_gap)
    return around.select(around.ring_layer == 0).merge(free)


def _limit_areas(zones: _BrimZones, reach: float, width: float, quality: Quality) -> Areas:
    """Return the area in which the centre lines of each zone may lie."""
    clear = quality.brim_gap + width / 2
    if quality.brim_type == "inner":
        return difference(zones.holes, offset(zones.bodies, clear, join="round"))
    low, high = zones.bodies.xy.min(axis=0) - 2 * reach, zones.bodies.xy.max(axis=0) + 2 * reach
    everywhere = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    inside = [[everywhere], *([] for _ in range(zones.bodies.n_layers - 1))]
    if quality.brim_type == "both":
        return union(Areas.from_rings(inside), zones.holes)
    free = union(Areas.from_rings(inside), offset(zones.holes, -clear, join="round"))
    if quality.brim_type == "outer":
        return free
    from printer_slicer.adhesion.brim_ears import find_sharp_corners  # noqa: PLC0415 - few brims have ears

    corner, zone = find_sharp_corners(zones.bodies, quality.brim_ear_angle_deg, quality.brim_ear_scale)
    turn = 2 * np.pi * np.arange(_EAR_CORNERS) / _EAR_CORNERS
    disc = reach * np.column_stack([np.cos(turn), np.sin(turn)])
    discs = [[disc + at for at in corner[zone == k]] for k in range(zones.bodies.n_layers)]
    return intersection(free, normalize(Areas.from_rings(discs)))


def _clip_loops(loops: Areas, within: Areas, width: float) -> tuple[list[Float], Int, Bool]:
    """Clip loops to their limits and drop short stubs; return the lines, their zones, and which are closed."""
    xy, size, ring, closed = clip_outlines(loops, within)
    start = np.append(0, np.cumsum(size))
    kept = np.flatnonzero(closed | (polyline_lengths(xy, start, closed=False) >= width))
    return [xy[start[i] : start[i + 1]] for i in kept.tolist()], loops.ring_layer[ring[kept]], closed[kept]


def _order_by_body(lines: list[Float], zone: Int, areas: Areas) -> list[int]:
    """Return the printing order of lines: all lines of a connected area, then all lines of the nearest remaining area.

    Args:
        lines: (n, 2) each.
        zone: (M,) zone of each line.
        areas: outer rings of connected areas, zone by zone.
    """
    begin = np.array([line[0] for line in lines]).reshape(-1, 2)
    # A clipped line ends on a border; its middle is certainly inside.
    middle = np.array([line[len(line) // 2 - 1 : len(line) // 2 + 1].mean(axis=0) for line in lines])
    by_zone = np.argsort(zone, kind="stable")
    ground = np.zeros(len(lines), np.int64)
    ground[by_zone] = find_enclosing_rings(areas, middle.reshape(-1, 2)[by_zone], zone[by_zone])
    groups = [np.flatnonzero(ground == one) for one in np.unique(ground).tolist()]
    order: list[int] = []
    here = begin[0] if len(lines) else np.zeros(2)
    while groups:
        first = np.array([begin[group[0]] for group in groups])
        group = groups.pop(int(np.argmin(((first - here) ** 2).sum(axis=1))))
        order += group.tolist()
        here = lines[order[-1]][-1]
    return order
