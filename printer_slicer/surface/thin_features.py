"""Find features thinner than the layers: there a vertical line passes the surface repeatedly between two sections.

Between two sections the shadow of the surface counts every passage. The difference of the two sections only shows
whether their number is odd. The excess comes from pairs of passages: a lid, a slot or the edge of a wedge between two
sections that appears in neither. Without any excess, the certified error also bounds the distance from the surface to
the layers (see `vertical_runs`).
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import difference
from printer_slicer.model import Sections
from printer_slicer.surface.certificate import Surface

__all__ = ["thin_areas"]

_ROUNDING = 2e-5  # mm² of area per mm of contour that rounding may cause


def thin_areas(surface: Surface, sections: Sections) -> Float:
    """Return the projected area (L + 1,) of thin features between each section and the previous one, mm².

    The first entry is for features below the first section, the last for those above the last section.

    Args:
        surface: surface of the part.
        sections: sections in the middle of the layers, with resolution 0.
    """
    solid, cut = sections.solid, sections.plan.cut
    before = solid.shift_layers(1)
    changed = difference(solid, before).area() + difference(before, solid).area()
    below = surface.up.area_below(cut) + surface.down.area_below(cut)
    everything = float(surface.up.area.sum() + surface.down.area.sum())
    passed = np.diff(np.concatenate([[0.0], below, [everything]]))
    pairs = (passed - np.append(changed, solid.area()[-1:])) / 2
    length = solid.length()
    noise = _ROUNDING * np.append(length + np.append(0.0, length[:-1]), length[-1:])
    return np.asarray(np.where(pairs > noise, pairs, 0.0))
