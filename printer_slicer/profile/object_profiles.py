"""Profiles of single objects: the profile of the plate with the overrides that apply to an object."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from printer_slicer.profile.files import profile_with
from printer_slicer.profile.profile import Profile

__all__ = [
    "MODIFIER_SETTINGS",
    "list_height_overrides",
    "list_overridden_objects",
    "list_support_styles",
    "list_unfollowed_settings",
    "make_profile_for_object",
]


MODIFIER_SETTINGS: Final = frozenset(
    {
        "infill",
        "infill_density",
        "infill_angle_deg",
        "infill_anchor",
        "infill_anchor_max",
        "lightning_angle_deg",
        "top_thickness",
        "bottom_thickness",
        "slope_shell_ratio",
        "solid_infill_below_area",
        "bridge_anchor",
        "bridge_flow_ratio",
        "internal_bridge_flow_ratio",
        "thick_bridges",
        "flow_ratio",
        "max_flow",
        "speeds.internal_infill",
        "speeds.solid_infill",
        "speeds.top_solid_infill",
        "speeds.bridge",
        "speeds.internal_bridge",
        "speeds.ratio",
        "accelerations.internal_infill",
        "accelerations.solid_infill",
        "accelerations.top_solid_infill",
        "accelerations.bridge",
        "support",
        "support_threshold_deg",
        "support_max_bridge",
        "support_min_area",
        "support_min_reach",
        "support_bottom_gap",
        "support_branch_diameter",
        "support_branch_growth_deg",
        "support_closing",
        "support_first_layer_expansion",
        "support_gap",
        "support_gap_slack",
        "support_minutes_per_gram",
        "support_interface_layers",
        "support_interface_spacing",
        "support_joist_spacing",
        "support_on_bed_only",
        "support_places",
        "support_bed_detour",
        "support_spacing",
        "support_tip_diameter",
        "support_tip_distance",
        "support_tree_angle_deg",
        "support_tree_slow_angle_deg",
        "support_walls",
        "support_xy_gap",
    }
)
"""Settings that modifiers change; speeds, accelerations and flow apply to the infill."""


def list_overridden_objects(profile: Profile) -> tuple[str, ...]:
    """Return the names of the objects that have overrides, without repetitions."""
    return tuple(dict.fromkeys(one.object for one in profile.quality.overrides if one.object))


def make_profile_for_object(profile: Profile, names: Collection[str]) -> Profile:
    """Apply the overrides of one object to the profile of the plate; keep overrides for height ranges as they are.

    Args:
        profile: profile of the plate.
        names: names of the object.
    """
    for_all_objects = [one for one in profile.quality.overrides if not one.object]
    for_this_object = [one for one in profile.quality.overrides if one.object in names]
    changes = {key: value for one in for_this_object if one.is_everywhere for key, value in one.set.items()}
    heights = [*for_all_objects, *(one for one in for_this_object if not one.is_everywhere)]
    height_overrides = [{"low": one.low, "high": one.high, "set": one.set} for one in heights]
    return profile_with(profile, {**changes, "quality.overrides": height_overrides})


def list_height_overrides(profile: Profile) -> tuple[tuple[float, float, Mapping[str, object]], ...]:
    """Return (low, high, changes) of each override for all objects, heights in mm; later overrides take precedence."""
    return tuple((one.low, one.high, one.set) for one in profile.quality.overrides if not one.object)


def list_support_styles(profile: Profile) -> set[object]:
    """Return the styles of supports that the profile and its overrides for objects and heights name."""
    named = ("quality.support", "support")
    return {
        profile.quality.support,
        *(one.set[name] for one in profile.quality.overrides for name in named if name in one.set),
    }


def list_unfollowed_settings(profile: Profile, name: str) -> list[str]:
    """Return the settings of a modifier that are not followed."""
    given = (key for one in profile.quality.overrides if one.object == name for key in one.set)
    return sorted({key for key in given if key.removeprefix("quality.") not in MODIFIER_SETTINGS})
