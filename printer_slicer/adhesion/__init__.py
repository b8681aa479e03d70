"""Sections -> Toolpaths: what is printed around the part to hold it on the bed and out of the wind."""

from __future__ import annotations

from printer_slicer.adhesion.brim import brim_paths
from printer_slicer.adhesion.skirt import skirt_paths
from printer_slicer.model import Sections, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["adhesion_paths"]


def adhesion_paths(sections: Sections, profile: Profile) -> Toolpaths:
    """The skirt, then the brim; none if not asked for.

    Skirt loops that would leave the bed are left out.

    Raises:
        PartError: the brim leaves the bed.
    """
    brim = brim_paths(sections, profile)
    return Toolpaths.joined(sections.plan, [skirt_paths(sections, brim, profile), brim])
