"""Make moves from toolpaths: filament, speeds, fan and temperatures.

Everything that depends on layer height uses the height of each layer: cross-sections, speeds at the flow limit, and the
ramp of the fan.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, SmallInt
from printer_slicer.extrusion.acceleration import acceleration_events
from printer_slicer.extrusion.cooling import fan_events, slow_small_layers
from printer_slicer.extrusion.extrusion_values import compute_move_values
from printer_slicer.extrusion.move_rows import APPROACH, list_moves
from printer_slicer.extrusion.timing import copy_times, move_seconds
from printer_slicer.model import Event, Heat, Program, ToolChange, Toolpaths, Travels
from printer_slicer.profile import Material, Profile
from printer_slicer.roles import Role, is_perimeter, roles_with
from printer_slicer.values import Struct, field, replace

__all__ = ["FullSpeedMoves", "compute_path_seconds", "cool", "extrude", "make_moves", "move_seconds"]

_OVERHANG_SUPPORT = 0.5  # fraction of the width; perimeters with less support are overhang perimeters


class FullSpeedMoves(Struct, frozen=True, eq=False):
    """Moves at full speed, before layers are slowed down and the fan is set.

    Attributes:
        program: the moves.
        support_ratio: (K,) fraction of the width of each extrusion that lies on the layer below.
        path: (K,) the path that each move belongs to or leads to; empty in the result of `make_moves`.
        temperature_changes: between moves.
        relative_speed: (K,) speed in relation to the fastest extrusion of a path that follows a surface; 1 for all
            other moves. Empty if there are no such paths.
    """

    program: Program
    support_ratio: Float
    path: Int
    temperature_changes: tuple[Event, ...] = ()
    relative_speed: Float = field(default_factory=lambda: np.zeros(0))


def extrude(
    paths: Toolpaths, travels: Travels, profile: Profile, profiles: Sequence[Profile] = ()
) -> Program:
    """Return the moves that print `paths` in order, with `travels` between them, fan and temperatures.

    Speeds, accelerations and flow come from `profiles`, by the `settings_id` of each path, or from `profile` if
    `profiles` is empty. Layers that take less than `material.min_layer_time` are slowed down, at most to
    `material.min_speed`.
    """
    return cool(make_moves(paths, travels, profile, profiles), profile)


def make_moves(
    paths: Toolpaths, travels: Travels, profile: Profile, profiles: Sequence[Profile] = ()
) -> FullSpeedMoves:
    """Return the moves of `extrude` at full speed.

    They do not refer to `paths`, so the caller can release these before `cool`.
    """
    profiles = tuple(profiles) or (profile,)
    moves = _make_moves(paths, travels, profile, profiles)
    changes = _list_temperature_changes(moves.program, paths, profile.material, profiles)
    return replace(moves, path=np.zeros(0, np.int64), temperature_changes=tuple(changes))


def cool(moves: FullSpeedMoves, profile: Profile) -> Program:
    """Slow down short layers, at most to `material.min_speed`, and add the changes of the fan."""
    program = slow_small_layers(moves.program, profile, moves.relative_speed)
    events = [*moves.temperature_changes, *fan_events(program, moves.support_ratio, profile), *program.events]
    return copy_times(replace(program, events=tuple(sorted(events, key=lambda event: event.index))), program)


def compute_path_seconds(paths: Toolpaths, travels: Travels, profile: Profile) -> Float:
    """Return the time (M,) that each path takes at full speed, with the travel to it, s.

    Arguments are those of `extrude`.
    """
    moves = _make_moves(paths, travels, profile, (profile,))
    seconds = move_seconds(moves.program, profile)
    return np.bincount(moves.path, seconds, minlength=paths.n_paths).astype(np.float64)


def _make_moves(
    paths: Toolpaths, travels: Travels, profile: Profile, profiles: tuple[Profile, ...]
) -> FullSpeedMoves:
    """Return the moves at full speed, without temperature changes."""
    rows = list_moves(paths, travels, profile)
    diameter = np.array([extruder.material.filament_diameter for extruder in profile.extruders])
    values = compute_move_values(paths, rows, diameter, profiles)
    path, xyz, is_bead, begin = rows.path, rows.xyz, rows.is_bead, rows.begin
    del rows  # free memory: its other columns are as long as those of the program
    role = np.where(is_bead, paths.role.astype(np.int16)[path], np.int16(Role.TRAVEL))
    role[is_perimeter(role) & (values.support_ratio < _OVERHANG_SUPPORT)] = Role.OVERHANG_PERIMETER
    layer, tool = paths.layer[path], paths.tool.astype(np.int16)[path]
    on_bed = paths.begins_at(0)[path]
    program = Program(
        paths.plan,
        origin=np.array([0.0, 0.0, float(paths.plan.top[0]) + APPROACH]),
        xyz=xyz,
        filament=values.filament,
        speed=values.speed,
        layer=layer,
        role=role,
        width=values.width,
        height=values.height,
        events=(
            *_list_tool_changes(tool),
            *acceleration_events(role, on_bed, paths.settings_id[path], profiles),
        ),
        z_top=paths.z_top[path],
        tool=tool,
    )
    if paths.has_arcs:
        centre = np.full((program.n_moves, 2), np.nan)
        centre[is_bead] = paths.centre[begin]
        program = replace(program, centre=centre)
    return FullSpeedMoves(program, values.support_ratio, path, relative_speed=values.relative_speed)


def _list_tool_changes(tool: SmallInt) -> list[ToolChange]:
    """Return the tool changes between moves, from the tool (K,) of each move; the first tool is already active."""
    changed = np.flatnonzero(np.diff(tool)) + 1
    return [
        ToolChange(index, number)
        for index, number in zip(changed.tolist(), tool[changed].tolist(), strict=True)
    ]


def _list_temperature_changes(
    program: Program, paths: Toolpaths, material: Material, profiles: tuple[Profile, ...]
) -> list[Event]:
    """Return the temperature changes after the first layer, and those that overrides for height ranges require.

    If objects have different layer plans, the first change comes after the first layer of every object.
    """
    of_rule = np.array([one.material.nozzle_temperature for one in profiles])
    layer_starts = np.append(0, np.flatnonzero(program.layer[1:] > program.layer[:-1]) + 1)
    temperature = np.full(paths.plan.n_layers, material.nozzle_temperature, np.float64)
    own = roles_with(is_part=True)[paths.role]
    temperature[paths.layer[own]] = of_rule[paths.settings_id[own]]
    nozzle, bed = material.first_layer_nozzle_temperature, material.first_layer_bed_temperature
    events: list[Event] = []
    last = int(paths.layer[paths.begins_at(0)].max(initial=0))
    for index in layer_starts[program.layer[layer_starts] > last].tolist():
        now = float(temperature[program.layer[index]])
        if now != nozzle or bed != material.bed_temperature:
            changed = now if now != nozzle else None
            events.append(
                Heat(index, changed, material.bed_temperature if bed != material.bed_temperature else None)
            )
        nozzle, bed = now, material.bed_temperature
    return events
