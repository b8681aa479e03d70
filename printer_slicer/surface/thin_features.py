"""Features thinner than the layers: places where the surface is passed more than once between two neighbouring cuts.

Between two cuts the shadow of the surface counts every passage, and the difference of the two sections only whether
their number is odd. What is left over are passages in pairs: a lid, a slot or the edge of a wedge that lies between two
cuts and shows in neither. Only where nothing is left over does the certified error bound the way from the surface to
the stack as well (see `runs`).
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import difference
from printer_slicer.model import Sections
from printer_slicer.surface.certificate import Surface

__all__ = ["thin_areas"]

_ROUNDING = 2e-5  # mm; what is left of contours that are rounded, for each mm of them


def thin_areas(surface: Surface, sections: Sections) -> Float:
    """(L + 1,) mm², the area of features that lie between each cut and the one before, seen from above.

    The first entry is about what lies below the first cut, the last about what lies above the last.

    Args:
        surface: of the part.
        sections: cut in the middle of the layers, with resolution 0.
    """
    solid, cut = sections.solid, sections.plan.cut
    before = solid.raised(1)
    changed = difference(solid, before).area() + difference(before, solid).area()
    below = surface.up.under(cut) + surface.down.under(cut)
    everything = float(surface.up.area.sum() + surface.down.area.sum())
    passed = np.diff(np.concatenate([[0.0], below, [everything]]))
    pairs = (passed - np.append(changed, solid.area()[-1:])) / 2
    length = solid.length()
    noise = _ROUNDING * np.append(length + np.append(0.0, length[:-1]), length[-1:])
    return np.asarray(np.where(pairs > noise, pairs, 0.0))
