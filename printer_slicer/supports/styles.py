"""Make supports in the style of the settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.model import Overhangs, Sections, SupportPlan, Supports, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import ROLES
from printer_slicer.supports.beads import lay_support_beads
from printer_slicer.supports.columns import lay_columns
from printer_slicer.supports.levels import list_places_without_room, plan_support_layers
from printer_slicer.supports.trees import grow_trees
from printer_slicer.values import replace

__all__ = ["STYLES", "make_supports", "measure_plastic"]

Style = Callable[[Overhangs, SupportPlan, Sections, Profile], Supports]

STYLES: Final[dict[str, Style]] = {"columns": lay_columns, "tree": grow_trees}
"""Function for each style; `auto` is the cheapest of them."""

_STOP_SECONDS: Final = 0.25  # time to travel to a path and to begin it


def make_supports(overhangs: Overhangs, sections: Sections, profile: Profile) -> tuple[Supports, Toolpaths]:
    """Return supports for what hangs, and their paths.

    Args:
        overhangs: what hangs.
        sections: all objects, also those without supports.
        profile: style and other settings of supports.
    """
    plan = plan_support_layers(overhangs, profile)
    style = profile.quality.support
    made = [
        STYLES[name](overhangs, plan, sections, profile) for name in ([style] if style in STYLES else STYLES)
    ]
    laid = [lay_support_beads(supports, profile) for supports in made]
    best = int(np.argmin([_estimate_cost(paths, profile) for paths in laid])) if len(made) > 1 else 0
    without_room = tuple(
        place for place in list_places_without_room(overhangs, plan) if place not in made[best].bare
    )
    return replace(made[best], bare=(*made[best].bare, *without_room)), laid[best]


def measure_plastic(paths: Toolpaths) -> float:
    """Return the volume of paths, mm³, at a flow ratio of 1."""
    if not paths.n_paths:
        return 0.0
    width = paths.width[paths.start[:-1]]  # the same along each path
    return float(paths.length() @ bead.cross_section(width, paths.height))


def _estimate_cost(paths: Toolpaths, profile: Profile) -> float:
    """Return the print time of supports and the price of their plastic, min."""
    speed = np.array([getattr(profile.speeds, row.speed) for row in ROLES])[paths.role]
    seconds = float((paths.length() / speed).sum()) + _STOP_SECONDS * paths.n_paths
    grams = measure_plastic(paths) * profile.material.density / 1000
    return seconds / 60 + profile.quality.support_gram_price * grams
