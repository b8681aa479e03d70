"""Fill solid regions with extrusions side by side, at a spacing that fits each connected area."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.bridges import bridge_line_gap, strand_diameter
from printer_slicer.geometry import ConnectedAreas, split_connected
from printer_slicer.infill.parallel_lines import RowSettings, fill_with_rows
from printer_slicer.infill.thin_solid import thin_solid_paths
from printer_slicer.infill.variable_width import fill_narrow_pieces
from printer_slicer.model import LayerPlan, Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["solid_paths"]

_TOP = 2  # index of top solid infill among the joined pieces


def solid_paths(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Fill bridges, top, bottom and other solid infill; lines turn by 90° from layer to layer."""
    plan = regions.plan
    turned = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    parts = _fill_bridges(regions, profile) + _fill_internal_bridges(regions, profile)
    even, others = thin_solid_paths(regions, split_connected(regions.solid_infill), profile)
    tops = split_connected(regions.top_solid_infill)
    pieces, which = ConnectedAreas.joined([split_connected(regions.bottom_solid_infill), others, tops])
    angle, top_angle = turned[pieces.layer], _find_top_angles(tops, regions, turned)
    angle[which == _TOP] = top_angle
    role = np.array([Role.BOTTOM_SOLID_INFILL, Role.SOLID_INFILL, Role.TOP_SOLID_INFILL])[which]
    along, left = fill_narrow_pieces(plan, pieces, role, profile)
    across = pieces.take(left)
    beads = _make_row_settings(plan, across, role[left], angle[left], profile)
    parts += [even, along, *fill_with_rows(plan, across, beads, profile)]
    if profile.quality.ironing:
        parts += _make_ironing_lines(plan, tops, top_angle, profile)
    return parts


def _find_top_angles(tops: ConnectedAreas, regions: Regions, turned: Float) -> Float:
    """Return the direction (P,) of the lines of each top, radians; `turned` (L,) are the usual ones."""
    given = np.full(tops.count + 1, np.nan)  # the last one is for rings without a piece
    given[tops.of_ring] = regions.top_angle
    given = given[:-1]
    return np.where(np.isnan(given), turned[tops.layer], given)


def _make_ironing_lines(
    plan: LayerPlan, skins: ConnectedAreas, angle: Float, profile: Profile
) -> list[Toolpaths]:
    """Return ironing lines across the lines of top solid infill, whose directions (P,) are given in radians."""
    quality = profile.quality
    height = quality.ironing_flow_ratio * plan.height[skins.layer]
    gap = np.full(skins.count, quality.ironing_spacing)
    across = angle + np.pi / 2
    width = np.round(bead.width_for_spacing(gap, height), 4)
    beads = RowSettings(_repeat_role(skins, Role.IRONING), across, gap, width, height)
    return fill_with_rows(plan, skins, beads, profile)


def _make_row_settings(
    plan: LayerPlan, pieces: ConnectedAreas, role: Int, angle: Float, profile: Profile
) -> RowSettings:
    """Return the settings of rows with the usual spacing and a width fitted to each piece."""
    height = plan.height[pieces.layer]
    wide = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(wide[pieces.layer], height)
    return RowSettings(role, angle, gap, np.zeros(pieces.count), height)


def _repeat_role(pieces: ConnectedAreas, role: Role) -> Int:
    """Return the same role (P,) for each piece."""
    return np.full(pieces.count, role)


def _fill_bridges(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Fill bridges with round strands for thick bridges, otherwise with flat lines of the bridge flow."""
    quality, plan, pieces = profile.quality, regions.plan, split_connected(regions.bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.bridge_angle
    beads = _make_row_settings(plan, pieces, _repeat_role(pieces, Role.BRIDGE), angle, profile)
    if quality.thick_bridges:
        thread = np.full(pieces.count, strand_diameter(profile))
        beads = RowSettings(beads.role, angle, bridge_line_gap(profile, beads.height), thread, thread)
    else:
        beads = _with_flow_ratio(beads, quality.bridge_flow_ratio, profile)
    walled = regions.inside if quality.perimeters and regions.inside.n_rings else None
    return fill_with_rows(plan, pieces, beads, profile, walled)


def _fill_internal_bridges(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Fill internal bridges with lines of their flow."""
    plan, quality = regions.plan, profile.quality
    pieces = split_connected(regions.internal_bridge)
    angle = np.zeros(pieces.count)
    angle[pieces.of_ring] = regions.internal_bridge_angle
    beads = _make_row_settings(plan, pieces, _repeat_role(pieces, Role.INTERNAL_BRIDGE), angle, profile)
    if quality.internal_bridge_flow_ratio != 1:
        beads = _with_flow_ratio(beads, quality.internal_bridge_flow_ratio, profile)
    return fill_with_rows(plan, pieces, beads, profile)


def _with_flow_ratio(beads: RowSettings, ratio: float, profile: Profile) -> RowSettings:
    """Return row settings with `ratio` times the usual flow at the same spacing; lines are at least as wide as high."""
    usual = bead.spacing(profile.extrusion_width, beads.height)
    width = np.maximum(np.round(bead.width_for_spacing(usual * ratio, beads.height), 4), beads.height)
    return RowSettings(beads.role, beads.angle, beads.gap, width, beads.height)
