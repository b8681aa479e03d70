"""Roofs of trees: closed layers under wide overhangs, which lie on single lines, the joists, between the tips."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.geometry import (
    Areas,
    difference,
    find_enclosing_rings,
    hatch,
    intersection,
    normalize,
    offset_open,
    split_connected,
    stroke_lines,
    union,
)
from printer_slicer.geometry.vectors import norm
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct

__all__ = [
    "Joists",
    "Roofs",
    "build_roofs",
    "find_shortest_lines",
    "find_wide_contacts",
    "keep_carried_roofs",
    "place_joists",
]

_MIN_ROOF_WIDTH = 2.0  # mm
_DIRECTIONS = np.deg2rad(np.arange(0, 180, 5))
_MIN_WIDTH = 0.4  # extrusion widths; narrower rests of roofs are left out
_MIN_CARRIED = 0.15  # of a piece of roof
_LAPPING = 0.1  # mm by which the roof reaches beyond the middle between two joists


class Joists(Struct, frozen=True, eq=False):
    """Straight lines under roofs.

    Attributes:
        ends: (J, 2, 2) mm, both ends of each centre line.
        roof_layer: (J,) support layer of the contact; the joist lies below the closed layers of the roof.
        angle: (J,) direction, radians.
        spacing: (J,) distance to the next joist under the same piece of roof, mm.
        share: (T,) positions of tips, from 0 at the first end to 1.
        of_tip: (T,) joist of each tip, ascending.
    """

    ends: Float
    roof_layer: Int
    angle: Float
    spacing: Float
    share: Float
    of_tip: Int

    @property
    def tip_places(self) -> Float:
        """Positions (T, 2) of tips, mm."""
        begin, end = self.ends[self.of_tip, 0], self.ends[self.of_tip, 1]
        return np.asarray(begin + self.share[:, None] * (end - begin))


class Roofs(Struct, frozen=True, eq=False):
    """Roofs and joists as areas by support layer.

    Attributes:
        contact: where roofs or joists touch the overhang.
        roof: closed layers.
        joist: lines below.
        joists: the same lines.
        n_closed: number of closed layers under each contact.
    """

    contact: Areas
    roof: Areas
    joist: Areas
    joists: Joists
    n_closed: int

    def find_line_angles(self) -> Float:
        """Return for each ring of the roof the direction across the joist below it, radians; nan without one."""
        return _find_angles_across(self.joists, self.roof, self.n_closed)


def find_shortest_lines(closed: Areas) -> Float:
    """Return for each ring of closed branches the direction across its piece, radians.

    In the second layer it is nan, because there the lines must cross those of the feet.
    """
    pieces = split_connected(closed)
    angle = (_choose_directions(pieces.areas)[0] + np.pi / 2) % np.pi
    return np.where(closed.ring_layer > 1, angle[pieces.of_ring], np.nan)


def find_wide_contacts(contacts: Areas, carrier: Int, n_layers: int) -> Areas:
    """Return the roofs by support layer: all contacts that are at least 2 mm wide.

    Args:
        contacts: areas under overhangs by layer of the part.
        carrier: (L,) support layer of the contacts of each layer.
        n_layers: number of support layers.
    """
    wide = offset_open(contacts, _MIN_ROOF_WIDTH / 2)
    layer = carrier[wide.ring_layer]
    order = np.argsort(layer, kind="stable")
    return normalize(wide.restacked(order, layer[order], n_layers))


def place_joists(roofs: Areas, settings: TreeSettings) -> Joists:
    """Place joists along the longer side of each piece of roof, and tips under them.

    The outermost joists lie at the edges of the piece. Each has a tip at both ends and more between them, so that no
    two are farther apart than `tip_distance`.
    """
    pieces = split_connected(roofs)
    angle, low, extent = _choose_directions(pieces.areas)
    half = settings.width / 2
    inner = np.maximum(extent - settings.width, 1e-3)
    spacing = inner / np.maximum(np.ceil(inner / settings.joist - 1e-6), 1)
    # The first and the last row lie just inside the edges of the piece that was made narrower.
    lines = hatch(pieces.areas, angle=angle, spacing=spacing, phase=(low + half) / spacing - 1e-6)
    ends = _shorten_lines(lines.ends, half)
    share, of_tip = _space_tips(norm(ends[:, 1] - ends[:, 0]), settings)
    layer, piece = pieces.layer[lines.layer], lines.layer
    return Joists(ends, layer, angle[piece], spacing[piece], share, of_tip)


def _choose_directions(pieces: Areas) -> tuple[Float, Float, Float]:
    """Return for each piece the direction in which it is narrowest across, and its lowest position and width across."""
    owner, n = pieces.point_layer, pieces.n_layers
    if not n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    across = np.outer(pieces.xy[:, 1], np.cos(_DIRECTIONS)) - np.outer(pieces.xy[:, 0], np.sin(_DIRECTIONS))
    first = np.flatnonzero(run_starts(owner))
    low, high = np.minimum.reduceat(across, first), np.maximum.reduceat(across, first)
    best = np.argmin(np.round(high - low, 3), axis=1)
    own = np.arange(n), best
    return _DIRECTIONS[best], low[own], (high - low)[own]


def _shorten_lines(ends: Float, by: float) -> Float:
    """Return the lines (n, 2, 2) without `by` mm at both ends; at least a short line in the middle remains."""
    way = ends[:, 1] - ends[:, 0]
    length = norm(way)
    cut = np.minimum(by / np.maximum(length, 1e-9), 0.45)[:, None] * way
    return np.stack([ends[:, 0] + cut, ends[:, 1] - cut], axis=1)


def _space_tips(length: Float, settings: TreeSettings) -> tuple[Float, Int]:
    """Return the positions (T,) of tips along joists of these lengths (J,), from 0 to 1, and the joist (T,) of each."""
    inset = settings.tip_radius - settings.width / 2
    span = length - 2 * inset
    single = span < 2 * settings.tip_radius
    count = np.where(single, 1, np.ceil(span / settings.tip_distance - 1e-6).astype(np.int64) + 1)
    of_tip, step = np.repeat(np.arange(len(length)), count), consecutive(np.zeros_like(count), count)
    along = inset + span[of_tip] * step / np.maximum(count[of_tip] - 1, 1)
    share = np.where(single[of_tip], 0.5, along / np.maximum(length[of_tip], 1e-9))
    return share, of_tip


def keep_carried_roofs(joists: Joists, carried: Bool, settings: TreeSettings) -> Joists:
    """Shorten joists to the stretches between tips that branches carry; drop those without such a tip.

    A stretch is kept between two neighbouring tips if both are carried; around a single tip only a short line remains.
    """
    n = len(joists.of_tip)
    same = np.append(joists.of_tip[1:] == joists.of_tip[:-1], False)[:n]
    linked = same & carried & np.append(carried[1:], False)[:n]
    begins = carried & ~np.append(False, linked[:-1])[:n]
    ends = carried & ~linked
    first, last = np.flatnonzero(begins), np.flatnonzero(ends)
    owner = joists.of_tip[first]
    length = np.maximum(norm(joists.ends[owner, 1] - joists.ends[owner, 0]), 1e-9)
    beyond = settings.tip_radius / length
    low = np.maximum(joists.share[first] - beyond, 0.0)[:, None]
    high = np.minimum(joists.share[last] + beyond, 1.0)[:, None]
    # Where the outermost tip of a joist is carried, the joist keeps its end.
    at, way = joists.ends[owner, 0], joists.ends[owner, 1] - joists.ends[owner, 0]
    stretch = np.cumsum(begins) - 1
    kept = np.flatnonzero(carried)
    return Joists(
        np.stack([at + low * way, at + high * way], axis=1),
        joists.roof_layer[owner],
        joists.angle[owner],
        joists.spacing[owner],
        joists.share[kept],
        stretch[kept],
    )


def build_roofs(contacts: Areas, joists: Joists, blocked: Areas, settings: TreeSettings) -> Roofs:
    """Return the areas of joists, and the roofs as far as joists carry them.

    Roofs in the lowest layers lie on the bed and need no joists. Lines of a roof run across the joists, so a roof ends
    where its joists end, and beside them half way to the next joist.
    """
    n, n_closed = contacts.n_layers, settings.interface_layers
    order = np.argsort(joists.roof_layer, kind="stable")
    ends, layer = joists.ends[order], joists.roof_layer[order]
    reach = np.maximum(joists.spacing[order] / 2 + _LAPPING, settings.width)
    near = normalize(_draw_rectangles(ends, settings.width / 2 + _LAPPING, reach, layer, n))
    on_bed = contacts.of_layers(np.arange(min(n_closed, n)))
    carried = intersection(contacts, near).of_layers(np.arange(n_closed, n)).merge(on_bed)
    roof = offset_open(_stack_roofs(carried, blocked, n_closed), _MIN_WIDTH * settings.width)
    above_bed = layer >= n_closed
    ends, layer = ends[above_bed], layer[above_bed]
    half = np.full(len(layer), settings.width / 2)
    joist = stroke_lines(ends.reshape(-1, 2), 2 * np.arange(len(layer) + 1), layer - n_closed, half, n)
    joist = difference(difference(joist, blocked), roof)
    roof = _drop_unsupported_roofs(roof, joist, n_closed)
    return Roofs(intersection(carried, roof) if n_closed else carried, roof, joist, joists, n_closed)


def _drop_unsupported_roofs(roof: Areas, joist: Areas, n_closed: int) -> Areas:
    """Return the roofs without pieces that have next to nothing below, because the part is where their joists were."""
    for _ in range(n_closed):
        pieces = split_connected(roof)
        below = roof.merge(joist).shift_layers(1)
        carried = intersection(pieces.areas, pieces.select_nearby_rings(below)).area()
        stands = (carried >= _MIN_CARRIED * pieces.areas.area()) | (pieces.layer == 0)
        if stands.all():
            break
        roof = pieces.on_layers(roof.n_layers, np.flatnonzero(stands))
    return roof


def _stack_roofs(contacts: Areas, blocked: Areas, n_closed: int) -> Areas:
    """Return the closed layers under contacts, as many as there is room for above the bed."""
    if not n_closed:
        return Areas.empty(contacts.n_layers)
    roof = contacts
    for below in range(1, n_closed):
        roof = union(roof, contacts.shift_layers(-below))
    return difference(roof, blocked) if n_closed > 1 else roof


def _draw_rectangles(ends: Float, along: float, across: Float, layer: Int, n_layers: int) -> Areas:
    """Return rectangles around lines (n, 2, 2) on layers (n,), ascending, `along` longer at both ends.

    `across` (n,) is half their width, mm.
    """
    way = ends[:, 1] - ends[:, 0]
    way = way / np.maximum(norm(way), 1e-9)[:, None]
    side = across[:, None] * np.column_stack([-way[:, 1], way[:, 0]])
    begin, end = ends[:, 0] - along * way, ends[:, 1] + along * way
    corners = np.stack([begin - side, end - side, end + side, begin + side], axis=1)
    return Areas(corners.reshape(-1, 2), 4 * np.arange(len(ends) + 1), layer, n_layers)


def _find_angles_across(joists: Joists, roof: Areas, n_closed: int) -> Float:
    """Return for each ring (R,) the direction across the longest joist in it, or the nearest one, radians; else nan.

    Joists count for the `n_closed` layers above them.
    """
    result = np.full(roof.n_rings, np.nan)
    below = np.repeat(np.arange(n_closed), len(joists.angle))
    joist = np.tile(np.arange(len(joists.angle)), n_closed)
    joist_layer = joists.roof_layer[joist] - below
    middle, length = joists.ends.mean(axis=1), norm(joists.ends[:, 1] - joists.ends[:, 0])
    order = np.lexsort((length[joist], joist_layer))
    joist, joist_layer = joist[order], joist_layer[order]
    joist, joist_layer = joist[joist_layer >= 0], joist_layer[joist_layer >= 0]
    inside = find_enclosing_rings(roof, middle[joist], joist_layer)
    for ring, layer in enumerate(roof.ring_layer.tolist()):
        own = joist[slice(*np.searchsorted(joist_layer, [layer, layer + 1]).tolist())]
        if len(own):
            away = norm(middle[own] - roof.ring(ring).mean(axis=0))
            result[ring] = joists.angle[own[np.argmin(away)]]
    result[inside[inside >= 0]] = joists.angle[joist[inside >= 0]]  # the longest comes last
    return np.asarray((result + np.pi / 2) % np.pi)
