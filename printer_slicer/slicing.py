"""Mesh + LayerPlan -> Sections: cut all layers at once, join tail to head, remove what is redundant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import Areas, Float, Int, difference, normalize, offset, simplify, union
from printer_slicer.geometry.planes import Crossings, connected, cross, edge_faults, lowest_of_chain
from printer_slicer.geometry.slabs import slab_shadows
from printer_slicer.model import Contours, Faults, Gap, LayerPlan, Mesh, Sections

__all__ = ["contours", "cut", "mesh_faults", "open_places"]

_ROUNDING = 1e-3  # mm; ends this close are the same point, written twice
_FINE = (
    0.002  # mm; contours that must not cross the surface are simplified by this much and moved away as much
)
_LARGEST_GAP = 1.0  # mm; a wider gap in a contour is a missing face, not a crack


def cut(mesh: Mesh, plan: LayerPlan, resolution: float) -> Sections:
    """The solid area of the part in each layer.

    Args:
        mesh: the part, standing on z = 0.
        plan: where each layer is cut.
        resolution: contours are simplified by at most this, mm, before any polygon operation; where a plan has
            positive or negative containment, by less, and always to its side.

    Raises:
        PartError: the planes meet no material, or the contours cannot be closed.
    """
    crossings = cross(mesh.triangles, plan.cut)
    rings, gaps = _joined(crossings, plan, mesh.name)
    solid = (
        normalize(simplify(rings, resolution)) if plan.containment == "mid" else _contained(mesh, plan, rings)
    )
    if solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="the part may be thinner than one layer, or inside out; check its size and units",
        )
    return Sections(plan, solid, crossings.unpaired, tuple(gaps))


def _contained(mesh: Mesh, plan: LayerPlan, rings: Areas) -> Areas:
    """Everything that the part covers in each layer, or only what it covers at every height of it.

    The section at one height of a layer differs from that at another only where the surface lies between them, so the
    section at the cut with the shadow of the surface in the layer is their union, and without it their intersection.
    """
    section = normalize(rings)
    if plan.containment == "positive":
        shadow = normalize(slab_shadows(mesh.triangles, plan.bottom, plan.top))
        return offset(simplify(union(section, shadow), _FINE), _FINE)
    return offset(simplify(_common(mesh, plan, section), _FINE), -_FINE)


def _common(mesh: Mesh, plan: LayerPlan, section: Areas) -> Areas:
    """What the part covers at every height of each layer.

    Bodies that overlap hide parts of each other's surface, so each is taken for itself; voids are bodies inside out.
    """
    body = connected(mesh.triangles)
    if body.max(initial=0) == 0:
        return difference(section, normalize(slab_shadows(mesh.triangles, plan.bottom, plan.top)))
    solid, hollow = Areas.empty(plan.n_layers), Areas.empty(plan.n_layers)
    for number in range(int(body.max()) + 1):
        one = Mesh(mesh.triangles[body == number], mesh.name)
        shadow = normalize(slab_shadows(one.triangles, plan.bottom, plan.top))
        if one.volume >= 0:
            rings = _joined(cross(one.triangles, plan.cut), plan, mesh.name)[0]
            solid = union(solid, difference(normalize(rings), shadow))
        else:
            turned = Mesh(one.triangles[:, ::-1], mesh.name)
            rings = _joined(cross(turned.triangles, plan.cut), plan, mesh.name)[0]
            hollow = union(hollow, union(normalize(rings), shadow))
    return difference(solid, hollow)


def contours(mesh: Mesh, plan: LayerPlan) -> Contours:
    """The contour of each layer before and after the repair that the paper describes, to look at."""
    crossings = cross(mesh.triangles, plan.cut)
    segments = np.stack([crossings.xy[crossings.tail], crossings.xy[crossings.head]], axis=1)
    joined = _joined(crossings, plan, mesh.name)[0]
    return Contours(segments, crossings.plane[crossings.tail], joined, simplify(joined, 0.0))


def open_places(mesh: Mesh, plan: LayerPlan) -> tuple[int, list[Gap]]:
    """How many edges lack a neighbour, and where contours had to be closed over a gap, widest first."""
    crossings = cross(mesh.triangles, plan.cut)
    return crossings.unpaired, _joined(crossings, plan, mesh.name)[1]


def mesh_faults(mesh: Mesh) -> Faults:
    """Where the mesh is open, wrongly oriented, or not a surface; in the coordinates of the mesh."""
    return Faults(*edge_faults(mesh.triangles))


def _joined(crossings: Crossings, plan: LayerPlan, name: str) -> tuple[Areas, list[Gap]]:
    """All segments joined tail to head into closed rings."""
    n_nodes = len(crossings.xy)
    following = np.full(n_nodes, -1, np.int64)
    following[crossings.tail] = crossings.head
    gaps: list[Gap] = []
    if crossings.unpaired:
        gaps = _close(following, crossings, plan)
        _refuse_wide(gaps, name, crossings.unpaired)
    ring, rank = _cycles(following)
    first = np.flatnonzero(rank == 0)
    first = first[np.argsort(crossings.plane[first], kind="stable")]
    size = np.bincount(ring, minlength=n_nodes)[first]
    start = np.concatenate([[0], np.cumsum(size)])
    place_of_ring = np.zeros(n_nodes, np.int64)
    place_of_ring[first] = start[:-1]
    xy = np.zeros((n_nodes, 2))
    xy[place_of_ring[ring] + rank] = crossings.xy
    return Areas(xy, start, crossings.plane[first], plan.n_layers), gaps


def _cycles(following: Int) -> tuple[Int, Int]:
    """For a permutation: the lowest index of each item's cycle, and the steps from there to the item."""
    n = len(following)
    lowest = lowest_of_chain(following)
    # Steps to the cycle's first item, by the same doubling along the chain that ends there.
    is_first = lowest == np.arange(n)
    jump = np.where(is_first[following], np.arange(n), following)
    steps = (jump != np.arange(n)).astype(np.int64)
    while True:
        ahead = steps[jump]
        if not ahead.any():
            break
        steps, jump = steps + ahead, jump[jump]
    length = np.bincount(lowest, minlength=n)
    return lowest, np.where(is_first, 0, length[lowest] - 1 - steps)


def _close(following: Int, crossings: Crossings, plan: LayerPlan) -> list[Gap]:
    """Join each loose tail to the nearest loose head of its plane, in place; the gaps that this bridged.

    Ends that fall together but for rounding find each other by sorting; only the rest is compared pair by pair.
    """
    heads = np.setdiff1d(np.arange(len(following)), following[following >= 0])
    tails = np.flatnonzero(following < 0)
    for grid in (_ROUNDING, 10 * _ROUNDING):
        tails, heads = _join_equal(following, crossings, tails, heads, grid)
    gaps: list[Gap] = []
    for plane in np.unique(crossings.plane[tails]):
        ends = tails[crossings.plane[tails] == plane]
        begins = heads[crossings.plane[heads] == plane]
        for end, begin, width in _nearest_pairs(crossings.xy[ends], crossings.xy[begins]):
            following[ends[end]] = begins[begin]
            x, y = crossings.xy[ends[end]]
            if width > 0:
                gaps.append(Gap(int(plane), float(x), float(y), float(plan.cut[plane]), width))
    return sorted(gaps, key=lambda gap: -gap.width)


def _join_equal(following: Int, crossings: Crossings, tails: Int, heads: Int, grid: float) -> tuple[Int, Int]:
    """Join, in place, tails and heads of one plane that round to the same place; what is left of both."""
    both = np.concatenate([tails, heads])
    cell = np.column_stack([crossings.plane[both], np.rint(crossings.xy[both] / grid).astype(np.int64)])
    number = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    tail_cell, head_cell = number[: len(tails)], number[len(tails) :]
    by_tail, by_head = np.argsort(tail_cell, kind="stable"), np.argsort(head_cell, kind="stable")
    tail_sorted, head_sorted = tail_cell[by_tail], head_cell[by_head]
    # The k-th tail of a cell goes with its k-th head.
    rank = np.arange(len(tails)) - np.searchsorted(tail_sorted, tail_sorted)
    partner = np.searchsorted(head_sorted, tail_sorted) + rank
    inside = np.minimum(partner, max(len(heads) - 1, 0))
    fits = (partner < len(heads)) & (head_sorted[inside] == tail_sorted)
    joined_tails, joined_heads = by_tail[fits], by_head[partner[fits]]
    following[tails[joined_tails]] = heads[joined_heads]
    return np.delete(tails, joined_tails), np.delete(heads, joined_heads)


def _nearest_pairs(ends: Float, begins: Float) -> Iterator[tuple[int, int, float]]:
    """Pairs (end, begin, distance) of as many points each, the nearest first, every point once."""
    distance = np.linalg.norm(ends[:, None] - begins[None], axis=2)
    free_end, free_begin = np.ones(len(ends), np.bool_), np.ones(len(begins), np.bool_)
    for pair in np.argsort(distance, axis=None, kind="stable").tolist():
        end, begin = divmod(pair, len(begins))
        if free_end[end] and free_begin[begin]:
            free_end[end] = free_begin[begin] = False
            yield end, begin, float(distance[end, begin])


def _refuse_wide(gaps: list[Gap], name: str, n_edges: int) -> None:
    """Raise when a contour had to be closed over more than a crack."""
    if gaps and gaps[0].width > _LARGEST_GAP:
        wide = gaps[0]
        raise MeshError(
            f"{name}: the surface is open: {n_edges} edges have no neighbour; the widest gap is {wide.width:.3g} mm "
            f"at x {wide.x:.2f} y {wide.y:.2f} z {wide.z:.2f}",
            remedy="close the mesh in the program that made it (look for missing or flipped faces there)",
        )
