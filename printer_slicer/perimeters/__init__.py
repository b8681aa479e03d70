"""Make perimeters from sections: loops along the contours, and extrusions in the middle of narrow places.

Where a section is wide enough, loops have one width and one spacing (`fixed_width`). Where it is too narrow for all
loops, their number and widths follow the thickness (`variable_width`).
"""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool
from printer_slicer.geometry import Areas, difference, intersection, offset, offset_open, union
from printer_slicer.layer_settings import resolve_layer_settings
from printer_slicer.model import Sections, Toolpaths, Walls
from printer_slicer.perimeters.perimeter_widths import widen_perimeters
from printer_slicer.perimeters.wall_loops import FillResult, fill_narrow, fill_pieces, make_loops
from printer_slicer.profile import Profile

__all__ = ["FillResult", "fill_narrow", "fill_pieces", "lay_layers", "lay_walls"]

_MAX_OVERHANG_BEADS = 3  # extra perimeters side by side; wider overhangs are bridged


def lay_walls(sections: Sections, profile: Profile) -> Walls:
    """Make `quality.perimeters` loops around every section, and return them with the area inside.

    The external perimeter touches the contour. The other perimeters fill the gaps beside its rounded side. Layers that
    are wide everywhere have loops of one width; on other layers the extrusions adapt to narrow places. With
    `quality.single_top_perimeter`, exposed top areas have only the external perimeter. With `quality.extra_perimeters`,
    the edges of overhangs get more perimeters.
    """
    return Walls.joined(lay_layers(sections, profile, np.ones(sections.plan.n_layers, np.bool_)))


def lay_layers(sections: Sections, profile: Profile, layers: Bool) -> list[Walls]:
    """Make the perimeters of the layers of a mask (L,) like `lay_walls`, in parts with the same settings."""
    layered = resolve_layer_settings(profile, sections.plan)
    return [_make_walls(sections, here & layers, own) for own, here in layered.each()]


def _make_walls(sections: Sections, selected: Bool, profile: Profile) -> Walls:
    """Make the perimeters of the `selected` layers (L,) with the settings of one profile."""
    plan, solid, quality = sections.plan, sections.solid.of_layers(selected), profile.quality
    top = Areas.empty(plan.n_layers)
    if quality.single_top_perimeter and quality.perimeters > 1:
        top = _find_exposed_top(sections.solid, profile.extrusion_width).of_layers(selected)
    # Make external perimeters first and the others inside them, because hidden borders may be simplified.
    external = profile.with_external_width
    apart = top.used | ((quality.varying_walls or external is not profile) and quality.perimeters > 0)
    usual = make_loops(solid.of_layers(~apart), plan, profile, quality.perimeters)
    parts, inside, lost = [usual.paths], usual.rest, usual.lost
    if apart.any():
        outer = make_loops(solid.of_layers(apart), plan, external, 1)
        under = difference(outer.rest, top) if top.n_rings else outer.rest
        inner = make_loops(under, plan, profile, quality.perimeters - 1, outermost=False)
        rest = union(difference(outer.rest, under), inner.rest) if top.n_rings else inner.rest
        inside, lost = inside.merge(rest), lost + outer.lost + inner.lost
        parts += [inner.paths, outer.paths]
    if quality.extra_perimeters and quality.perimeters:
        hanging = _find_unsupported_strips(sections.solid, inside, profile.extrusion_width, selected)
        extra = fill_narrow(hanging, plan, profile, beads=_MAX_OVERHANG_BEADS)
        inside = difference(inside, difference(hanging, extra.rest))
        parts = [extra.paths, *parts]
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    paths = widen_perimeters(Toolpaths.joined(plan, parts), solid.area() - inside.area() - lost)
    return Walls(plan, width, paths, inside, lost)


def _find_exposed_top(solid: Areas, width: float) -> Areas:
    """Return the areas with nothing above them, without strips that are only the visible edge of a layer."""
    return offset_open(difference(solid, solid.shift_layers(-1)), 1.5 * width)


def _find_unsupported_strips(solid: Areas, inside: Areas, width: float, selected: Bool) -> Areas:
    """Return the narrow unsupported strips beside unsupported perimeters, on the `selected` layers (L,)."""
    above_bed = selected & (np.arange(solid.n_layers) > 0)
    reach = _MAX_OVERHANG_BEADS * width
    # Short spans are supported at both ends.
    below = offset(offset(solid.shift_layers(1), (width + reach) / 2), -reach / 2)
    walls = difference(difference(solid, inside), below).of_layers(above_bed)
    air = difference(inside, below).of_layers(above_bed)
    strips = difference(air, offset_open(air, reach / 2))
    beside = intersection(strips, offset(offset_open(walls, width / 4), reach + width))
    return offset_open(beside, width / 4)
