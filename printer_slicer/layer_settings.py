"""The settings of each layer, with the overrides for height ranges applied.

An override applies to the layers whose middle lies in its height range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.model import LayerPlan
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.object_profiles import list_height_overrides
from printer_slicer.values import Struct, force_setattr

__all__ = ["LayerSettings", "resolve_layer_settings"]


class LayerSettings(Struct, frozen=True, eq=False):
    """The distinct profiles of a part's layers, and the index of each layer's profile.

    Attributes:
        profiles: distinct profiles, at least one.
        of_layer: (L,) index of the profile of each layer.
    """

    profiles: tuple[Profile, ...]
    of_layer: Int

    def __post_init__(self) -> None:
        force_setattr(self, "of_layer", frozen_array(self.of_layer, np.int64, (-1,)))

    def values(self, read: Callable[[Profile], float]) -> Float:
        """Return the value (L,) of a setting on each layer; booleans become 0 and 1."""
        return np.array([read(profile) for profile in self.profiles], np.float64)[self.of_layer]

    def each(self) -> Iterator[tuple[Profile, Bool]]:
        """Yield each profile that layers have, with a mask (L,) of these layers."""
        for number, profile in enumerate(self.profiles):
            mask = self.of_layer == number
            if mask.any():
                yield profile, mask

    def run_starts(self) -> Int:
        """Return for each layer the first layer (L,) of its run of consecutive layers with equal settings."""
        begins = np.append(True, np.diff(self.of_layer) != 0)
        return np.maximum.accumulate(np.where(begins, np.arange(len(begins)), 0))


def resolve_layer_settings(profile: Profile, plan: LayerPlan) -> LayerSettings:
    """Apply the overrides for height ranges to each layer; overrides for objects are ignored."""
    heights = list_height_overrides(profile)
    if not heights:
        return LayerSettings((profile,), np.zeros(plan.n_layers, np.int64))
    middle = (plan.bottom + plan.top) / 2
    applies = np.array([(low <= middle) & (middle < high) for low, high, _ in heights])
    combinations, of_layer = np.unique(applies, axis=1, return_inverse=True)
    profiles: list[Profile] = []
    indices = []
    for column in combinations.T:
        changes: dict[str, object] = {"quality.overrides": ()}
        for holds, (_, _, own) in zip(column.tolist(), heights, strict=True):
            changes |= own if holds else {}
        changed = profile_with(profile, changes)
        profiles += [] if changed in profiles else [changed]
        indices.append(profiles.index(changed))
    return LayerSettings(tuple(profiles), np.array(indices)[of_layer.reshape(-1)])
