"""Plan the layers of each feature of a part that stands apart, such as a tower.

Sources: Tyberg and Bohn, "Local adaptive slicing", 1998. Features share planes at the heights where they begin and end
to stand apart. All planes are layer tops in all plans, and the certificate of each stack counts only its own facets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.feature_ranges import FeatureRange, clip_features, find_feature_ranges
from printer_slicer.geometry.facet_clipping import clip_facets
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.model import LayerPlan, Mesh, ObjectStack
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.planning import plan_layers
from printer_slicer.planning.shared_layer_times import (
    compute_error_price,
    compute_time_shares,
)
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.planners import HeightRange

__all__ = ["explain_unused_features", "prepare_feature_plans"]

_FEWEST_LAYERS: Final = 5  # thickest layers in a range; features that are not so high are not worth a stack

_NO_FEATURES: Final = "planner.stacks = features has no effect"

PlanFeatures = Callable[[Mapping[str, float | str]], tuple[ObjectStack, ...]]
"""Plans all features with changed settings."""


def explain_unused_features(part: Mesh) -> str:
    """Return why no feature of a part can have layers of its own; empty if nothing is against it."""
    if len(part.objects) > 1:
        return f"{_NO_FEATURES} on a plate with several objects; each object may have layers of its own"
    if part.all_volumes:
        return (
            f"{_NO_FEATURES} on a part with modifiers, negative volumes, or enforcers or blockers of supports"
        )
    return ""


def prepare_feature_plans(part: Mesh, profile: Profile) -> PlanFeatures | None:
    """Return a function that plans the features of a part; None if the part has no features.

    Only a part that is a single object has plans for features (`explain_unused_features`). A feature does not begin or
    end within a height range that sets the layer height.
    """
    if explain_unused_features(part):
        return None
    ranges = find_feature_ranges(part, profile.printer.z_step, _FEWEST_LAYERS * profile.thickest)
    forced = [one for one in profile.dials.ranges if one.layer_height]
    found = [
        (one, meshes)
        for one in ranges
        if not any(_is_within(z, fixed) for z in (one.low, one.high) for fixed in forced)
        and (meshes := clip_features(part, one))
    ]
    if not found:
        return None
    price = compute_error_price(part, profile)

    def plan_features(changes: Mapping[str, float | str]) -> tuple[ObjectStack, ...]:
        """Plan all features with changed settings."""
        own = profile_with(profile, {"quality.planner.error_price": price} | dict(changes))
        return _plan_features(part, found, own)

    return plan_features


_FoundRanges = Sequence[tuple[FeatureRange, Sequence[Mesh]]]


def _plan_features(part: Mesh, found: _FoundRanges, profile: Profile) -> tuple[ObjectStack, ...]:
    """Plan the whole part, and each feature; ranges whose plans do not meet at the planes get no stacks."""
    ranged = profile_with(
        profile, {"quality.planner.ranges": _divide_ranges([one for one, _ in found], profile)}
    )
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


def _divide_ranges(places: Sequence[FeatureRange], profile: Profile) -> list[dict[str, float]]:
    """Return height ranges with the settings of the profile, so that planes lie at the ends of features.

    The ranges of the profile are divided at these ends, and others have its tolerance.
    """
    ends = [z for place in places for z in (place.low, place.high)]
    divided = []
    for one in profile.dials.ranges:
        own = {"tolerance": one.tolerance, "layer_height": one.layer_height}
        borders = [one.low, *sorted(z for z in ends if _is_within(z, one)), one.high]
        divided += [{"low": low, "high": high, **own} for low, high in pairwise(borders)]
    for place in places:
        borders = sorted({place.low, place.high, *(z for one in divided for z in (one["low"], one["high"]))})
        for low, high in pairwise(z for z in borders if place.low <= z <= place.high):
            if not any(one["low"] < high and one["high"] > low for one in divided):
                divided.append({"low": low, "high": high, "tolerance": profile.quality.tolerance})
    return divided


def _is_within(z: float, place: HeightRange) -> bool:
    """Return whether a height is above the lower end of a range and below its upper end."""
    return bool(place.low + SAME_TOP < z < place.high - SAME_TOP)


def _clip_between(part: Mesh, ranges: Sequence[FeatureRange]) -> Float:
    """Return the facets (n, 3, 3) below, between and above ranges."""
    borders = [
        0.0,
        *(z for place in ranges for z in (place.low, place.high)),
        max(part.height, ranges[-1].high),
    ]
    pairs = zip(borders[::2], borders[1::2], strict=True)
    clips = [clip_facets(part.triangles, low, high) for low, high in pairs if low < high]
    return np.concatenate([np.zeros((0, 3, 3)), *clips])


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
