"""Find layers whose contoured perimeters exceed the tolerance, and make them again before the infill.

Where a followed surface is beside a steep one or ends, an extrusion may have to stay higher than the surface. The
perimeters show nearly all of these places. Layers that the rest of the print shows to break the tolerance are changed
after that, see `pipeline`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.contouring import contour, find_facet_bins, measure_deviations
from printer_slicer.geometry import Areas
from printer_slicer.model import ContourDeviations, LayerPlan, Mesh, ObjectStack, Sections, Walls
from printer_slicer.objects import cut_objects
from printer_slicer.ordering.loops import close_loops
from printer_slicer.perimeters.known_walls import KnownWalls
from printer_slicer.planning.inexact_layers import change_inexact_layers
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["change_inexact_walls"]

_ROUNDS: Final = 2  # level around some places, then level everywhere or divided


def change_inexact_walls(
    part: Mesh, sections: Sections, walls: Walls, profile: Profile, known: KnownWalls
) -> tuple[Sections, Walls]:
    """Return sections and perimeters of a part in which no contoured perimeter breaks the tolerance.

    Layers get level tops or are divided as in `change_inexact_layers`. Only what this changes is made again.

    Args:
        part: its surface, placed.
        sections: of the part.
        walls: their perimeters.
        profile: of the part; gives the tolerance.
        known: the same perimeters; gets the new ones.
    """
    for _ in range(_ROUNDS):
        measured = _measure_walls(part, sections, walls)
        if measured is None:
            break
        stack = ObjectStack(sections.plan, part, (0,), contours=measured)
        changed = change_inexact_layers([stack], profile)
        if changed is None:
            break
        sections = _cut_changed(part, sections, changed[0].plan, profile)
        (walls,) = known.lay([sections], [profile])
    return sections, walls


def _measure_walls(part: Mesh, sections: Sections, walls: Walls) -> ContourDeviations | None:
    """Return how far contoured perimeters are from the surfaces that they follow; None if they follow none."""
    plan, rule = sections.plan, sections.plan.contour_rule
    bins = find_facet_bins(part, plan, rule) if rule else None
    if rule is None or bins is None:
        return None
    paths = walls.paths.take(np.flatnonzero(bins.tops.is_contoured[walls.paths.layer]))
    lowered = contour(close_loops(paths), bins, sections, rule)
    return measure_deviations(lowered, bins, sections, rule, part)


def _cut_changed(part: Mesh, sections: Sections, plan: LayerPlan, profile: Profile) -> Sections:
    """Return the sections of a changed plan from those of the plan before.

    If it has the same layers, those whose tops have become level are cut again, also if only around some places.
    """
    before = sections.plan
    if plan.n_layers != before.n_layers or before.contour_rule is None or plan.contour_rule is None:
        return cut_objects([part], [plan], [profile])[0]
    changed = before.contour_rule.find_contoured(before.top) & ~plan.contour_rule.find_contoured(plan.top)
    changed |= plan.contour_rule.find_partly_level(plan.top)
    # The first layer decides how far the inset of the elephant foot reaches.
    layers = np.flatnonzero(changed | (np.arange(plan.n_layers) == 0))
    made = cut_objects([part], [plan.take(layers)], [profile])[0]
    areas = {}
    for name in ("solid", "below_cut"):
        old, new = getattr(sections, name), getattr(made, name)
        empty = Areas.empty(plan.n_layers)
        new = new.on_layers(layers, plan.n_layers).of_layers(changed) if new else empty
        areas[name] = (old.of_layers(~changed) if old else empty).merge(new)
    return replace(sections, plan=plan, **areas)
