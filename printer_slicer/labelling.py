"""Find the object that each extrusion belongs to, from its position; supports belong to the object that they carry.

Most objects stand apart, so only one bounding box contains an extrusion. Where several do, as for a ring around a
cube, the section of each object at this height is tested (winding number). Objects that overlap are printed as one
solid; the extrusions of such a solid belong to its first object.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.geometry import Areas, find_enclosing_rings
from printer_slicer.model import Labels, LayerPlan, Mesh, PlateObject, Program
from printer_slicer.roles import roles_with
from printer_slicer.values import Struct

__all__ = ["SupportOwners", "find_objects", "label_moves", "make_unique_names"]

_TOLERANCE: Final = 1.0  # mm: extrusions may lie this far outside the bounding box because of compensation
_MAX_NAME_LENGTH: Final = 24  # characters of a name, to keep lines short


class SupportOwners(Struct, frozen=True, eq=False):
    """The object that each support carries.

    Attributes:
        plan: the layers of supports, without a raft.
        areas: the supports by layer.
        owner: (R,) object that each ring of `areas` carries.
    """

    SEVERAL: ClassVar[int] = -1
    """It carries several objects, so it belongs to none."""
    UNKNOWN: ClassVar[int] = -2

    plan: LayerPlan
    areas: Areas
    owner: Int


def label_moves(
    program: Program, part: Mesh, plan: LayerPlan, owners: SupportOwners | None = None
) -> Labels | None:
    """Find the object of each move; None if the part has only one object.

    Args:
        program: the moves.
        part: the part, with its objects.
        plan: the layers of the part; the program may have raft layers below them, and layers of supports between.
        owners: the objects of supports; those of unknown ones are found by position.
    """
    items = part.objects
    if len(items) < 2:
        return None
    carries = roles_with(is_support=True)[program.role]
    lays = roles_with(is_part=True)[program.role] | carries
    same = (np.diff(program.layer, prepend=-1) == 0) & (np.diff(carries, prepend=False) == 0)
    begins = lays & ~(np.append(False, lays[:-1]) & same)
    first = np.flatnonzero(begins)
    middle = (program.start[first, :2] + program.xyz[first, :2]) / 2
    lift = float(program.plan.top[-1] - plan.top[-1])
    layer = np.minimum(plan.find_tops(program.plan.top[program.layer[first]] - lift), plan.n_layers - 1)
    found = find_objects(middle, plan.cut[layer], part)
    if owners:
        some = np.flatnonzero(carries[first])
        at = owners.plan.find_tops(program.plan.top[program.layer[first[some]]] - lift)
        ring = find_enclosing_rings(owners.areas, middle[some], at)
        owner = np.append(owners.owner, SupportOwners.UNKNOWN)[ring]
        found[some] = np.where(owner == SupportOwners.UNKNOWN, found[some], owner)
    item = np.full(program.n_moves, -1)
    item[lays] = found[np.cumsum(begins)[lays] - 1]
    boxes = np.array([[one.low[:2], one.high[:2]] for one in items])
    return Labels(make_unique_names([one.name for one in items]), boxes, item)


def make_unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """Make names unique and acceptable for all programs that read G-code."""
    made: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:_MAX_NAME_LENGTH] or "object"
        number, unique = 1, plain
        while unique in made:
            number += 1
            unique = f"{plain}_{number}"
        made.append(unique)
    return tuple(made)


def find_objects(place: Float, z: Float, part: Mesh) -> Int:
    """Return the index of the object (n,) at each point `place` (n, 2) and height `z` (n,), mm."""
    items = part.objects
    low, high = (np.array([getattr(one, side) for one in items]) for side in ("low", "high"))
    at = np.column_stack([place, z])
    beyond = np.maximum(np.maximum(low[None] - at[:, None], at[:, None] - high[None]), 0).max(axis=2)
    volume = np.prod(high - low, axis=1)
    # Choose the nearest bounding box; if several boxes contain the point, choose the smallest.
    found = np.lexsort((np.broadcast_to(volume, beyond.shape), np.maximum(beyond - _TOLERANCE, 0)), axis=1)[
        :, 0
    ]
    doubtful = np.flatnonzero((beyond <= _TOLERANCE).sum(axis=1) > 1)
    for level in distinct(z[doubtful]):
        some = doubtful[z[doubtful] == level]
        held = np.stack([_contains_points(place[some], float(level), one, part) for one in items])
        certain = held.any(axis=0)
        found[some[certain]] = held.argmax(axis=0)[certain]
    return found


def _contains_points(place: Float, z: float, item: PlateObject, part: Mesh) -> Bool:
    """Return whether the section of an object at height `z` contains each point (n,) of `place` (n, 2)."""
    if not item.count or not item.low[2] <= z <= item.high[2]:
        return np.zeros(len(place), np.bool_)
    facets = part.triangles[item.facets]
    above = facets[:, :, 2] > z
    facets = facets[above.any(axis=1) & ~above.all(axis=1)]
    begin, end = _cut_edges(facets, z, rising=True), _cut_edges(facets, z, rising=False)
    x, y = place[:, 0, None], place[:, 1, None]
    crosses = (begin[:, 1] <= y) != (end[:, 1] <= y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = begin[:, 0] + (y - begin[:, 1]) / (end[:, 1] - begin[:, 1]) * (end[:, 0] - begin[:, 0])
        right = crosses & (at > x)
    turns = np.where(right, np.sign(end[:, 1] - begin[:, 1]), 0).sum(axis=1)
    return np.asarray(turns != 0)


def _cut_edges(facets: Float, z: float, *, rising: bool) -> Float:
    """Return the point (n, 2), mm, at which the plane at `z` cuts one edge of each facet.

    With `rising` this is the edge that crosses the plane upward, otherwise the edge that crosses it downward.
    """
    after = np.roll(facets, -1, axis=1)
    low, high = (facets, after) if rising else (after, facets)
    edge = ((low[:, :, 2] <= z) & (high[:, :, 2] > z)).argmax(axis=1)
    every = np.arange(len(facets))
    a, b = low[every, edge], high[every, edge]
    share = (z - a[:, 2]) / (b[:, 2] - a[:, 2])
    cut: Float = a[:, :2] + share[:, None] * (b - a)[:, :2]
    return cut
