"""Where the nozzle passes: inside the part, in the sections moved inward, and from piece to piece of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import find_enclosing_rings, offset, simplify
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.geometry.vectors import feet
from printer_slicer.model import Areas
from printer_slicer.travels.routing_field import OFF, Corners, RoutingField

__all__ = ["InsetRegions", "inset_regions", "outside_field"]

_SIMPLER = 0.5  # of the clearance: what the outlines of rooms may be off
_REACH = 4.0  # clearances: what is farther out of the rooms is not led in


@dataclass(frozen=True, slots=True, eq=False)
class InsetRegions:
    """The sections without a margin along their outlines.

    Attributes:
        ground: to seek ways in; each outer ring with the holes in it is a field, by the number of that ring.
        clearance: mm that the rooms are narrower than the sections on each side, about.
    """

    ground: RoutingField
    clearance: float

    def locate(self, points: Float, layer: Int) -> tuple[Float, Int]:
        """Where points (P, 2) on their `layer` (P,) ascending lie in rooms, and in which: (P, 2) and (P,).

        Those in the margin are led in by the nearest way; those outside have no room, -1, and stay where they are.
        """
        areas, place = self.ground.areas, points.copy()
        ring = find_enclosing_rings(areas, points, layer)
        room = np.where((ring >= 0) & np.append(areas.ring_area() > 0, False)[ring], ring, -1)
        out = np.flatnonzero(room < 0)
        edge = self.ground.outlines.nearest(points[out], layer[out])
        out, edge = out[edge >= 0], edge[edge >= 0]
        begin, end = areas.xy[edge], areas.xy[areas.following[edge]]
        foot, _ = feet(points[out], begin, end)
        near = np.hypot(*(foot - points[out]).T) <= _REACH * self.clearance
        along = (end - begin)[near]
        inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
        place[out[near]] = foot[near] + OFF * inward
        room[out[near]] = self.ground.own[areas.point_ring[edge[near]]]
        return place, room


def inset_regions(solid: Areas, box: tuple[Float, Float], clearance: float) -> InsetRegions:
    """The rooms of sections.

    Args:
        solid: the sections.
        box: corners (2,) of the box, mm, in which all points to ask for will lie.
        clearance: mm.
    """
    areas = simplify(offset(solid, -clearance), _SIMPLER * clearance)
    outer = areas.ring_area() > 0
    around = find_enclosing_rings(
        areas.select(outer), areas.xy[areas.ring_start[:-1][~outer]], areas.ring_layer[~outer]
    )
    room = np.arange(areas.n_rings)
    room[~outer] = np.append(np.flatnonzero(outer), -1)[around]
    return InsetRegions(
        RoutingField(areas, OutlineIndex(areas, *box), room, Corners.inside(areas), np.inf), clearance
    )


def outside_field(
    solid: Areas, outlines: OutlineIndex, box: tuple[Float, Float], clearance: float, toll: float
) -> RoutingField:
    """Where ways are sought that leave the part: each layer is a field, with corners inside and outside of it.

    Args:
        solid: the sections.
        outlines: of the sections.
        box: corners (2,) of the box, mm, in which all points to ask for will lie.
        clearance: mm.
        toll: mm that a way may be longer to cross one outline less.
    """
    simple = simplify(solid, _SIMPLER * clearance)
    corners = Corners.inside(simple, clearance).joined(Corners.outside(simple, clearance))
    if simple.n_rings != solid.n_rings:  # slivers are gone; otherwise rings have the same numbers
        solid, outlines = simple, OutlineIndex(simple, *box)
    return RoutingField(solid, outlines, solid.ring_layer, corners, toll)
