"""Put narrow columns under unsupported beads of supports that an overhang needs."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    contain_points,
    difference,
    find_enclosing_rings,
    intersection,
    normalize,
    offset,
    offset_open,
    split_connected,
    stroke_lines,
    union,
)
from printer_slicer.geometry.raster import CellGrid, clearance
from printer_slicer.model import Overhangs, SupportPlan, Toolpaths
from printer_slicer.roles import Role
from printer_slicer.supports.bead_samples import BeadMap, BeadSamples, sample_beads
from printer_slicer.supports.unsupported_beads import SpanRules, find_unsupported_beads
from printer_slicer.values import Struct

__all__ = ["AddedColumns", "add_columns", "find_contact_areas", "find_needed_paths"]

_REACH: Final = 1.0  # mm sideways from a bead to what it carries
_CELL: Final = 0.1  # mm, of the raster on which neighbours are sought
_REACH_OF_WALLS: Final = (
    0.85  # widths from a bead to the edges of its column; of both walls, half must lie on a bead
)
_MIN_WIDTH: Final = 0.4  # widths; narrower rests of columns are left out
_STEP: Final = 0.4  # widths by which columns beside steep slopes of the part move from layer to layer
_CORNER: Final = 0.03  # mm by which stretches that are carried are simplified


class AddedColumns(Struct, frozen=True, eq=False):
    """Columns under unsupported beads.

    Attributes:
        area: by support layer.
        paths: their loops.
        replaced: where they take the place of other beads, by support layer.
    """

    area: Areas
    paths: Toolpaths
    replaced: Areas


def find_contact_areas(overhangs: Overhangs, plan: SupportPlan, some: Bool) -> Areas:
    """Return the overhangs right above some support layers, a mask (S,), grown as far as a bead carries sideways."""
    carrier = plan.carrier[overhangs.area.ring_layer]
    order = np.argsort(carrier, kind="stable")
    order = order[(carrier[order] >= 0) & some[carrier[order]]]
    return offset(normalize(overhangs.area.restacked(order, carrier[order], plan.layers.n_layers)), _REACH)


def find_needed_paths(samples: BeadSamples, paths: Toolpaths, kept: Bool, contacts: Areas) -> Bool:
    """Return a mask (M,) of paths without which some place of an overhang would be unsupported.

    These are lost paths under overhangs, if no other bead is near, and lost paths below them.

    Args:
        samples: of all beads.
        paths: the beads.
        kept: (n,) samples that would remain if everything were taken out that does not stand.
        contacts: see `find_contact_areas`.
    """
    needed, start = np.zeros(paths.n_paths, np.bool_), samples.layer_start
    covered = BeadMap(samples)
    for layer in range(paths.plan.n_layers - 1, -1, -1):
        some = np.arange(start[layer], start[layer + 1])
        lost = some[~kept[some]]
        if not len(lost):
            covered.mark(lost)
            continue
        is_contact = _lies_in(contacts, samples.points(lost), layer)
        if is_contact.any():
            is_contact &= ~_has_neighbours(samples, lost, some[kept[some]])
        needed[samples.path[lost[is_contact | covered.covered[samples.cells(lost)]]]] = True
        covered.mark(some[needed[samples.path[some]]])
    return needed


def _lies_in(areas: Areas, points: Float, layer: int) -> Bool:
    """Return which points (k, 2) lie in the areas of a layer."""
    own = areas.copy_layers(np.array([layer]))
    return contain_points(own, points, np.zeros(len(points), np.int64))


def _has_neighbours(samples: BeadSamples, which: Int, others: Int) -> Bool:
    """Return which of some samples (k,) have one of the others (m,) within reach."""
    points = samples.points(which)
    grid = CellGrid.around(points.min(axis=0) - 2 * _REACH, points.max(axis=0) + 2 * _REACH, _CELL)
    covered = np.zeros(grid.n_cells, np.bool_)
    covered[grid.find_cells(samples.points(others))] = True
    away = clearance(covered.reshape(grid.n_rows, grid.n_columns), _CELL, 2 * _REACH)
    # Others outside the grid count in its outermost cells, which are too far from all points.
    return np.asarray(away.reshape(-1)[grid.find_cells(points)] <= _REACH)


def add_columns(
    samples: BeadSamples,
    paths: Toolpaths,
    hanging: Bool,
    blocked: Areas,
    rules: SpanRules,
    *,
    leans: bool,
) -> AddedColumns:
    """Return columns of two walls under unsupported stretches, down to the part, the bed or beads below.

    Args:
        samples: of the beads.
        paths: the beads.
        hanging: (n,) samples that are to be carried.
        blocked: areas by layer that must stay free.
        rules: largest lengths of unsupported beads.
        leans: whether columns lean beside steep slopes.
    """
    layers, n_layers = paths.plan, paths.plan.n_layers
    wanted = _draw_stretches(samples, paths, hanging)
    width = np.zeros(n_layers)
    width[paths.layer] = paths.width[paths.start[:-1]]
    column, leaning = Areas.empty(1), Areas.empty(1)
    areas, replaced, loops = list[Areas](), list[Areas](), list[Toolpaths]()
    for layer in range(n_layers - 2, -1, -1):
        at = np.array([layer])
        above = wanted.copy_layers(at + 1)
        column = union(column, above) if column.n_rings and above.n_rings else column.merge(above)
        if not column.n_rings:
            continue
        own = paths.take(np.flatnonzero(paths.layer == layer))
        usual = float(width[layer] or width.max())
        column, beside = _lean(column, blocked.copy_layers(at), _STEP * usual if leans else 0.0, usual)
        leaning = union(leaning, beside) if beside.n_rings else leaning
        beads, passed = _divide_beads(own, leaning)
        column = offset_open(difference(column, beads), _MIN_WIDTH * usual)
        replaced.append(intersection(offset(column, usual / 4), passed).on_layers(at, n_layers))
        areas.append(column.on_layers(at, n_layers))
        walls = _make_walls(column, usual, paths, layer)
        loops.append(walls)
        column = _find_unsupported_columns(column, walls, paths, rules, layer)
    made = Toolpaths.joined(layers, [*loops, paths.take(np.zeros(0, np.int64))])
    area, passed = (Areas.concatenate(some[::-1], n_layers) for some in (areas, replaced))
    return AddedColumns(area, made, passed)


def _lean(column: Areas, blocked: Areas, step: float, width: float) -> tuple[Areas, Areas]:
    """Return the columns of a layer outside of what is blocked, and what of it is beside steep slopes.

    Where a steep slope of the part takes a narrow strip, they become wider on their free side, so that they lean beside
    the slope. They move by less than half a width, so that their walls lie on each other.

    Args:
        column: the columns of the layer above, one layer.
        blocked: what must stay free, one layer.
        step: most by which columns move, mm; 0: none leans.
        width: of extrusions, mm.
    """
    if not step:
        return difference(column, blocked), Areas.empty(1)
    lost = intersection(column, blocked)
    strips = difference(lost, offset_open(lost, step))
    if not strips.n_rings:
        return difference(column, blocked), strips
    beside = intersection(offset(strips, 2 * _REACH_OF_WALLS * width), offset(column, step))
    return difference(union(column, beside), blocked), difference(beside, blocked)


def _draw_stretches(samples: BeadSamples, paths: Toolpaths, hanging: Bool) -> Areas:
    """Return the areas of unsupported stretches, about twice as wide as their beads, by layer."""
    which = np.flatnonzero(hanging)
    begins = np.append(True, (np.diff(which) != 1) | (np.diff(samples.path[which]) != 0))
    # A single sample is a short line.
    again = np.repeat(which, 2)
    half = np.where(np.arange(len(again)) % 2, 0.5, -0.5)[:, None] * _measure_ways(samples, again)
    points = samples.points(again) + half
    start = np.append(2 * np.flatnonzero(begins), 2 * len(which))
    of_run = samples.path[which[begins]]
    reach = _REACH_OF_WALLS * paths.width[paths.start[of_run]]
    return stroke_lines(points, start, paths.layer[of_run], reach, paths.plan.n_layers)


def _measure_ways(samples: BeadSamples, which: Int) -> Float:
    """Return the way (k, 2) that each of some samples stands for, mm."""
    across = samples.across[samples.bead[which]].astype(np.float64)
    way = np.column_stack([across[:, 1], -across[:, 0]])
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    return np.asarray(way * samples.length[which, None])


def _draw_beads(paths: Toolpaths) -> Areas:
    """Return what paths of one layer cover, as a stack of one layer."""
    if not paths.n_paths:
        return Areas.empty(1)
    begin, end = paths.ends_of_beads
    points = np.stack([paths.xy[begin], paths.xy[end]], axis=1).reshape(-1, 2)
    zero = np.zeros(len(begin), np.int64)
    return stroke_lines(points, 2 * np.arange(len(begin) + 1), zero, paths.width[begin] / 2, 1)


def _divide_beads(own: Toolpaths, leaning: Areas) -> tuple[Areas, Areas]:
    """Return what beads of one layer cover, and what columns that lean take the place of, as stacks of one layer.

    Such columns pass through rows of other columns, and then carry what lies on those.
    """
    beads = _draw_beads(own)
    if not leaning.n_rings:
        return beads, leaning
    rows = own.take(np.flatnonzero(own.role == Role.SUPPORT))
    passed = intersection(_draw_beads(rows), leaning)
    return difference(beads, passed), passed


def _make_walls(column: Areas, width: float, paths: Toolpaths, layer: int) -> Toolpaths:
    """Return the loops around the columns of one layer."""
    loops = offset(column, -width / 2)
    return Toolpaths.gathered(
        paths.plan,
        xy=loops.xy,
        size=np.diff(loops.ring_start),
        layer=np.full(loops.n_rings, layer),
        role=np.full(loops.n_rings, Role.SUPPORT),
        width=np.full(loops.n_rings, width),
        closed=True,
    )


def _find_unsupported_columns(
    column: Areas, walls: Toolpaths, paths: Toolpaths, rules: SpanRules, layer: int
) -> Areas:
    """Return the columns of a layer whose walls the beads below do not support."""
    if not layer or not walls.n_paths:
        return Areas.empty(1)
    below = paths.take(np.flatnonzero(paths.layer == layer - 1))
    both = Toolpaths.joined(paths.plan, [below, walls])
    samples = sample_beads(both)
    hanging = find_unsupported_beads(samples, both, rules)
    places = samples.points(np.flatnonzero(hanging & (samples.path >= below.n_paths)))
    if not len(places):
        return Areas.empty(1)
    pieces = split_connected(column)
    ring = find_enclosing_rings(column, places, np.zeros(len(places), np.int64))
    which = np.unique(pieces.of_ring[ring[ring >= 0]])
    return pieces.on_layers(1, which)
