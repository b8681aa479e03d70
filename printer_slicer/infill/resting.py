"""Internal bridges that rest at both ends: on lines of the sparse infill below, on what is solid there, or at walls.

Solid over sparse infill has no shape of its own kind: it ends where a skin or a slope does, anywhere over the cells of
the pattern. Each of its rows is made longer until it reaches what carries it, and the direction of the rows is the one
in which the threads sag least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.bridges import over_sparse
from printer_slicer.geometry import (
    Areas,
    Lines,
    Pieces,
    Polylines,
    difference,
    hatch,
    intersection,
    offset,
    offset_open,
    pieces_of,
    staircases,
    stroked,
    union,
)
from printer_slicer.model import Regions
from printer_slicer.profile import Profile

__all__ = ["carried_layers", "rested"]

_DIRECTIONS = 12
_WORTH = 0.95  # of the sagging of the usual direction: what another one must be under to be taken
_NEAR = 1e-3  # mm: engines round to 0.01 µm


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """Where internal bridges may be, and what carries them.

    Attributes:
        room: what is inside the walls and not open to the air.
        air: the parts of it with no plastic right below.
        grip: mm that a row lies on what carries it, at least, where that is as wide.
    """

    room: Areas
    air: Areas
    grip: float


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows across pieces, and how far they have to go.

    Attributes:
        lines: across the pieces.
        u: (S, 2) mm, from where to where each reaches when it rests at both ends.
        sag: (S,) mm³: the cubes of the spans of each, added up: a thread sags by the square of its span, all along it.
    """

    lines: Lines
    u: Float
    sag: Float


def carried_layers(regions: Regions) -> Int:
    """The layers whose sparse infill has to carry an internal bridge."""
    return np.flatnonzero(regions.internal_bridge.used) - 1


def rested(regions: Regions, lines: Polylines, profile: Profile) -> Regions:
    """The regions with internal bridges that reach to what carries them, and the direction of each.

    What they take is solid or sparse infill; what is open to the air stays as it is. Lines at the borders of sparse
    areas move with these and are not counted on.

    Args:
        regions: what is inside the walls, by purpose.
        lines: of the sparse infill, on the layers `carried_layers` at least.
        profile: width of beads, and how far bridges reach onto what carries them.
    """
    bridge, width = regions.internal_bridge, profile.extrusion_width
    used, second = _by_turns(bridge)
    regions = _laid(regions, bridge.of_layers(used & ~second), lines, profile, used & ~second)
    # Those of the layer below have grown: what they carry by now is solid, and none has to rest on it.
    below = regions.sparse.raised(1).of_layers(second)
    own = over_sparse(bridge.of_layers(second), below, width, profile.quality.bridge_anchor)
    return _laid(regions, own, lines, profile, second)


def _by_turns(bridge: Areas) -> tuple[Bool, Bool]:
    """(L,) the layers with bridges; and of those that lie one on the other every second one."""
    own, used = np.arange(bridge.n_layers), bridge.used
    since = own - np.maximum.accumulate(np.where(used, -1, own))
    return used, used & (since % 2 == 0)


def _laid(regions: Regions, own: Areas, lines: Polylines, profile: Profile, here: Bool) -> Regions:
    """The regions when the bridges of some layers (L,) rest: `own`; what else was to be bridged there is solid."""
    width, wanted = profile.extrusion_width, regions.internal_bridge.of_layers(here)
    pieces, ground = pieces_of(own), _ground(regions, lines, width, profile.quality.bridge_anchor, here)
    # In between those of the usual pattern, to which any other is compared.
    usual = np.deg2rad(profile.quality.infill_angle_deg + 45)
    done, turn = _grown(pieces, _best_angles(pieces, ground, width, float(usual)), ground, width)
    elsewhere = ~here[regions.internal_bridge.ring_layer]
    layer = np.concatenate([regions.internal_bridge.ring_layer[elsewhere], done.ring_layer])
    turns = np.concatenate([regions.internal_bridge_angle[elsewhere], turn])
    return replace(
        regions,
        internal_bridge=regions.internal_bridge.select(elsewhere).merge(done),
        internal_bridge_angle=turns[np.argsort(layer, kind="stable")],
        solid=difference(union(regions.solid, difference(wanted, own)), done),
        sparse=difference(regions.sparse, done),
    )


def _grown(pieces: Pieces, angle: Float, ground: _Ground, width: float) -> tuple[Areas, Float]:
    """All pieces on their layers, made long enough, and (R,) the direction of each ring; none overlap."""
    n = ground.room.n_layers
    done, of_ring = Areas.empty(n), np.zeros(0)
    for turn in distinct(angle).tolist():
        chosen = np.flatnonzero(angle == turn)
        own = pieces.on_layers(n, chosen)
        others = done.merge(
            pieces.on_layers(n, np.flatnonzero(angle != turn))
        )  # overlapping, as what is cut off may
        grown = difference(_stretched(own, pieces.take(chosen), ground, width, turn), difference(others, own))
        order = np.argsort(np.concatenate([done.ring_layer, grown.ring_layer]), kind="stable")
        of_ring = np.concatenate([of_ring, np.full(grown.n_rings, turn)])[order]
        done = done.merge(grown)
    return done, of_ring


def _ground(regions: Regions, lines: Polylines, width: float, grip: float, used: Bool) -> _Ground:
    """Room and air on some of the layers (L,)."""
    n = regions.plan.n_layers
    closed = regions.bottom_skin.merge(regions.bridge).merge(regions.top_skin).of_layers(used)
    inside = regions.inside
    if not inside.n_rings:
        inside = union(regions.internal_bridge, union(regions.solid, regions.sparse))
    room = difference(inside.of_layers(used), closed)
    some = lines.take(np.flatnonzero(np.append(used[1:], False)[lines.layer]))
    pens = stroked(some.xy, some.start, some.layer + 1, np.full(some.n_lines, width / 2), n)
    hollow = intersection(room, regions.sparse.raised(1).of_layers(used))
    # What is narrower than half a bead is no gap.
    return _Ground(room, offset_open(difference(hollow, pens), width / 4), grip)


def _best_angles(pieces: Pieces, ground: _Ground, width: float, usual: float) -> Float:
    """(P,) the direction in which the threads of each piece sag least."""
    best, record = np.full(pieces.count, usual), np.full(pieces.count, np.inf)
    for turn in (np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS).tolist():
        rows = _rows(pieces, ground, 2 * width, usual + turn)
        sag = np.bincount(rows.lines.layer, rows.sag, minlength=pieces.count)
        better = sag < (record * _WORTH - _NEAR if turn else record)
        best[better], record[better] = usual + turn, sag[better]
    return best


def _stretched(own: Areas, pieces: Pieces, ground: _Ground, width: float, angle: float) -> Areas:
    """Pieces with rows of this direction made long enough."""
    step = width / 2
    rows = _rows(pieces, ground, step, angle)
    longer = np.flatnonzero(np.abs(rows.u - rows.lines.u).max(axis=1, initial=0.0) > _NEAR)
    if not len(longer):
        return own
    # Twice as wide as they lie apart: what is laid in between rows, or along the border, is as long as those beside it.
    strips = staircases(
        rows.lines.take(longer), rows.u[longer], angle=angle, half=step, n_layers=pieces.count
    )
    strips = strips.restacked(np.arange(strips.n_rings), pieces.layer[strips.ring_layer], own.n_layers)
    # Growing unites what overlaps, and so does what the room has in common with it.
    whole = own.merge(strips)
    # Notches between strips that no row fits in.
    smooth = offset(offset(whole, width / 2), -width / 2)
    return intersection(whole.merge(smooth), ground.room)


def _rows(pieces: Pieces, ground: _Ground, step: float, angle: float) -> _Rows:
    """Rows of one direction across the pieces, made longer until they rest at both ends."""
    lines, room, air = (
        hatch(areas, angle=angle, spacing=step)
        for areas in (pieces.areas, ground.room.of_layers(pieces.layer), ground.air.of_layers(pieces.layer))
    )
    keys = _Keys.of(lines, room, air)
    own, rooms, gaps = (
        keys.of_lines(one, layer)
        for one, layer in (
            (lines, pieces.layer[lines.layer]),
            (room, room.layer),
            (air, air.layer),
        )
    )
    bounds = _around(own, rooms)
    low = _reached(own[:, 0], own[:, 1], bounds[:, 0], gaps, ground.grip)
    high = -_reached(-own[:, 1], -own[:, 0], -bounds[:, 1], -gaps[::-1, ::-1], ground.grip)
    spans = np.append(0.0, np.cumsum((gaps[:, 1] - gaps[:, 0]) ** 3))
    first = np.searchsorted(gaps[:, 1], low + _NEAR)
    last = np.searchsorted(gaps[:, 0], high - _NEAR)
    u = lines.u + np.stack([low - own[:, 0], high - own[:, 1]], axis=1)
    return _Rows(lines, u, spans[np.maximum(last, first)] - spans[first])


@dataclass(frozen=True, slots=True)
class _Keys:
    """Places along the rows of all layers one behind the other, so that they can be searched at once."""

    row: int
    rows: int
    low: float
    pitch: float

    @classmethod
    def of(cls, *parts: Lines) -> _Keys:
        """For places in all these lines."""
        row = np.concatenate([part.row for part in parts])
        u = np.concatenate([part.u for part in parts]).ravel()
        if not len(u):
            return cls(0, 1, 0.0, 1.0)
        low = float(u.min())
        return cls(int(row.min()), int(row.max() - row.min()) + 1, low, float(u.max()) - low + 1.0)

    def of_lines(self, lines: Lines, layer: Int) -> Float:
        """(S, 2) where the lines begin and end, on `layer` (S,)."""
        group = layer * self.rows + (lines.row - self.row)
        return group[:, None] * self.pitch + (lines.u - self.low)


def _around(own: Float, rooms: Float) -> Float:
    """(S, 2) from where to where the room reaches around each row; at least as far as the row."""
    if not len(rooms):
        return own
    found = np.maximum(np.searchsorted(rooms[:, 0], own.mean(axis=1), side="right") - 1, 0)
    around = rooms[found]
    within: Bool = (around[:, 0] <= own.mean(axis=1)) & (around[:, 1] >= own.mean(axis=1))
    wider = np.stack([np.minimum(around[:, 0], own[:, 0]), np.maximum(around[:, 1], own[:, 1])], axis=1)
    return np.where(within[:, None], wider, own)


def _reached(begin: Float, end: Float, limit: Float, gaps: Float, grip: float) -> Float:
    """(S,) where rows begin that rest on something, at `limit` at the farthest.

    Args:
        begin: (S,) of the rows now.
        end: (S,) of the rows.
        limit: (S,) how far the room goes.
        gaps: (G, 2) ascending, the air along all rows.
        grip: mm to lie on what carries.
    """
    if not len(gaps):
        return begin
    # The first gap that ends after the row begins: in front of it lies what the row can rest on.
    gap = np.searchsorted(gaps[:, 1], begin + _NEAR)
    exists = gap < len(gaps)
    shore = np.where(exists, gaps[np.minimum(gap, len(gaps) - 1), 0], np.inf)
    before = np.where(gap > 0, gaps[np.maximum(gap - 1, 0), 1], -np.inf)
    farthest = np.maximum(limit, before)
    return np.where(shore < end, np.minimum(begin, np.maximum(shore - grip, farthest)), begin)
