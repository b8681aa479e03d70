"""Measure the distance from the surface of a part to its stacked layers.

Each section is treated as a body with vertical walls from the bottom to the top of its layer. The boundary of the
stack consists of these walls, of the horizontal areas where neighbouring sections differ, of the bottom of the first
layer and of the top of the last one. Nothing is assumed about the part: a missing top, a flat surface between two
layer tops, a lost feature and the steps on a slope all count.

Contoured layers are lower in some places: up to the top of the nearest extrusion. Points on the surface above such
layers are compared with an upright profile through the layers, along the steepest way down.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.errors import PartError
from printer_slicer.geometry.segment_index import OutlineIndex, SegmentIndex
from printer_slicer.geometry.vectors import nearest_share
from printer_slicer.model import Mesh, Sections, Toolpaths
from printer_slicer.roles import roles_with
from printer_slicer.values import Struct, force_setattr

__all__ = ["Deviation", "LocalTops", "measure_deviation"]

_MAX_GRADIENT: Final = 1.0  # mm per mm; steeper surfaces are compared with walls
_REACH, _STEP = 0.4, 0.02  # mm along a profile
_LAYERS_AROUND: Final = 2  # of a point, in its profile
_POINTS_AT_ONCE: Final = 1 << 10  # bounds the memory
_LEVEL: Final = 1e-6  # mm


class LocalTops(Struct, frozen=True, eq=False):
    """Tops of contoured layers: centre lines of all extrusions of these layers.

    Attributes:
        begin, end: (S, 3) mm, with the z of the nozzle.
        layer: (S,) layer of each.
    """

    begin: Float
    end: Float
    layer: Int

    def __post_init__(self) -> None:
        n = len(self.layer)
        force_setattr(self, "begin", frozen_array(self.begin, np.float64, (n, 3)))
        force_setattr(self, "end", frozen_array(self.end, np.float64, (n, 3)))
        force_setattr(self, "layer", frozen_array(self.layer, np.int64, (n,)))

    @classmethod
    def of_paths(cls, paths: Toolpaths) -> LocalTops:
        """Return the tops of layers with lowered paths of the part; scarf seams do not count, as others fill them."""
        xyz = np.column_stack([paths.xy, paths.z_top[paths.path_of_point] + paths.z_offset])
        begin, end = (xyz[point] for point in paths.ends_of_beads)
        path = paths.path_of_bead
        of_part = roles_with(is_part=True)[paths.role[path]]
        used = np.zeros(paths.plan.n_layers, np.bool_)
        used[paths.layer[paths.find_lowered(_LEVEL) & roles_with(is_part=True)[paths.role]]] = True
        some = np.flatnonzero(of_part & used[paths.layer[path]])
        return cls(begin[some], end[some], paths.layer[path[some]])


class Deviation(Struct, frozen=True, eq=False):
    """Distances from points on the surface of the part to the boundary of the stacked layers.

    Attributes:
        points: (n, 3) random points, evenly distributed over the surface, mm.
        distance: (n,) distance of each point, mm.
    """

    points: Float
    distance: Float

    def __post_init__(self) -> None:
        force_setattr(self, "points", frozen_array(self.points, np.float64, (-1, 3)))
        force_setattr(self, "distance", frozen_array(self.distance, np.float64, (len(self.points),)))

    @property
    def mean(self) -> float:
        """Mean distance, mm."""
        return float(self.distance.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean, mm; infinite for a single point."""
        n = len(self.distance)
        return float(self.distance.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf

    @property
    def p95(self) -> float:
        """95th percentile of the distance, mm."""
        return float(np.percentile(self.distance, 95))

    @property
    def max(self) -> float:
        """Largest distance among the points, mm; the true maximum may be slightly larger."""
        return float(self.distance.max())


def measure_deviation(
    mesh: Mesh, sections: Sections, n_points: int = 20_000, seed: int = 0, tops: LocalTops | None = None
) -> Deviation:
    """Measure distances from random points on the surface of a part to the boundary of its stacked layers.

    Each distance is exact except for rounding; only the choice of the points is random. Above contoured layers, it is
    that in the profile, in steps of 0.02 mm.

    Args:
        mesh: the part, standing on z = 0.
        sections: the areas printed in each layer; with resolution 0 the result is the error of the layers alone.
        n_points: number of points, at least 1.
        seed: the same seed gives the same points.
        tops: tops of contoured layers; None: all layers are level.

    Raises:
        PartError: no layer contains any material.
        ValueError: `n_points` is less than 1.
    """
    if n_points < 1:
        raise ValueError(f"at least one point is needed, got {n_points}")
    if sections.solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="The part may be thinner than one layer. Check its size and units",
        )
    points, facet = _choose_random_points(mesh, n_points, np.random.default_rng(seed))
    distance = _measure_distance_to_stack(points, sections)
    if tops is not None and len(tops.layer):
        _measure_distance_to_tops(mesh, points, facet, sections, tops, distance)
    return Deviation(points, distance)


def _choose_random_points(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[Float, Int]:
    """Return (count, 3) random points, distributed evenly by area, and the facet (count,) of each."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    cumulative_area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    # A facet without area adds nothing to the sum and is never chosen.
    facet = np.searchsorted(cumulative_area[:-1], rng.random(count) * cumulative_area[-1], side="right")
    # A triangle is narrower towards its first corner; the square root makes up for that, so points are evenly spread.
    outward, across = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    points = (1 - outward) * a[facet] + outward * ((1 - across) * b[facet] + across * c[facet])
    return np.asarray(points), facet


def _measure_distance_to_stack(points: Float, sections: Sections) -> Float:
    """Return the distance of each point (n,) from the boundary of the stack, mm.

    The walls of the point's own layer are searched first, then the layers above and below.
    """
    planes = np.concatenate([[0.0], sections.plan.top])
    xy, z = np.ascontiguousarray(points[:, :2]), points[:, 2]
    outlines = OutlineIndex(sections.solid, xy.min(axis=0), xy.max(axis=0))
    own_layer = np.clip(np.searchsorted(planes[1:], z), 0, sections.plan.n_layers - 1).astype(np.int64)
    outside = np.maximum(z - planes[own_layer + 1], planes[own_layer] - z)
    best: Float = np.hypot(outlines.distance(xy, own_layer), np.maximum(outside, 0.0))
    inside = outlines.is_inside(xy, own_layer)
    for step in (1, -1):
        _search_layers(outlines, planes, (xy, z, own_layer, inside), best, step)
    return best


def _search_layers(
    outlines: OutlineIndex, planes: Float, start: tuple[Float, Float, Int, Bool], best: Float, step: int
) -> None:
    """Search the layers above (step 1) or below (step -1) each point, and lower `best` to any shorter distance found.

    If the xy of a point is in exactly one of two neighbouring sections, the point is above or below a horizontal face,
    and nothing beyond that face is nearer. The rim of such a face belongs to a wall, so for other points the walls are
    enough.
    """
    xy, z, layer, inside = start
    active = np.arange(len(xy))
    while len(active):
        gap = np.abs(z[active] - planes[layer + (step > 0)])
        near = gap < best[active]
        active, gap, layer, inside = active[near], gap[near], layer[near] + step, inside[near]
        exists = (layer >= 0) & (layer < len(planes) - 1)
        beyond = np.zeros(len(active), np.bool_)
        beyond[exists] = outlines.is_inside(xy[active[exists]], layer[exists])
        is_face = inside != beyond
        best[active[is_face]] = gap[is_face]
        further = exists & ~is_face
        active, gap, layer, inside = active[further], gap[further], layer[further], beyond[further]
        best[active] = np.minimum(best[active], np.hypot(outlines.distance(xy[active], layer), gap))


class _ProfileLayers:
    """The layers as upright profiles cut them."""

    def __init__(self, sections: Sections, tops: LocalTops, box: tuple[Float, Float]) -> None:
        self._planes = np.concatenate([[0.0], sections.plan.top])
        self._outlines = OutlineIndex(sections.solid, *box)
        self._tops, self._n = tops, sections.plan.n_layers
        self._lines = SegmentIndex((tops.begin[:, :2], tops.end[:, :2]), tops.layer, self._n, box)
        self.is_contoured = np.bincount(tops.layer, minlength=self._n) > 0

    def layer_at(self, z: Float) -> Int:
        """Return the layer (n,) at each height, mm."""
        return np.clip(np.searchsorted(self._planes[1:], z), 0, self._n - 1).astype(np.int64)

    def spans(self, xy: Float, layer: Int) -> tuple[Float, Float, Float]:
        """Return bottom, local top and top (n,) of layers at points (n, 2); outside, the local top is the bottom."""
        known = np.flatnonzero((layer >= 0) & (layer < self._n))
        bottom, top = self._planes[np.clip(layer, 0, self._n)], self._planes[np.clip(layer + 1, 0, self._n)]
        bottom, top = np.where(layer < 0, -np.inf, bottom), np.where(layer >= self._n, np.inf, top)
        local = bottom.copy()
        inside = known[self._outlines.is_inside(xy[known], layer[known])]
        local[inside] = top[inside]
        lowered = inside[self.is_contoured[layer[inside]]]
        segment = self._lines.nearest(xy[lowered], layer[lowered])
        begin, end = self._tops.begin[segment], self._tops.end[segment]
        share = nearest_share(xy[lowered] - begin[:, :2], (end - begin)[:, :2])
        local[lowered] = np.maximum(begin[:, 2] + share * (end - begin)[:, 2], bottom[lowered])
        return bottom, local, np.maximum(top, local)


def _measure_distance_to_tops(  # noqa: PLR0917 - arrays of one measurement
    mesh: Mesh, points: Float, facet: Int, sections: Sections, tops: LocalTops, distance: Float
) -> None:
    """Replace the distance (n,) of points (n, 3) on shallow facets (n,) near contoured layers, mm."""
    a, b, c = mesh.triangles[facet].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    across = np.hypot(*normal[:, :2].T)
    box = points[:, :2].min(axis=0) - _REACH, points[:, :2].max(axis=0) + _REACH
    layers = _ProfileLayers(sections, tops, box)
    own = layers.layer_at(points[:, 2])
    near = np.pad(layers.is_contoured, 1)
    near = near[:-2] | near[1:-1] | near[2:]
    chosen = np.flatnonzero((normal[:, 2] > 0) & (across <= _MAX_GRADIENT * normal[:, 2]) & near[own])
    down = normal[:, :2] / np.maximum(across, _LEVEL)[:, None]
    for first in range(0, len(chosen), _POINTS_AT_ONCE):
        some = chosen[first : first + _POINTS_AT_ONCE]
        found = _measure_in_profile(layers, points[some], own[some], down[some])
        distance[some] = np.where(np.isfinite(found), found, distance[some])


def _measure_in_profile(layers: _ProfileLayers, points: Float, own: Int, down: Float) -> Float:
    """Return the distance (n,) of points (n, 3) to the nearest change from filled to empty; inf if none is near.

    The profile of each point lies along its direction `down` (n, 2), around its layer `own` (n,).
    """
    z = points[:, 2]
    steps = np.arange(-round(_REACH / _STEP), round(_REACH / _STEP) + 1) * _STEP
    _, local, _ = layers.spans(points[:, :2], own)
    filled = (z <= local)[:, None]
    place = (points[:, None, :2] + steps[:, None] * down[:, None]).reshape(-1, 2)
    nearest = np.full((len(points), len(steps)), np.inf)
    height = z[:, None]
    for step in range(-_LAYERS_AROUND, _LAYERS_AROUND + 1):
        spans = layers.spans(place, np.repeat(own + step, len(steps)))
        bottom, local, top = (one.reshape(nearest.shape) for one in spans)
        to_filled = np.where(
            local > bottom, np.maximum(np.maximum(bottom - height, height - local), 0), np.inf
        )
        to_empty = np.where(top > local, np.maximum(np.maximum(local - height, height - top), 0), np.inf)
        nearest = np.minimum(nearest, np.where(filled, to_empty, to_filled))
    # An upright wall lies on average half a step before the first point behind it.
    away = np.where(nearest > 0, np.abs(steps), np.maximum(np.abs(steps) - _STEP / 2, 0.0))
    return np.asarray(np.hypot(nearest, away).min(axis=1))
