"""The planner of the paper: thick layers where the area of the section is constant, thin layers elsewhere.

Source: "Speeding up algorithm for building the STL model using 3D printing", steps 4.1 to 4.9. Two variants correct
errors of the literal algorithm; both are off by default:

    literal   compare the areas one thin layer apart; if they are equal, add a thick layer, else a thin one
    guarded   the same, but every plane up to the top of the thick layer must have the same area
    aligned   divide the part at its z levels; regions of constant area get thick layers, the others thin ones, and
              each region ends exactly at its level

Guarantee: none on distance. Equal areas do not imply equal contours: a sheared prism gets thick layers. The literal
variant may skip a feature between two planes, or extend above the part by almost a thick layer. Cost: one pass over
the facets for all planes.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import AreaPlanner, Profile
from printer_slicer.surface.flats import find_flats

__all__ = ["plan_area"]

_ROUNDING = 1e-4  # mm; rounding error of coordinates in STL files, which have 24 bits


def plan_area(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan layers of `quality.thickest_layer` where the area is constant, and of `quality.thinnest_layer` elsewhere.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` has tolerance and variant.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    settings = profile.quality.planner
    if not isinstance(settings, AreaPlanner):
        settings = AreaPlanner()
    steps = ZSteps(mesh, profile)
    thin, thick = steps.to_steps(profile.thinnest), steps.to_steps(profile.thickest)
    if settings.aligned:
        heights = _plan_aligned(mesh, steps, thin, thick, settings)
    else:
        heights = _plan_literal(mesh, steps, thin, thick, settings)
    return steps.make_plan(heights, "area")


def _are_areas_equal(area: Float, other: Float, settings: AreaPlanner) -> Bool:
    """Return whether the areas of each pair are equal within the tolerance."""
    return np.asarray(
        np.abs(area - other) <= settings.tolerance + settings.relative_tolerance * np.maximum(area, other)
    )


def _plan_literal(mesh: Mesh, steps: ZSteps, thin: int, thick: int, settings: AreaPlanner) -> Int:
    """Return layer heights by the paper's algorithm, in z steps."""
    first = min(steps.first or thin, steps.part)
    pitch = int(np.gcd.reduce([first, thin, thick]))
    # All reachable planes are multiples of the pitch, so all areas are computed in one pass over the facets.
    planes = np.asarray(
        np.arange(steps.part // pitch + thick // pitch + 2) * (pitch * steps.size), np.float64
    )
    area = section_areas(mesh.triangles, _snap_to_levels(planes, mesh))
    heights, plane = [first], first
    while plane < steps.part:
        reach = np.arange(plane + thin, plane + (thick if settings.guarded else thin) + 1, thin)
        ahead = np.append(reach, plane + thick) if settings.guarded else reach
        same = _are_areas_equal(area[plane // pitch], area[np.unique(ahead) // pitch], settings).all()
        heights.append(thick if same else thin)
        plane += heights[-1]
    return np.array(heights, np.int64)


def _snap_to_levels(planes: Float, mesh: Mesh) -> Float:
    """Move planes that are within rounding error of a z level of the part onto it; they cut the part just below it."""
    level = np.unique(mesh.triangles[:, :, 2])
    above = np.minimum(np.searchsorted(level, planes), len(level) - 1)
    below = np.maximum(above - 1, 0)
    nearest = np.where(planes - level[below] < level[above] - planes, level[below], level[above])
    return np.where(np.abs(nearest - planes) < _ROUNDING, nearest, planes)


def _plan_aligned(mesh: Mesh, steps: ZSteps, thin: int, thick: int, settings: AreaPlanner) -> Int:
    """Return layer heights in z steps; each region between z levels of the part is filled on its own."""
    level, constant = _find_constant_intervals(mesh, steps, thick, settings)
    constant = _drop_short_runs(level, constant, thick)
    bottom, rest = steps.split_first_layer()
    heights = [np.array([bottom], np.int64)] if bottom else []
    flats = np.rint(find_flats(mesh)[0] / steps.size).astype(np.int64)
    ends, is_thick = _find_region_ends(level, constant, flats, bottom, steps) if rest else ([], [])
    for end, wide in zip(ends, is_thick, strict=True):
        layers = fill_with_layers(end - bottom, thick if wide else thin, steps.lowest, steps.highest)
        heights.append(layers)
        bottom += int(layers.sum())
    return np.concatenate(heights)


def _find_constant_intervals(
    mesh: Mesh, steps: ZSteps, thick: int, settings: AreaPlanner
) -> tuple[Int, Bool]:
    """Return the z levels of the part in steps, and whether the area is constant from each level to the next.

    Between neighbouring levels the area is a quadratic in z, so it is constant if three values are equal. Only
    intervals near two equal areas half a thick layer apart are tested; every constant run with room for a thick layer
    contains such a pair.
    """
    at = np.clip(np.rint(mesh.triangles[:, :, 2] / steps.size), 0, steps.part).astype(np.int64).ravel()
    level = np.flatnonzero(np.bincount(np.append(at, [0, steps.part])))
    pitch = thick / 2
    planes = np.asarray(np.arange(0.5, steps.part / pitch) * (pitch * steps.size), dtype=np.float64)
    coarse = section_areas(mesh.triangles, planes)
    pairs = np.flatnonzero(_are_areas_equal(coarse[:-1], coarse[1:], settings))
    first = np.searchsorted(level[1:], (pairs - 0.5) * pitch, side="right")
    last = np.searchsorted(level[:-1], (pairs + 2.5) * pitch)
    marks = np.zeros(len(level), np.int64)
    np.add.at(marks, first, 1)
    np.add.at(marks, last, -1)
    near = np.cumsum(marks)[:-1] > 0
    low, high = level[:-1][near] * steps.size, level[1:][near] * steps.size
    # Half a step inside the interval, because levels are rounded to steps and planes must not touch the next one.
    margin = np.minimum(steps.size / 2, (high - low) / 4)
    planes = np.stack([low + margin, (low + high) / 2, high - margin], axis=1)
    area = section_areas(mesh.triangles, planes.ravel()).reshape(-1, 3)
    constant = np.zeros(len(near), np.bool_)
    constant[near] = _are_areas_equal(area[:, :2], area[:, 1:], settings).all(axis=1)
    return level, constant


def _drop_short_runs(level: Int, constant: Bool, thick: int) -> Bool:
    """Keep only runs of constant area that are at least as high as a thick layer; shorter runs save nothing."""
    run = np.cumsum(np.diff(constant.astype(np.int64), prepend=0) != 0)
    length = np.bincount(run, weights=np.diff(level))
    return np.asarray(constant & (length[run] >= thick))


def _find_region_ends(
    level: Int, constant: Bool, flats: Int, bottom: int, steps: ZSteps
) -> tuple[list[int], list[bool]]:
    """Return the upper end of each region above `bottom`, in steps, and whether its area is constant."""
    thick_from = np.concatenate([constant, [False]])
    change = np.flatnonzero(np.diff(constant.astype(np.int64)) != 0) + 1
    wanted = np.unique(np.concatenate([level[change], flats, [steps.part]]))
    ends: list[int] = []
    for end in wanted[(wanted >= bottom + steps.lowest) & (wanted <= steps.part)].tolist():
        if ends and end - ends[-1] < steps.lowest:
            if end < steps.part:
                continue
            ends.pop()
        ends.append(end)
    ends = ends or [steps.part]
    begins = [bottom, *ends[:-1]]
    inside = [
        thick_from[:-1][(level[:-1] < end) & (level[1:] > begin)]
        for begin, end in zip(begins, ends, strict=True)
    ]
    return ends, [bool(part.all()) for part in inside]
