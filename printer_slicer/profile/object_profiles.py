"""Profiles of single objects: the profile of the plate with the overrides that apply to an object."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from printer_slicer.profile.files import profile_with
from printer_slicer.profile.profile import Profile

__all__ = [
    "list_height_overrides",
    "list_overridden_objects",
    "list_support_styles",
    "make_profile_for_object",
]


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
