"""Toolpaths -> Program: how much filament, how fast, how cool.

Everything that depends on layer height takes each layer's own: the cross-section of the bead, the speed that the
material's flow limit allows, the height at which the fan has ramped up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.extrusion.accelerating import acceleration_events
from printer_slicer.extrusion.beads import beads_of, speeds_of
from printer_slicer.extrusion.cooling import fans, slowed
from printer_slicer.extrusion.rows import APPROACH, rows_of
from printer_slicer.extrusion.timing import known_as, move_seconds
from printer_slicer.model import Event, Heat, Program, ToolChange, Toolpaths, Travels
from printer_slicer.profile import Material, Profile
from printer_slicer.roles import Role, is_perimeter, roles_with

__all__ = ["extrude", "move_seconds"]

_HALF = 0.5  # of its width: a perimeter's bead that is carried by less hangs


def extrude(paths: Toolpaths, travels: Travels, profile: Profile, rules: Sequence[Profile] = ()) -> Program:
    """The moves that print `paths` in order, with `travels` between them, fan and temperatures.

    Speeds, accelerations and flow of the paths are those of `rules`, by their number; `profile` where there are none,
    and for what belongs to no object. Layers that would be quicker than `material.min_layer_time` are slowed down, down
    to `material.min_speed`.
    """
    # What the moves were made from is not needed any more when they are timed: that takes the most memory.
    rules = tuple(rules) or (profile,)
    program, carried = _moves(paths, travels, profile, rules)
    program = slowed(program, profile)
    events = [
        *_heat(program, paths, profile.material, rules),
        *fans(program, carried, profile),
        *program.events,
    ]
    return known_as(replace(program, events=tuple(sorted(events, key=lambda event: event.index))), program)


def _moves(
    paths: Toolpaths, travels: Travels, profile: Profile, rules: tuple[Profile, ...]
) -> tuple[Program, Float]:
    """The moves as quick as they may be, and (K,) the share of each bead that lies over the layer below."""
    rows = rows_of(paths, travels, profile)
    beads = beads_of(paths, rows, rules)
    role = np.where(rows.is_bead, paths.role[rows.path], Role.TRAVEL)
    carried = rows.spread(beads.carried)
    role[is_perimeter(role) & (carried < _HALF)] = Role.OVERHANG_PERIMETER
    diameter = np.array([extruder.material.filament_diameter for extruder in profile.extruders])
    layer, tool = paths.layer[rows.path], paths.tool[rows.path]
    on_bed = paths.begins_at(0)[rows.path]
    program = Program(
        paths.plan,
        origin=np.array([0.0, 0.0, float(paths.plan.top[0]) + APPROACH]),
        xyz=rows.xyz,
        filament=rows.pulled + rows.spread(beads.filament(diameter[paths.tool[rows.bead_path]])),
        speed=speeds_of(paths, rows, beads, rules),
        layer=layer,
        role=role,
        width=rows.spread(beads.width),
        height=rows.spread(beads.height * beads.share),
        events=(
            *_tool_changes(tool),
            *acceleration_events(role, on_bed, paths.settings_id[rows.path], rules),
        ),
        z_top=paths.z_top[rows.path],
        tool=tool,
    )
    if paths.has_arcs:
        centre = np.full((program.n_moves, 2), np.nan)
        centre[rows.is_bead] = paths.centre[rows.begin]
        program = replace(program, centre=centre)
    return program, carried


def _tool_changes(tool: Int) -> list[ToolChange]:
    """Where the extruder in use (K,) is another one than before; the first one is in use from the start."""
    changed = np.flatnonzero(np.diff(tool)) + 1
    return [
        ToolChange(index, number)
        for index, number in zip(changed.tolist(), tool[changed].tolist(), strict=True)
    ]


def _heat(program: Program, paths: Toolpaths, material: Material, rules: tuple[Profile, ...]) -> list[Event]:
    """From the second layer on the temperatures of the rest of the part, and those that heights have of their own.

    Where objects have layers of their own, from the layer on in which none of them begins.
    """
    of_rule = np.array([rule.material.nozzle_temperature for rule in rules])
    begins = np.flatnonzero(np.diff(program.layer, prepend=-1) > 0)
    wanted = np.full(paths.plan.n_layers, material.nozzle_temperature, np.float64)
    own = roles_with(is_part=True)[paths.role]
    wanted[paths.layer[own]] = of_rule[paths.settings_id[own]]
    nozzle, bed = material.first_layer_nozzle_temperature, material.first_layer_bed_temperature
    events: list[Event] = []
    last = int(paths.layer[paths.begins_at(0)].max(initial=0))
    for index in begins[program.layer[begins] > last].tolist():
        now = float(wanted[program.layer[index]])
        if now != nozzle or bed != material.bed_temperature:
            changed = now if now != nozzle else None
            events.append(
                Heat(index, changed, material.bed_temperature if bed != material.bed_temperature else None)
            )
        nozzle, bed = now, material.bed_temperature
    return events
