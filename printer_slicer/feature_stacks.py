"""Find features of a part that stand apart, such as towers, and plan the layers of each separately.

Sources: Tyberg and Bohn, "Local adaptive slicing", 1998. Features share planes at the heights where they begin and end
to stand apart. All planes are layer tops in all plans, and the certificate of each stack counts only its own facets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, find_enclosing_rings, offset, simplify, split_connected, union
from printer_slicer.geometry.facet_clipping import clip_facets
from printer_slicer.geometry.plane_sections import section_contours
from printer_slicer.geometry.slab_projection import BESIDE, project_slabs
from printer_slicer.model import LayerPlan, Mesh, ObjectStack
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.planning import plan_layers
from printer_slicer.planning.shared_layer_times import (
    compute_error_price,
    compute_time_shares,
)
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.object_profiles import list_overridden_objects
from printer_slicer.surface.flats import find_flats
from printer_slicer.values import Struct

__all__ = ["FeatureRange", "find_feature_ranges", "list_rings_of_feature", "prepare_feature_plans"]

_SMALLEST_GAP: Final = 1.0  # mm between features as seen from above
_FINE: Final = 0.05  # mm; outlines are simplified by this tolerance
_SLAB: Final = 0.5  # mm, thickness of the slabs in which features are searched for
_FEWEST_LAYERS: Final = 5  # thickest layers in a range; features that are not so high are not worth a stack
_STEP_TOLERANCE: Final = 1e-2  # of a z step


class FeatureRange(Struct, frozen=True, eq=False):
    """A range of heights in which features stand apart.

    Attributes:
        low, high: mm, whole z steps.
        outlines: one layer for each feature: an area that contains it and no other one, as seen from above.
    """

    low: float
    high: float
    outlines: Areas


PlanFeatures = Callable[[Mapping[str, float | str]], tuple[ObjectStack, ...]]
"""Plans all features with changed settings."""


def find_feature_ranges(mesh: Mesh, profile: Profile) -> list[FeatureRange]:
    """Return the ranges of heights in which parts of a mesh are at least 1 mm apart as seen from above, ascending.

    What overlaps as seen from above anywhere in the range is one feature.

    Args:
        mesh: the part, standing on z = 0.
        profile: gives the z step and the thickest layer.
    """
    planes = _list_planes(mesh, profile.printer.z_step)
    shadows = _project_slabs(mesh, planes)
    shortest = _FEWEST_LAYERS * profile.thickest
    return [
        FeatureRange(float(planes[first]), float(planes[last]), outlines)
        for first, last, outlines in _join_slabs(shadows)
        if planes[last] - planes[first] >= shortest
    ]


def _list_planes(mesh: Mesh, step: float) -> Float:
    """Return heights (n,) that divide a part, mm, in whole z steps: every 0.5 mm, and on both sides of flats."""
    even = np.linspace(0.0, mesh.height, max(round(mesh.height / _SLAB), 1) + 1)
    z = np.concatenate([even, find_flats(mesh)[0]]) / step
    whole = np.concatenate([np.ceil(z - _STEP_TOLERANCE), np.floor(z[len(even) :] + _STEP_TOLERANCE)])
    return np.unique(np.round(whole * step, 7))


def _project_slabs(mesh: Mesh, planes: Float) -> Areas:
    """Return what is solid anywhere between two planes, as seen from above, grown by half of the smallest gap."""
    bottom, top = planes[:-1], planes[1:]
    middle = section_contours(mesh.triangles, np.minimum((bottom + top) / 2, mesh.height - BESIDE))
    shadows = simplify(union(middle, project_slabs(mesh.triangles, bottom, top)), _FINE)
    return offset(shadows, _SMALLEST_GAP / 2 + _FINE)


def _join_slabs(shadows: Areas) -> Iterator[tuple[int, int, Areas]]:
    """Yield ranges of slabs in which features stand apart: first plane, last plane, one layer for each feature."""
    slabs = [shadows.copy_layers(np.array([layer])) for layer in range(shadows.n_layers)]
    count = [split_connected(slab).count for slab in slabs]
    first = 0
    while first < len(slabs):
        last, whole = first + 1, slabs[first]
        pieces = split_connected(whole)
        while pieces.count >= 2 and last < len(slabs) and count[last] >= 2:
            joined = union(whole, slabs[last])
            found = split_connected(joined)
            if found.count < pieces.count:
                break
            whole, pieces, last = joined, found, last + 1
        if pieces.count >= 2:
            yield first, last, pieces.areas
        first = last


def prepare_feature_plans(part: Mesh, profile: Profile) -> PlanFeatures | None:
    """Return a function that plans the features of a part; None if the part has no features.

    Only a part that is a single object has plans for features. It must have no modifiers or other volumes, the profile
    no overrides for objects, no height ranges, no `max_layers` and no spiral.
    """
    dials = profile.dials
    if part.all_volumes or dials.ranges or dials.max_layers or profile.quality.spiral:
        return None
    ranges = [] if list_overridden_objects(profile) else find_feature_ranges(part, profile)
    found = [(one, meshes) for one in ranges if (meshes := _divide_facets(part, one))]
    if not found:
        return None
    price = compute_error_price(part, profile)

    def plan_features(changes: Mapping[str, float | str]) -> tuple[ObjectStack, ...]:
        """Plan all features with changed settings."""
        own = profile_with(profile, {"quality.planner.error_price": price} | dict(changes))
        return _plan_features(part, found, own)

    return plan_features


def _divide_facets(part: Mesh, place: FeatureRange) -> list[Mesh]:
    """Return the surface of each feature in a range; an empty list if a facet belongs to none."""
    triangles = clip_facets(part.triangles, place.low, place.high)
    points = triangles.mean(axis=1)[:, :2]
    outlines = place.outlines
    flat = Areas(outlines.xy, outlines.ring_start, np.zeros(outlines.n_rings, np.int64), 1)
    ring = find_enclosing_rings(flat, points, np.zeros(len(points), np.int64))
    owner = outlines.ring_layer[ring]
    if (ring < 0).any() or len(np.unique(owner)) < outlines.n_layers:
        return []
    return [
        Mesh(triangles[owner == k], f"{part.name}, z {place.low:g} to {place.high:g}, feature {k + 1}")
        for k in range(outlines.n_layers)
    ]


_FoundRanges = Sequence[tuple[FeatureRange, Sequence[Mesh]]]


def _plan_features(part: Mesh, found: _FoundRanges, profile: Profile) -> tuple[ObjectStack, ...]:
    """Plan the whole part, and each feature; ranges whose plans do not meet at the planes get no stacks."""
    ends = [
        {"low": place.low, "high": place.high, "tolerance": profile.quality.tolerance} for place, _ in found
    ]
    ranged = profile_with(profile, {"quality.planner.ranges": ends})
    base = plan_layers(part, ranged)
    between = _clip_between(part, [place for place, _ in found])
    stacks, kept = list[ObjectStack](), list[FeatureRange]()
    for place, meshes in found:
        plans = _plan_range(meshes, between, ranged)
        if all(_has_planes(plan, place, base) for plan in plans):
            kept.append(place)
            stacks += _make_feature_stacks(place, meshes, plans)
    if not kept:
        return (ObjectStack(plan_layers(part, profile), part, (0,)),)
    stacks += _make_common_stacks(part, base, kept)
    return tuple(sorted(stacks, key=lambda one: float(one.plan.bottom[0])))


def _clip_between(part: Mesh, ranges: Sequence[FeatureRange]) -> Float:
    """Return the facets (n, 3, 3) below, between and above ranges."""
    borders = [
        0.0,
        *(z for place in ranges for z in (place.low, place.high)),
        max(part.height, ranges[-1].high),
    ]
    pairs = zip(borders[::2], borders[1::2], strict=True)
    return np.concatenate([clip_facets(part.triangles, low, high) for low, high in pairs if low < high])


def _plan_range(meshes: Sequence[Mesh], between: Float, profile: Profile) -> list[LayerPlan]:
    """Plan each feature of a range together with what lies between the ranges."""
    shares = compute_time_shares(meshes, [1] * len(meshes), profile)
    plans = []
    for mesh, share in zip(meshes, shares.tolist(), strict=True):
        near = np.concatenate([mesh.triangles, between])
        own = profile_with(profile, {"material.min_layer_time": profile.material.min_layer_time * share})
        plans.append(plan_layers(Mesh(near, mesh.name), own))
    return plans


def _has_planes(plan: LayerPlan, place: FeatureRange, base: LayerPlan) -> bool:
    """Return whether layers of a feature begin and end at the planes of its range, as those of the part do."""
    for z in (place.low, place.high):
        if z > SAME_TOP and not (_has_top(plan, z) and _has_top(base, z)) and z < base.top[-1] - SAME_TOP:
            return False
    return True


def _has_top(plan: LayerPlan, z: float) -> bool:
    """Return whether a layer ends at a height, or the plan ends below it."""
    return bool(z > plan.top[-1] or np.abs(plan.top - z).min() <= SAME_TOP)


def _make_feature_stacks(
    place: FeatureRange, meshes: Sequence[Mesh], plans: Sequence[LayerPlan]
) -> Iterator[ObjectStack]:
    """Yield the stack of each feature: its layers in the range that contain any of it."""
    for k, (mesh, plan) in enumerate(zip(meshes, plans, strict=True)):
        low, high = max(place.low, float(mesh.bounds[0, 2])), min(place.high, mesh.height)
        here = (plan.top > low + BESIDE) & (plan.bottom < high - BESIDE)
        outline = place.outlines.copy_layers(np.array([k]))
        yield ObjectStack(plan.take(np.flatnonzero(here)), mesh, (0,), plan, outline)


def _make_common_stacks(part: Mesh, base: LayerPlan, ranges: Sequence[FeatureRange]) -> Iterator[ObjectStack]:
    """Yield the stacks below, between and above ranges, which contain the whole part."""
    borders = [0.0, *(z for place in ranges for z in (place.low, place.high)), np.inf]
    for low, high in zip(borders[::2], borders[1::2], strict=True):
        here = np.flatnonzero((base.bottom >= low - SAME_TOP) & (base.top <= high + SAME_TOP))
        if len(here):
            top = max(part.height, float(base.top[-1])) if high == np.inf else high
            mesh = Mesh(clip_facets(part.triangles, low, top), f"{part.name}, z {low:g} to {top:g}")
            yield ObjectStack(base.take(here), mesh, (0,), base)


def list_rings_of_feature(solid: Areas, here: Int, outline: Areas) -> Int:
    """Return the rings of some layers that lie within an outline, and all rings of other layers, ascending.

    Args:
        solid: the part in all layers.
        here: (n,) layers.
        outline: area of the feature as seen from above, one layer.
    """
    first = solid.xy[solid.ring_start[:-1]]
    is_here = np.isin(solid.ring_layer, here)
    rings = np.flatnonzero(is_here)
    around = find_enclosing_rings(outline, first[rings], np.zeros(len(rings), np.int64))
    inside = (around >= 0) & (
        outline.ring_area()[around] > 0
    )  # not in a hole, where another feature may stand
    return np.sort(np.concatenate([np.flatnonzero(~is_here), rings[inside]]))
