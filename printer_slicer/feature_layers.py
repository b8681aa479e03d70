"""Slice a part whose features have layers of their own: each set of layers with its neighbours, then only what is kept.

The regions of a layer depend on the layers around it. So the whole part is sliced with the layers of the part, and
again with those of each feature. Of each, only the layers of its stacks are printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.feature_ranges import list_rings_of_feature
from printer_slicer.model import (
    Areas,
    LayerPlan,
    Mesh,
    ObjectStack,
    Regions,
    Sections,
    Toolpaths,
    Walls,
)
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.objects import cut_objects
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = ["FeatureLayers", "cut_features", "list_feature_layers", "select_printed_layers"]

_LAYERS_AROUND: Final = (
    5  # thickest layers, besides the solid shell, that the layers of a feature may depend on
)


class FeatureLayers(Struct, frozen=True, eq=False):
    """Layers from the bed to the top of a part, of which some are printed.

    Attributes:
        plan: all layers.
        printed: (n,) indices of the layers that are printed, ascending.
        outline: area of the feature as seen from above, in one layer; None: everything.
    """

    plan: LayerPlan
    printed: Int
    outline: Areas | None

    def select_sections(self, sections: Sections) -> Sections:
        """Return the sections of the printed layers."""
        return replace(
            sections, plan=self.plan.take(self.printed), solid=sections.solid.copy_layers(self.printed)
        )

    def select_walls(self, walls: Walls) -> Walls:
        """Return the walls of the printed layers."""
        return Walls(
            self.plan.take(self.printed),
            walls.width[self.printed],
            self.select_paths(walls.paths),
            walls.inside.copy_layers(self.printed),
            walls.lost[self.printed],
        )

    def select_regions(self, regions: Regions) -> Regions:
        """Return the regions of the printed layers."""
        return regions.take(self.printed)

    def select_paths(self, paths: Toolpaths) -> Toolpaths:
        """Return the paths of the printed layers."""
        chosen = paths.take(np.flatnonzero(np.isin(paths.layer, self.printed)))
        return replace(
            chosen, plan=self.plan.take(self.printed), layer=np.searchsorted(self.printed, chosen.layer)
        )


def list_feature_layers(plan: Sequence[LayerPlan] | Sequence[ObjectStack]) -> list[FeatureLayers]:
    """Return the layers of the part and those of each feature; an empty list if the part has no stacks of features."""
    stacks = [one for one in plan if isinstance(one, ObjectStack) and one.whole_plan]
    common = [one for one in stacks if one.outline is None]
    groups = [group for group in (common, *([one] for one in stacks if one.outline)) if group]
    return [_join_stacks(group) for group in groups]


def _join_stacks(stacks: Sequence[ObjectStack]) -> FeatureLayers:
    """Return the layers of stacks that belong to the same plan."""
    plan = stacks[0].whole_plan or stacks[0].plan
    tops = np.concatenate([one.plan.top for one in stacks])
    return FeatureLayers(plan, plan.find_tops(tops), stacks[0].outline)


def cut_features(part: Mesh, layers: Sequence[FeatureLayers], profile: Profile) -> list[Sections]:
    """Return for each set of layers the sections of the part; of a feature, only itself and what is near in z.

    Raises:
        PartError: no layer contains material, or the contours cannot be closed.
    """
    around = max(profile.quality.top_thickness, profile.quality.bottom_thickness)
    around += _LAYERS_AROUND * profile.thickest
    return [_select_feature(cut_objects([part], [one.plan], [profile])[0], one, around) for one in layers]


def _select_feature(sections: Sections, layers: FeatureLayers, around: float) -> Sections:
    """Remove other features in the printed layers, and all layers further than `around` mm below or above these."""
    if layers.outline is None:
        return sections
    rings = list_rings_of_feature(sections.solid, layers.printed, layers.outline)
    near = _is_near(layers.plan, layers.printed, around)
    return replace(sections, solid=sections.solid.take(rings).of_layers(near))


def _is_near(plan: LayerPlan, printed: Int, around: float) -> Bool:
    """Return which layers (L,) are at most `around` mm below or above the printed ones."""
    low, high = plan.bottom[printed[0]] - around, plan.top[printed[-1]] + around
    return np.asarray((plan.top > low - SAME_TOP) & (plan.bottom < high + SAME_TOP))


def select_printed_layers(
    layers: Sequence[FeatureLayers],
    stages: tuple[Sequence[Sections], Sequence[Walls], Sequence[Regions]],
    paths: Sequence[Toolpaths],
) -> tuple[list[Sections], list[Walls], list[Regions], list[Toolpaths]]:
    """Return the printed layers of the part and of each feature.

    Args:
        layers: of the part and of each feature.
        stages: sections, walls and regions of each of these.
        paths: the perimeters of the first of these, its infill, the perimeters of the second, and so on.
    """
    of_path = [one for one in layers for _ in ("perimeters", "infill")]
    sections, walls, regions = stages
    return (
        [one.select_sections(made) for one, made in zip(layers, sections, strict=True)],
        [one.select_walls(made) for one, made in zip(layers, walls, strict=True)],
        [one.select_regions(made) for one, made in zip(layers, regions, strict=True)],
        [one.select_paths(made) for one, made in zip(of_path, paths, strict=True)],
    )
