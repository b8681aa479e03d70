"""Make perimeters of a plan that differs little from the one before, only where the sections have changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.geometry import Areas
from printer_slicer.model import Sections, Walls
from printer_slicer.perimeters import lay_layers, lay_walls
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["KnownWalls"]


class KnownWalls:
    """The perimeters that were made last."""

    def __init__(self) -> None:
        self._solids: list[Areas] = []
        self._walls: list[Walls] = []

    def lay(self, sections: Sequence[Sections], profiles: Sequence[Profile]) -> list[Walls]:
        """Make the perimeters of each object like `lay_walls`, and remember them.

        Args:
            sections: of each object.
            profiles: of each object; the same in every call.
        """
        is_known = len(self._walls) == len(sections) and all(map(_have_same_layers, sections, self._walls))
        self._walls = (
            list(map(_lay_changed_walls, sections, profiles, self._solids, self._walls))
            if is_known
            else list(map(lay_walls, sections, profiles))
        )
        self._solids = [one.solid for one in sections]
        return list(self._walls)


def _have_same_layers(sections: Sections, walls: Walls) -> bool:
    """Return whether sections have the layers of known walls."""
    return np.array_equal(sections.plan.top, walls.plan.top)


def _lay_changed_walls(sections: Sections, profile: Profile, solid: Areas, walls: Walls) -> Walls:
    """Make the perimeters of sections where they differ from other sections whose walls are known.

    Args:
        sections: whose walls are asked for.
        profile: as of the known walls.
        solid: the other sections.
        walls: their walls.
    """
    changed = sections.solid.find_changed_layers(solid)
    # Perimeters also depend on the layers above and below.
    changed[1:] |= changed[:-1].copy()
    changed[:-1] |= changed[1:].copy()
    known = replace(walls, plan=sections.plan, paths=walls.paths.on_plan(sections.plan)).of_layers(~changed)
    return Walls.joined([*lay_layers(sections, profile, changed), known])
