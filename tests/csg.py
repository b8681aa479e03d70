"""Random shapes from solids that are added and subtracted: thin fins, slender tips, slivers between cuts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import trimesh

from printer_slicer.model import Mesh

__all__ = ["csg_shape"]

_OPERATIONS: Final = 6  # solids after the first
_REACH: Final = 6.0  # mm from the middle of the first solid to those of the others


def csg_shape(seed: int) -> Mesh:
    """A solid of up to 25 mm, the same for a seed at any time, standing on z = 0.

    Args:
        seed: which one.
    """
    chance = np.random.default_rng(seed)
    solid = _box(chance, 10.0, 16.0)
    for _ in range(int(chance.integers(3, _OPERATIONS + 1))):
        made = _SOLIDS[int(chance.integers(len(_SOLIDS)))](chance, 3.0, 10.0)
        if chance.random() < 0.5:
            made.apply_transform(trimesh.transformations.random_rotation_matrix(chance.random(3)))
        made.apply_translation(chance.uniform(-_REACH, _REACH, 3))
        cut = chance.random() < 0.5
        combine = trimesh.boolean.difference if cut else trimesh.boolean.union
        changed = combine([solid, made], engine="manifold")
        solid = changed if len(changed.faces) and changed.volume > 100.0 else solid
    solid = max(solid.split(only_watertight=True), key=lambda piece: piece.volume)
    solid.apply_translation(-solid.bounds[0])
    return Mesh(np.asarray(solid.triangles, np.float64), f"csg {seed}")


def _box(chance: np.random.Generator, least: float, most: float) -> trimesh.Trimesh:
    return trimesh.creation.box(chance.uniform(least, most, 3))


def _cylinder(chance: np.random.Generator, least: float, most: float) -> trimesh.Trimesh:
    radius, height = chance.uniform(least / 2, most / 2), chance.uniform(least, 2 * most)
    return trimesh.creation.cylinder(radius, height, sections=48)


def _cone(chance: np.random.Generator, least: float, most: float) -> trimesh.Trimesh:
    radius, height = chance.uniform(least / 2, most / 2), chance.uniform(least, most)
    return trimesh.creation.cone(radius, height, sections=48)


def _ball(chance: np.random.Generator, least: float, most: float) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, chance.uniform(least / 2, most / 2))


def _slab(chance: np.random.Generator, least: float, most: float) -> trimesh.Trimesh:
    """Thin: what it leaves, or what it cuts, may be narrower than a bead."""
    x, y = chance.uniform(least, 1.5 * most, 2)
    return trimesh.creation.box((x, y, chance.uniform(0.2, 1.5)))


_SOLIDS: Final[tuple[Callable[[np.random.Generator, float, float], trimesh.Trimesh], ...]] = (
    _box,
    _cylinder,
    _cone,
    _ball,
    _slab,
)
