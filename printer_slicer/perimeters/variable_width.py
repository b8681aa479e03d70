"""Fill narrow places with loops and lines of variable width, joined to the fixed-width loops around them."""

from __future__ import annotations

from functools import reduce

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.geometry import Areas, normalize, offset, simplify
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.geometry.medial_axis import CHORD, MedialAxis, medial_axis
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import reorder_ragged
from printer_slicer.perimeters.bead_counts import CountedGraph, count_beads
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.facing_sides import find_facing_sides
from printer_slicer.perimeters.graph import AxisGraph
from printer_slicer.perimeters.layout import BeadLayout, lay_out_beads
from printer_slicer.perimeters.middle_lines import MiddleLines, trace_middle_lines
from printer_slicer.perimeters.tracing import BeadRings, join_loops, trace_beads
from printer_slicer.values import Struct

__all__ = ["NarrowFill", "fill_narrow_areas"]

_MAX_FACING_ANGLE = np.deg2rad(26)  # slightly more than the angle of corners that get middle beads
# Radius, mm, by which narrow places are followed into wider ones, to bridge short bulges.
_EXTRA_RADIUS = 0.02
_CELL = 0.4  # mm
_POINTS_AT_ONCE = 1 << 14  # points of outlines whose narrow places are filled at once
_SEPARATION = 2e-5  # mm; two steps of the grid that areas are rounded to
_CHORD_RATIO = 0.8  # tolerance of the medial axis, as a share of that of outlines
_ROUNDING = 1e-3  # mm of an outline
_AXIS_MARGIN = 0.5  # mm around narrow places within which the medial axis must be known


class NarrowFill(Struct, frozen=True, eq=False):
    """All loops and lines of the layers with narrow places.

    Attributes:
        layers: (L,) which layers have narrow places.
        rings: loops of these layers.
        lines: middle lines.
        inside: remaining areas.
        lost: (L,) mm² that are too thin for any bead.
    """

    layers: Bool
    rings: BeadRings
    lines: MiddleLines
    inside: Areas
    lost: Float

    @classmethod
    def empty(cls, n_layers: int) -> NarrowFill:
        """Return the fill of `n_layers` layers without narrow places."""
        none, of_none = np.zeros((0, 2)), np.zeros(0, np.int64)
        rings = BeadRings(none, np.zeros(0), of_none, of_none, of_none)
        return cls(
            np.zeros(n_layers, np.bool_),
            rings,
            MiddleLines.empty(),
            Areas.empty(n_layers),
            np.zeros(n_layers),
        )

    def merge(self, other: NarrowFill) -> NarrowFill:
        """Combine the fills of different layers."""
        return NarrowFill(
            self.layers | other.layers,
            self.rings.merge(other.rings),
            self.lines.merge(other.lines),
            self.inside.merge(other.inside),
            self.lost + other.lost,
        )


def fill_narrow_areas(solid: Areas, beading: Beading, tolerance: float = 0.0) -> NarrowFill:
    """Fill the layers that have narrow places with loops and middle lines, a few layers at a time to save memory.

    Args:
        solid: clean areas.
        beading: number of beads by thickness.
        tolerance: mm by which the outlines of these layers may be simplified.
    """
    fills = [_fill_layers(solid.of_layers(some), beading, tolerance) for some in _split_layers(solid)]
    return reduce(NarrowFill.merge, fills, NarrowFill.empty(solid.n_layers))


def _split_layers(solid: Areas) -> list[Bool]:
    """Divide the layers into slabs of about `_POINTS_AT_ONCE` points; return the mask (L,) of each slab."""
    points = solid.ring_start[solid.layer_start]
    slab = (points[1:] - 1) // _POINTS_AT_ONCE
    return [slab == number for number in distinct(slab[solid.used]).tolist()]


def _fill_layers(solid: Areas, beading: Beading, tolerance: float) -> NarrowFill:
    """Fill the narrow places of some layers, see `fill_narrow_areas`."""
    widest = beading.thresholds()[-1] + _EXTRA_RADIUS
    if tolerance:
        simple = simplify(solid, tolerance)
        near = find_facing_sides(simple, 2 * widest, _MAX_FACING_ANGLE)
        solid = normalize(simple.of_layers(near.layer))
    else:
        near = find_facing_sides(solid, 2 * widest, _MAX_FACING_ANGLE)
        solid = solid.of_layers(near.layer)
    if not len(near.layer):
        return NarrowFill.empty(solid.n_layers)
    chord = max(CHORD, _CHORD_RATIO * tolerance)
    narrow, broken = _fill_along_axis(solid, near, (beading, widest), chord)
    if broken.any():
        # Layers whose narrow places cannot be joined to fixed-width loops are traced completely. A small inset
        # separates outlines that touch themselves because of rounding.
        apart = offset(solid.of_layers(broken), -_SEPARATION)
        rest, _ = _fill_along_axis(apart, None, (beading, np.full_like(widest, np.inf)), chord)
        narrow = narrow.merge(rest)
    return narrow


def _fill_along_axis(
    solid: Areas, near: Boxes | None, limits: tuple[Beading, Float], chord: float
) -> tuple[NarrowFill, Bool]:
    """Fill along the medial axis near narrow places, or along all of it; return the fill and the failed layers (L,)."""
    beading, widest = limits
    sides = np.ones(len(solid.xy), np.bool_)
    if near is not None:
        sides = Boxes.of_sides(solid).touches_any(near.expand(2 * float(widest.max()) + _AXIS_MARGIN))
    axis = medial_axis(solid, float(widest.max(initial=0.0)), sides, chord=chord)
    real = _have_real_sides(solid, sides, axis.source, axis.corner)
    counted, layers, broken = _select_narrow_pieces(
        count_beads(AxisGraph.of(axis), real, beading, widest), beading, solid.n_layers
    )
    broken[axis.left_out] = True
    if near is not None:
        broken |= _find_unknown_layers(counted, near, float(widest.max()) + _AXIS_MARGIN, solid.n_layers)
    layout = lay_out_beads(counted, beading)
    walk = trace_beads(layout, layout.active, layout.inset, layout.width)
    width = beading.spacing + beading.rounding
    around = solid.select(layers[solid.ring_layer] & _find_partly_wide_rings(solid, axis, counted))
    rings, failed = join_loops(walk, _make_fixed_loops(around, beading), layout, width)
    broken[failed] = True
    layers &= ~broken
    lines = trace_middle_lines(layout, beading)
    within = rings.take(rings.level == beading.loops)
    return (
        NarrowFill(
            layers,
            rings.take((rings.level < beading.loops) & layers[rings.layer]),
            lines.take(layers[lines.layer]),
            _rings_to_areas(within, solid.n_layers).of_layers(layers),
            _lost_area(layout, solid.n_layers) * layers,
        ),
        broken,
    )


def _find_partly_wide_rings(solid: Areas, axis: MedialAxis, counted: CountedGraph) -> Bool:
    """Return which rings (R,) belong to areas that are not narrow everywhere; only these have fixed-width loops."""
    graph = counted.graph
    half = np.flatnonzero(np.repeat(counted.used, 2))
    ring = solid.point_ring[axis.source[2 * graph.origin[half >> 1] + (half & 1)]]
    foot = graph.foot.take(half, axis=0)
    way = foot[:, 1] - foot[:, 0]
    covered = np.bincount(ring, norm(way), minlength=solid.n_rings)
    area = label_components(ring.reshape(-1, 2).T, solid.n_rings)
    wide = np.zeros(solid.n_rings, np.bool_)
    wide[area[covered < solid.ring_length() - _ROUNDING]] = True
    return wide[area]


def _make_fixed_loops(solid: Areas, beading: Beading) -> list[Areas]:
    """Return the fixed-width loops of each level, and the border of the remaining area.

    Round joins keep a constant distance from the outline, like the loops around the medial axis.
    """
    inset = np.arange(beading.loops + 1)[:, None] * beading.spacing + beading.margin
    inset[:-1] += beading.spacing / 2
    return [offset(solid, -one, join="round") for one in inset]


def _have_real_sides(solid: Areas, sides: Bool, source: Int, corner: Bool) -> Bool:
    """Return whether the outlines to the left and right of each piece (E,) of the axis are among the chosen `sides`."""
    both = np.zeros(len(sides), np.bool_)
    both[solid.following] = sides
    both &= sides
    half = ~corner | both[source]
    return np.asarray(half[::2] & half[1::2])


def _find_unknown_layers(counted: CountedGraph, near: Boxes, reach: float, n_layers: int) -> Bool:
    """Return the layers (L,) with pieces so far from narrow places that sides that were not selected may be nearer."""
    graph = counted.graph
    point = distinct(graph.ends[counted.used].ravel())
    result = np.zeros(n_layers, np.bool_)
    if not len(point):
        return result
    # Test cells instead of points, because many points share a cell.
    cell = np.floor(graph.xy.take(point, axis=0) / _CELL).astype(np.int64)
    origin = cell.min(axis=0)
    wide, deep = cell.max(axis=0) - origin + 1
    x, y = (cell - origin).T
    rest, y = np.divmod(distinct((graph.layer[point] * wide + x) * deep + y), deep)
    layer, x = np.divmod(rest, wide)
    middle = (np.column_stack([x, y]) + origin + 0.5) * _CELL
    result[layer[~Boxes(middle, middle, layer).touches_any(near.expand(reach - _CELL / 2))]] = True
    return result


def _lost_area(layout: BeadLayout, n_layers: int) -> Float:
    """Return the area (L,) around pieces too thin for any bead, mm²."""
    graph = layout.graph
    piece = np.flatnonzero(layout.used & (layout.count[layout.port] == 0).all(axis=1))
    half = np.stack([2 * piece, 2 * piece + 1], axis=1).ravel()
    begin, end = graph.xy[graph.start[half]], graph.xy[graph.start[half ^ 1]]
    across, other = end - graph.foot[half, 0], graph.foot[half, 1] - begin
    area = np.abs(across[:, 0] * other[:, 1] - across[:, 1] * other[:, 0]) / 2
    return np.bincount(graph.layer[graph.start[half]], area, n_layers).astype(np.float64)


def _select_narrow_pieces(
    counted: CountedGraph, beading: Beading, n_layers: int
) -> tuple[CountedGraph, Bool, Bool]:
    """Return the connected pieces with a narrow place, their layers (L,), and layers (L,) with incomplete pieces."""
    graph = counted.graph
    ends, layer = graph.ends, graph.piece_layer
    group = label_components(ends[counted.used].T, len(graph.xy))
    narrow = counted.central & (counted.count < beading.full_count)
    open_ended = np.zeros(len(graph.xy), np.bool_)
    open_ended[group[ends[counted.wide].ravel()]] = True
    apart = ~counted.used & ~counted.wide
    open_ended[group[ends[apart].ravel()]] = True
    is_narrow = ~open_ended  # small islands without a long side
    is_narrow[group[ends[narrow, 0]]] = True
    used = counted.used & is_narrow[group[ends[:, 0]]]
    layers = np.zeros(n_layers, np.bool_)
    layers[layer[used]] = True
    touched = np.zeros(len(graph.xy), np.bool_)
    touched[ends[used]] = True
    cut = apart & touched[ends].any(axis=1)
    broken = np.zeros(n_layers, np.bool_)
    broken[layer[cut]] = True
    # Keep the first pieces of wide places, because they show where the narrow places end.
    kept = np.flatnonzero(used | (counted.wide & touched[ends].any(axis=1)))
    central, corner = (counted.central & used)[kept], (counted.corner & used)[kept]
    count = np.where(used, counted.count, 0)[kept]
    pieces = CountedGraph(graph.with_pieces(kept), used[kept], central, corner, counted.wide[kept], count)
    return pieces, layers, broken


def _rings_to_areas(rings: BeadRings, n_layers: int) -> Areas:
    """Return the rings as clean areas."""
    order = np.argsort(rings.layer, kind="stable")
    (x, y), size = reorder_ragged((rings.xy[:, 0], rings.xy[:, 1]), rings.size, order)
    start = np.concatenate([[0], np.cumsum(size)])
    return normalize(Areas(np.column_stack([x, y]), start, rings.layer[order], n_layers))
