"""Sample the wrong points of a stack of layers, and compute their exact distance from the surface of the part.

In each layer, a stack contains one area from the bottom of the layer to its top. A point is wrongly filled if the stack
contains it and the part does not, and wrongly empty in the opposite case. Results are exact apart from rounding. Points
that are too near to an edge or a face for a certain answer are left out.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import LayerPlan, Mesh, Sections
from tests.parts import shapely

__all__ = ["distance_to_mesh", "distance_to_triangles", "in_stack", "winding", "wrong_among", "wrong_points"]

UNSURE = 1e-9  # mm
DIGITS = 1e-14  # how well coordinates are known, as a share of the largest
AT_ONCE = 4000  # points


def wrong_points(
    mesh: Mesh, stack: Sections | LayerPlan, n: int, rng: np.random.Generator
) -> tuple[Float, Int]:
    """Points (n', 3) that are wrongly filled or empty, and their layers (n',), from `n` tried where they are likely.

    Sections are taken with their contours as they are, rounded and perhaps simplified; for a plan it is the mesh that
    says what its layers hold, exactly. The part over the last layer counts as wrongly empty, in layer `n_layers`.
    """
    return wrong_among(
        _likely(mesh, stack if isinstance(stack, LayerPlan) else stack.plan, n, rng), mesh, stack
    )


def wrong_among(points: Float, mesh: Mesh, stack: Sections | LayerPlan) -> tuple[Float, Int]:
    """Those of the points (n, 3) that are wrongly filled or empty for sure, and their layers."""
    held, layer, sure = in_stack(points, mesh, stack)
    turns, _, known = winding(points, mesh, points[:, 2], points[:, 2])
    wrong = (held != (turns > 0)) & sure & known
    return points[wrong], layer[wrong]


# --- distances ---


@lru_cache(maxsize=8)
def _tree(mesh: Mesh) -> Any:
    """The boxes of the facets seen from above."""
    low, high = mesh.triangles[:, :, :2].min(axis=1), mesh.triangles[:, :, :2].max(axis=1)
    return shapely.STRtree(shapely.box(*low.T, *high.T))


def _under(points: Float, mesh: Mesh, reach: Float) -> tuple[Int, Int]:
    """Pairs (point, facet) whose xy boxes are no farther apart than the point's reach (n,)."""
    x, y = points[:, :2].T
    point, facet = _tree(mesh).query(shapely.box(x - reach, y - reach, x + reach, y + reach))
    return point, facet


def distance_to_mesh(points: Float, mesh: Mesh, reach: float | Float) -> Float:
    """(n,) mm from each point (n, 3) to the nearest facet; inf where that is more than `reach` (one, or (n,))."""
    reaches = np.broadcast_to(reach, (len(points),))
    z = mesh.triangles[:, :, 2]
    bottom, top = z.min(axis=1), z.max(axis=1)
    result = np.full(len(points), np.inf)
    for first in range(0, len(points), AT_ONCE):
        some, away = points[first : first + AT_ONCE], reaches[first : first + AT_ONCE]
        point, facet = _under(some, mesh, away)
        height, far = some[point, 2], away[point]
        near = (bottom[facet] - far <= height) & (height <= top[facet] + far)
        point, facet = point[near], facet[near]
        found = distance_to_triangles(some[point], mesh.triangles[facet])
        np.minimum.at(result[first : first + AT_ONCE], point, found)
    return np.where(result <= reaches, result, np.inf)


def distance_to_triangles(points: Float, triangles: Float) -> Float:
    """(n,) mm from each point (n, 3) to the triangle (n, 3, 3) that goes with it; never less than it is."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = _dot(normal, normal)
    square[square == 0] = np.inf  # no area: its edges are all there is of it
    gap = points - a
    second = _dot(np.cross(gap, c - a), normal) / square
    third = _dot(np.cross(b - a, gap), normal) / square
    within = (second >= 0) & (third >= 0) & (second + third <= 1)
    # Measured to a point of the triangle, so that a badly known normal of a needle cannot make it less.
    foot = a + second[:, None] * (b - a) + third[:, None] * (c - a)
    result = np.where(within, np.linalg.norm(points - foot, axis=1), np.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        along = end - begin
        length = _dot(along, along)
        place = np.clip(_dot(points - begin, along) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        result = np.minimum(result, np.linalg.norm(points - begin - place[:, None] * along, axis=1))
    return np.asarray(result)


def _dot(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("ij,ij->i", a, b))


# --- inside or outside ---


def winding(points: Float, mesh: Mesh, low: Float, high: Float) -> tuple[Int, Int, Bool]:
    """(n,) how often the surface runs around the points at each xy between the heights `low` and `high` (n,).

    The least and the greatest number between them, equal for `low` = `high`, and whether that is sure. A line straight
    down enters the part where it meets a facet that looks up, and leaves it where one looks down.
    """
    point, height, turn, sure = _met(points, mesh)
    doubtful = np.minimum(np.abs(height - low[point]), np.abs(height - high[point])) <= UNSURE
    sure[point[doubtful]] = False
    # From the top down; each number holds from where the line meets a facet to where it meets the next.
    order = np.lexsort((-height, point))
    point, height = point[order], height[order]
    first = np.searchsorted(point, point)
    total = np.cumsum(turn[order])
    number = total - (total - turn[order])[first]
    until = np.append(height[1:], -np.inf)
    until[np.append(np.diff(point) != 0, True)[: len(until)]] = -np.inf
    counts = (height > low[point]) & (until < high[point])
    # Above everything it is 0, which counts where the line meets nothing before `high`.
    highest = np.full(len(points), -np.inf)
    np.maximum.at(highest, point, height)
    least = np.where(highest < high, 0, np.iinfo(np.int64).max)
    greatest = np.where(highest < high, 0, np.iinfo(np.int64).min)
    np.minimum.at(least, point[counts], number[counts])
    np.maximum.at(greatest, point[counts], number[counts])
    return least, greatest, sure


def _met(points: Float, mesh: Mesh) -> tuple[Int, Float, Int, Bool]:
    """Where vertical lines through the points meet facets: point, height, 1 up or -1 down; (n,) who is sure of it."""
    point, facet = _under(points, mesh, np.full(len(points), UNSURE))
    at, triangles = points[point], mesh.triangles[facet]
    flat = triangles[:, :, :2] - at[:, None, :2]
    edge = np.roll(flat, -1, axis=1) - flat
    side = flat[:, :, 0] * edge[:, :, 1] - flat[:, :, 1] * edge[:, :, 0]
    length = np.hypot(edge[:, :, 0], edge[:, :, 1])
    meets = (side > 0).all(axis=1) | (side < 0).all(axis=1)
    twice = side.sum(axis=1)
    # Each corner's weight is the area opposite to it: `side` of the edge that begins at the next corner.
    weight = np.roll(side, -1, axis=1) / np.where(twice == 0, 1.0, twice)[:, None]
    height = (weight * triangles[:, :, 2]).sum(axis=1)
    # Facets that are narrow from above do not tell well how high a place of theirs is.
    known = DIGITS * np.abs(at).max(axis=1) * length.max(axis=1) * np.ptp(triangles[:, :, 2], axis=1)
    vague = meets & (known > UNSURE * np.abs(twice))
    sure = np.ones(len(points), np.bool_)
    on_an_edge = (np.abs(side) <= UNSURE * length).any(axis=1) & _beside(flat)
    sure[point[on_an_edge | vague]] = False
    return point[meets], height[meets], np.sign(twice[meets]).astype(np.int64), sure


def _beside(flat: Float) -> Bool:
    """(n,) whether the origin is, but for rounding, in the box of each triangle (n, 3, 2)."""
    low, high = flat.min(axis=1), flat.max(axis=1)
    return np.asarray(((low <= UNSURE) & (high >= -UNSURE)).all(axis=1))


def in_stack(points: Float, mesh: Mesh, stack: Sections | LayerPlan) -> tuple[Bool, Int, Bool]:
    """(n,) whether the stack holds each point, its layer (n,) (`n_layers` above the last one), and whether sure."""
    plan = stack if isinstance(stack, LayerPlan) else stack.plan
    planes, z = np.concatenate([[0.0], plan.top]), points[:, 2]
    layer = np.searchsorted(plan.top, z).astype(np.int64)
    sure = (z - planes[layer] > UNSURE) & (np.append(plan.top, np.inf)[layer] - z > UNSURE)
    known = np.flatnonzero(layer < plan.n_layers)
    held = np.zeros(len(points), np.bool_)
    if len(known):
        decide = _held_by_mesh if isinstance(stack, LayerPlan) else _held_by_section
        held[known], sure_of_it = decide(points[known], layer[known], mesh, stack)
        sure[known] &= sure_of_it
    return held, layer, sure


def _held_by_section(points: Float, layer: Int, _: Mesh, sections: Any) -> tuple[Bool, Bool]:
    xy = points[:, :2]
    outlines = OutlineIndex(sections.solid, xy.min(axis=0), xy.max(axis=0))
    return outlines.is_inside(xy, layer), outlines.distance(xy, layer) > UNSURE


def _held_by_mesh(points: Float, layer: Int, mesh: Mesh, plan: Any) -> tuple[Bool, Bool]:
    """Where the part is at the height of the cut; anywhere in the layer, or everywhere in it, as containment says."""
    cut, bottom, top = plan.cut[layer], plan.bottom[layer], plan.top[layer]
    low, high = (cut, cut) if plan.containment == "mid" else (bottom, top)
    least, greatest, sure = winding(points, mesh, low, high)
    return (greatest > 0 if plan.containment == "positive" else least > 0), sure


# --- where to look ---


def _likely(mesh: Mesh, plan: LayerPlan, n: int, rng: np.random.Generator) -> Float:
    """(n, 3) points near the surface: moved anywhere, straight up and down, and to the ends of their layer."""
    planes = np.concatenate([[0.0], plan.top, [max(mesh.height, float(plan.top[-1]))]])
    points = _on_surface(mesh, n, rng)
    layer = np.clip(np.searchsorted(planes, points[:, 2]) - 1, 0, len(planes) - 2)
    bottom, top = planes[layer], planes[layer + 1]
    height = np.maximum(top - bottom, 1e-6)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # Also very near: what is worst at an edge is often a narrow place beside it.
    step = height * 10.0 ** -rng.uniform(0, 4, n) * rng.uniform(0, 1.5, n)
    points[:, :2] += step[:, None] * direction[:, :2]
    anywhere = bottom + height * rng.random(n)
    ends = np.where(rng.random(n) < 0.5, bottom + 2 * UNSURE, top - 2 * UNSURE)
    kind = rng.integers(4, size=n)
    points[:, 2] = np.choose(kind, [points[:, 2] + step * direction[:, 2], anywhere, ends, ends])
    return points


def _on_surface(mesh: Mesh, n: int, rng: np.random.Generator) -> Float:
    """(n, 3) points on the surface: by area, by facet, on edges and on corners, a quarter each."""
    triangles = mesh.triangles
    a, b, c = triangles.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    kind = np.arange(n) % 4
    facet = rng.integers(len(triangles), size=n)
    facet[kind == 0] = rng.choice(len(triangles), size=int((kind == 0).sum()), p=area / area.sum())
    weight = rng.dirichlet(np.ones(3), size=n)
    weight[kind == 2, 2] = 0.0
    weight[kind == 3, 1:] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    corners = rng.permuted(np.tile(np.arange(3), (n, 1)), axis=1)
    return np.asarray(np.einsum("ij,ijk->ik", weight, triangles[facet[:, None], corners]))
