"""Solid regions: beads side by side, in every connected area as many as fit."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Pieces, pieces_of
from printer_slicer.infill.narrow import along_narrow
from printer_slicer.infill.rows import RowBeads, rows_in
from printer_slicer.infill.strips import strip_paths
from printer_slicer.model import LayerPlan, Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["solid_paths"]

_APART = 0.05  # mm between the threads of a bridge: round ones that touch would push each other aside


def solid_paths(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Lines that fill bridges, skins and what is solid below them; the direction turns by 90° from layer to layer."""
    plan = regions.plan
    turned = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    parts = _bridges(regions, profile) + _internal_bridges(regions, profile)
    even, others = strip_paths(regions, pieces_of(regions.solid), profile)
    pieces, which = Pieces.joined([pieces_of(regions.bottom_skin), others, pieces_of(regions.top_skin)])
    role = np.array([Role.BOTTOM_SOLID_INFILL, Role.SOLID_INFILL, Role.TOP_SOLID_INFILL])[which]
    along, left = along_narrow(plan, pieces, role, profile)
    across = pieces.take(left)
    beads = _usual(plan, across, role[left], turned[across.layer], profile)
    parts += [even, along, *rows_in(plan, across, beads, profile)]
    if profile.quality.ironing:
        parts += _ironed(plan, pieces_of(regions.top_skin), turned, profile)
    return parts


def _ironed(plan: LayerPlan, skins: Pieces, turned: Float, profile: Profile) -> list[Toolpaths]:
    """Lines close together across those of the top skins, which the hot nozzle smooths and fills a little."""
    quality = profile.quality
    height = quality.ironing_flow_ratio * plan.height[skins.layer]
    gap = np.full(skins.count, quality.ironing_spacing)
    across = turned[skins.layer] + np.pi / 2
    width = np.round(bead.width_for_spacing(gap, height), 4)
    beads = RowBeads(_all(skins, Role.IRONING), across, gap, width, height)
    return rows_in(plan, skins, beads, profile)


def _usual(plan: LayerPlan, pieces: Pieces, role: Int, angle: Float, profile: Profile) -> RowBeads:
    """Beads as far apart as their width says, and as wide as fits."""
    height = plan.height[pieces.layer]
    wide = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(wide[pieces.layer], height)
    return RowBeads(role, angle, gap, np.zeros(pieces.count), height)


def _all(pieces: Pieces, role: Role) -> Int:
    """(P,) the same role for each."""
    return np.full(pieces.count, role)


def _bridges(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Threads over air: round ones, or beads with as much plastic as asked for."""
    quality, plan, pieces = profile.quality, regions.plan, pieces_of(regions.bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.bridge_angle
    beads = _usual(plan, pieces, _all(pieces, Role.BRIDGE), angle, profile)
    if quality.thick_bridges:
        thread = np.full(pieces.count, profile.printer.nozzle_diameter * np.sqrt(quality.bridge_flow_ratio))
        beads = RowBeads(beads.role, angle, thread + _APART, thread, thread)
    else:
        beads = _with_flow(beads, quality.bridge_flow_ratio, profile)
    walled = regions.inside if quality.perimeters and regions.inside.n_rings else None
    return rows_in(plan, pieces, beads, profile, walled)


def _internal_bridges(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """The first solid beads over sparse infill."""
    plan, quality = regions.plan, profile.quality
    pieces = pieces_of(regions.internal_bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.internal_bridge_angle
    beads = _usual(plan, pieces, _all(pieces, Role.INTERNAL_BRIDGE), angle, profile)
    if quality.internal_bridge_flow_ratio != 1:
        beads = _with_flow(beads, quality.internal_bridge_flow_ratio, profile)
    return rows_in(plan, pieces, beads, profile)


def _with_flow(beads: RowBeads, ratio: float, profile: Profile) -> RowBeads:
    """The same beads with more or less plastic, where they are; never narrower than high."""
    usual = bead.spacing(profile.extrusion_width, beads.height)
    width = np.maximum(np.round(bead.width_for_spacing(usual * ratio, beads.height), 4), beads.height)
    return RowBeads(beads.role, beads.angle, beads.gap, width, beads.height)
