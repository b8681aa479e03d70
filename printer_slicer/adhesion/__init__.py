"""Make skirt, brim and raft from sections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.adhesion.brim import brim_paths, brim_reach
from printer_slicer.adhesion.raft import place_on_raft, raft_paths, raft_reach
from printer_slicer.adhesion.skirt import skirt_paths
from printer_slicer.model import Sections, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["add_adhesion", "adhesion_paths", "measure_reach", "measure_spacing", "place_on_raft"]


def measure_reach(profile: Profile) -> float:
    """Return how far brim and raft extend beyond the part at most, mm."""
    return max(brim_reach(profile), raft_reach(profile))


def measure_spacing(profile: Profile) -> float:
    """Return the distance between the brims and rafts of two parts that keeps them separate, mm."""
    return max(4 * raft_reach(profile) - 2 * measure_reach(profile), 0.0)


def adhesion_paths(printed: Sections, profile: Profile) -> Toolpaths:
    """Return the paths of the skirt, brim and raft that the profile turns on, in this order.

    Skirt loops that would leave the bed are omitted.

    Args:
        printed: result of `place_on_raft`.
        profile: the profile used for it.

    Raises:
        PartError: the brim leaves the bed.
    """
    brim = brim_paths(printed, profile)
    skirt = skirt_paths(printed, brim, profile)
    return Toolpaths.joined(printed.plan, [skirt, brim, raft_paths(printed, profile)])


def add_adhesion(
    paths: Sequence[Toolpaths],
    solid: Sections,
    printed: Sections,
    profile: Profile,
    around: Sections | None = None,
) -> Toolpaths:
    """Join the paths of all objects, lifted onto the raft, with skirt, brim and raft.

    Args:
        paths: of objects on the bed.
        solid: their sections.
        printed: the sections on the raft; the same without a raft.
        profile: settings of skirt, brim and raft.
        around: what skirt and brim surround, if it is more than the printed sections.

    Raises:
        PartError: the brim leaves the bed.
    """
    lift = float(printed.plan.top[-1] - solid.plan.top[-1])
    beside = adhesion_paths(around or printed, profile)
    if (
        around is not None
    ):  # a draft shield has the layers of the part, not also those of supports between them
        own = np.isin(beside.layer, printed.plan.find_tops(solid.plan.top + lift))
        beside = beside.take(np.flatnonzero(own | (beside.z_top <= lift)))  # the latter has a raft
    lifted = [beside, *(some.on_plan(printed.plan, lift) for some in paths)]
    return Toolpaths.joined(printed.plan, lifted)
