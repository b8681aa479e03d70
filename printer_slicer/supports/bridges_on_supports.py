"""Print bridges over supports as solid infill.

Lines of thick bridges reach below their layer, so the gap to a support would be smaller than the settings say. Lines
that lie on a support are no bridges.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.geometry import Areas, intersection, split_connected
from printer_slicer.model import Regions
from printer_slicer.values import replace

__all__ = ["replace_bridges_on_supports"]

_MIN_AREA: Final = 1.0  # mm² of a bridge over supports; less is their edge


def replace_bridges_on_supports(regions: Regions, carried: Areas) -> Regions:
    """Return regions in which bridges over supports are bottom solid infill.

    Args:
        regions: of an object.
        carried: the areas that supports carry, on the same layers.
    """
    pieces = split_connected(regions.bridge)
    if not pieces.count:
        return regions
    over = intersection(pieces.areas, pieces.select_nearby_rings(carried)).area() > _MIN_AREA
    if not over.any():
        return regions
    rests = np.append(over, False)[pieces.of_ring]
    bottom = regions.bottom_solid_infill.merge(regions.bridge.select(rests))
    return replace(
        regions,
        bridge=regions.bridge.select(~rests),
        bridge_angle=regions.bridge_angle[~rests],
        bottom_solid_infill=bottom,
    )
