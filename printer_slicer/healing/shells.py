"""Which way facets face: neighbours the same way, shells outward unless they are voids."""

from __future__ import annotations

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.geometry.joints import linked
from printer_slicer.healing.facets import Facets
from printer_slicer.model import Bool, Float, Int, Repair

__all__ = ["face_alike", "face_outward", "solid_angle_at", "winding_at"]

_INWARD = 1e-3  # of the size of a facet: how far a point is moved off it
_NO_VOLUME = 1e-9  # mm³
_MOSTLY = 0.5


def face_alike(facets: Facets, name: str) -> tuple[Facets, list[Repair]]:
    """With neighbours facing the same way: in each patch the facets with less area are turned round.

    Every facet is two items, as it is and turned; neighbours link the items that face alike. A patch of one side only
    links both items of one facet.

    Raises:
        MeshError: the surface has one side only, like a Möbius strip.
    """
    pair, same = facets.pairs()
    if same.all():
        return facets, []
    n = len(facets.corners)
    one, other = pair
    links = np.concatenate(
        [np.stack([one, other + n * ~same]), np.stack([one + n, other + n * same])], axis=1
    )
    side = linked(links, 2 * n)
    as_is, turned = side[:n], side[n:]
    twisted = np.flatnonzero(as_is == turned)
    if len(twisted):
        x, y, z = facets.middles[twisted[0]]
        raise MeshError(
            f"{name}: the surface has one side only around x {x:.2f} y {y:.2f} z {z:.2f}: no solid lies behind it",
            remedy="close the mesh in the program that made it",
        )
    # Of the two sides of a patch the one that more area is on already.
    area = np.linalg.norm(facets.normals, axis=1)
    n_sides = int(side.max()) + 1
    weight = np.bincount(as_is, area, n_sides) - np.bincount(turned, area, n_sides)
    turn = (weight[as_is] < 0) | ((weight[as_is] == 0) & (as_is > turned))
    return facets.turned(turn), [Repair("facets turned round", facets.middles[turn])]


def _shell_volumes(facets: Facets, shell: Int, n_shells: int) -> Float:
    """(n_shells,) signed volume of each shell, mm³, as seen from one of its own corners."""
    first = np.zeros(n_shells, np.int64)
    first[shell[::-1]] = facets.corners[::-1, 0]
    a, b, c = (facets.triangles - facets.points[first][shell][:, None]).transpose(1, 0, 2)
    return np.asarray(np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6, n_shells), np.float64)


def face_outward(facets: Facets) -> tuple[Facets, list[Repair]]:
    """With every closed shell facing outward, but for voids: those that face inward and lie within the solid.

    The largest shells are judged first, and each by those larger than itself.
    """
    shell = facets.patches()
    n_shells = int(shell.max(initial=-1)) + 1
    volume = _shell_volumes(facets, shell, n_shells)
    closed = _closed(facets, shell, n_shells)
    inward = np.flatnonzero(closed & (volume < -_NO_VOLUME))
    if not len(inward):
        return facets, []
    turn = _not_void(facets, shell, np.where(closed, volume, np.inf), inward)
    if not turn.any():
        return facets, []
    firsts = np.unique(shell[turn[shell]], return_index=True)[1]
    places = facets.middles[turn[shell]][firsts]
    return facets.turned(turn[shell]), [Repair("shells turned outward", places)]


def _closed(facets: Facets, shell: Int, n_shells: int) -> Bool:
    """(n_shells,) whether the facets of each shell alone pass every edge as often in both directions."""
    key, inverse = np.unique(
        np.repeat(shell, 3) * np.int64(len(facets.count)) + facets.edges.ravel(), return_inverse=True
    )
    net = np.bincount(inverse.ravel(), facets.turns.ravel())
    return np.asarray(np.bincount(key[net != 0] // len(facets.count), minlength=n_shells) == 0)


def _not_void(facets: Facets, shell: Int, volume: Float, inward: Int) -> Bool:
    """(n_shells,) those of the `inward` shells that do not lie within larger ones; what is open is infinitely large."""
    normals = facets.normals
    size = np.linalg.norm(normals, axis=1)
    # A point just behind the largest facet of each shell, where the void is if it is one.
    order = np.lexsort((size, shell))
    largest = order[np.searchsorted(shell[order], inward, side="right") - 1]
    places = facets.middles[largest] + _INWARD * normals[largest] / np.sqrt(size[largest])[:, None]
    turn = np.zeros(len(volume), np.bool_)
    around = solid_angle_at if np.isinf(volume).any() else winding_at
    for k in np.argsort(-np.abs(volume[inward]), kind="stable").tolist():
        larger = np.flatnonzero((np.abs(volume) > abs(volume[inward[k]]))[shell])
        weight = np.where(turn[shell[larger]], -1, 1)
        turn[inward[k]] = around(facets.triangles[larger], places[k], weight) < _MOSTLY
    return turn


def solid_angle_at(triangles: Float, point: Float, weight: Int) -> float:
    """How much of all directions from a point is covered by the surface, seen from behind: 1 within a closed one.

    An open surface covers less, but more than half of all directions deep inside.

    Args:
        triangles: (F, 3, 3) mm.
        point: (3,) mm, not on the surface.
        weight: (F,) 1, or -1 for facets that count the other way round.

    Source: van Oosterom & Strackee, The solid angle of a plane triangle, 1983.
    """
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    box = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [
        np.einsum("ij,ij->i", one, other) * length
        for one, other, length in ((a, b, lc), (b, c, la), (c, a, lb))
    ]
    angle = 2 * np.arctan2(box, la * lb * lc + sum(dots))
    return float((angle * weight).sum() / (4 * np.pi))


def winding_at(triangles: Float, point: Float, weight: Int) -> int:
    """How often the surface runs around a point: facets straight over it that look up, less those that look down.

    Args:
        triangles: (F, 3, 3) mm; closed.
        point: (3,) mm, not on the surface.
        weight: (F,) 1, or -1 for facets that count the other way round.
    """
    x, y, z = point
    xs, ys, zs = np.ascontiguousarray(triangles.T)
    near = np.flatnonzero(
        (xs.min(axis=0) <= x)
        & (xs.max(axis=0) > x)
        & (ys.min(axis=0) <= y)
        & (ys.max(axis=0) > y)
        & (zs.max(axis=0) > z)
    )
    over = triangles[near]
    signs = np.where(_height_at(over, x, y) > z, _turns_around(over, x, y), 0)
    return int((signs * weight[near]).sum())


def _turns_around(triangles: Float, x: float, y: float) -> Int:
    """(F,) 1 where the facet, seen from above, runs around the place counter-clockwise, -1 clockwise, else 0."""
    begin, end = triangles, triangles[:, [1, 2, 0]]
    up = (begin[:, :, 1] <= y) & (end[:, :, 1] > y)
    down = (begin[:, :, 1] > y) & (end[:, :, 1] <= y)
    # From the lower end to the upper one, so that both facets of an edge see the same number.
    low, high = np.where(down[:, :, None], end, begin), np.where(down[:, :, None], begin, end)
    rise = np.where(up | down, high[:, :, 1] - low[:, :, 1], 1.0)
    where = low[:, :, 0] + (y - low[:, :, 1]) / rise * (high[:, :, 0] - low[:, :, 0])
    right = where > x
    return np.asarray((up & right).sum(axis=1) - (down & right).sum(axis=1))


def _height_at(triangles: Float, x: float, y: float) -> Float:
    """(F,) height of the plane of each facet over the place; upright facets give their top."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    flat = normal[:, 2] != 0
    slope = normal[:, 0] * (x - a[:, 0]) + normal[:, 1] * (y - a[:, 1])
    top = triangles[:, :, 2].max(axis=1)
    return np.asarray(np.where(flat, a[:, 2] - slope / np.where(flat, normal[:, 2], 1.0), top))
