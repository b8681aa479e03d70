"""Heights at which supports should end below flats of the part, if supports have the layers of the part."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.model import Mesh
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import list_support_styles
from printer_slicer.surface.flats import find_downward_flats

__all__ = ["find_support_contacts"]

_MIN_AREA: Final = 4.0  # mm²; smaller flats have supports that end where a layer happens to end
_ROUNDING: Final = 1e-2  # units; precision of heights in 32-bit coordinates


def find_support_contacts(mesh: Mesh, profile: Profile, unit: float) -> tuple[Int, Int]:
    """Find the flats below which supports end at a layer of the part, for `quality.support_synchronize_layers`.

    With a layer that ends at `support_gap` below a flat, the gap is exact, although supports have no other layers.
    Left out are flats so low that no layer fits between the first layer and the top of the support, and all flats if
    the gap is thinner than the printer's layers. Bridges count as well, because planners do not know them.

    Args:
        mesh: the part, standing on z = 0.
        profile: settings of supports, containment, and limits of layer heights.
        unit: mm per unit of the results; layers end at whole units.

    Returns:
        The units (n,) at which the layers above the flats begin, ascending, and (n,) those at which supports end.
    """
    quality, printer = profile.quality, profile.printer
    supported = list_support_styles(profile) != {"off"}
    gap = round(quality.support_gap / unit)
    if (
        not (supported and quality.support_synchronize_layers)
        or gap * unit < printer.min_layer - _ROUNDING * unit
    ):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    height = find_downward_flats(mesh, _MIN_AREA)[0] / unit
    contact = {
        "mid": np.rint(height),
        "positive": np.floor(height + _ROUNDING),
        "negative": np.ceil(height - _ROUNDING),
    }[quality.containment].astype(np.int64)
    contact = np.unique(contact)
    lowest = quality.first_layer_height + printer.min_layer
    contact = contact[(contact - gap) * unit >= lowest - _ROUNDING * unit]
    return contact, contact - gap
