"""Flats: horizontal areas of the surface, where a layer should start or end."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh

__all__ = ["SMALLEST_FLAT", "find_downward_flats", "find_flats"]

SMALLEST_FLAT = 1.0  # mm²
_LEVEL = 1e-3  # slope below which a facet counts as horizontal
_SAME = 1e-3  # mm; facets within this distance in z belong to the same flat
_AT_ONCE = 1 << 15  # facets whose columns stay in the processor's cache


_cached_flats: WeakKeyDictionary[Mesh, tuple[Float, Float]] = WeakKeyDictionary()
_cached_downward_flats: WeakKeyDictionary[Mesh, tuple[Float, Float]] = WeakKeyDictionary()


def find_flats(mesh: Mesh, smallest: float = SMALLEST_FLAT) -> tuple[Float, Float]:
    """Find the heights at which horizontal facets face up or down. The result is cached per mesh.

    Args:
        mesh: the part, standing on z = 0.
        smallest: mm²; heights with less area than this are left out.

    Returns:
        The heights (n,), ascending, mm, and their areas (n,), mm².
    """
    if mesh not in _cached_flats:
        _cached_flats[mesh] = _find_all_flats(mesh)
    height, area = _cached_flats[mesh]
    large = area >= smallest
    return height[large], area[large]


def find_downward_flats(mesh: Mesh, smallest: float = SMALLEST_FLAT) -> tuple[Float, Float]:
    """Find the heights above the bed at which horizontal facets face down; arguments and results as `find_flats`."""
    if mesh not in _cached_downward_flats:
        _cached_downward_flats[mesh] = _find_all_flats(mesh, downward=True)
    height, area = _cached_downward_flats[mesh]
    large = (area >= smallest) & (height > _SAME)
    return height[large], area[large]


def _find_all_flats(mesh: Mesh, *, downward: bool = False) -> tuple[Float, Float]:
    """Return the heights (n,) of all flats, or of those that face down, mm, and their areas (n,), mm²."""
    blocks = [
        _select_level_facets(mesh.triangles[at : at + _AT_ONCE]) for at in range(0, mesh.n_facets, _AT_ONCE)
    ]
    place, area = np.concatenate([np.zeros((2, 0)), *blocks], axis=1)
    if downward:
        place, area = place[area < 0], -area[area < 0]
    area = np.abs(area)
    order = np.argsort(place, kind="stable")
    place, area = place[order], area[order]
    begins = np.flatnonzero(np.diff(place, prepend=-np.inf) > _SAME)
    if len(begins) == 0:
        return np.zeros(0), np.zeros(0)
    total = np.add.reduceat(area, begins)
    return np.add.reduceat(area * place, begins) / total, total


def _select_level_facets(triangles: Float) -> Float:
    """Return the heights and areas (2, n) of the horizontal facets; areas of facets that face down are negative."""
    x, y, z = np.ascontiguousarray(triangles.transpose(2, 1, 0))  # (3, n): corner, facet
    run, across, climb = (column[[1, 2]] - column[0] for column in (x, y, z))
    normal_x = across[0] * climb[1] - climb[0] * across[1]
    normal_y = climb[0] * run[1] - run[0] * climb[1]
    normal_z = run[0] * across[1] - across[0] * run[1]
    flat = np.hypot(normal_x, normal_y) <= _LEVEL * np.abs(normal_z)
    flat &= normal_z != 0
    return np.stack([z[:, flat].mean(axis=0), normal_z[flat] / 2])
