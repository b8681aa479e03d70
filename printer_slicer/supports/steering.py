"""Apply support enforcers and blockers, and painted facets, to what hangs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.geometry import (
    Areas,
    difference,
    intersection,
    offset,
    offset_open,
    split_connected,
    union,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.model import Bare, LayerPlan, Overhangs, Sections, Volumes, VolumeSections
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    from printer_slicer.arrays import Bool, Int
    from printer_slicer.profile import Profile

__all__ = ["SteeredOverhangs", "list_volume_warnings", "steer"]

_SLIVER: Final = (
    0.02  # mm; narrower strips than twice this are rounding, or surfaces that are nearly vertical
)
_TOUCH: Final = 0.35  # mm; pieces in neighbouring layers that are this near belong to one patch
_FLAT_SHARE: Final = 0.2  # of the area of a patch, in a single layer
_BLOCKED: Final = "a support blocker covers it"


class SteeredOverhangs(Struct, frozen=True, eq=False):
    """What hangs and gets a support, after volumes and painted facets were applied.

    Attributes:
        overhangs: the areas that get a support.
        blocked: the islands that get none because they are blocked; they are printed in the air.
        has_unused_enforcers: whether there are enforced places, but nothing hangs in any of them.
    """

    overhangs: Overhangs
    blocked: tuple[Bare, ...] = ()
    has_unused_enforcers: bool = False


def steer(overhangs: Overhangs, sections: Sections, volumes: VolumeSections) -> SteeredOverhangs:
    """Add what is enforced to what hangs, then take out what is blocked.

    Whatever hangs over nothing within an enforced place gets a support: at any angle, however small, and also bridges.
    Where a place is enforced and blocked, it is blocked.

    Args:
        overhangs: what hangs by the rules for the whole part.
        sections: the part.
        volumes: the places by layer of `overhangs.plan`.
    """
    if not (volumes.enforce.n_rings or volumes.block.n_rings):
        return SteeredOverhangs(overhangs)
    enforced = _find_enforced(sections.solid, volumes.enforce)
    area = difference(union(overhangs.area, enforced), volumes.block)
    patch = _label_patches(area)
    islands = difference(overhangs.islands, volumes.block)
    steered = replace(
        overhangs,
        area=area,
        ring_patch=patch,
        islands=islands,
        bridged=difference(overhangs.bridged, enforced),
        is_flat=_find_flat_layers(area, patch),
    )
    unused = volumes.enforce.n_rings > 0 and not enforced.n_rings
    blocked = _list_blocked(overhangs.islands, volumes.block, overhangs.plan)
    return SteeredOverhangs(steered, blocked, unused)


def _find_enforced(solid: Areas, enforce: Areas) -> Areas:
    """Return what hangs over nothing within the enforced places."""
    hangs = difference(intersection(solid, enforce), solid.shift_layers(1))
    on_bed = np.arange(solid.n_layers) == 0
    return offset_open(hangs.of_layers(~on_bed), _SLIVER)


def _label_patches(area: Areas) -> Int:
    """Return the patch (R,) of each ring; pieces in neighbouring layers that touch are one patch."""
    pieces = split_connected(area)
    boxes = Boxes(*pieces.areas.boxes(), pieces.layer)
    raised = Boxes(boxes.low, boxes.high, boxes.layer + 1)
    one, other = raised.expand(_TOUCH).find_overlapping(boxes)
    grown = offset(pieces.areas, _TOUCH)
    touches = intersection(grown.copy_layers(one), pieces.areas.copy_layers(other)).used
    label = label_components(np.stack([one, other])[:, touches], pieces.count)
    return np.asarray(label[np.maximum(pieces.of_ring, 0)], np.int64)


def _find_flat_layers(area: Areas, patch: Int) -> Bool:
    """Return in which layers (L,) much of a patch hangs."""
    n_patches = int(patch.max(initial=-1)) + 1
    key = area.ring_layer * n_patches + patch
    share = np.bincount(key, area.ring_area(), area.n_layers * n_patches).reshape(area.n_layers, n_patches)
    return np.asarray((share > _FLAT_SHARE * share.sum(axis=0)).any(axis=1))


def _list_blocked(islands: Areas, block: Areas, plan: LayerPlan) -> tuple[Bare, ...]:
    """List the islands of which more than half is blocked, from the lowest."""
    pieces = split_connected(islands)
    area, (low, high) = pieces.areas.area(), pieces.areas.boxes()
    covered = intersection(pieces.areas, block.copy_layers(pieces.layer)).area()
    found = []
    for piece in np.flatnonzero(covered > area / 2).tolist():
        x, y = ((low[piece] + high[piece]) / 2).tolist()
        z = float(plan.bottom[pieces.layer[piece]])
        found.append(Bare(x, y, z, float(area[piece]), _BLOCKED, is_island=True))
    return tuple(found)


def list_volume_warnings(volumes: Volumes | None, profile: Profile) -> list[str]:
    """Return warnings about volumes and painted facets that have no effect, or an unexpected one."""
    if volumes is None:
        return []
    found = []
    supports = {
        profile.quality.support,
        *(one.set.get("support", "off") for one in profile.quality.overrides),
    }
    if volumes.has_enforcers and supports == {"off"}:
        what = "support enforcers" if volumes.enforce else "facets painted for supports"
        found.append(f"the model has {what}, but supports are off; to use them, set support = auto")
    if volumes.negative:
        found.append("layer heights and the surface deviation are computed without the negative volumes")
    return found
