"""Solid regions: beads side by side, in every connected area as many as fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import (
    Areas,
    Float,
    Pieces,
    chain_rows,
    hatch,
    offset,
    pieces_of,
)
from printer_slicer.geometry.areas import lengths
from printer_slicer.infill.strips import strip_paths
from printer_slicer.model import LayerPlan, Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["solid_paths"]

# A turn runs along the boundary, which meets the lines at any angle; past 20° it is longer than three spacings.
_LONGEST_TURN = 3.0
_NARROWEST, _WIDEST = 0.7, 1.5  # spacing of beads as a share of the usual one
_HAIR = 2e-4  # mm; more than the geometry's rounding
_IN_SWEEPS = (Role.TOP_SKIN, Role.IRONING)
_APART = 0.05  # mm between the threads of a bridge: round ones that touch would push each other aside


@dataclass(frozen=True, slots=True, eq=False)
class _Beads:
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


def solid_paths(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Lines that fill bridges, skins and what is solid below them; the direction turns by 90° from layer to layer."""
    plan = regions.plan
    turned = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    parts = [_bridges(regions, profile), _internal_bridges(regions, profile)]
    along, across = strip_paths(regions, pieces_of(regions.solid), profile)
    parts.append(along)
    for pieces, role in (
        (pieces_of(regions.bottom_skin), Role.BOTTOM_SKIN),
        (across, Role.SOLID),
        (pieces_of(regions.top_skin), Role.TOP_SKIN),
    ):
        beads = _usual(plan, pieces, role, turned[pieces.layer], profile)
        parts.append(_filled(plan, pieces, beads, profile))
    if profile.quality.ironing:
        parts.append(_ironed(plan, pieces_of(regions.top_skin), turned, profile))
    return parts


def _ironed(plan: LayerPlan, skins: Pieces, turned: Float, profile: Profile) -> Toolpaths:
    """Lines close together across those of the top skins, which the hot nozzle smooths and fills a little."""
    quality = profile.quality
    height = quality.ironing_flow_ratio * plan.height[skins.layer]
    gap = np.full(skins.count, quality.ironing_spacing)
    across = turned[skins.layer] + np.pi / 2
    beads = _Beads(Role.IRONING, across, gap, np.round(bead.width_for_spacing(gap, height), 4), height)
    return _filled(plan, skins, beads, profile)


def _usual(plan: LayerPlan, pieces: Pieces, role: Role, angle: Float, profile: Profile) -> _Beads:
    height = plan.height[pieces.layer]
    wide = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(wide[pieces.layer], height)
    return _Beads(role, angle, gap, np.zeros(pieces.count), height)


def _bridges(regions: Regions, profile: Profile) -> Toolpaths:
    """Threads over air: round ones, or beads with as much plastic as asked for."""
    quality, plan, pieces = profile.quality, regions.plan, pieces_of(regions.bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.bridge_angle
    beads = _usual(plan, pieces, Role.BRIDGE, angle, profile)
    if quality.thick_bridges:
        thread = np.full(pieces.count, profile.printer.nozzle_diameter * np.sqrt(quality.bridge_flow_ratio))
        beads = _Beads(Role.BRIDGE, angle, thread + _APART, thread, thread)
    else:
        beads = _with_flow(beads, quality.bridge_flow_ratio, profile)
    return _filled(plan, pieces, beads, profile)


def _internal_bridges(regions: Regions, profile: Profile) -> Toolpaths:
    """The first solid beads over sparse infill."""
    plan, quality = regions.plan, profile.quality
    pieces = pieces_of(regions.internal_bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.internal_bridge_angle
    beads = _usual(plan, pieces, Role.INTERNAL_BRIDGE, angle, profile)
    if quality.internal_bridge_flow_ratio != 1:
        beads = _with_flow(beads, quality.internal_bridge_flow_ratio, profile)
    return _filled(plan, pieces, beads, profile)


def _with_flow(beads: _Beads, ratio: float, profile: Profile) -> _Beads:
    """The same beads with more or less plastic, where they are; never narrower than high."""
    usual = bead.spacing(profile.extrusion_width, beads.height)
    width = np.maximum(np.round(bead.width_for_spacing(usual * ratio, beads.height), 4), beads.height)
    return _Beads(beads.role, beads.angle, beads.gap, width, beads.height)


def _filled(plan: LayerPlan, pieces: Pieces, beads: _Beads, profile: Profile) -> Toolpaths:
    """Beads side by side, a little nearer or farther than usual so that a whole number of them fills each piece."""
    overlap = profile.quality.infill_overlap * profile.extrusion_width if profile.quality.perimeters else 0.0
    low, high = _across(pieces.areas, beads.angle)
    low, high = low - overlap, high + overlap
    count = np.maximum(np.rint((high - low) / beads.gap), 1)
    gap = np.clip((high - low) / count, _NARROWEST * beads.gap, _WIDEST * beads.gap)
    width = np.round(bead.width_for_spacing(gap, beads.height), 4)  # what the file will say
    gap = np.where(beads.width > 0, gap, bead.spacing(width, beads.height))
    width = np.where(beads.width > 0, beads.width, width)
    # The centre lines stay half a bead inside; the turns at their ends fill the half bead that is left. The outermost
    # rows would lie on the border: a hair inside they are certain to be found.
    area = offset(pieces.areas, overlap - gap / 2)
    first = np.where(count > 1, low + gap / 2 + _HAIR, (low + high) / 2)
    step = np.where(count > 1, (high - low - gap - 2 * _HAIR) / np.maximum(count - 1, 1), gap)
    rows = hatch(area, angle=beads.angle, spacing=step, phase=first / step)
    xy, start, piece = chain_rows(rows, max_turn=_LONGEST_TURN * gap)
    # Between walls that nearly touch, rows shrink to dots that fill nothing and cost a stop each.
    size = np.diff(start)
    seen = lengths(xy, start, closed=False) >= np.minimum(gap, profile.extrusion_width)[piece] / 2
    xy, size, piece = xy[np.repeat(seen, size)], size[seen], piece[seen]
    return Toolpaths.gathered(
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
