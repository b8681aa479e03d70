"""Greedy adaptive layers: from the bed up, each as thick as the steepest facet in it allows.

A layer of height t over a facet whose unit normal has the vertical part n = |n_z| leaves a stair. Four rules say how
thick it may be (s = sqrt(1 - n²) is the horizontal part of the normal):

    metric      bound on                      t at most                              layers end on flats
    cusp        height of the stair, t n      c / n                                  yes
    triangle    its area, t² n / 2 s          min(d / 0.184, 1.44 d sqrt(s / n))     no
    wasserfall  stair and bulge of the bead   d / (0.184 + 0.5 n)                    yes
    topography  width of the stair, t n / s   w s / n                                no, and flats do not count

`quality.tolerance` is the cusp metric's c: what a layer is off by is half of its cusp height when it is cut in the
middle, so c = 2 tolerance (c = tolerance where `quality.containment` is one-sided). The other metrics get the d or w
with which all four allow the same height on a slope of 45 degrees: t45 = c sqrt(2), d = t45 / 1.44 (triangle),
d = t45 (0.184 + 0.5 / sqrt(2)) (wasserfall), w = t45 (topography). On other slopes they allow a cusp height of at most
c (triangle), 1.11 c (wasserfall, near flats), 1.41 c (topography, near walls).

Sources: cusp: Dolenc and Mäkelä, Slicing procedures for layered manufacturing techniques, 1994. triangle: the rule of
PrusaSlicer's adaptive layers. wasserfall: Wasserfall, Hendrich and Zhang, Adaptive slicing for the FDM process
revisited, 2017, as in Slic3r, with its option to match horizontal surfaces. topography: CuraEngine's adaptive layers,
which look no higher than the middle of a layer, where it is cut. The last three are the rules only: neither
PrusaSlicer's resampling of the heights nor Cura's greatest change between neighbours is done, and the top is met.

Guarantee: with cusp, each facet's cusp height is within c in every layer that is thicker than the thinnest, unless no
layers within c end on the next flat; with triangle and wasserfall within what is said above. Topography guarantees
none: a slope that begins in the upper half of a layer is not seen. No metric sees edges, peaks or features thinner than
a layer, no metric minimises anything but the next layer, and flats nearer to each other than the thinnest layer are not
all met. Cost: one pass over the facets, one over the z steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import event_planes, reachable_layers, stack_layers
from printer_slicer.planning.slopes import Slopes, cusp_height, thickest_within
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import CuspPlanner, Profile

__all__ = ["METRICS", "Metric", "height_limit", "plan_cusp"]

_BULGE: Final = 0.184  # share of a bead's height by which its rounded side errs on a wall
_TRIANGLE: Final = 1.44
_DIAGONAL: Final = sqrt(0.5)  # |n_z| of a slope of 45 degrees


class Metric(NamedTuple):
    """One rule for the height of a layer.

    Attributes:
        limit: greatest height for |n_z| (n,) and the height allowed at 45 degrees, mm.
        ends_on_flats: whether layers end on flats.
        sees_flats: whether flats inside a layer count as facets with |n_z| = 1.
        seen: the share of a layer, from its bottom, whose facets decide.
    """

    limit: Callable[[Float, float], Float]
    ends_on_flats: bool
    sees_flats: bool = True
    seen: float = 1.0


def _cusp(n: Float, diagonal: float) -> Float:
    return diagonal * _DIAGONAL / n


def _triangle(n: Float, diagonal: float) -> Float:
    d = diagonal / _TRIANGLE
    return np.asarray(np.minimum(d / _BULGE, _TRIANGLE * d * np.sqrt(_level(n) / n)))


def _wasserfall(n: Float, diagonal: float) -> Float:
    return diagonal * (_BULGE + 0.5 * _DIAGONAL) / (_BULGE + 0.5 * n)


def _topography(n: Float, diagonal: float) -> Float:
    return diagonal * _level(n) / n


def _level(n: Float) -> Float:
    """The horizontal part of a unit normal with vertical part `n`."""
    return np.asarray(np.sqrt(np.maximum(1 - n * n, 0.0)))


METRICS: Final[Mapping[str, Metric]] = {
    "cusp": Metric(_cusp, ends_on_flats=True),
    "triangle": Metric(_triangle, ends_on_flats=False),
    "wasserfall": Metric(_wasserfall, ends_on_flats=True),
    "topography": Metric(_topography, ends_on_flats=False, sees_flats=False, seen=0.5),
}


def height_limit(metric: str, slope: Float, profile: Profile) -> Float:
    """The greatest layer height (n,) that a metric allows over facets with |n_z| = `slope` (n,), mm.

    Args:
        metric: a key of `METRICS`.
        slope: 0 for a wall, 1 for a flat.
        profile: `quality.tolerance` and `quality.containment` decide.
    """
    diagonal = cusp_height(profile) / _DIAGONAL
    return METRICS[metric].limit(np.maximum(slope, 1e-12), diagonal)


def plan_cusp(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Layers as thick as the steepest facet in each allows, found from the bed up.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` holds the metric, `quality.tolerance` the error allowed.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    settings = profile.quality.planner
    name = settings.metric if isinstance(settings, CuspPlanner) else "cusp"
    metric = METRICS[name]
    steps = ZSteps(mesh, profile)
    first, rest = steps.begin()
    heights = np.array([first] if first else [], np.int64)
    if rest:
        slopes = Slopes(mesh, steps, flats=metric.sees_flats)
        limit = thickest_within(slopes, steps, lambda n: height_limit(name, n, profile), seen=metric.seen)
        planes = event_planes(mesh, steps, first) if metric.ends_on_flats else [steps.part]
        heights = np.append(
            heights, stack_layers(reachable_layers(limit, planes, first, steps), limit, planes, first, steps)
        )
    return steps.plan(heights, "cusp")
