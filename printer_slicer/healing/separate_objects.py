"""Repair the objects of a plate one by one, so that it stays known which facets belong to which object."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from printer_slicer.healing.soundness import is_sound
from printer_slicer.healing.steps import run_steps
from printer_slicer.model import Mesh, Repair, Repairs
from printer_slicer.values import replace

__all__ = ["are_separate", "repair_objects"]

_MIN_DISTANCE: Final = 0.5  # mm; nearer objects may close each other's holes


def are_separate(mesh: Mesh) -> bool:
    """Return whether a mesh has several objects with known facets, whose bounding boxes are apart."""
    items = mesh.objects
    known = sum(item.count for item in items) == len(mesh.triangles) and all(item.count for item in items)
    if len(items) < 2 or not known:
        return False
    low, high = (np.array([getattr(item, side) for item in items]) for side in ("low", "high"))
    gap = np.maximum(low[:, None] - high[None], low[None] - high[:, None]).max(axis=2)
    np.fill_diagonal(gap, np.inf)
    return bool((gap >= _MIN_DISTANCE).all())


def repair_objects(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """Repair the objects of a mesh one by one; a mesh without anything to repair is returned unchanged.

    Raises:
        MeshError: the surface of an object is one-sided, or none of its facets remain.
    """
    pieces, done = [], list[Repair]()
    for item in mesh.objects:
        own = Mesh(mesh.triangles[item.facets], item.name)
        repaired, repairs = (own, Repairs()) if is_sound(own.triangles) else run_steps(own)
        pieces.append(repaired.triangles)
        done += repairs.done
    if not done:
        return mesh, Repairs()
    counts = [len(one) for one in pieces]
    firsts = np.cumsum([0, *counts[:-1]]).tolist()
    items = tuple(
        replace(item, first=first, count=count)
        for item, first, count in zip(mesh.objects, firsts, counts, strict=True)
    )
    return Mesh(np.concatenate(pieces), mesh.name, items, mesh.volumes), Repairs(tuple(_merge(done)))


def _merge(repairs: Sequence[Repair]) -> Iterable[Repair]:
    """Yield one repair of each kind, in the order of the first ones."""
    for kind in dict.fromkeys(one.kind for one in repairs):
        same = [one for one in repairs if one.kind == kind]
        places = np.concatenate([one.places for one in same])
        yield Repair(kind, places, max(one.widest for one in same), sum(one.area for one in same))
