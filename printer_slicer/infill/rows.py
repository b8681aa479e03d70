"""Solid areas filled with rows, and with beads of varying width where rows leave wedges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import (
    Areas,
    Float,
    Lines,
    Pieces,
    chain_rows,
    difference,
    hatch,
    offset,
    offset_open,
    pieces_of,
    staircases,
)
from printer_slicer.geometry.areas import lengths
from printer_slicer.infill.narrow import beads_amid
from printer_slicer.infill.turns import zigzags
from printer_slicer.model import LayerPlan, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["Beads", "rows_in"]

# Spacings. A turn runs along the boundary, which meets the lines at any angle; under 27° it would be longer.
_LONGEST_TURN = 2.2
_NARROWEST, _WIDEST = 0.7, 1.5  # spacing of beads as a share of the usual one
_HAIR = 2e-4  # mm; more than the geometry's rounding
_IN_SWEEPS = (Role.TOP_SKIN, Role.IRONING)
_SLIT = 0.06  # mm: half the width of gaps that are closed when beads are pressed flat
_SPECK = 0.08  # mm²: smaller gaps are not worth a stop
_AMID = 3  # beads side by side in what rows leave
_MORE, _LESS = 1.15, 0.85  # by how much beads are wider or narrower so that a piece holds what it should
_PRESSED = 0.5  # of the overlap with the walls is filled, where that is no more than
_MOST_PRESSED = 0.007  # of the volume


@dataclass(frozen=True, slots=True, eq=False)
class Beads:
    """Beads of one role, for each of P pieces.

    Attributes:
        role: why they are laid.
        angle: (P,) radians.
        gap: (P,) mm from one centre line to the next, usually.
        width: (P,) mm of a bead if that is fixed; 0 where it follows from how many fit.
        height: (P,) mm.
    """

    role: Role
    angle: Float
    gap: Float
    width: Float
    height: Float


def rows_in(plan: LayerPlan, pieces: Pieces, beads: Beads, profile: Profile) -> list[Toolpaths]:
    """Beads side by side, a little nearer or farther than usual so that a whole number of them fills each piece."""
    overlap = profile.quality.infill_overlap * profile.extrusion_width if profile.quality.perimeters else 0.0
    low, high = _across(pieces.areas, beads.angle)
    low, high = low - overlap, high + overlap
    count = np.maximum(np.rint((high - low) / beads.gap), 1)
    gap = np.clip((high - low) / count, _NARROWEST * beads.gap, _WIDEST * beads.gap)
    # The centre lines stay half a bead inside; the turns at their ends fill the half bead that is left. The outermost
    # rows would lie on the border: a hair inside they are certain to be found.
    area = offset(pieces.areas, overlap - gap / 2)
    first = np.where(count > 1, low + gap / 2 + _HAIR, (low + high) / 2)
    step = np.where(count > 1, (high - low - gap - 2 * _HAIR) / np.maximum(count - 1, 1), gap)
    rows = hatch(area, angle=beads.angle, spacing=step, phase=first / step)
    xy, start, piece = (
        chain_rows(rows, max_turn=_LONGEST_TURN * gap)  # threads in the air stay straight
        if beads.width.any()
        else zigzags(rows, area, beads.angle, gap, _LONGEST_TURN)
    )
    # Between walls that nearly touch, rows shrink to dots that fill nothing and cost a stop each.
    size = np.diff(start)
    long = lengths(xy, np.append(0, np.cumsum(size)), closed=False)
    seen = long >= np.minimum(gap, profile.extrusion_width)[piece] / 2
    xy, size, piece, long = xy[np.repeat(seen, size)], size[seen], piece[seen], long[seen]
    between: list[Toolpaths] = []
    if not beads.width.any():
        filled = np.zeros(pieces.count)
        if beads.role != Role.INTERNAL_BRIDGE:  # its rows rest at both ends; beads between them would not
            stairs = _stairs(rows, area, beads.angle, gap)
            amid, filled = _amid(plan, pieces, stairs, beads.role, profile)
            between = [amid]
        laid = np.bincount(piece, long, minlength=pieces.count) * gap
        gap = gap * _share(pieces.areas, laid, filled, overlap)
    fits = np.maximum(bead.width_for_spacing(gap, beads.height), beads.height)
    width = np.where(beads.width > 0, beads.width, np.round(fits, 4))  # what the file will say
    paths = Toolpaths.gathered(
        plan,
        xy=xy,
        size=size,
        layer=pieces.layer[piece],
        role=np.full(len(piece), beads.role),
        width=width[piece],
        height=beads.height[piece],
        closed=False,
        # Rows come from the lowest up: each is laid beside one that is there already, never between two.
        sweep=piece if beads.role in _IN_SWEEPS else None,
    )
    return [paths, *between]


def _share(areas: Areas, laid: Float, filled: Float, overlap: float) -> Float:
    """(P,) by how much rows have to be thicker so that each piece holds what it should.

    What is pressed into the notches beside the walls counts, as far as that is little.
    """
    area = areas.area()
    wanted = area + np.minimum(_PRESSED * overlap * areas.length(), _MOST_PRESSED * area) - filled
    share = np.divide(wanted, laid, out=np.ones_like(laid), where=laid > 0)
    return np.asarray(np.clip(share, _LESS, _MORE), dtype=np.float64)


def _amid(
    plan: LayerPlan, pieces: Pieces, stairs: Areas, role: Role, profile: Profile
) -> tuple[Toolpaths, Float]:
    """Beads where rows leave room, and (P,) mm² of each piece that they fill."""
    left = pieces_of(offset_open(difference(pieces.areas, stairs), _SLIT))
    left = left.take(np.flatnonzero(left.areas.area() > _SPECK))
    gaps = Pieces(left.areas, pieces.layer[left.layer], left.of_ring)
    paths, _, filled = beads_amid(plan, gaps, role, profile, beads=_AMID)
    return paths, np.bincount(left.layer, filled, minlength=pieces.count).astype(np.float64)


def _stairs(rows: Lines, area: Areas, angle: Float, gap: Float) -> Areas:
    """(P entries) what rows fill: rectangles as wide as their share, longer where turns fill what is beyond their ends.

    Where the border meets rows at so small an angle that none turns there, they end as they are.
    """
    turn, half = angle[rows.layer], gap[rows.layer] / 2
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    side = area.xy[area.following[rows.edge]] - area.xy[rows.edge]  # (S, 2, 2)
    side /= np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-12)[..., None]
    cos = np.abs((side * along[:, None]).sum(axis=2))
    sin = np.sqrt(np.maximum(1 - cos**2, 0.0))
    steep = sin * _LONGEST_TURN >= 1
    beyond = np.where(steep, half[:, None] * (1 + cos) / np.maximum(sin, 1e-9), 0.0)
    return staircases(
        rows, rows.u + beyond * np.array([-1, 1]), angle=angle, half=gap / 2, n_layers=area.n_layers
    )


def _across(areas: Areas, angle: Float) -> tuple[Float, Float]:
    """(P,) from where to where each piece reaches across lines of its direction."""
    if not areas.n_rings:
        return np.zeros(areas.n_layers), np.zeros(areas.n_layers)
    owner = areas.point_layer
    (x, y), turn = areas.xy.T, angle[owner]
    across = y * np.cos(turn) - x * np.sin(turn)
    start = np.searchsorted(owner, np.arange(areas.n_layers)).astype(np.int64)
    low: Float = np.minimum.reduceat(across, start)
    high: Float = np.maximum.reduceat(across, start)
    return low, high
