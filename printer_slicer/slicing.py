"""Mesh + LayerPlan -> Sections: cut all layers at once, join tail to head, remove what is redundant."""

from __future__ import annotations

import numpy as np

from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import Areas, Int, normalize, simplify
from printer_slicer.geometry.planes import Crossings, cross
from printer_slicer.model import Contours, Gap, LayerPlan, Mesh, Sections

__all__ = ["contours", "cut", "open_places"]

_LARGEST_GAP = 1.0  # mm; a wider gap in a contour is a missing face, not a crack


def cut(mesh: Mesh, plan: LayerPlan, resolution: float) -> Sections:
    """The solid area of the part in each layer.

    Args:
        mesh: the part, standing on z = 0.
        plan: where each layer is cut.
        resolution: contours are simplified by at most this, mm, before any polygon operation.

    Raises:
        PartError: the planes meet no material, or the contours cannot be closed.
    """
    crossings = cross(mesh.triangles, plan.cut)
    rings, gaps = _joined(crossings, plan, mesh.name)
    solid = normalize(simplify(rings, resolution))
    if solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="the part may be thinner than one layer, or inside out; check its size and units",
        )
    return Sections(plan, solid, crossings.unpaired, tuple(gaps))


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
    """For a permutation: the lowest index of each item's cycle, and the steps from there to the item.

    Pointer jumping: after round k every item knows its cycle's minimum over 2^k successors, so the number of rounds is
    the logarithm of the longest cycle.
    """
    n = len(following)
    lowest = np.arange(n)
    jump = following
    while True:
        better = np.minimum(lowest, lowest[jump])
        if np.array_equal(better, lowest):
            break
        lowest, jump = better, jump[jump]
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
    """Join each loose tail to the nearest loose head of its plane, in place; the gaps that this bridged."""
    heads = np.setdiff1d(np.arange(len(following)), following[following >= 0])
    tails = np.flatnonzero(following < 0)
    gaps: list[Gap] = []
    for plane in np.unique(crossings.plane[tails]):
        ends = tails[crossings.plane[tails] == plane]
        begins = heads[crossings.plane[heads] == plane]
        distance = np.linalg.norm(crossings.xy[ends][:, None] - crossings.xy[begins][None], axis=2)
        for _ in range(len(ends)):
            i, j = np.unravel_index(np.argmin(distance), distance.shape)
            following[ends[i]] = begins[j]
            width = float(distance[i, j])
            if width > 0:
                x, y = crossings.xy[ends[i]]
                gaps.append(Gap(int(plane), float(x), float(y), float(plan.cut[plane]), width))
            distance[i], distance[:, j] = np.inf, np.inf
    return sorted(gaps, key=lambda gap: -gap.width)


def _refuse_wide(gaps: list[Gap], name: str, n_edges: int) -> None:
    """Raise when a contour had to be closed over more than a crack."""
    if gaps and gaps[0].width > _LARGEST_GAP:
        wide = gaps[0]
        raise MeshError(
            f"{name}: the surface is open: {n_edges} edges have no neighbour; the widest gap is {wide.width:.3g} mm "
            f"at x {wide.x:.2f} y {wide.y:.2f} z {wide.z:.2f}",
            remedy="close the mesh in the program that made it (look for missing or flipped faces there)",
        )
