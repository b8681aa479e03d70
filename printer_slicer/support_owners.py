"""Find the object that each support carries, so that it is cancelled together with the object."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.geometry import ConnectedAreas, normalize, offset, split_connected
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.labelling import SupportOwners, find_objects
from printer_slicer.model import Mesh, Overhangs, Supports
from printer_slicer.supports.pieces import find_overlaps

__all__ = ["find_support_owners"]

_INSET = 0.02  # mm inside an overhang, where its object is looked for


def find_support_owners(supports: Supports, overhangs: Overhangs, part: Mesh) -> SupportOwners:
    """Return the object of each support.

    A support is all that is connected from the bed up. One that carries several objects belongs to none of them, so
    that it is printed even if one of them is cancelled.

    Args:
        supports: the areas, with the plan for all overhangs.
        overhangs: what the supports carry.
        part: the part, with its objects.
    """
    pieces = split_connected(normalize(supports.area))
    body = label_components(np.stack(find_overlaps(pieces, pieces)), pieces.count)
    carrier = supports.plan.carrier
    overhanging = split_connected(overhangs.area.of_layers(carrier >= 0))
    objects = _find_objects_above(overhanging, overhangs, part)
    onto = ConnectedAreas(overhanging.areas, carrier[overhanging.layer], overhanging.of_ring)
    above, below = find_overlaps(onto, pieces, (0,))
    pairs = np.unique(np.stack([body[below], objects[above]]), axis=1)
    n_bodies = int(body.max(initial=-1)) + 1
    count = np.bincount(pairs[0], minlength=n_bodies)
    owner = np.full(n_bodies, SupportOwners.UNKNOWN)
    owner[pairs[0]] = pairs[1]
    owner[count > 1] = SupportOwners.SEVERAL
    areas = pieces.on_layers(supports.plan.layers.n_layers, np.arange(pieces.count))
    return SupportOwners(supports.plan.layers, areas, owner[body[pieces.areas.ring_layer]])


def _find_objects_above(overhanging: ConnectedAreas, overhangs: Overhangs, part: Mesh) -> Int:
    """Return the object (P,) of each overhanging piece."""
    inner = offset(overhanging.areas, -_INSET)
    points = np.zeros((overhanging.count, 2))
    for areas in (overhanging.areas, inner):
        first = np.searchsorted(areas.ring_layer, np.flatnonzero(areas.used))
        points[areas.used] = areas.xy[areas.ring_start[first]]
    return find_objects(points, overhangs.plan.cut[overhanging.layer], part)
