"""Greedy adaptive layers: from the bed up, each layer is as thick as the flattest facet in it allows.

A layer of height t leaves a stair step on a facet whose unit normal has the vertical component n = |n_z|. Four metrics
limit t (s = sqrt(1 - n²) is the horizontal component of the normal):

    metric      bound on                      t at most                              layers end on flats
    cusp        height of the stair, t n      c / n                                  yes
    triangle    its area, t² n / 2 s          min(d / 0.184, 1.44 d sqrt(s / n))     no
    wasserfall  stair and bulge of the bead   d / (0.184 + 0.5 n)                    yes
    topography  width of the stair, t n / s   w s / n                                no, and flats do not count

The limit c of the cusp metric follows from `quality.tolerance`: a layer cut in its middle deviates by half its cusp
height, so c = 2 tolerance (c = tolerance if `quality.containment` is one-sided). The limits d and w of the other
metrics are chosen such that all four allow the same height on a slope of 45 degrees: t45 = c sqrt(2), d = t45 / 1.44
(triangle), d = t45 (0.184 + 0.5 / sqrt(2)) (wasserfall), w = t45 (topography). On other slopes they allow a cusp height
of at most c (triangle), 1.11 c (wasserfall, near flats), 1.41 c (topography, near walls).

Sources: cusp: Dolenc and Mäkelä, Slicing procedures for layered manufacturing techniques, 1994. triangle: the rule of
PrusaSlicer's adaptive layers. wasserfall: Wasserfall, Hendrich and Zhang, Adaptive slicing for the FDM process
revisited, 2017, as in Slic3r, with its option to match horizontal surfaces. topography: CuraEngine's adaptive layers,
which consider facets only up to the middle of a layer, where it is cut. Only the metrics of these programs are
implemented, without PrusaSlicer's resampling of the heights and Cura's limit on changes between neighbours.

Guarantee: with cusp, the cusp height of each facet is at most c in every layer thicker than the thinnest, unless no
layers within c end on the next flat; with triangle and wasserfall it is within the limits above. Topography guarantees
nothing, because it misses slopes that start in the upper half of a layer. All metrics ignore edges, peaks and features
thinner than a layer, and optimize only the next layer. Not all flats closer together than the thinnest layer are met.
Cost: one pass over the facets, one over the z steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import (
    fill_with_reachable_layers,
    find_event_planes,
    find_reachable_layers,
)
from printer_slicer.planning.slopes import Slopes, cusp_height, find_thickest_layers
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import CuspPlanner, Profile

__all__ = ["METRICS", "Metric", "height_limit", "plan_cusp"]

_BULGE: Final = (
    0.184  # deviation of the rounded side of an extrusion on a vertical wall, as a fraction of its height
)
_TRIANGLE: Final = 1.44
_N_Z_AT_45: Final = sqrt(0.5)  # |n_z| of a slope of 45 degrees


class Metric(NamedTuple):
    """A metric that limits the height of layers.

    Attributes:
        limit: (|n_z| (n,), height allowed at 45 degrees) -> maximum layer height (n,), mm.
        ends_on_flats: whether layers end on flats.
        sees_flats: whether flats inside a layer count as facets with |n_z| = 1.
        considered: fraction of a layer, from its bottom, whose facets are considered.
    """

    limit: Callable[[Float, float], Float]
    ends_on_flats: bool
    sees_flats: bool = True
    considered: float = 1.0


def _limit_by_cusp(n_z: Float, height_at_45: float) -> Float:
    """Return the maximum layer height, given by the height of the stair step."""
    return height_at_45 * _N_Z_AT_45 / n_z


def _limit_by_triangle(n_z: Float, height_at_45: float) -> Float:
    """Return the maximum layer height, given by the area of the stair step."""
    d = height_at_45 / _TRIANGLE
    return np.asarray(np.minimum(d / _BULGE, _TRIANGLE * d * np.sqrt(_horizontal_component(n_z) / n_z)))


def _limit_by_wasserfall(n_z: Float, height_at_45: float) -> Float:
    """Return the maximum layer height, given by the stair step and the bulge of the extrusion (Wasserfall et al.)."""
    return height_at_45 * (_BULGE + 0.5 * _N_Z_AT_45) / (_BULGE + 0.5 * n_z)


def _limit_by_topography(n_z: Float, height_at_45: float) -> Float:
    """Return the maximum layer height, given by the width of the stair step."""
    return height_at_45 * _horizontal_component(n_z) / n_z


def _horizontal_component(n_z: Float) -> Float:
    """Return the horizontal component of a unit normal with vertical component `n_z`."""
    return np.asarray(np.sqrt(np.maximum(1 - n_z * n_z, 0.0)))


METRICS: Final[Mapping[str, Metric]] = {
    "cusp": Metric(_limit_by_cusp, ends_on_flats=True),
    "triangle": Metric(_limit_by_triangle, ends_on_flats=False),
    "wasserfall": Metric(_limit_by_wasserfall, ends_on_flats=True),
    "topography": Metric(_limit_by_topography, ends_on_flats=False, sees_flats=False, considered=0.5),
}


def height_limit(metric: str, slope: Float, profile: Profile) -> Float:
    """Return the maximum layer height (n,) that a metric allows on facets with |n_z| = `slope` (n,), mm.

    Args:
        metric: a key of `METRICS`.
        slope: 0 for a wall, 1 for a flat.
        profile: gives `quality.tolerance` and `quality.containment`.
    """
    height_at_45 = cusp_height(profile) / _N_Z_AT_45
    return METRICS[metric].limit(np.maximum(slope, 1e-12), height_at_45)


def plan_cusp(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan layers from the bed up, each as thick as the flattest facet in it allows.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` has the metric, `quality.tolerance` the allowed deviation.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    settings = profile.quality.planner
    name = settings.metric if isinstance(settings, CuspPlanner) else "cusp"
    metric = METRICS[name]
    steps = ZSteps(mesh, profile)
    first, rest = steps.split_first_layer()
    heights = np.array([first] if first else [], np.int64)
    if rest:
        slopes = Slopes(mesh, steps, flats=metric.sees_flats)
        limit = find_thickest_layers(
            slopes, steps, lambda n: height_limit(name, n, profile), considered=metric.considered
        )
        planes = find_event_planes(mesh, steps, first) if metric.ends_on_flats else [steps.part]
        heights = np.append(
            heights,
            fill_with_reachable_layers(
                find_reachable_layers(limit, planes, first, steps), limit, planes, first, steps
            ),
        )
    return steps.make_plan(heights, "cusp")
