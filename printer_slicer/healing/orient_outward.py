"""Orient shells outward: flip bodies that face inward together with their voids."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.holes import CRACK
from printer_slicer.healing.nesting import compute_winding_numbers, measure_coverage
from printer_slicer.model import Repair
from printer_slicer.values import Struct

__all__ = ["measure_volume_and_area", "orient_outward"]

_TEST_DEPTH_RATIO = 1e-3  # of the size of a facet: distance of a test point from it
_MIN_VOLUME = 1e-9  # mm³
_MIN_VOLUME_RATIO = (
    1e-3  # of its area to the power of 1.5: minimum volume for an open surface to have an inside
)
_INSIDE_THRESHOLD = 0.5
_MAX_OPEN_SHELLS = 2000  # maximum number of open shells that are compared
_N_FURTHER_POINTS = 6  # additional test points of an outward shell, which must all lie within another shell


class _Shells(Struct, frozen=True, eq=False):
    """The surface split into shells: closed patches, and groups of open patches within a crack's width of each other.

    Attributes:
        shell_of_facet: (F,) the shell of each facet.
        volume: (S,) mm³, signed.
        closed: (S,) whether the shell is closed.
        has_inside: (S,) whether the shell encloses enough volume to have an inside.
    """

    shell_of_facet: Int
    volume: Float
    closed: Bool
    has_inside: Bool

    @classmethod
    def from_facets(cls, facets: Facets) -> _Shells:
        """Group the patches of a surface into shells; each closed patch is a shell."""
        patch = facets.label_patches()
        n_patches = int(patch.max(initial=-1)) + 1
        closed = _is_patch_closed(facets, patch, n_patches)
        shell = _group_open_patches(facets, patch, closed)[patch]
        n_shells = int(shell.max(initial=-1)) + 1
        whole = np.ones(n_shells, np.bool_)
        whole[shell[~closed[patch]]] = False
        volume, area = measure_volume_and_area(facets, shell, n_shells)
        has_inside = np.abs(volume) > np.where(whole, _MIN_VOLUME, _MIN_VOLUME_RATIO * area**1.5)
        return cls(shell, volume, whole, has_inside)


def orient_outward(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Flip shells until every shell except a void faces outward.

    A shell that faces inward is a void if it lies within the solid, judged by the larger shells around it. Otherwise it
    is flipped, together with the shells in it that faced outward: a body that is inside out has its voids inside out
    too. The largest shells are checked first.
    """
    shells = _Shells.from_facets(facets)
    inward = shells.has_inside & (shells.volume < 0)
    if not inward.any():
        return facets, []
    turn = _choose_shells_to_flip(facets, shells, inward)
    if not turn.any():
        return facets, []
    done = []
    for kind, some in (("shells turned outward", turn & inward), ("voids turned inward", turn & ~inward)):
        if some.any():
            first = np.unique(shells.shell_of_facet, return_index=True)[1][some]
            done.append(Repair(kind, facets.centroids[first]))
    return facets.flip(turn[shells.shell_of_facet]), done


def measure_volume_and_area(facets: Facets, shell: Int, n_shells: int) -> tuple[Float, Float]:
    """Return the signed volume, mm³, and the area, mm², of each shell (n_shells,).

    Open shells are closed by a cone to the middle of their border.
    """
    origin = np.zeros((n_shells, 3))
    origin[shell[::-1]] = facets.points[facets.corners[::-1, 0]]
    border = facets.count[facets.edges] == 1
    owner = np.repeat(shell, 3)[border.ravel()]
    n_border = np.bincount(owner, minlength=n_shells)
    for axis in range(3):
        total = np.bincount(owner, facets.points[facets.corners[border], axis], n_shells)
        origin[:, axis] = np.where(n_border > 0, total / np.maximum(n_border, 1), origin[:, axis])
    a, b, c = (facets.triangles - origin[shell][:, None]).transpose(1, 0, 2)
    volume = np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6, n_shells)
    area = np.bincount(shell, np.linalg.norm(facets.normals, axis=1) / 2, n_shells)
    return volume.astype(np.float64), area.astype(np.float64)


def _is_patch_closed(facets: Facets, patch: Int, n_patches: int) -> Bool:
    """Return whether the facets of each patch (n_patches,) use every edge equally often in both directions."""
    key, inverse = np.unique(
        np.repeat(patch, 3) * np.int64(len(facets.count)) + facets.edges.ravel(), return_inverse=True
    )
    net = np.bincount(inverse.ravel(), facets.turns.ravel())
    return np.asarray(np.bincount(key[net != 0] // len(facets.count), minlength=n_patches) == 0)


def _group_open_patches(facets: Facets, patch: Int, closed: Bool) -> Int:
    """Return the shell of each patch (P,); open patches whose bounding boxes nearly touch are one shell."""
    open_ones = np.flatnonzero(~closed)
    if not 1 < len(open_ones) <= _MAX_OPEN_SHELLS:
        return np.arange(len(closed))
    low, high = _find_bounding_boxes(facets, patch, len(closed))
    low, high = low[open_ones] - CRACK / 2, high[open_ones] + CRACK / 2
    near = ((low[:, None] <= high[None]) & (high[:, None] >= low[None])).all(axis=2)
    pairs = open_ones[np.stack(np.nonzero(near))]
    return label_components(pairs, len(closed))


def _find_bounding_boxes(facets: Facets, shell: Int, n_shells: int) -> tuple[Float, Float]:
    """Return the lower and upper corners (n_shells, 3) of the bounding box of each shell."""
    order = np.argsort(shell, kind="stable")
    first = np.searchsorted(shell[order], np.arange(n_shells))
    corners = facets.triangles.take(order, axis=0)
    return np.minimum.reduceat(corners.min(axis=1), first), np.maximum.reduceat(corners.max(axis=1), first)


def _choose_shells_to_flip(facets: Facets, shells: _Shells, inward: Bool) -> Bool:
    """Return which shells (S,) to flip, see `orient_outward`."""
    asked = np.flatnonzero(inward | _is_possible_void(facets, shells, inward))
    places, asker = _choose_test_points(facets, shells, asked, inward)
    found = [
        look(facets.triangles[some], shells.shell_of_facet[some], places)
        for look, some in (
            (compute_winding_numbers, shells.closed[shells.shell_of_facet]),
            (measure_coverage, (~shells.closed & shells.has_inside)[shells.shell_of_facet]),
        )
        if some.any()
    ]
    place, other, around = (np.concatenate(column) for column in zip(*found, strict=True))
    size = np.abs(shells.volume)
    larger = size[other] > size[asker[place]]
    place, other, around = place[larger], other[larger], around[larger]
    order = np.argsort(asker[place], kind="stable")
    place, other, around = place[order], other[order], around[order]
    start, end = (np.searchsorted(asker[place], asked, side=side) for side in ("left", "right"))
    turn = np.zeros(len(inward), np.bool_)
    for k in np.argsort(-size[asked], kind="stable").tolist():
        shell, these = asked[k], slice(int(start[k]), int(end[k]))
        if inward[shell]:
            turn[shell] = (around[these] * np.where(turn[other[these]], -1, 1)).sum() < _INSIDE_THRESHOLD
        else:
            within = other[these][np.abs(around[these]) >= _INSIDE_THRESHOLD]
            parents, seen = np.unique(within, return_counts=True)
            parents = parents[seen == _N_FURTHER_POINTS + 1]
            turn[shell] = len(parents) > 0 and bool(turn[parents[np.argmin(size[parents])]])
    return turn


def _is_possible_void(facets: Facets, shells: _Shells, inward: Bool) -> Bool:
    """Return which shells (S,) face outward and have a bounding box inside that of a larger shell facing inward."""
    from printer_slicer.geometry.planar import SegmentTree  # noqa: PLC0415 - shapely only when it is needed

    low, high = _find_bounding_boxes(facets, shells.shell_of_facet, len(inward))
    around, outward = np.flatnonzero(inward), np.flatnonzero(shells.has_inside & ~inward)
    tree = SegmentTree(np.stack([low[around, :2], high[around, :2]], axis=1))
    one, other = tree.query_boxes(low[outward, :2], high[outward, :2])
    one, other = outward[one], around[other]
    within = ((low[one] >= low[other]) & (high[one] <= high[other])).all(axis=1)
    within &= np.abs(shells.volume[one]) < np.abs(shells.volume[other])
    result = np.zeros(len(inward), np.bool_)
    result[one[within]] = True
    return result


def _choose_test_points(facets: Facets, shells: _Shells, asked: Int, inward: Bool) -> tuple[Float, Int]:
    """Return test points (n, 3) just inside shells, and the shell of each (n,).

    There is one behind the largest facet of each shell, and there are more for shells that face outward.
    """
    normals = facets.normals
    size = np.linalg.norm(normals, axis=1)
    order = np.lexsort((size, shells.shell_of_facet))
    last = np.searchsorted(shells.shell_of_facet[order], asked, side="right") - 1
    first = np.searchsorted(shells.shell_of_facet[order], asked)
    chosen, asker = [order[last]], [asked]
    several = np.flatnonzero(~inward[asked])
    for look in range(_N_FURTHER_POINTS):  # choose facets from small to large
        chosen.append(order[first + (last - first) * look // _N_FURTHER_POINTS][several])
        asker.append(asked[several])
    facet, shell = np.concatenate(chosen), np.concatenate(asker)
    off = np.where(inward[shell], 1, -1) * _TEST_DEPTH_RATIO / np.sqrt(np.maximum(size[facet], 1e-300))
    return facets.centroids[facet] + off[:, None] * normals[facet], shell
