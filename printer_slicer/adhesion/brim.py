"""The brim: loops around the first layer that hold on to it, outside of it, in its holes, or at its corners.

The outlines of the first layer divide the bed into rooms: the one around everything, and one in each hole. What stands
in a hole of another body has its outside there, so each room has its own loops, and those of one room never reach
another. Each room is a layer of the stacks below, and all are worked on at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.adhesion.ears import sharp_corners
from printer_slicer.adhesion.loops import on_bed, paths_of
from printer_slicer.arrays import Bool, Float, Int, lengths
from printer_slicer.errors import PartError
from printer_slicer.geometry import (
    clip_outlines,
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    rings_around,
    union,
)
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.profile import Profile, Quality
from printer_slicer.roles import Role

__all__ = ["brim_paths"]

# Two loops that would come closer than this share of the spacing are left out: they would lie on each other.
_CLOSEST = 0.6
_EAR_STEPS = 48  # corners of an ear


@dataclass(frozen=True, slots=True, eq=False)
class _Rooms:
    """The first layer, room by room: room 0 is around everything, the others are holes.

    Attributes:
        bodies: what stands in each room, filled up.
        holes: the area of each hole; nothing in room 0.
    """

    bodies: Areas
    holes: Areas


def brim_paths(sections: Sections, profile: Profile) -> Toolpaths:
    """Loops on the first layer, body by body, from far away to the part; cut where an ear ends.

    Raises:
        PartError: the brim leaves the bed.
    """
    quality, plan, width = profile.quality, sections.plan, profile.width_on_bed
    gap = float(bead.spacing(width, float(plan.height[0])))
    count = int(np.ceil(quality.brim_width / gap - 1e-6))
    first = sections.solid.select(sections.solid.ring_layer == 0)
    if not (count and first.n_rings):
        return paths_of(plan, [], np.zeros(0, np.int64), Role.BRIM, width)
    rooms = _rooms(first)
    out = quality.brim_gap + width / 2 + gap * np.arange(count)
    reach = float(out[-1]) + width / 2
    within = _limits(rooms, reach, width, quality)
    cuts = [
        _cut(_loops(rooms, float(distance), _CLOSEST * gap / 2, quality), within, width)
        for distance in out[::-1]
    ]
    lines = [line for some, _, _ in cuts for line in some]
    room, closed = (np.concatenate([cut[i] for cut in cuts]) for i in (1, 2))
    if not on_bed(np.concatenate([np.zeros((0, 2)), *lines]), profile, width):
        raise PartError(
            f"a brim of {quality.brim_width:g} mm around the part leaves the bed of {profile.printer.name!r}",
            remedy="lower quality.brim_width",
        )
    around = union(offset(rooms.bodies, reach, join="round"), rooms.holes)
    grounds = within if quality.brim_type == "ears" else around
    order = _by_body(lines, room, grounds.select(grounds.ring_area() > 0))
    return paths_of(
        plan,
        [lines[i] for i in order],
        np.zeros(len(order), np.int64),
        Role.BRIM,
        width,
        closed=closed[order],
    )


def _rooms(first: Areas) -> _Rooms:
    solid = first.ring_area() > 0
    bodies, holes = first.select(solid), first.select(~solid)
    # The middle of a side lies on no other ring, even where two touch at a corner.
    middle = (bodies.xy + bodies.xy[bodies.following])[bodies.ring_start[:-1]] / 2
    room = rings_around(
        Areas(holes.xy, holes.ring_start, holes.ring_layer, first.n_layers), middle, bodies.ring_layer
    )
    n_rooms = holes.n_rings + 1
    order = np.argsort(room, kind="stable")
    placed = bodies.take(order)
    filled = [ring[::-1] for ring in holes.rings(0)]
    return _Rooms(
        Areas(placed.xy, placed.ring_start, room[order] + 1, n_rooms),
        Areas.from_rings([[], *([ring] for ring in filled)]),
    )


def _loops(rooms: _Rooms, distance: float, near: float, quality: Quality) -> Areas:
    """The centre lines at one distance from what they go around, room by room."""
    kind = quality.brim_type
    if kind == "inner":
        return offset_open(offset(rooms.holes, -distance, join="round"), near)
    # Grown a little farther and back: gaps between neighbours that are too narrow for two beads get none.
    around = offset(offset(rooms.bodies, distance + near, join="round"), -near, join="round")
    if kind != "both":
        return around
    free = offset_open(offset(difference(rooms.holes, rooms.bodies), -distance, join="round"), near)
    return around.select(around.ring_layer == 0).merge(free)


def _limits(rooms: _Rooms, reach: float, width: float, quality: Quality) -> Areas:
    """Where the centre lines of each room may lie, beyond what their distance sees to."""
    clear = quality.brim_gap + width / 2
    if quality.brim_type == "inner":
        return difference(rooms.holes, offset(rooms.bodies, clear, join="round"))
    low, high = rooms.bodies.xy.min(axis=0) - 2 * reach, rooms.bodies.xy.max(axis=0) + 2 * reach
    everywhere = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    inside = [[everywhere], *([] for _ in range(rooms.bodies.n_layers - 1))]
    if quality.brim_type == "both":
        return union(Areas.from_rings(inside), rooms.holes)
    free = union(Areas.from_rings(inside), offset(rooms.holes, -clear, join="round"))
    if quality.brim_type == "outer":
        return free
    corner, room = sharp_corners(rooms.bodies, quality.brim_ear_angle_deg, quality.brim_ear_scale)
    turn = 2 * np.pi * np.arange(_EAR_STEPS) / _EAR_STEPS
    disc = reach * np.column_stack([np.cos(turn), np.sin(turn)])
    discs = [[disc + at for at in corner[room == k]] for k in range(rooms.bodies.n_layers)]
    return intersection(free, normalize(Areas.from_rings(discs)))


def _cut(loops: Areas, within: Areas, width: float) -> tuple[list[Float], Int, Bool]:
    """The centre lines inside their limits, with room and whether closed; stubs shorter than a bead is wide go."""
    xy, size, ring, closed = clip_outlines(loops, within)
    start = np.append(0, np.cumsum(size))
    kept = np.flatnonzero(closed | (lengths(xy, start, closed=False) >= width))
    return [xy[start[i] : start[i + 1]] for i in kept.tolist()], loops.ring_layer[ring[kept]], closed[kept]


def _by_body(lines: list[Float], room: Int, grounds: Areas) -> list[int]:
    """The order in which lines are laid: those of one ground after each other as they stand, then the nearest ground.

    Args:
        lines: (n, 2) each.
        room: (M,) of each line.
        grounds: outer rings around what hangs together, room by room.
    """
    begin = np.array([line[0] for line in lines]).reshape(-1, 2)
    # Where a line was cut it ends on a border; half-way along it is certainly inside.
    middle = np.array([line[len(line) // 2 - 1 : len(line) // 2 + 1].mean(axis=0) for line in lines])
    by_room = np.argsort(room, kind="stable")
    ground = np.zeros(len(lines), np.int64)
    ground[by_room] = rings_around(grounds, middle.reshape(-1, 2)[by_room], room[by_room])
    groups = [np.flatnonzero(ground == one) for one in np.unique(ground).tolist()]
    order: list[int] = []
    here = begin[0] if len(lines) else np.zeros(2)
    while groups:
        first = np.array([begin[group[0]] for group in groups])
        group = groups.pop(int(np.argmin(((first - here) ** 2).sum(axis=1))))
        order += group.tolist()
        here = lines[order[-1]][-1]
    return order
