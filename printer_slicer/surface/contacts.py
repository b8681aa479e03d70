"""Where a ball can touch the surface, and how steeply: what the certified error is made of.

A ball that rests on the surface touches a facet along its normal, an edge along a direction between the normals of its
facets, a corner along a direction of its normal cone. What counts is the vertical part of that direction, its *rise*:
how fast the distance to the surface can grow while one moves vertically. Let e be an edge, and let m be the direction
in one of its facets that leaves e at a right angle. The directions u in which a ball can touch e are those with
u · e = 0 and u · m <= 0 for the m of every facet at e. The steepest direction at right angles to e has the rise
√(1 - e_z²) and is one of them exactly if no m points upward; otherwise the steepest touch at e is along the normal of a
facet. A corner adds something only if all its edges lead downward (it then has rise 1), for the rim of a cone of
directions that does not hold the vertical belongs to the edges. Balls that touch from below see the same upside down:
there it is the edges whose every m points upward, and the corners from which all leads upward. Both sides go into one
list: what one side does not need is what stops a way down the surface from going on (see `runs`).

Nothing here asks whether the mesh is closed, oriented or free of crossings: a missing neighbour takes conditions
away and can only raise a rise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, distinct, frozen_array
from printer_slicer.geometry.connectivity import weld_keys
from printer_slicer.geometry.facet_topology import edge_keys, keys_of
from printer_slicer.model import Mesh
from printer_slicer.surface.envelope import Envelope

__all__ = ["Contacts", "find_contacts"]

_LEVEL: Final = 1e-9  # sine of the slope under which a direction counts as horizontal
_NO_AREA: Final = 1e-12  # of its longest edge squared: such a facet has no normal worth the name
_AT_ONCE: Final = 1 << 15  # facets whose columns stay in the processor's cache
_Keys = NDArray[np.uint64]
_NEXT: Final = [1, 2, 0]
_BEFORE: Final = [2, 0, 1]


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """Stretches of z in which balls touch the surface, by ascending `low`.

    Attributes:
        low, high: (n,) mm; equal for flats, level edges and extrema.
        rise: (n,) 0 to 1, how fast the distance to the surface can grow with z.
        source: (n,) where it is, of F facets: facet f as f; the edge after its corner c as F + 3 f + c; that corner
            itself as 4 F + 3 f + c.
    """

    low: Float
    high: Float
    rise: Float
    source: Int

    def __post_init__(self) -> None:
        for name in ("low", "high", "rise"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (len(self.source),)))
        object.__setattr__(self, "source", frozen_array(self.source, np.int64, (-1,)))

    def events(self) -> Float:
        """(n,) heights of flats, level ridges and valleys, and of corners that are highest or lowest around, mm."""
        return distinct(self.low[(self.low == self.high) & (self.rise > 1 - _LEVEL)])

    def mirrored(self) -> Contacts:
        """The same seen upside down: z becomes -z."""
        order = np.argsort(-self.high, kind="stable")
        return Contacts(-self.high[order], -self.low[order], self.rise[order], self.source[order])


class _Marks(NamedTuple):
    """Edges or corners of one block that may add a contact, as far as the block knows, and those that none has.

    Attributes:
        place: (n,) number of each that may.
        key: (n,) its key.
        refused: (m,) keys of those that no contact has, of which other blocks may not know.
    """

    place: Int
    key: _Keys
    refused: _Keys

    @classmethod
    def kept(cls, blocks: Sequence[_Marks]) -> Int:
        """The numbers of those that no block refuses."""
        place, key, refused = (np.concatenate(column) for column in zip(*blocks, strict=True))
        number, firsts = weld_keys(np.concatenate([key, refused]))
        gone = np.zeros(len(firsts), np.bool_)
        gone[number[len(key) :]] = True
        return np.asarray(place[~gone[number[: len(key)]]])


class _Block(NamedTuple):
    """What one block of facets says: each facet, the surface, and marks.

    Attributes:
        facets: (4, n) lowest and highest z, rise, and number of each.
        area: mm².
        marks: ridges and valleys by 3 f + c, where facet f has the edge after its corner c; peaks and pits, which are
            corners, by 3 f + c.
    """

    facets: Float
    area: float
    marks: tuple[_Marks, _Marks, _Marks, _Marks]


def find_contacts(mesh: Mesh) -> tuple[Contacts, float]:
    """Where balls touch the surface, from above or from below; and how large the surface is, mm².

    Args:
        mesh: the part; any triangles will do.
    """
    envelope = Envelope.over(*mesh.bounds[:, 2].tolist())
    blocks = []
    for at in range(0, max(mesh.n_facets, 1), _AT_ONCE):
        block = _block(mesh.triangles, at)
        envelope.add(*block.facets[:3])
        blocks.append(block._replace(facets=block.facets[:, _matters(envelope, *block.facets[:3])]))
    low, high, rise, facet = np.concatenate([block.facets for block in blocks], axis=1)
    ridges, valleys, peaks, pits = (
        _Marks.kept(marks) for marks in zip(*(block.marks for block in blocks), strict=True)
    )
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
    order = np.flatnonzero((rise > _LEVEL) & _matters(envelope, low, high, rise))
    order = order[np.argsort(low[order], kind="stable")]
    return Contacts(low[order], high[order], rise[order], source[order]), area


def _matters(envelope: Envelope, low: Float, high: Float, rise: Float) -> Bool:
    """(n,) contacts that add to some run; flats and extrema are kept, for they are events."""
    return envelope.shows(low, high, rise) | (rise > 1 - _LEVEL)


def _block(triangles: Float, begin: int) -> _Block:
    """The contacts that the facets from `begin` on may have."""
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
    # A facet without area can lie in any plane through its edges, and has no inward direction that could refuse one.
    solid = size > _NO_AREA * length.max(axis=0) ** 2
    rise = np.where(solid, np.abs(normal_z) / np.maximum(size, 1e-300), level.max(axis=0))
    inward = normal_x * across - normal_y * run  # m_z, times the lengths of normal and edge
    slack = np.where(solid, _LEVEL * size * length, np.inf)
    steeper = (level > rise + _LEVEL) & (length > 0)
    tag = keys_of(x.ravel(), y.ravel(), z.ravel()).reshape(3, -1)
    marks = (
        *_marked(edge_keys(tag), steeper, (inward > slack, inward < -slack), begin, in_two=True),
        *_marked(tag, None, (_beside_higher(z, tag), _beside_higher(-z, tag)), begin, in_two=False),
    )
    number = np.arange(begin, begin + len(rise), dtype=np.float64)
    return _Block(np.stack([z.min(axis=0), z.max(axis=0), rise, number]), float(size.sum()) / 2, marks)


def _marked(
    key: _Keys, wanted: Bool | None, refusals: tuple[Bool, Bool], begin: int, *, in_two: bool
) -> tuple[_Marks, _Marks]:
    """Marks of the edges or corners (3, n) of a block, for each of two kinds of refusals.

    What is there twice within the block is known to no other block where facets share it by twos, as they do edges.
    """
    flat = key.ravel()
    number, firsts = weld_keys(flat)
    candidates = firsts.astype(np.int64) if wanted is None else np.flatnonzero(wanted)
    outside_field = (
        np.bincount(number, minlength=len(firsts)) == 1 if in_two else np.ones(len(firsts), np.bool_)
    )
    corner, facet = np.divmod(candidates, key.shape[1])
    place = 3 * (begin + facet) + corner
    found = []
    for refused in refusals:
        gone = np.zeros(len(firsts), np.bool_)
        gone[number[refused.ravel()]] = True
        kept = ~gone[number[candidates]]
        found.append(_Marks(place[kept], flat[candidates[kept]], flat[firsts[gone & outside_field]]))
    return found[0], found[1]


def _beside_higher(z: Float, tag: _Keys) -> Bool:
    """(3, n) corners that have another one as high or higher beside them in their facet."""
    beside = np.zeros(z.shape, np.bool_)
    for others in (_NEXT, _BEFORE):
        beside |= (z[others] >= z) & (tag[others] != tag)
    return beside
