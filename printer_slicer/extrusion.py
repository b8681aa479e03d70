"""Toolpaths -> Program: how much filament, how fast, how cool.

Everything that depends on layer height takes each layer's own: the cross-section of the bead, the speed that the
material's flow limit allows, the height at which the fan has ramped up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import frozen_array
from printer_slicer.model import Bool, Event, Fan, Float, Heat, Int, Program, Role, Toolpaths, Travels, leaves
from printer_slicer.motion.blocks import Limits
from printer_slicer.motion.machine import limits_of
from printer_slicer.motion.whole import durations
from printer_slicer.profile import Material, Profile, Speeds

__all__ = ["extrude", "move_seconds"]

_APPROACH = 2.0  # mm over the first layer at which the nozzle arrives: nothing is dragged over the bed
_ROUNDS = 12  # of slowing down at most: with acceleration, half the speed is not quite twice the time
_NEARLY = 0.995  # of the minimum layer time is enough
_SHORTEST = 0.003  # mm, of a bead
_HALF = 0.5  # of its width: a perimeter's bead that is carried by less hangs
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # carried, for which there are settings
_FAN_STEP = 0.05  # smaller changes of the fan are not worth a line


def extrude(paths: Toolpaths, travels: Travels, profile: Profile) -> Program:
    """The moves that print `paths` in order, with `travels` between them, fan and temperatures.

    Layers that would be quicker than `material.min_layer_time` are slowed down, down to `material.min_speed`.
    """
    rows = _rows(paths, travels, profile)
    beads = _beads_of(paths, rows, profile)
    role = np.append(np.where(rows.kind == _BEAD, paths.role[rows.path], Role.TRAVEL), Role.TRAVEL)
    carried = _spread(beads.carried, rows)
    role[_is_perimeter(role) & (carried < _HALF)] = Role.OVERHANG_PERIMETER
    program = Program(
        paths.plan,
        origin=np.array([0.0, 0.0, float(paths.plan.top[0]) + _APPROACH]),
        xyz=_positions(paths, travels, rows),
        filament=_filament(rows, beads, profile),
        speed=_speeds(paths, rows, beads, profile),
        layer=np.append(paths.layer[rows.path], paths.layer[-1:]),
        role=role,
        width=_spread(beads.width, rows),
        height=_spread(beads.height, rows),
    )
    program = _slowed(program, profile)
    events = _heat(program, profile.material) + _fans(program, carried, profile)
    made = replace(program, events=tuple(sorted(events, key=lambda event: event.index)))
    _timed[made] = _timed[program]  # fans and heaters take no time
    return made


_timed: WeakKeyDictionary[Program, tuple[Limits, Float]] = WeakKeyDictionary()
"""How long the moves of programs take: slowing down, fans and those who tell about it all ask."""


def move_seconds(program: Program, profile: Profile) -> Float:
    """(K,) how long each move takes on this printer, with unlimited look-ahead."""
    limits = limits_of(profile.printer)
    known = _timed.get(program)
    if known is None or known[0] != limits:
        seconds = frozen_array(durations(_steps(program), program.speed, limits), np.float64, (-1,))
        _timed[program] = known = limits, seconds
    return known[1]


def _steps(program: Program) -> Float:
    """(K, 4) x, y, z and filament of each move, mm."""
    return np.column_stack([program.xyz - program.start, program.filament])


_RETRACT, _LIFT, _TRAVEL, _DROP, _DERETRACT, _BEAD = range(6)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """The moves before they have numbers; one more, the last retraction, follows them.

    Attributes:
        path: (K,) the path each move belongs to or leads to.
        kind: (K,) one of the kinds above.
        point: (K,) index into the paths' points where the move ends; for the kinds that do not travel, where it is.
        begin: (M, 2) first point of each path.
        leave: (M, 2) where the nozzle is before each path.
        hop: (M,) lift over the layer during the travel to each path.
    """

    path: Int
    kind: Int
    point: Int
    begin: Float
    leave: Float
    hop: Float


def _rows(paths: Toolpaths, travels: Travels, profile: Profile) -> _Rows:
    """Which moves there are: for each path some of the five kinds that lead to it, then its beads."""
    size = np.diff(paths.start)
    leave, begin = leaves(paths)
    first = np.arange(paths.n_paths) == 0
    new_layer = np.diff(paths.layer, prepend=-1) > 0
    hop = np.where(first, _APPROACH, np.where(travels.retract, profile.printer.z_hop, 0.0))
    count = np.zeros((paths.n_paths, _BEAD + 1), np.int64)
    count[:, _RETRACT] = count[:, _DERETRACT] = travels.retract
    count[:, _LIFT] = (new_layer | (hop > 0)) & ~first
    count[:, _TRAVEL] = (np.hypot(*(begin - leave).T) > 0) | first
    count[:, _TRAVEL] += np.diff(travels.start)
    count[:, _DROP] = hop > 0
    count[:, _BEAD] = np.where(paths.closed, size, size - 1)
    path = np.repeat(np.arange(paths.n_paths), count.sum(axis=1))
    kind = np.repeat(np.tile(np.arange(_BEAD + 1), paths.n_paths), count.ravel())
    point = _points(paths, path, kind)
    # Where a bead's width changes at once, the same point stands twice; and files are written in steps of 1 µm.
    step = paths.xy.take(point, axis=0) - paths.xy.take(_before(paths, path, point), axis=0)
    kept = np.flatnonzero((kind != _BEAD) | (np.hypot(*step.T) > _SHORTEST))
    return _Rows(path[kept], kind[kept], point[kept], begin, leave, hop)


def _before(paths: Toolpaths, path: Int, point: Int) -> Int:
    """(K,) the point at which the bead that ends at `point` (K,) of `path` (K,) begins."""
    first = paths.start[:-1][path]
    return np.asarray(np.where(point > first, point, paths.start[1:][path]) - 1)


def _points(paths: Toolpaths, path: Int, kind: Int) -> Int:
    """(K,) the point at which each bead ends; the path's first point for the moves that lead to it."""
    is_bead = kind == _BEAD
    running = np.cumsum(is_bead)
    first = np.searchsorted(path, np.arange(paths.n_paths))
    before = np.where(first > 0, running[np.maximum(first - 1, 0)], 0)
    nth = np.where(is_bead, running - before[path], 0)
    size = np.diff(paths.start)
    return np.asarray(paths.start[:-1][path] + nth % np.maximum(size[path], 1), np.int64)


def _positions(paths: Toolpaths, travels: Travels, rows: _Rows) -> Float:
    """(K + 1, 3) where each move ends."""
    z = paths.plan.top[paths.layer]
    xyz = np.zeros((len(rows.path) + 1, 3))
    xyz[:-1, :2] = paths.xy.take(rows.point, axis=0)
    stays = rows.kind <= _LIFT
    xyz[:-1, :2][stays] = rows.leave[rows.path[stays]]
    # All travels of a way but the last one end at the points that it passes.
    passing = (rows.kind == _TRAVEL) & (np.append(rows.kind[1:], _BEAD) == _TRAVEL)
    passing &= np.append(rows.path[1:], -1) == rows.path
    xyz[:-1, :2][passing] = travels.xy
    lifted = (rows.kind == _LIFT) | (rows.kind == _TRAVEL)
    xyz[:-1, 2] = z[rows.path] + np.where(lifted, rows.hop[rows.path], 0.0)
    pulling = rows.kind == _RETRACT  # still on the layer of the path before
    xyz[:-1, 2][pulling] = z[rows.path[pulling] - 1]
    xyz[-1] = xyz[-2]  # the last move is a retraction on the spot
    return xyz


@dataclass(frozen=True, slots=True, eq=False)
class _Beads:
    """What the moves lay that are beads, in their order.

    Attributes:
        length: (B,) mm.
        width: (B,) mm, in the mean along the bead.
        height: (B,) mm.
        flow: (B,) the cross-section is multiplied by this.
        carried: (B,) share of the width that lies over the layer below.
    """

    length: Float
    width: Float
    height: Float
    flow: Float
    carried: Float

    @property
    def cross_section(self) -> Float:
        """(B,) mm²; it grows evenly with the width, so that of the mean width is the mean one."""
        return bead.cross_section(self.width, self.height)


def _beads_of(paths: Toolpaths, rows: _Rows, profile: Profile) -> _Beads:
    is_bead = rows.kind == _BEAD
    end, path = rows.point[is_bead], rows.path[is_bead]
    begin = _before(paths, path, end)
    length = np.hypot(*(paths.xy.take(end, axis=0) - paths.xy.take(begin, axis=0)).T)
    first = np.where(paths.layer[path] == 0, profile.quality.first_layer_flow, 1.0)
    width = (paths.width[begin] + paths.width[end]) / 2
    return _Beads(
        length, width, paths.height[path], first * profile.material.flow_ratio, paths.carried[begin]
    )


def _spread(values: Float, rows: _Rows) -> Float:
    """(K + 1,) values (B,) of the beads at their moves; 0 at the others."""
    result = np.zeros(len(rows.path) + 1)
    result[:-1][rows.kind == _BEAD] = values
    return result


def _filament(rows: _Rows, beads: _Beads, profile: Profile) -> Float:
    """(K + 1,) filament fed by each move, mm."""
    printer, material = profile.printer, profile.material
    per_mm = bead.filament_per_mm(beads.width, beads.height, material.filament_diameter)
    fed = _spread(beads.length * (per_mm * beads.flow), rows)
    fed[:-1][rows.kind == _RETRACT] = -printer.retract_length
    fed[:-1][rows.kind == _DERETRACT] = printer.retract_length
    fed[-1] = -printer.retract_length
    return fed


def _speeds(paths: Toolpaths, rows: _Rows, beads: _Beads, profile: Profile) -> Float:
    """(K + 1,) speed of each move, mm/s."""
    printer, speeds, material = profile.printer, profile.quality.speeds, profile.material
    of_role = np.zeros(len(Role))
    # A draft shield goes on over the first layer.
    of_role[[Role.SKIRT, Role.BRIM]] = max(speeds.first_layer, speeds.outer_perimeter), speeds.first_layer
    of_role[Role.RAFT] = speeds.raft
    of_role[Role.OUTER_PERIMETER] = speeds.outer_perimeter
    of_role[Role.INNER_PERIMETER] = speeds.inner_perimeter
    of_role[Role.BRIDGE] = speeds.bridge
    of_role[Role.INTERNAL_BRIDGE] = speeds.internal_bridge
    of_role[[Role.BOTTOM_SKIN, Role.SOLID]] = speeds.solid
    of_role[Role.TOP_SKIN] = speeds.top_skin
    of_role[Role.SPARSE] = speeds.sparse
    of_role[Role.IRONING] = speeds.ironing
    wanted = of_role[paths.role]
    raft = paths.role == Role.RAFT
    begins = (paths.layer == 0) | (raft.any() & (paths.layer == paths.layer[raft].max(initial=-1) + 1))
    wanted = np.where(begins, np.minimum(wanted, speeds.first_layer), wanted)
    is_bead = rows.kind == _BEAD
    laid = wanted[rows.path[is_bead]]
    hangs = _is_perimeter(paths.role[rows.path[is_bead]]) & (beads.carried < 1)
    slower = laid * np.interp(beads.carried, _SHARES, _overhang_speeds(speeds))
    # The last quarter goes over to a bridge.
    faster = np.maximum(laid - speeds.bridge, 0) * np.minimum(beads.carried / _SHARES[1], 1)
    laid = np.where(hangs, np.minimum(slower, speeds.bridge + faster), laid)
    flowing = material.max_flow / (beads.cross_section * beads.flow)
    z_speed = min(speeds.travel, printer.max_speed_z)
    lead = np.array([printer.retract_speed, z_speed, speeds.travel, z_speed, printer.deretract_speed, 0.0])
    speed = lead[rows.kind]
    speed[is_bead] = np.minimum(laid, flowing)
    return np.append(speed, printer.retract_speed)


def _is_perimeter(role: Int) -> Bool:
    """(n,) whether it is the role of a perimeter's bead."""
    return np.asarray((role == Role.OUTER_PERIMETER) | (role == Role.INNER_PERIMETER))


def _overhang_speeds(speeds: Speeds) -> tuple[float, ...]:
    """For each of `_SHARES` of the bead that is carried, the share of the perimeter's speed."""
    return (
        speeds.overhang_0_ratio,
        speeds.overhang_25_ratio,
        speeds.overhang_50_ratio,
        speeds.overhang_75_ratio,
        1.0,
    )


def _slowed(program: Program, profile: Profile) -> Program:
    """The program with beads slowed down on layers that are too quick to cool."""
    material, layer, is_bead = profile.material, program.layer, program.role != Role.TRAVEL
    speed, seconds = program.speed, move_seconds(program, profile)
    # What is slower already, a first layer say, is not made faster by the lower bound.
    floor = np.minimum(speed, material.min_speed)
    for _ in range(_ROUNDS if material.min_layer_time else 0):
        total, laying = (np.bincount(layer, weights=part) for part in (seconds, seconds * is_bead))
        room = material.min_layer_time - (total - laying)
        short = (total < material.min_layer_time * _NEARLY) & (laying > 0)
        factor = np.where(short, laying / np.maximum(room, 1e-9), 1.0)[layer]
        slower = np.where(is_bead & (factor < 1), np.maximum(speed * factor, floor), speed)
        if (slower >= speed * _NEARLY).all():  # what is still too quick is as slow as it may be
            break
        around = layer[slower < speed][[0, -1]]
        speed = slower
        seconds = _timed_again(program, seconds, speed, around, limits_of(profile.printer))
    return program if speed is program.speed else replace(program, speed=speed)


def _timed_again(program: Program, seconds: Float, speed: Float, around: Int, limits: Limits) -> Float:
    """(K,) how long moves take, where only those from the first to the last layer of `around` have another speed.

    Braking for them may reach into the layers beside, no farther: at the step up to a layer the nozzle all but stops.
    """
    # One layer more on both sides: the first and the last of all would begin and end at rest.
    first, begin, end, last = np.searchsorted(program.layer, around[[0, 0, 1, 1]] + [-2, -1, 2, 3])
    asked = slice(first, last)
    again = durations(_steps(program)[asked], speed[asked], limits)[begin - first : end - first]
    return np.concatenate([seconds[:begin], again, seconds[end:]])


def _heat(program: Program, material: Material) -> list[Event]:
    """From the second layer on the temperatures of the rest of the part."""
    above = np.flatnonzero(program.layer > 0)
    if len(above) == 0:
        return []
    nozzle = (
        material.nozzle_temperature
        if material.nozzle_temperature != material.first_layer_nozzle_temperature
        else None
    )
    bed = (
        material.bed_temperature if material.bed_temperature != material.first_layer_bed_temperature else None
    )
    return [Heat(int(above[0]), nozzle, bed)] if nozzle is not None or bed is not None else []


def _fans(program: Program, carried: Float, profile: Profile) -> list[Event]:
    """Fan changes: more on quick layers, ramped up over mm of height, full on bridges, in between on overhangs.

    `carried` (K,) is the share of each bead that lies over the layer below.
    """
    material, plan = profile.material, program.plan
    seconds = np.bincount(program.layer, weights=move_seconds(program, profile), minlength=plan.n_layers)
    span = max(material.fan_layer_time - material.min_layer_time, 1e-9)
    hurry = np.clip((material.fan_layer_time - seconds) / span, 0, 1)
    strongest = max(material.fan_ratio, material.fan_ratio_max)
    wanted = material.fan_ratio + hurry * (strongest - material.fan_ratio)
    ramp_height = max(material.fan_full_above - material.fan_off_below, 1e-9)
    ramp = np.clip((plan.top - material.fan_off_below) / ramp_height, 0, 1)
    ratio = (wanted * ramp)[program.layer]
    hangs = (program.role == Role.BRIDGE) | (program.role == Role.INTERNAL_BRIDGE)
    bridge = _until_next_bead(program.role, hangs) & (ramp[program.layer] > 0)
    on_bridges = np.maximum(ratio, material.fan_ratio_bridge)
    toward = np.interp(_of_next_bead(program.role, carried, 1.0), _SHARES, _overhang_fans(material))
    toward = np.where(ramp[program.layer] > 0, toward, 0.0)
    ratio = np.where(bridge, on_bridges, ratio + toward * (on_bridges - ratio))
    steps = np.round(ratio / _FAN_STEP).astype(np.int64)
    change = np.flatnonzero(np.diff(steps, prepend=0) != 0)
    return [Fan(int(i), float(np.clip(steps[i] * _FAN_STEP, 0, 1))) for i in change]


def _overhang_fans(material: Material) -> tuple[float, ...]:
    """For each of `_SHARES` of the bead that is carried, how far the fan goes toward that on bridges."""
    return (
        material.fan_overhang_0_ratio,
        material.fan_overhang_25_ratio,
        material.fan_overhang_50_ratio,
        material.fan_overhang_75_ratio,
        0.0,
    )


def _of_next_bead(role: Int, values: Float, otherwise: float) -> Float:
    """(K,) the value of the bead that each move leads to."""
    is_bead = role != Role.TRAVEL
    following = np.minimum.accumulate(np.where(is_bead, np.arange(len(role)), len(role))[::-1])[::-1]
    return np.asarray(np.append(values, otherwise)[following])


def _until_next_bead(role: Int, wanted: Bool) -> Bool:
    """(K,) the value of the bead that each move leads to."""
    is_bead = role != Role.TRAVEL
    following = np.minimum.accumulate(np.where(is_bead, np.arange(len(role)), len(role))[::-1])[::-1]
    return np.asarray((following < len(role)) & wanted[np.minimum(following, len(role) - 1)])
