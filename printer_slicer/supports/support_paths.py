"""The paths of supports: lines and loops of their bases, closed layers, branches and joists.

Lines of a base lie over each other in all layers, because each column has the same rows in all of them. The first layer
has more rows between them. Interfaces run across these lines.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import (
    Areas,
    Lines,
    chain_rows,
    close_gaps,
    crosses_rings,
    difference,
    hatch,
    hatch_evenly,
    intersection,
    normalize,
    offset,
    offset_open,
    split_connected,
    stroke_lines,
    union,
)
from printer_slicer.model import LayerPlan, Supports, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.supports.base_rows import hatch_bases
from printer_slicer.supports.branches import find_second_loops
from printer_slicer.supports.slim_columns import find_slim_columns
from printer_slicer.values import Struct

__all__ = ["compute_line_widths", "make_support_paths"]

_ACROSS: Final = np.pi / 2  # radians, direction of interfaces across the lines of a base, which run along x
_MAX_TURN: Final = 1.6  # row spacings of a line from row to row
_MIN_LENGTH: Final = 0.8  # widths; shorter lines are dropped
_MIN_CLOSED_LENGTH: Final = 1.5  # widths; in corners of closed layers, which may have nothing below
_MIN_ROOM: Final = 1.5  # mm between the loops of a slim column, below which it has no lines
_MAX_END: Final = 0.75  # mm by which lines of interfaces may reach beyond the lines below
_ALONG: Final = 20.0  # by which areas are stretched along rows, so that gaps are closed across rows only
_FLOOR_GAPS: Final = 2.0  # gaps of interfaces between the lines of floors
_MAX_ROW_GAP: Final = 1.25  # row spacings between two rows
_OVERLAP: Final = 0.1  # of the width, by which lines overlap the loops around them


class _Widths(Struct, frozen=True, eq=False):
    """Sizes of extrusions, one for each support layer (S,), mm.

    Attributes:
        line: width.
        spacing: distance between the centre lines of neighbours.
    """

    line: Float
    spacing: Float


def compute_line_widths(layers: LayerPlan, profile: Profile) -> Float:
    """Return the width (L,) of the lines of supports in each layer, mm; it is at least the height of the layer."""
    usual = bead.layer_widths(layers.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    return np.maximum(usual, layers.height)


def make_support_paths(supports: Supports, profile: Profile) -> Toolpaths:
    """Return the paths of supports, on the layers of their plan.

    Args:
        supports: the areas.
        profile: spacings and loops of supports, and extrusion widths.
    """
    layers = supports.plan.layers
    line = compute_line_widths(layers, profile)
    widths = _Widths(line, bead.spacing(line, layers.height))
    slim = find_slim_columns(supports, profile.quality.support_spacing, widths.line)
    return Toolpaths.joined(
        layers,
        [
            *_make_base(supports, slim, widths, profile),
            *_make_branches(supports, widths),
            _make_joists(supports, widths),
            _make_closed_layers(*_trim_interface(supports, slim, widths, profile), widths, layers, profile),
            _make_floors(supports.floor, widths, layers, profile),
        ],
    )


def _make_base(supports: Supports, slim: Areas, widths: _Widths, profile: Profile) -> list[Toolpaths]:
    """Return the loops and the lines of the base, without branches.

    The first layer has one loop at least. Above it there are loops around slim columns, which lines alone would not
    hold upright, and as many around all columns as the settings say.
    """
    quality, layers = profile.quality, supports.plan.layers
    area = difference(supports.base, supports.hollow) if supports.hollow.n_rings else supports.base
    is_first = np.arange(layers.n_layers) == 0
    paths, inner, filled = [], offset(area, -widths.line / 2), area
    for number in range(max(quality.support_walls, 1)):
        everywhere = is_first | (number < quality.support_walls)
        loops = offset(filled, -widths.line / 2).of_layers(everywhere)
        paths.append(_make_loops(layers, loops, widths))
        filled = offset(filled, np.where(everywhere, -widths.spacing, 0.0))
        inner = offset(filled, np.where(everywhere, -(0.5 - _OVERLAP), -0.5) * widths.line)
    if not quality.support_walls:
        above = difference(slim, supports.interface.merge(supports.floor))
        paths.append(_make_loops(layers, offset(above, -widths.line / 2), widths))
        band = difference(above, offset(above, -widths.spacing))
        inner = difference(inner, offset(band, (0.5 - _OVERLAP) * widths.line))
        # Between two loops that are near each other, there is no room for lines.
        inside = offset_open(intersection(inner, above), _MIN_ROOM / 2)
        inner = difference(inner, above).merge(inside)
    lines, pieces, spacing = hatch_bases(supports, inner, quality.support_spacing)
    return [*paths, _join_lines(layers, lines, (area, pieces.layer), widths, (spacing, Role.SUPPORT))]


def _trim_interface(
    supports: Supports, slim: Areas, widths: _Widths, profile: Profile
) -> tuple[Areas, Float]:
    """Return the interface without what reaches too far beyond the rows of columns, and the angle of its rings (R,).

    Roofs of trees end at their joists.
    """
    interface, spacing = supports.interface, profile.quality.support_spacing
    if supports.hollow.n_rings or not interface.n_rings:
        return interface, supports.interface_angle
    columns = normalize(supports.base.merge(interface).merge(supports.floor)).of_layers(interface.used)
    lines, pieces, _ = hatch_bases(supports, columns, spacing)
    layer = pieces.layer[lines.layer]
    start, n = 2 * np.arange(lines.n_lines + 1), interface.n_layers
    # Strokes have round ends, and rows end half a width inside the columns.
    inward = np.minimum(widths.line[layer] + _MAX_END, lines.length() / 2)[:, None] * [1.0, 0.0]
    ends = lines.ends + np.stack([inward, -inward], axis=1)
    near = stroke_lines(ends.reshape(-1, 2), start, layer, widths.line[layer] / 2 + _MAX_END, n)
    between = max(_MAX_ROW_GAP * spacing / 2 - _MAX_END, 0.0)
    near = _close_across(near, between)  # what lies between two rows is carried by both
    trimmed = intersection(interface, union(near, slim.of_layers(interface.used)))
    return trimmed, np.full(trimmed.n_rings, np.nan)


def _close_across(areas: Areas, distance: float) -> Areas:
    """Return areas along x with the gaps closed that are narrower along y than twice a distance, mm."""
    wide = _stretch(areas, _ALONG)
    return _stretch(close_gaps(wide, distance), 1 / _ALONG)


def _stretch(areas: Areas, factor: float) -> Areas:
    """Return areas that are longer along x by a factor."""
    return Areas(areas.xy * [factor, 1.0], areas.ring_start, areas.ring_layer, areas.n_layers)


def _make_loops(layers: LayerPlan, loops: Areas, widths: _Widths) -> Toolpaths:
    """Return the rings of areas as paths."""
    return Toolpaths.gathered(
        layers,
        xy=loops.xy,
        size=np.diff(loops.ring_start),
        layer=loops.ring_layer,
        role=np.full(loops.n_rings, Role.SUPPORT),
        width=widths.line[loops.ring_layer],
        closed=True,
    )


def _join_lines(
    layers: LayerPlan, lines: Lines, within: tuple[Areas, Int], widths: _Widths, rows: tuple[Float, Role]
) -> Toolpaths:
    """Return lines as zigzags of one role, which never leave the areas they fill.

    Args:
        layers: of supports.
        lines: their layer is an entry.
        within: the areas by layer, and the layer (E,) of each entry.
        widths: by layer.
        rows: distance between the rows of each entry (E,), mm, and the role.
    """
    (area, layer_of), (spacing, role) = within, rows
    shortest = _MIN_CLOSED_LENGTH if role == Role.SUPPORT_INTERFACE else _MIN_LENGTH
    kept = lines.take(np.flatnonzero(lines.length() >= shortest * widths.line[layer_of[lines.layer]]))
    xy, start, entry = chain_rows(kept, max_turn=_MAX_TURN * spacing)
    # Zigzags are cut where the step from row to row leaves the area, as beside a thin wall between two rows.
    step = np.setdiff1d(np.arange(1, len(xy) - 1, 2), start[1:] - 1)
    at = layer_of[entry[np.searchsorted(start, step, side="right") - 1]]
    cut = step[crosses_rings(area, xy[step], xy[step + 1], at)] + 1
    starts = np.union1d(start, cut)
    layer = layer_of[entry[np.searchsorted(start, starts[:-1], side="right") - 1]]
    return Toolpaths.gathered(
        layers,
        xy=xy,
        size=np.diff(starts),
        layer=layer,
        role=np.full(len(layer), role),
        width=widths.line[layer],
        closed=False,
    )


def _make_closed_layers(
    area: Areas, ring_angle: Float, widths: _Widths, layers: LayerPlan, profile: Profile
) -> Toolpaths:
    """Return the lines of closed layers; they run in the direction of each ring, or across those of the base."""
    spacing = widths.line + profile.quality.support_interface_spacing
    angles = np.where(np.isnan(ring_angle), _ACROSS, ring_angle)
    turns, every = np.unique(np.round(angles, 9)), np.arange(area.n_layers)
    laid = [Toolpaths.joined(layers, [_make_loops(layers, Areas.empty(area.n_layers), widths)])]
    for turn in turns:
        some = area.select(np.round(angles, 9) == turn)
        lines = hatch(offset(some, -widths.line / 2), angle=turn, spacing=spacing)
        laid.append(_join_lines(layers, lines, (some, every), widths, (spacing, Role.SUPPORT_INTERFACE)))
    return Toolpaths.joined(layers, laid)


def _make_floors(floor: Areas, widths: _Widths, layers: LayerPlan, profile: Profile) -> Toolpaths:
    """Return the lines of the layers on the part, across those of the base; the outermost lie near the edges."""
    pieces = split_connected(floor)
    usual = widths.line[pieces.layer] + _FLOOR_GAPS * profile.quality.support_interface_spacing
    lines, _, spacing, _ = hatch_evenly(pieces.areas, np.full(pieces.count, _ACROSS), usual)
    return _join_lines(layers, lines, (floor, pieces.layer), widths, (spacing, Role.SUPPORT_INTERFACE))


def _make_branches(supports: Supports, widths: _Widths) -> list[Toolpaths]:
    """Return the loops of branches: one, and a second one in thick branches."""
    hollow, layers = supports.hollow, supports.plan.layers
    if not hollow.n_rings:
        return []
    second = find_second_loops(hollow, widths.line / 2 + widths.spacing, float(widths.line[-1]))
    return [
        _make_loops(layers, offset(hollow, -widths.line / 2), widths),
        _make_loops(layers, second, widths),
    ]


def _make_joists(supports: Supports, widths: _Widths) -> Toolpaths:
    """Return joists as single lines along their pieces, or several where pieces are wider."""
    pieces, layers = split_connected(supports.joists), supports.plan.layers
    width = widths.line[pieces.layer]
    angle, low, high = _measure_across(pieces.areas)
    rows = np.maximum(np.rint((high - low) / width), 1)
    spacing = np.maximum(high - low, 1e-3) / rows
    lines = hatch(pieces.areas, angle=angle, spacing=spacing, phase=low / spacing + 0.5)
    lines = lines.take(np.flatnonzero(lines.length() >= (1 + _MIN_LENGTH) * width[lines.layer]))
    cut = np.minimum(width[lines.layer] / 2 / np.maximum(lines.length(), 1e-9), 0.4)[:, None]
    begin, end = lines.ends[:, 0], lines.ends[:, 1]
    ends = np.stack([begin + cut * (end - begin), end - cut * (end - begin)], axis=1)
    return Toolpaths.gathered(
        layers,
        xy=ends.reshape(-1, 2),
        size=np.full(lines.n_lines, 2),
        layer=pieces.layer[lines.layer],
        role=np.full(lines.n_lines, Role.SUPPORT),
        width=width[lines.layer],
        closed=False,
    )


def _measure_across(pieces: Areas) -> tuple[Float, Float, Float]:
    """Return for each piece the direction of its longest side, and its lowest and highest position across it, mm."""
    n = pieces.n_layers
    if not n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    owner, side = pieces.point_layer, pieces.xy[pieces.following] - pieces.xy
    length = np.hypot(*side.T)
    longest = np.lexsort((length, owner))[np.cumsum(np.bincount(owner, minlength=n)) - 1]
    angle = np.arctan2(side[longest, 1], side[longest, 0])
    across = pieces.xy[:, 1] * np.cos(angle[owner]) - pieces.xy[:, 0] * np.sin(angle[owner])
    first = np.searchsorted(owner, np.arange(n))
    return angle, np.minimum.reduceat(across, first), np.maximum.reduceat(across, first)
