"""Sections, and paths that consist of a single point, so that a test can define the exact travel moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Areas, LayerPlan, Sections, Toolpaths, Travels, find_travel_ends
from printer_slicer.roles import Role
from printer_slicer.travels import travel
from tests.parts import profile, shapely

__all__ = ["length_of", "places", "sections_of", "travelled", "way"]


def sections_of(*layers: Any) -> Sections:
    """One shapely area a layer, 0.2 mm each."""
    rings = [
        [
            shapely.get_coordinates(ring)[:-1]
            for part in shapely.get_parts(shapely.orient_polygons(layer))
            for ring in (part.exterior, *part.interiors)
        ]
        for layer in layers
    ]
    plan = LayerPlan.from_tops(0.2 * np.arange(1, len(layers) + 1))
    return Sections(plan, Areas.from_rings(rings))


def places(
    sections: Sections, points: Any, layer: Any = None, role: Role = Role.INTERNAL_INFILL
) -> Toolpaths:
    """A path at each of the points (M, 2), of no length, on its `layer` (M,) or all on the first."""
    xy = np.array(points, np.float64).reshape(-1, 2)
    return Toolpaths.gathered(
        sections.plan,
        xy=xy,
        size=np.ones(len(xy), np.int64),
        layer=np.zeros(len(xy), np.int64) if layer is None else np.asarray(layer),
        role=np.full(len(xy), int(role)),
        width=np.full(len(xy), 0.45),
        closed=True,
    )


def travelled(area: Any, *points: Sequence[float], **changes: Any) -> tuple[Toolpaths, Travels]:
    """The ways between places on one layer."""
    sections = sections_of(area)
    paths = places(sections, points)
    return paths, travel(paths, sections, profile(**changes))


def way(paths: Toolpaths, travels: Travels, index: int) -> Float:
    """(n, 2) all points of a way."""
    begin, end = find_travel_ends(paths)
    between = travels.xy[travels.start[index] : travels.start[index + 1]]
    return np.concatenate([begin[index : index + 1], between, end[index : index + 1]])


def length_of(line: Float) -> float:
    """Mm."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())
