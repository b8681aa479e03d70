"""Plates of parts, given as areas, and reference areas of skirt, brim and raft computed with shapely."""

from __future__ import annotations

from typing import Any

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, normalize
from printer_slicer.model import LayerPlan, Sections, Toolpaths
from printer_slicer.roles import Role
from tests.parts import shape, shapely

__all__ = ["disc", "foot", "lines", "plastic", "plate", "ring_of", "standing", "star"]


def plate(*layers: list[Float], height: float = 0.2) -> Sections:
    """Layers given by their rings; holes run clockwise."""
    return standing(normalize(Areas.from_rings(list(layers))), height)


def standing(areas: Areas, height: float = 0.2) -> Sections:
    """Areas as the sections of layers of this height."""
    return Sections(LayerPlan.from_tops(np.arange(1, areas.n_layers + 1) * height), areas)


def ring_of(x0: float, y0: float, x1: float, y1: float) -> Float:
    """(4, 2) a rectangle, counter-clockwise."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64)


def disc(radius: float, at: tuple[float, float] = (0.0, 0.0), sides: int = 96, turned: float = 0.0) -> Float:
    """(sides, 2) a regular polygon, by default nearly a circle, counter-clockwise; turned by radians."""
    turn = turned + 2 * np.pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(turn), np.sin(turn)]) + np.array(at)


def star(points: int, outer: float, inner: float) -> Float:
    """(2 * points, 2) a star; its points are the even corners."""
    turn = np.pi * np.arange(2 * points) / points
    return np.where(np.arange(2 * points) % 2, inner, outer)[:, None] * np.column_stack(
        [np.cos(turn), np.sin(turn)]
    )


def foot(sections: Sections, layer: int = 0) -> Any:
    """The area of one layer."""
    return shape(sections.solid, layer)


def lines(paths: Toolpaths, role: Role, layer: int | None = None) -> list[Any]:
    """The centre lines of one role, on one layer or on all."""
    chosen = (paths.role == role) & ((paths.layer == layer) | (layer is None))
    return [
        shapely.LinearRing(paths.path(i)) if paths.closed[i] else shapely.LineString(paths.path(i))
        for i in np.flatnonzero(chosen).tolist()
    ]


def plastic(paths: Toolpaths, role: Role, layer: int | None = None) -> Any:
    """The area under the beads of one role."""
    width = float(paths.width[0]) if len(paths.width) else 0.0
    return shapely.union_all([shapely.buffer(line, width / 2) for line in lines(paths, role, layer)])
