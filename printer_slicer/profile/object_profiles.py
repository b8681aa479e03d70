"""Profiles of single objects: the profile with the overrides that apply to an object."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from printer_slicer.profile.files import profile_with
from printer_slicer.profile.profile import Profile

__all__ = ["override_heights", "override_objects", "profile_for_object"]


def override_objects(profile: Profile) -> tuple[str, ...]:
    """Return the names of the objects that have overrides, each once."""
    return tuple(dict.fromkeys(one.object for one in profile.quality.overrides if one.object))


def profile_for_object(profile: Profile, names: Collection[str]) -> Profile:
    """Return the profile of one object: its overrides are applied, and those for height ranges are kept.

    Args:
        profile: profile of the plate.
        names: names of the object.
    """
    general = [one for one in profile.quality.overrides if not one.object]
    own = [one for one in profile.quality.overrides if one.object in names]
    changes = {key: value for one in own if one.is_everywhere for key, value in one.set.items()}
    heights = [*general, *(one for one in own if not one.is_everywhere)]
    left = [{"low": one.low, "high": one.high, "set": one.set} for one in heights]
    return profile_with(profile, {**changes, "quality.overrides": left})


def override_heights(profile: Profile) -> tuple[tuple[float, float, Mapping[str, object]], ...]:
    """Return the overrides for height ranges of all objects: low, high (mm) and changes; later ones win."""
    return tuple((one.low, one.high, one.set) for one in profile.quality.overrides if not one.object)
