"""Regions for travels: the sections of the part inset by a clearance, and the field outside of these regions."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import find_enclosing_rings, offset, simplify
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.geometry.vectors import nearest_on_segments
from printer_slicer.model import Areas
from printer_slicer.travels.routing_field import OFF, Corners, RoutingField
from printer_slicer.values import Struct

__all__ = ["SIMPLER", "InsetRegions", "build_inset_regions", "build_outside_field", "is_within"]

SIMPLER = 0.5
"""Tolerance for simplified outlines, as a fraction of the clearance."""

_REACH = 4.0  # clearances; points farther outside the inset regions are not moved into them


class InsetRegions(Struct, frozen=True, eq=False):
    """Sections of the part, inset by a margin, in which travels keep a clearance from the outlines.

    Attributes:
        field: routing field; each outer ring with its holes is a separate field, numbered by the ring.
        clearance: mm, approximate width of the margin.
    """

    field: RoutingField
    clearance: float

    def locate(self, points: Float, layer: Int) -> tuple[Float, Int]:
        """Find the region of each point, and move points in the margin to the nearest position in a region.

        Args:
            points: (P, 2) mm.
            layer: (P,) layer of each point, ascending.

        Returns:
            The positions (P, 2) mm, and the region (P,) of each. Points farther outside stay, with region -1.
        """
        areas, place = self.field.areas, points.copy()
        ring = find_enclosing_rings(areas, points, layer)
        region = np.where((ring >= 0) & np.append(areas.ring_area() > 0, False)[ring], ring, -1)
        outside = np.flatnonzero(region < 0)
        edge = self.field.outlines.nearest(points[outside], layer[outside])
        outside, edge = outside[edge >= 0], edge[edge >= 0]
        begin, end = areas.xy[edge], areas.xy[areas.following[edge]]
        foot, _ = nearest_on_segments(points[outside], begin, end)
        near = np.hypot(*(foot - points[outside]).T) <= _REACH * self.clearance
        along = (end - begin)[near]
        inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
        place[outside[near]] = foot[near] + OFF * inward
        region[outside[near]] = self.field.own[areas.point_ring[edge[near]]]
        return place, region


def build_inset_regions(solid: Areas, box: tuple[Float, Float], clearance: float) -> InsetRegions:
    """Inset the sections by a clearance and prepare them for routing.

    Args:
        solid: the sections.
        box: corners (2,) of a box around all points to be queried, mm.
        clearance: mm.
    """
    areas = simplify(offset(solid, -clearance), SIMPLER * clearance)
    outer = areas.ring_area() > 0
    around = find_enclosing_rings(
        areas.select(outer), areas.xy[areas.ring_start[:-1][~outer]], areas.ring_layer[~outer]
    )
    region = np.arange(areas.n_rings)
    region[~outer] = np.append(np.flatnonzero(outer), -1)[around]
    return InsetRegions(
        RoutingField.of(areas, OutlineIndex(areas, *box), region, Corners.inside(areas), np.inf), clearance
    )


def is_within(xy: Float, bed: Float) -> Bool:
    """Return which points (n, 2) lie on the bed, whose lowest and highest x and y are `bed` (2, 2), mm."""
    return np.asarray(((xy >= bed[0]) & (xy <= bed[1])).all(axis=1))


def build_outside_field(
    solid: Areas,
    outlines: OutlineIndex,
    boxes: tuple[tuple[Float, Float], Float],
    clearance: float,
    toll: float,
) -> RoutingField:
    """Return the field for routes that leave the part: one field per layer, with corners on both sides of outlines.

    Args:
        solid: the sections.
        outlines: outlines of the sections.
        boxes: corners (2,) of a box around all points to be queried, and of the bed, mm; routes do not leave the bed.
        clearance: mm.
        toll: mm by which a route may be longer to cross one outline less.
    """
    simple = simplify(solid, SIMPLER * clearance)
    box, bed = boxes
    corners = Corners.inside(simple, clearance).joined(Corners.outside(simple, clearance))
    corners = corners.take(np.flatnonzero(is_within(corners.place, bed)))
    if simple.n_rings != solid.n_rings:  # some slivers were dropped; otherwise ring numbers agree
        solid, outlines = simple, OutlineIndex(simple, *box)
    return RoutingField.of(solid, outlines, solid.ring_layer, corners, toll)
