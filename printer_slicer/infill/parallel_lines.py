"""Fill solid areas with parallel lines, and the wedges between lines and border with variable extrusion width."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    Lines,
    difference,
    hatch_evenly,
    offset_open,
    split_connected,
    unite_row_rectangles,
)
from printer_slicer.infill.bridge_anchors import join_bridge_lines, measure_extensions
from printer_slicer.infill.connections import MAX_CONNECTION, Zigzags, join_rows
from printer_slicer.infill.variable_width import fill_gaps
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role, roles_with
from printer_slicer.values import Struct

__all__ = ["RowSettings", "fill_with_rows"]

_CONNECTION_RATIO = 1 / 3  # width of connections as a share of the row width; at least as wide as high
_HALF_SLIT = 0.06  # mm, half the width of gaps that close when extrusions are pressed flat
_MIN_GAP_AREA = 0.08  # mm²; smaller gaps are not worth a stop
_MAX_BEADS_BETWEEN = 3  # most extrusions side by side in gaps between rows
_MAX_FLOW, _MIN_FLOW = 1.15, 0.85  # limits of the flow factor that gives a piece its nominal volume


class RowSettings(Struct, frozen=True, eq=False):
    """Settings of the rows in each of P pieces.

    Attributes:
        role: (P,) role of the extrusions.
        angle: (P,) radians.
        gap: (P,) mm, usual distance between centre lines.
        width: (P,) mm, extrusion width if it is fixed; 0 where it is fitted to the piece.
        height: (P,) mm.
    """

    role: Int
    angle: Float
    gap: Float
    width: Float
    height: Float


def fill_with_rows(
    plan: LayerPlan, pieces: ConnectedAreas, beads: RowSettings, profile: Profile, inside: Areas | None = None
) -> list[Toolpaths]:
    """Fill pieces with parallel lines, at a spacing at which a whole number of lines fits.

    Bridge lines start and end in the walls around `inside`, if given.
    """
    overlap = _end_overlap(plan, pieces, beads, profile)
    rows, area, gap, grid = hatch_evenly(pieces.areas, beads.angle, beads.gap)
    shortest = np.minimum(gap, profile.extrusion_width) / 2
    if beads.width.any():  # bridge lines have a constant width
        if inside is None:
            threads = Zigzags.with_uniform_width(rows, area, beads.angle, gap, overlap)
        else:
            way = measure_extensions(rows, grid, pieces, inside, gap / 2)
            threads = join_bridge_lines(rows, way, gap, beads.angle)
        threads = _drop_short_lines(threads, shortest)
        laid = [_make_toolpaths(plan, pieces, beads, threads, beads.width[threads.entry])]
        if (beads.role == Role.BRIDGE).any():  # extrusions beside the rows are supported by the perimeters
            laid.append(
                _fill_between_rows(
                    plan, pieces, _rows_area(rows, area, beads.angle, gap), beads.role, profile
                )[0]
            )
        return laid
    turn = _connection_spacing(gap, beads.height, profile)
    lines = _drop_short_lines(join_rows(rows, area, beads.angle, gap, turn, overlap=overlap), shortest)
    between: list[Toolpaths] = []
    filled = np.zeros(pieces.count)
    if (
        beads.role != Role.INTERNAL_BRIDGE
    ).any():  # its rows are supported; extrusions between them would not be
        amid, filled = _fill_between_rows(
            plan, pieces, _rows_area(rows, area, beads.angle, gap), beads.role, profile
        )
        between = [amid]
    long, turns = (np.bincount(lines.entry, part, minlength=pieces.count) for part in lines.length().T)
    gap = gap * _flow_factors(pieces.areas, long * gap, filled + turns * turn)
    piece = np.repeat(lines.entry, np.diff(lines.start))
    fits = bead.width_for_spacing(np.where(lines.thin, turn[piece], gap[piece]), beads.height[piece])
    width = np.maximum(fits, beads.height[piece]).round(4)  # as written to the file
    return [_make_toolpaths(plan, pieces, beads, lines, width), *between]


def _connection_spacing(gap: Float, height: Float, profile: Profile) -> Float:
    """Return the spacing (P,) of connections between rows that are `gap` (P,) mm apart; see `join_rows`."""
    if not profile.quality.perimeters:  # round ends would be visible
        return gap
    return np.minimum(np.maximum(_CONNECTION_RATIO * gap, bead.spacing(height, height)), gap)


def _end_overlap(plan: LayerPlan, pieces: ConnectedAreas, beads: RowSettings, profile: Profile) -> Float:
    """Return the overlap (P,) of row ends with the perimeter, mm: a share of the mean of the two spacings."""
    if not profile.quality.perimeters:
        return np.zeros(pieces.count)
    wide = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    perimeter = bead.spacing(wide, plan.height)[pieces.layer]
    share = np.where(beads.role == Role.IRONING, 0.0, profile.quality.infill_overlap)
    return np.asarray(share * (perimeter + beads.gap) / 2)


def _drop_short_lines(lines: Zigzags, shortest: Float) -> Zigzags:
    """Drop lines shorter than `shortest` (P,) mm, because the nozzle would stop for each."""
    return lines.take(np.flatnonzero(lines.length().sum(axis=1) >= shortest[lines.entry]))


def _make_toolpaths(
    plan: LayerPlan, pieces: ConnectedAreas, beads: RowSettings, lines: Zigzags, width: Float
) -> Toolpaths:
    """Return the zigzags as paths, with a width for each path or point."""
    piece = lines.entry
    return Toolpaths.gathered(
        plan,
        xy=lines.xy,
        size=np.diff(lines.start),
        layer=pieces.layer[piece],
        role=beads.role[piece],
        width=width,
        height=beads.height[piece],
        closed=False,
        # Rows are printed in order: each one beside the previous one, never between two others.
        chain_id=np.where(roles_with(is_top=True)[beads.role[piece]], piece, -1),
    )


def _flow_factors(areas: Areas, laid_area: Float, filled_area: Float) -> Float:
    """Return the flow factor (P,) that gives each piece its nominal volume."""
    wanted = areas.area() - filled_area
    share = np.divide(wanted, laid_area, out=np.ones_like(laid_area), where=laid_area > 0)
    return np.asarray(np.clip(share, _MIN_FLOW, _MAX_FLOW), dtype=np.float64)


def _fill_between_rows(
    plan: LayerPlan, pieces: ConnectedAreas, rows_area: Areas, role: Int, profile: Profile
) -> tuple[Toolpaths, Float]:
    """Fill gaps between rows; return the paths and the area (P,) mm² that they fill in each piece."""
    left = split_connected(offset_open(difference(pieces.areas, rows_area), _HALF_SLIT))
    left = left.take(np.flatnonzero(left.areas.area() > _MIN_GAP_AREA))
    gaps = ConnectedAreas(left.areas, pieces.layer[left.layer], left.of_ring)
    paths, _, filled = fill_gaps(plan, gaps, role[left.layer], profile, beads=_MAX_BEADS_BETWEEN)
    return paths, np.bincount(left.layer, filled, minlength=pieces.count).astype(np.float64)


def _rows_area(rows: Lines, area: Areas, angle: Float, gap: Float) -> Areas:
    """Return the area (P entries) that rows fill: rectangles, extended to the space that connections fill.

    Rows are not extended where the border meets them at a small angle, because there are no connections there.
    """
    turn, half = angle[rows.layer], gap[rows.layer] / 2
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    side = area.xy[area.following[rows.edge]] - area.xy[rows.edge]  # (S, 2, 2)
    side /= np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-12)[..., None]
    cos = np.abs((side * along[:, None]).sum(axis=2))
    sin = np.sqrt(np.maximum(1 - cos**2, 0.0))
    steep = sin * MAX_CONNECTION >= 1
    beyond = np.where(steep, half[:, None] * (1 + cos) / np.maximum(sin, 1e-9), 0.0)
    return unite_row_rectangles(
        rows, rows.u + beyond * np.array([-1, 1]), angle=angle, half=gap / 2, n_layers=area.n_layers
    )
