"""The union of all layers of a stack."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import distinct
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.engine import normalize

__all__ = ["unite_layers"]


def unite_layers(areas: Areas) -> Areas:
    """Return the union of all layers as a stack of one layer; rings of a layer may overlap."""
    used = distinct(areas.ring_layer)
    areas = areas.copy_layers(used)
    while areas.n_layers > 1:  # in pairs, so that few rings overlap in each step
        half = np.arange(areas.n_layers) // 2
        areas = normalize(areas.on_layers(half, int(half[-1]) + 1))
    return areas if areas.n_layers else Areas.empty(1)
