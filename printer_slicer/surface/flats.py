"""Flats: horizontal stretches of the surface, where a layer should begin or end."""

from __future__ import annotations

import numpy as np

from printer_slicer.model import Float, Mesh

__all__ = ["SMALLEST_FLAT", "find_flats"]

SMALLEST_FLAT = 1.0  # mm²
_LEVEL = 1e-3  # rise over run under which a facet is horizontal
_SAME = 1e-3  # mm; facets this near in z belong to one flat


def find_flats(mesh: Mesh, smallest: float = SMALLEST_FLAT) -> tuple[Float, Float]:
    """Heights (n,) ascending, mm, at which horizontal facets face up or down, and their areas (n,), mm².

    Args:
        mesh: the part, standing on z = 0.
        smallest: heights with less area than this, mm², are left out.
    """
    z = mesh.triangles[:, :, 2]
    spans = z.max(axis=1) - z.min(axis=1)
    # A facet that rises more than its longest possible run allows cannot be flat; few are left to look at.
    near = np.flatnonzero(spans <= _LEVEL * float(np.hypot(*mesh.size[:2])) + _SAME)
    a, b, c = mesh.triangles[near].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a) / 2
    flat = np.hypot(normal[:, 0], normal[:, 1]) <= _LEVEL * np.abs(normal[:, 2])
    flat &= normal[:, 2] != 0
    place, area = z[near][flat].mean(axis=1), np.abs(normal[flat, 2])
    order = np.argsort(place, kind="stable")
    place, area = place[order], area[order]
    begins = np.flatnonzero(np.diff(place, prepend=-np.inf) > _SAME)
    if len(begins) == 0:
        return np.zeros(0), np.zeros(0)
    total = np.add.reduceat(area, begins)
    height = np.add.reduceat(area * place, begins) / total
    large = total >= smallest
    return height[large], total[large]
