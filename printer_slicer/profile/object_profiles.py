"""Which settings hold for an object and at a height: the profile with the overrides that apply there."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from printer_slicer.profile.files import profile_with
from printer_slicer.profile.profile import Profile

__all__ = ["for_object", "heights_of", "objects_of"]


def objects_of(profile: Profile) -> tuple[str, ...]:
    """The objects that have settings of their own, as they were named; each once."""
    return tuple(dict.fromkeys(one.object for one in profile.quality.overrides if one.object))


def for_object(profile: Profile, names: Collection[str]) -> Profile:
    """The profile of one object: its own settings, and those of heights, its own last.

    Args:
        profile: of the plate.
        names: what the object is called.
    """
    general = [one for one in profile.quality.overrides if not one.object]
    own = [one for one in profile.quality.overrides if one.object in names]
    changes = {key: value for one in own if one.is_everywhere for key, value in one.set.items()}
    heights = [*general, *(one for one in own if not one.is_everywhere)]
    left = [{"low": one.low, "high": one.high, "set": one.set} for one in heights]
    return profile_with(profile, {**changes, "quality.overrides": left})


def heights_of(profile: Profile) -> tuple[tuple[float, float, Mapping[str, object]], ...]:
    """The settings of heights: from, to (mm), and the changes, later ones winning; those of objects are left out."""
    return tuple((one.low, one.high, one.set) for one in profile.quality.overrides if not one.object)
