"""Contacts, from which the certified error is computed: where a ball can touch the surface, and how steeply.

A ball on the surface touches a facet along its normal, an edge along a direction between the normals of its facets, and
a corner along a direction of its normal cone. The *rise* is the vertical component of that unit direction: the rate at
which the distance to the surface can grow during vertical movement.

Let e be the unit direction of an edge, and m the direction in one of its facets that leaves e at a right angle. The
directions u in which a ball can touch e satisfy u · e = 0, and u · m <= 0 for every facet at e. The steepest direction
at right angles to e has the rise √(1 - e_z²). It is allowed exactly if no m points upward. Otherwise the steepest
contact at e is along the normal of a facet. A corner adds a contact only if all its edges lead downward; its rise is
then 1. If its cone of directions does not include the vertical, the steepest directions lie on the rim of the cone,
which belongs to the edges.

Balls that touch from below follow the same rules upside down: edges where every m points upward, and corners from
which all edges lead upward. Both sides go into one list: a contact that one side does not need marks a height at which
a path down the surface can end (see `vertical_runs`).

The mesh need not be closed, oriented or free of self-intersections. A missing neighbour removes conditions and can only
increase a rise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, distinct, frozen_array
from printer_slicer.geometry.connectivity import weld_keys
from printer_slicer.geometry.facet_topology import coordinate_keys, edge_keys
from printer_slicer.kernel import load_kernel
from printer_slicer.model import Mesh
from printer_slicer.surface.envelope import Envelope
from printer_slicer.values import Struct, force_setattr

__all__ = ["Contacts", "find_contacts"]

_LEVEL: Final = 1e-9  # sine of the slope under which a direction counts as horizontal
_NO_AREA: Final = 1e-12  # of the longest edge squared: a facet with less has no reliable normal
_AT_ONCE: Final = 1 << 15  # facets whose columns stay in the processor's cache
_Keys = NDArray[np.uint64]
_NEXT: Final = [1, 2, 0]
_BEFORE: Final = [2, 0, 1]


class Contacts(Struct, frozen=True, eq=False):
    """Ranges of z in which a ball can touch the surface, by ascending `low`.

    Attributes:
        low, high: (n,) mm; equal for flats, level edges and extrema.
        rise: (n,) 0 to 1, rate at which the distance to the surface can grow with z.
        source: (n,) the feature, for F facets: f for facet f; F + 3 f + c for the edge after its corner c;
            4 F + 3 f + c for that corner.
    """

    low: Float
    high: Float
    rise: Float
    source: Int

    def __post_init__(self) -> None:
        for name in ("low", "high", "rise"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (len(self.source),)))
        force_setattr(self, "source", frozen_array(self.source, np.int64, (-1,)))

    def event_heights(self) -> Float:
        """Return the heights (n,) of flats, level ridges and valleys, and local extrema, mm."""
        return distinct(self.low[(self.low == self.high) & (self.rise > 1 - _LEVEL)])

    def mirror(self) -> Contacts:
        """Return the contacts of the surface turned upside down: z becomes -z."""
        order = np.argsort(-self.high, kind="stable")
        return Contacts(-self.high[order], -self.low[order], self.rise[order], self.source[order])


class _ContactCandidates(NamedTuple):
    """Edges or corners of one block of facets that may add a contact, and those that cannot add one.

    Attributes:
        place: (n,) number of each candidate.
        key: (n,) key of each candidate.
        refused: (m,) keys of edges or corners that add no contact; other blocks may contain them, too.
    """

    place: Int
    key: _Keys
    refused: _Keys

    @classmethod
    def select_accepted(cls, blocks: Sequence[_ContactCandidates]) -> Int:
        """Return the numbers of the candidates that no block rules out."""
        place, key, refused = (np.concatenate(column) for column in zip(*blocks, strict=True))
        number, firsts = weld_keys(np.concatenate([key, refused]))
        is_refused = np.zeros(len(firsts), np.bool_)
        is_refused[number[len(key) :]] = True
        return np.asarray(place[~is_refused[number[: len(key)]]])


class _FacetBlock(NamedTuple):
    """Contacts found in one block of facets.

    Attributes:
        facets: (4, n) lowest and highest z, rise, and number of each facet.
        area: mm², total area.
        marks: candidates for ridges and valleys (edges), peaks and pits (corners), each numbered 3 f + c: the edge
            after corner c of facet f, or that corner.
    """

    facets: Float
    area: float
    marks: tuple[_ContactCandidates, _ContactCandidates, _ContactCandidates, _ContactCandidates]


def find_contacts(mesh: Mesh) -> tuple[Contacts, float]:
    """Find the contacts of the surface from above and below, and its area, mm².

    Args:
        mesh: the part; any triangles are allowed.
    """
    envelope = Envelope.between_heights(*mesh.bounds[:, 2].tolist())
    blocks = []
    for at in range(0, max(mesh.n_facets, 1), _AT_ONCE):
        block = _process_block(mesh.triangles, at)
        envelope.add(*block.facets[:3])
        blocks.append(block._replace(facets=block.facets[:, _is_relevant(envelope, *block.facets[:3])]))
    low, high, rise, facet = np.concatenate([block.facets for block in blocks], axis=1)
    candidates = zip(*(block.marks for block in blocks), strict=True)
    ridges, valleys, peaks, pits = map(_ContactCandidates.select_accepted, candidates)
    area = sum(block.area for block in blocks)
    del blocks
    edges, corners = distinct(np.concatenate([ridges, valleys])), np.concatenate([peaks, pits])
    start, end = mesh.triangles[edges // 3, edges % 3], mesh.triangles[edges // 3, (edges + 1) % 3]
    steep = np.hypot(*(end - start)[:, :2].T) / np.linalg.norm(end - start, axis=1)
    tip = mesh.triangles[corners // 3, corners % 3, 2]
    low = np.concatenate([low, np.minimum(start[:, 2], end[:, 2]), tip])
    high = np.concatenate([high, np.maximum(start[:, 2], end[:, 2]), tip])
    rise = np.concatenate([rise, steep, np.ones(len(corners))])
    source = np.concatenate([facet.astype(np.int64), mesh.n_facets + edges, 4 * mesh.n_facets + corners])
    envelope.add(low, high, rise)
    kept = np.flatnonzero((rise > _LEVEL) & _is_relevant(envelope, low, high, rise))
    order = kept[np.argsort(low[kept], kind="stable")]
    return Contacts(low[order], high[order], rise[order], source[order]), area


def _is_relevant(envelope: Envelope, low: Float, high: Float, rise: Float) -> Bool:
    """Return a mask (n,) of contacts to keep: flats, extrema, and contacts that can increase a bound."""
    return envelope.is_uncovered(low, high, rise) | (rise > 1 - _LEVEL)


def _process_block(triangles: Float, begin: int) -> _FacetBlock:
    """Find the possible contacts of the block of facets that starts at `begin`."""
    kernel = load_kernel()
    if kernel:
        facets = np.ascontiguousarray(triangles[begin : begin + _AT_ONCE])
        return _read_block(kernel.facet_contacts(facets, begin), begin)
    x, y, z = np.ascontiguousarray(
        triangles[begin : begin + _AT_ONCE].transpose(2, 1, 0)
    )  # (3, n): corner, facet
    run, across, climb = (column[_NEXT] - column for column in (x, y, z))
    normal_x = across[0] * climb[1] - climb[0] * across[1]
    normal_y = climb[0] * run[1] - run[0] * climb[1]
    normal_z = run[0] * across[1] - across[0] * run[1]
    level = np.sqrt(run * run + across * across)
    length = np.sqrt(level * level + climb * climb)
    size = np.sqrt(normal_x * normal_x + normal_y * normal_y + normal_z * normal_z)
    level /= np.maximum(length, 1e-300)  # √(1 - e_z²)
    # A facet without area may lie in any plane through its edges. It has no inward direction that could rule out one.
    solid = size > _NO_AREA * length.max(axis=0) ** 2
    rise = np.where(solid, np.abs(normal_z) / np.maximum(size, 1e-300), level.max(axis=0))
    inward = normal_x * across - normal_y * run  # m_z, times the lengths of normal and edge
    slack = np.where(solid, _LEVEL * size * length, np.inf)
    steeper = (level > rise + _LEVEL) & (length > 0)
    tag = coordinate_keys(x.ravel(), y.ravel(), z.ravel()).reshape(3, -1)
    marks = (
        *_find_candidates(
            edge_keys(tag), steeper, (inward > slack, inward < -slack), begin, shared_by_two=True
        ),
        *_find_candidates(
            tag,
            None,
            (_has_higher_neighbour(z, tag), _has_higher_neighbour(-z, tag)),
            begin,
            shared_by_two=False,
        ),
    )
    number = np.arange(begin, begin + len(rise), dtype=np.float64)
    return _FacetBlock(np.stack([z.min(axis=0), z.max(axis=0), rise, number]), float(size.sum()) / 2, marks)


def _read_block(made: tuple[bytes, ...], begin: int) -> _FacetBlock:
    """Return the block that the compiled kernel made."""
    low, high, rise, size = (np.frombuffer(column) for column in made[:4])
    ridges, valleys, peaks, pits = (
        _ContactCandidates(
            np.frombuffer(place, np.int64), np.frombuffer(key, np.uint64), np.frombuffer(refused, np.uint64)
        )
        for place, key, refused in zip(made[4::3], made[5::3], made[6::3], strict=True)
    )
    number = np.arange(begin, begin + len(rise), dtype=np.float64)
    return _FacetBlock(
        np.stack([low, high, rise, number]), float(size.sum()) / 2, (ridges, valleys, peaks, pits)
    )


def _find_candidates(
    key: _Keys, eligible: Bool | None, refusals: tuple[Bool, Bool], begin: int, *, shared_by_two: bool
) -> tuple[_ContactCandidates, _ContactCandidates]:
    """Select the edges or corners (3, n) of a block that may add a contact from above, and from below.

    Args:
        key: (3, n) key of each edge or corner.
        eligible: (3, n) mask of those that may add a contact; all if None.
        refusals: two masks (3, n), from above and from below, of those that add none.
        begin: number of the first facet of the block.
        shared_by_two: whether two facets share each one, as with edges: those found twice occur in no other block.
    """
    flat = key.ravel()
    number, firsts = weld_keys(flat)
    candidates = firsts.astype(np.int64) if eligible is None else np.flatnonzero(eligible)
    may_be_shared = (
        np.bincount(number, minlength=len(firsts)) == 1 if shared_by_two else np.ones(len(firsts), np.bool_)
    )
    corner, facet = np.divmod(candidates, key.shape[1])
    place = 3 * (begin + facet) + corner
    found = []
    for refused in refusals:
        is_refused = np.zeros(len(firsts), np.bool_)
        is_refused[number[refused.ravel()]] = True
        kept = ~is_refused[number[candidates]]
        found.append(
            _ContactCandidates(place[kept], flat[candidates[kept]], flat[firsts[is_refused & may_be_shared]])
        )
    return found[0], found[1]


def _has_higher_neighbour(z: Float, tag: _Keys) -> Bool:
    """Return a mask (3, n) of corners with another corner of their facet at the same height or higher."""
    has_higher = np.zeros(z.shape, np.bool_)
    for others in (_NEXT, _BEFORE):
        has_higher |= (z[others] >= z) & (tag[others] != tag)
    return has_higher
