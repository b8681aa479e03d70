"""Extend internal bridges until both ends of every line are supported.

Supports are lines of the internal infill below, solid areas below, and perimeters. Solid infill over internal infill
ends where a top surface or a slope ends, anywhere over the cells of the pattern. Each of its lines is extended to the
next support, and the lines take the direction in which they sag least.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.bridges import find_internal_bridges
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    Lines,
    Polylines,
    close_gaps,
    difference,
    hatch,
    intersection,
    offset_open,
    split_connected,
    stroke_lines,
    union,
    unite_row_rectangles,
)
from printer_slicer.model import Regions
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = ["layers_below_bridges", "support_internal_bridges"]

_N_DIRECTIONS = 12
_CLEARLY_BETTER = 0.95  # share of the best sag so far that another direction must be below
_ROUNDING = 1e-3  # mm; engines round to 0.01 µm


class _BridgeAreas(Struct, frozen=True, eq=False):
    """Areas in which internal bridges may lie, and their unsupported part.

    Attributes:
        allowed: inside the perimeters and not at a surface.
        unsupported: the part of `allowed` with nothing directly below.
        overlap: least overlap of a row with its support, if the support is that wide, mm.
    """

    allowed: Areas
    unsupported: Areas
    overlap: float


class _ExtendedRows(Struct, frozen=True, eq=False):
    """Rows across pieces, extended to their supports.

    Attributes:
        lines: rows across the pieces.
        u: (S, 2) mm, begin and end of each extended row.
        sag: (S,) mm³, sum of the cubed spans; a span sags by its square, over its length.
    """

    lines: Lines
    u: Float
    sag: Float


def layers_below_bridges(regions: Regions) -> Int:
    """Return the layers whose internal infill supports an internal bridge."""
    return np.flatnonzero(regions.internal_bridge.used) - 1


def support_internal_bridges(regions: Regions, lines: Polylines, profile: Profile) -> Regions:
    """Return the regions with internal bridges extended to their supports, and with their directions.

    Bridges grow into solid infill and internal infill, never into exposed areas. Connections along the borders of
    internal infill move with the border, so they do not count as supports.

    Args:
        regions: the area inside the perimeters.
        lines: of the internal infill, at least on the layers of `layers_below_bridges`.
        profile: extrusion width and bridge anchors.
    """
    bridge, width = regions.internal_bridge, profile.extrusion_width
    used, second = _split_stacked_layers(bridge)
    regions = _extend_bridges(regions, bridge.of_layers(used & ~second), lines, profile, used & ~second)
    # The bridges of the layer below have grown, so fewer areas lie over internal infill now.
    below = regions.internal_infill.shift_layers(1).of_layers(second)
    own = find_internal_bridges(bridge.of_layers(second), below, width, profile.quality.bridge_anchor)
    return _extend_bridges(regions, own, lines, profile, second)


def _split_stacked_layers(bridge: Areas) -> tuple[Bool, Bool]:
    """Return which layers (L,) have bridges, and every second one in runs of such layers."""
    own, used = np.arange(bridge.n_layers), bridge.used
    since = own - np.maximum.accumulate(np.where(used, -1, own))
    return used, used & (since % 2 == 0)


def _extend_bridges(
    regions: Regions, bridges: Areas, lines: Polylines, profile: Profile, is_affected: Bool
) -> Regions:
    """Extend `bridges` on the layers `is_affected` (L,), where all other internal bridges become solid infill."""
    if not is_affected.any():
        return regions
    width, wanted = profile.extrusion_width, regions.internal_bridge.of_layers(is_affected)
    pieces, bridge_areas = (
        split_connected(bridges),
        _find_bridge_areas(regions, lines, width, profile.quality.bridge_anchor, is_affected),
    )
    # The usual direction lies between the lines of the usual pattern; other directions are compared to it.
    usual = np.deg2rad(profile.quality.infill_angle_deg + 45)
    done, turn = _extend_pieces(
        pieces, _find_best_angles(pieces, bridge_areas, width, float(usual)), bridge_areas, width
    )
    elsewhere = ~is_affected[regions.internal_bridge.ring_layer]
    layer = np.concatenate([regions.internal_bridge.ring_layer[elsewhere], done.ring_layer])
    turns = np.concatenate([regions.internal_bridge_angle[elsewhere], turn])
    return replace(
        regions,
        internal_bridge=regions.internal_bridge.select(elsewhere).merge(done),
        internal_bridge_angle=turns[np.argsort(layer, kind="stable")],
        solid_infill=difference(union(regions.solid_infill, difference(wanted, bridges)), done),
        internal_infill=difference(regions.internal_infill, done),
    )


def _extend_pieces(
    pieces: ConnectedAreas, angle: Float, bridge_areas: _BridgeAreas, width: float
) -> tuple[Areas, Float]:
    """Return the extended pieces on their layers, without overlaps, and the direction (R,) of each ring."""
    n = bridge_areas.allowed.n_layers
    done, of_ring = Areas.empty(n), np.zeros(0)
    for turn in distinct(angle).tolist():
        chosen = np.flatnonzero(angle == turn)
        own = pieces.on_layers(n, chosen)
        others = done.merge(pieces.on_layers(n, np.flatnonzero(angle != turn)))  # they may overlap
        grown = difference(
            _extend_along_rows(own, pieces.take(chosen), bridge_areas, width, turn), difference(others, own)
        )
        order = np.argsort(np.concatenate([done.ring_layer, grown.ring_layer]), kind="stable")
        of_ring = np.concatenate([of_ring, np.full(grown.n_rings, turn)])[order]
        done = done.merge(grown)
    return done, of_ring


def _find_bridge_areas(
    regions: Regions, lines: Polylines, width: float, overlap: float, selected: Bool
) -> _BridgeAreas:
    """Return the areas for internal bridges on the `selected` layers (L,)."""
    n = regions.plan.n_layers
    closed = (
        regions.bottom_solid_infill.merge(regions.bridge).merge(regions.top_solid_infill).of_layers(selected)
    )
    inside = regions.inside
    if not inside.n_rings:
        inside = union(regions.internal_bridge, union(regions.solid_infill, regions.internal_infill))
    room = difference(inside.of_layers(selected), closed)
    some = lines.take(np.flatnonzero(np.append(selected[1:], False)[lines.layer]))
    pens = stroke_lines(some.xy, some.start, some.layer + 1, np.full(some.n_lines, width / 2), n)
    hollow = intersection(room, regions.internal_infill.shift_layers(1).of_layers(selected))
    # Gaps narrower than half a width are ignored.
    return _BridgeAreas(room, offset_open(difference(hollow, pens), width / 4), overlap)


def _find_best_angles(
    pieces: ConnectedAreas, bridge_areas: _BridgeAreas, width: float, usual: float
) -> Float:
    """Return the direction (P,) in which the lines of each piece sag least."""
    best, record = np.full(pieces.count, usual), np.full(pieces.count, np.inf)
    for turn in (np.arange(_N_DIRECTIONS) * np.pi / _N_DIRECTIONS).tolist():
        rows = _make_extended_rows(pieces, bridge_areas, 2 * width, usual + turn)
        sag = np.bincount(rows.lines.layer, rows.sag, minlength=pieces.count)
        better = sag < (record * _CLEARLY_BETTER - _ROUNDING if turn else record)
        best[better], record[better] = usual + turn, sag[better]
    return best


def _extend_along_rows(
    bridges: Areas, pieces: ConnectedAreas, bridge_areas: _BridgeAreas, width: float, angle: float
) -> Areas:
    """Return the pieces extended to their supports along rows of one direction."""
    step = width / 2
    rows = _make_extended_rows(pieces, bridge_areas, step, angle)
    longer = np.flatnonzero(np.abs(rows.u - rows.lines.u).max(axis=1, initial=0.0) > _ROUNDING)
    if not len(longer):
        return bridges
    # Strips are twice as wide as the row distance, so that lines between rows are as long as their neighbours.
    strips = unite_row_rectangles(
        rows.lines.take(longer), rows.u[longer], angle=angle, half=step, n_layers=pieces.count
    )
    strips = strips.restacked(np.arange(strips.n_rings), pieces.layer[strips.ring_layer], bridges.n_layers)
    # Offsetting and intersecting unite overlapping areas.
    whole = bridges.merge(strips)
    # Close notches between strips that are too narrow for a row.
    smooth = close_gaps(whole, width / 2)
    return intersection(whole.merge(smooth), bridge_areas.allowed)


def _make_extended_rows(
    pieces: ConnectedAreas, bridge_areas: _BridgeAreas, step: float, angle: float
) -> _ExtendedRows:
    """Return rows of one direction across the pieces, extended until both ends are supported."""
    lines, room, air = (
        hatch(areas, angle=angle, spacing=step)
        for areas in (
            pieces.areas,
            bridge_areas.allowed.of_layers(pieces.layer),
            bridge_areas.unsupported.of_layers(pieces.layer),
        )
    )
    keys = _RowKeys.of(lines, room, air)
    own, rooms, gaps = (
        keys.keys_of(one, layer)
        for one, layer in ((lines, pieces.layer[lines.layer]), (room, room.layer), (air, air.layer))
    )
    bounds = _find_allowed_ranges(own, rooms)
    low = _find_supported_begins(own[:, 0], own[:, 1], bounds[:, 0], gaps, bridge_areas.overlap)
    high = -_find_supported_begins(
        -own[:, 1], -own[:, 0], -bounds[:, 1], -gaps[::-1, ::-1], bridge_areas.overlap
    )
    spans = np.append(0.0, np.cumsum((gaps[:, 1] - gaps[:, 0]) ** 3))
    first = np.searchsorted(gaps[:, 1], low + _ROUNDING)
    last = np.searchsorted(gaps[:, 0], high - _ROUNDING)
    u = lines.u + np.stack([low - own[:, 0], high - own[:, 1]], axis=1)
    return _ExtendedRows(lines, u, spans[np.maximum(last, first)] - spans[first])


class _RowKeys(Struct, frozen=True):
    """Sort keys for positions along the rows of all layers, so that all can be searched at once."""

    row: int
    rows: int
    low: float
    pitch: float

    @classmethod
    def of(cls, *parts: Lines) -> _RowKeys:
        """Return the keys for positions on all these lines."""
        row = np.concatenate([part.row for part in parts])
        u = np.concatenate([part.u for part in parts]).ravel()
        if not len(u):
            return cls(0, 1, 0.0, 1.0)
        low = float(u.min())
        return cls(int(row.min()), int(row.max() - row.min()) + 1, low, float(u.max()) - low + 1.0)

    def keys_of(self, lines: Lines, layer: Int) -> Float:
        """Return the keys (S, 2) of both ends of lines on `layer` (S,)."""
        group = layer * self.rows + (lines.row - self.row)
        return group[:, None] * self.pitch + (lines.u - self.low)


def _find_allowed_ranges(rows: Float, ranges: Float) -> Float:
    """Return begin and end (S, 2) of the allowed range along each row, which includes at least the row itself."""
    if not len(ranges):
        return rows
    found = np.maximum(np.searchsorted(ranges[:, 0], rows.mean(axis=1), side="right") - 1, 0)
    around = ranges[found]
    within: Bool = (around[:, 0] <= rows.mean(axis=1)) & (around[:, 1] >= rows.mean(axis=1))
    wider = np.stack([np.minimum(around[:, 0], rows[:, 0]), np.maximum(around[:, 1], rows[:, 1])], axis=1)
    return np.where(within[:, None], wider, rows)


def _find_supported_begins(begin: Float, end: Float, limit: Float, gaps: Float, overlap: float) -> Float:
    """Return the positions (S,), never before `limit`, from which rows must start so that their start is supported.

    Args:
        begin: (S,) present begin of the rows.
        end: (S,) end of the rows.
        limit: (S,) end of the allowed area.
        gaps: (G, 2) ascending, unsupported spans along all rows.
        overlap: mm of overlap with the support.
    """
    if not len(gaps):
        return begin
    # Find the first gap that ends after the row begins; the support lies in front of it.
    gap = np.searchsorted(gaps[:, 1], begin + _ROUNDING)
    exists = gap < len(gaps)
    shore = np.where(exists, gaps[np.minimum(gap, len(gaps) - 1), 0], np.inf)
    before = np.where(gap > 0, gaps[np.maximum(gap - 1, 0), 1], -np.inf)
    farthest = np.maximum(limit, before)
    return np.where(shore < end, np.minimum(begin, np.maximum(shore - overlap, farthest)), begin)
