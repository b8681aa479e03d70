"""Compute volume and speed of each extrusion."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.extrusion.move_rows import MoveKind, MoveRows, find_lowered_paths
from printer_slicer.model import Toolpaths
from printer_slicer.profile import Profile, Speeds
from printer_slicer.roles import ROLES, Role, is_perimeter, roles_with
from printer_slicer.values import Struct

__all__ = ["SUPPORT_RATIOS", "MoveValues", "compute_move_values"]

_BEADS_AT_ONCE = 1 << 14  # bounds the memory for intermediate values

_MAX_FLOW_CHANGE = 25.0
"""Maximum change of the flow per second, as a fraction of the full flow; 0.04 s is a usual pressure advance."""

_WRITTEN = 0.001  # mm; positions are written in steps of this
_ROUNDED_SPEED = 1.002  # speeds are written in mm/min, rounded

SUPPORT_RATIOS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Support ratios for which there are settings of overhangs."""


class _BeadValues(Struct, frozen=True, eq=False):
    """Values of extruding moves, in their order.

    Attributes:
        length: (B,) mm.
        width: (B,) mm, mean along the move.
        height: (B,) mm, at full flow.
        share: (B,) fraction of the cross-section that is extruded, mean along the move.
        flow: (B,) flow ratio.
        support_ratio: (B,) fraction of the width that rests on the layer below.
        climb: (B,) change of z, mm.
        share_change: (B,) change of the share along the move.
        is_lowered: (B,) whether the path follows a surface.
    """

    length: Float
    width: Float
    height: Float
    share: Float
    flow: Float
    support_ratio: Float
    climb: Float
    share_change: Float
    is_lowered: Bool

    @property
    def cross_section(self) -> Float:
        """Cross-section (B,), mm², at the mean width of each extrusion, which gives the mean cross-section."""
        return bead.cross_section(self.width, self.height) * (self.share * self.flow)

    def filament(self, diameter: Float) -> Float:
        """Return the filament length (B,) of each extrusion, mm, for filament diameters (B,) in mm."""
        per_mm = bead.filament_per_mm(self.width, self.height, diameter)
        return self.length * per_mm * (self.share * self.flow)


class MoveValues(Struct, frozen=True, eq=False):
    """Values of all moves.

    Attributes:
        speed: (K,) mm/s.
        filament: (K,) mm; negative for retractions.
        width: (K,) mm, mean along an extrusion; 0 for other moves.
        height: (K,) mm, mean along an extrusion; 0 for other moves.
        support_ratio: (K,) fraction of the width of an extrusion that rests on the layer below; 0 for other moves.
        relative_speed: (K,) speed in relation to the fastest extrusion of a path that follows a surface; 1 for all
            other moves. Empty if there are no such paths.
    """

    speed: Float
    filament: Float
    width: Float
    height: Float
    support_ratio: Float
    relative_speed: Float


def compute_move_values(
    paths: Toolpaths, rows: MoveRows, diameter: Float, profiles: tuple[Profile, ...]
) -> MoveValues:
    """Compute the values of all moves from the profiles of their paths, a slab of extrusions at a time.

    `diameter` holds the filament diameter of each tool, mm.
    """
    speed = _speeds_without_extrusion(paths, rows, profiles[0])
    filament, width, height, support_ratio = (np.zeros(len(speed)) for _ in range(4))
    filament[rows.pulls] = rows.pulled
    supported = [_supported_speeds(paths, profile) for profile in profiles]
    moves = np.flatnonzero(rows.is_bead).astype(np.int32)
    lowered = find_lowered_paths(paths, profiles[0])
    for first in range(0, len(moves), _BEADS_AT_ONCE):
        some = slice(first, first + _BEADS_AT_ONCE)
        move = moves[some]
        path = rows.path[move]
        beads = _compute_bead_values(paths, (rows.begin[some], rows.end[some], path), profiles, lowered)
        filament[move] = beads.filament(diameter[paths.tool[path]])
        speed[move] = _bead_speeds(paths, path, beads, supported, profiles)
        width[move], height[move] = beads.width, beads.height * beads.share
        support_ratio[move] = beads.support_ratio
    relative = _find_relative_speeds(speed, rows, lowered) if lowered.any() else np.zeros(0)
    return MoveValues(speed, filament, width, height, support_ratio, relative)


def _find_relative_speeds(speed: Float, rows: MoveRows, lowered: Bool) -> Float:
    """Return the relative speed (K,) of moves for the mask `lowered` (M,) of paths that follow a surface."""
    moves = np.flatnonzero(rows.is_bead & lowered[rows.path])
    fastest = np.zeros(len(lowered))
    np.maximum.at(fastest, rows.path[moves], speed[moves])
    result = np.ones(len(speed))
    result[moves] = speed[moves] / fastest[rows.path[moves]]
    return result


def _compute_bead_values(
    paths: Toolpaths, moves: tuple[Int, Int, Int], profiles: tuple[Profile, ...], lowered: Bool
) -> _BeadValues:
    """Compute the values of extrusions from their first and last points (B,) and their paths (B,).

    `lowered` (M,) is the mask of the paths that follow a surface.
    """
    start, end, path = moves
    delta = paths.xy.take(end, axis=0) - paths.xy.take(start, axis=0)
    climbed = paths.z_offset[end] - paths.z_offset[start]
    flow, first = (
        np.array(values)[paths.settings_id[path]]
        for values in (
            [rule.material.flow_ratio for rule in profiles],
            [rule.quality.first_layer_flow for rule in profiles],
        )
    )
    return _BeadValues(
        np.sqrt((delta * delta).sum(axis=1) + climbed * climbed),
        (paths.width[start] + paths.width[end]) / 2,
        paths.height[path],
        (paths.flow_ratio[start] + paths.flow_ratio[end]) / 2,
        np.where(paths.begins_at(0)[path], first, 1.0) * flow,
        paths.support_ratio[start],
        climbed,
        paths.flow_ratio[end] - paths.flow_ratio[start],
        lowered[path],
    )


def _speeds_without_extrusion(paths: Toolpaths, rows: MoveRows, profile: Profile) -> Float:
    """Return the speed (K,) of each move that does not extrude, mm/s; 0 for extrusions."""
    printer, speeds = profile.printer, profile.speeds
    z_speed = min(speeds.travel, printer.max_speed_z)
    wipe = min(speeds.travel, printer.max_speed_x)
    lead = np.zeros(MoveKind.BEAD + 1)
    lead[[MoveKind.RETRACT, MoveKind.DERETRACT]] = printer.retract_speed, printer.deretract_speed
    lead[[MoveKind.WIPE, MoveKind.LIFT, MoveKind.TRAVEL, MoveKind.DROP]] = (
        wipe,
        z_speed,
        speeds.travel,
        z_speed,
    )
    if printer.z_hop_ramp:
        lead[MoveKind.LIFT] = speeds.travel
    speed = lead[rows.kind]
    if speeds.first_layer_travel < speeds.travel:
        careful = (
            (rows.kind <= MoveKind.TRAVEL) & (rows.kind >= MoveKind.WIPE) & paths.begins_at(0)[rows.path]
        )
        speed[careful] = np.minimum(speed[careful], speeds.first_layer_travel)
    return speed


def _bead_speeds(
    paths: Toolpaths, path: Int, beads: _BeadValues, supported: list[Float], profiles: tuple[Profile, ...]
) -> Float:
    """Return the speed (B,) of extrusions, mm/s, from the profiles of their paths (B,).

    `supported` has for each profile the speeds (M,) of all paths where they are supported.
    """
    printing = _bead_speeds_of_profile(paths, path, beads, supported[0][path], profiles[0])
    for number, rule in enumerate(profiles[1:], 1):
        own = _bead_speeds_of_profile(paths, path, beads, supported[number][path], rule)
        printing = np.where(paths.settings_id[path] == number, own, printing)
    return printing


def _bead_speeds_of_profile(
    paths: Toolpaths, path: Int, beads: _BeadValues, speed: Float, profile: Profile
) -> Float:
    """Return the speed (B,) of extrusions with the settings of one profile, mm/s.

    `speed` (B,) is their speed where they are supported.
    """
    speeds = profile.speeds
    is_overhang = is_perimeter(paths.role[path]) & (beads.support_ratio < 1)
    slower = speed * np.interp(beads.support_ratio, SUPPORT_RATIOS, _overhang_speed_ratios(speeds))
    slower = np.minimum(slower, _overhang_speed_limits(beads.support_ratio, speed, profile))
    # Below a support ratio of a quarter, the speed blends into the bridge speed.
    faster = np.maximum(speed - speeds.bridge, 0) * np.minimum(beads.support_ratio / SUPPORT_RATIOS[1], 1)
    speed = np.where(is_overhang, np.minimum(slower, speeds.bridge + faster), speed)
    on_bed = profile.material.first_layer_max_flow_ratio
    melted = np.where(paths.begins_at(0)[path], on_bed, 1.0) * profile.max_flow
    limited = np.minimum(speed, melted / np.maximum(beads.cross_section, 1e-9))
    if beads.is_lowered.any():
        return np.where(beads.is_lowered, _limit_climbing_speeds(beads, limited, profile), limited)
    return limited


def _limit_climbing_speeds(beads: _BeadValues, speed: Float, profile: Profile) -> Float:
    """Limit the speed (B,), mm/s, of extrusions that follow a surface, where they climb or fall.

    The pressure in the nozzle follows a change of the flow late. So the flow changes only at a limited rate, as far as
    the minimum speed of the material allows. The speed of the z axis is limited, too.
    """
    length = np.maximum(beads.length, 1e-9)
    of_flow = _MAX_FLOW_CHANGE * length / np.maximum(np.abs(beads.share_change), 1e-9)
    # Rounded positions may be steeper than exact ones.
    of_z = profile.printer.max_speed_z * length / (np.abs(beads.climb) * _ROUNDED_SPEED + 2 * _WRITTEN)
    even = np.minimum(speed, np.maximum(of_flow, profile.material.min_speed))
    return np.minimum(even, of_z)


def _overhang_speed_limits(support_ratio: Float, full_speed: Float, profile: Profile) -> Float:
    """Return the highest speed (B,) that the printer allows for perimeters with these support ratios, mm/s.

    The limits of the printer are interpolated. Where it has none, the limit is the speed `full_speed` (B,).
    """
    limits = profile.printer.speeds
    points = (profile.speeds.bridge, limits.overhang_25, limits.overhang_50, limits.overhang_75, 0.0)
    if not any(points[1:]):
        return full_speed
    of_point = np.stack([np.minimum(full_speed, one) if one else full_speed for one in points])
    below = np.clip((support_ratio / SUPPORT_RATIOS[1]).astype(np.int64), 0, len(SUPPORT_RATIOS) - 2)
    share = support_ratio / SUPPORT_RATIOS[1] - below
    each = np.arange(len(support_ratio))
    return np.asarray(of_point[below, each] * (1 - share) + of_point[below + 1, each] * share)


def _supported_speeds(paths: Toolpaths, profile: Profile) -> Float:
    """Return the speed (M,) of paths where they are supported, mm/s."""
    speeds = profile.speeds
    speed = _role_speeds(speeds)[paths.role]
    single = (paths.role == Role.PERIMETER) & ~paths.closed
    speed = np.where(single, speeds.gap_fill, speed)
    if speeds.small_perimeter:
        small = is_perimeter(paths.role) & paths.closed
        small &= paths.length() < 2 * np.pi * speeds.small_perimeter_radius
        speed = np.where(small, np.minimum(speed, speeds.small_perimeter), speed)
    if speeds.even_flow_ratio:
        speed = speed * _even_flow_factors(paths, profile)
    raft = paths.role == Role.RAFT
    base = int(paths.layer[raft].max(initial=-1)) + 1  # the part's first layer
    if base:
        speed = np.where(raft & (paths.layer == base - 1), profile.raft_interface_speed, speed)
    first = np.where(roles_with(is_infill=True)[paths.role], speeds.first_layer_infill, speeds.first_layer)
    begins = paths.begins_at(0) | paths.begins_at(base)
    speed = np.where(begins, np.minimum(speed, first), speed)
    low, high = float(paths.plan.top[base]), speeds.slow_below
    if high > low:
        share = np.clip((paths.z_top - low) / (high - low), 0, 1)
        ramped = np.minimum(speed, first + share * np.maximum(speed - first, 0))
        speed = np.where(raft, speed, ramped)
    return np.asarray(speed)


def _even_flow_factors(paths: Toolpaths, profile: Profile) -> Float:
    """Return speed factors (M,) that reduce the difference in flow between thin and thick layers."""
    speeds = profile.speeds
    factor = (profile.quality.layer_height / np.maximum(paths.height, 1e-6)) ** speeds.even_flow_ratio
    return np.asarray(np.clip(factor, 1 / speeds.even_flow_most, speeds.even_flow_most))


def _role_speeds(speeds: Speeds) -> Float:
    """Return the speed (roles,) of each role, mm/s."""
    of_role = np.array([getattr(speeds, row.speed) for row in ROLES])
    # A draft shield continues above the first layer.
    of_role[Role.SKIRT] = max(speeds.first_layer, speeds.external_perimeter)
    return of_role


def _overhang_speed_ratios(speeds: Speeds) -> tuple[float, ...]:
    """Return the speed of perimeters at each of `SUPPORT_RATIOS`, as a fraction of their normal speed."""
    return (
        speeds.overhang_0_ratio,
        speeds.overhang_25_ratio,
        speeds.overhang_50_ratio,
        speeds.overhang_75_ratio,
        1.0,
    )
