"""What the stages before supports make of a part, and columns under it: once per process for each part."""

from __future__ import annotations

from functools import cache

import numpy as np

from printer_slicer.model import Mesh, Overhangs, Sections, SupportPlan, Supports
from printer_slicer.perimeters import lay_walls
from printer_slicer.profile import Profile, load_profile
from printer_slicer.regions import classify
from printer_slicer.slicing import cut
from printer_slicer.supports import find_overhangs
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.support_layers import plan_support_layers
from tests.parts import layers

__all__ = ["columns_of", "prepared"]


@cache
def prepared(
    mesh: Mesh, height: float = 0.2, **changes: object
) -> tuple[Overhangs, SupportPlan, Sections, Profile]:
    """What the stage takes, of a part in the middle of the bed."""
    profile = load_profile(quality="standard", changes={"support": "columns", **changes})
    low, high = mesh.bounds
    middle = np.array(profile.printer.corners).mean(axis=0)
    mesh = mesh.moved((*(middle - (low + high)[:2] / 2), 0.0))
    sections = cut(mesh, layers(round(mesh.height / height), height), 0.0125)
    overhangs = find_overhangs(sections, classify(sections, lay_walls(sections, profile), profile), profile)
    return overhangs, plan_support_layers(overhangs, profile), sections, profile


@cache
def columns_of(mesh: Mesh, **changes: object) -> tuple[Supports, Sections, Profile]:
    """Columns under a part."""
    overhangs, plan, sections, profile = prepared(mesh, **changes)  # type: ignore[arg-type]
    return make_columns(overhangs, plan, sections, profile), sections, profile
