"""Measure the distance from the surface of a part to its stacked layers.

Each section is treated as a body with vertical walls from the bottom to the top of its layer. The boundary of the
stack consists of these walls, of the horizontal areas where neighbouring sections differ, of the bottom of the first
layer and of the top of the last one. Nothing is assumed about the part: a missing top, a flat surface between two
layer tops, a lost feature and the steps on a slope all count.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.errors import PartError
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import Mesh, Sections
from printer_slicer.values import Struct, force_setattr

__all__ = ["Deviation", "measure_deviation"]


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


def measure_deviation(mesh: Mesh, sections: Sections, n_points: int = 20_000, seed: int = 0) -> Deviation:
    """Measure distances from random points on the surface of a part to the boundary of its stacked layers.

    Each distance is exact except for rounding; only the choice of the points is random.

    Args:
        mesh: the part, standing on z = 0.
        sections: the areas printed in each layer; with resolution 0 the result is the error of the layers alone.
        n_points: number of points, at least 1.
        seed: the same seed gives the same points.

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
    points = _choose_random_points(mesh, n_points, np.random.default_rng(seed))
    return Deviation(points, _measure_distance_to_stack(points, sections))


def _choose_random_points(mesh: Mesh, count: int, rng: np.random.Generator) -> Float:
    """Return (count, 3) random points, distributed evenly by area."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    cumulative_area = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    # A facet without area adds nothing to the sum and is never chosen.
    facet = np.searchsorted(cumulative_area[:-1], rng.random(count) * cumulative_area[-1], side="right")
    # A triangle is narrower towards its first corner; the square root makes up for that, so points are evenly spread.
    outward, across = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return np.asarray((1 - outward) * a[facet] + outward * ((1 - across) * b[facet] + across * c[facet]))


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
