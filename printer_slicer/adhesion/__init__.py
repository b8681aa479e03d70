"""Sections -> Toolpaths: what is printed under and around the part to hold it on the bed and out of the wind."""

from __future__ import annotations

from collections.abc import Sequence

from printer_slicer.adhesion.brim import brim_paths
from printer_slicer.adhesion.raft import on_raft, raft_paths
from printer_slicer.adhesion.skirt import skirt_paths
from printer_slicer.model import Sections, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["adhesion_paths", "on_raft", "with_adhesion"]


def adhesion_paths(printed: Sections, profile: Profile) -> Toolpaths:
    """The skirt, then the brim, then the raft; none if not asked for.

    Skirt loops that would leave the bed are left out.

    Args:
        printed: of `on_raft`.
        profile: what they were made with.

    Raises:
        PartError: the brim leaves the bed.
    """
    brim = brim_paths(printed, profile)
    skirt = skirt_paths(printed, brim, profile)
    return Toolpaths.joined(printed.plan, [skirt, brim, raft_paths(printed, profile)])


def with_adhesion(
    paths: Sequence[Toolpaths], solid: Sections, printed: Sections, profile: Profile
) -> Toolpaths:
    """The paths of all objects on the layers that are printed, and what holds them on the bed.

    Args:
        paths: of objects that stand on the bed.
        solid: their sections.
        printed: the same on the raft, if there is one.
        profile: skirt, brim and raft.

    Raises:
        PartError: the brim leaves the bed.
    """
    lift = float(printed.plan.top[-1] - solid.plan.top[-1])
    lifted = [adhesion_paths(printed, profile), *(some.on_plan(printed.plan, lift) for some in paths)]
    return Toolpaths.joined(printed.plan, lifted)
