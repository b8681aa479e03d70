"""Join the programs of objects that are printed one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.model import Acceleration, Event, Fan, Heat, LayerPlan, Program, ToolChange
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["join_plans", "join_programs"]

_CLEARANCE: Final = 2.0  # mm between the nozzle and everything that is finished
_SINK: Final = 0.01  # mm


def join_plans(plans: Sequence[LayerPlan]) -> LayerPlan:
    """Return the layers of several objects in the order in which they are printed: tops ascend within each object."""
    first = plans[0]
    top, cut, bottom = (
        np.concatenate([getattr(plan, name) for plan in plans]) for name in ("top", "cut", "bottom")
    )
    return LayerPlan(top, cut, first.planner, first.containment, bottom)


def join_programs(
    programs: Sequence[Program], profile: Profile, *, has_skirt: bool = False
) -> tuple[Program, Int]:
    """Join programs that are printed one after the other; return also the number (K,) of the program of each move.

    Between two of them, and at the end, the nozzle is lifted above everything that is finished. With `has_skirt`, the
    first program has a single layer; if it is as high as the first layer of the next program, they are one layer.

    Args:
        programs: of the objects; each ends with a retraction.
        profile: with retraction, print height and temperatures.
        has_skirt: whether the first program is a skirt.
    """
    programs = [_keep_printed_layers(one) for one in programs]
    shares = has_skirt and len(programs) > 1 and _has_same_first_top(programs[0], programs[1])
    plan = join_plans([one.plan for one in programs][1 if shares else 0 :])
    first_layer, safe, pieces = 0, 0.0, list[Program]()
    for index, program in enumerate(programs):
        moves = replace(program, layer=program.layer + first_layer)
        if index:
            moves = _deretract_first(_approach(moves, safe, profile), profile)
        extruded = program.xyz[program.role != Role.TRAVEL, 2]
        safe = max(safe, min(float(extruded.max(initial=0.0)) + _CLEARANCE, profile.printer.bed_z))
        pieces.append(_leave(moves, safe, profile))
        first_layer += 0 if shares and not index else program.plan.n_layers
    owner = np.repeat(np.arange(len(pieces)), [one.n_moves for one in pieces])
    return _concatenate(plan, pieces, profile), owner


def _has_same_first_top(skirt: Program, program: Program) -> bool:
    """Return whether the first layers of two programs have the same top."""
    return bool(abs(skirt.plan.top[0] - program.plan.top[0]) < SAME_TOP)


def _keep_printed_layers(program: Program) -> Program:
    """Return a program without the layers of its plan in which it does not move, such as those above its object."""
    used = distinct(program.layer)
    plan = program.plan
    own = LayerPlan(plan.top[used], plan.cut[used], plan.planner, plan.containment, plan.bottom[used])
    return replace(program, plan=own, layer=np.searchsorted(used, program.layer))


def _insert_moves(program: Program, at: int, xyz: Float, speed: float, filament: float = 0.0) -> Program:
    """Insert moves to positions (n, 3), mm, that do not extrude, before the move with index `at`.

    They belong to the layer and the tool of that move, or of the last one.
    """
    n, like = len(xyz), min(at, program.n_moves - 1)
    other = {"xyz": xyz, "filament": np.full(n, filament), "speed": np.full(n, speed)}
    other |= {"role": np.full(n, Role.TRAVEL), "width": np.zeros(n), "height": np.zeros(n)}
    other |= {name: np.repeat(getattr(program, name)[like], n) for name in ("layer", "z_top", "tool")}
    other["centre"] = np.full((n, 2), np.nan)
    names = [name for name in other if name != "centre" or program.has_arcs]
    columns = {name: np.insert(getattr(program, name), [at] * n, other[name], axis=0) for name in names}
    if not program.has_arcs:
        columns["centre"] = np.broadcast_to(np.float64(np.nan), (program.n_moves + n, 2))
    events = tuple(
        replace(event, index=event.index + n) if event.index >= at else event for event in program.events
    )
    return replace(program, **columns, events=events)


def _get_lift_speed(profile: Profile) -> float:
    """Return the speed at which the nozzle is lifted, mm/s."""
    return min(profile.speeds.travel, profile.printer.max_speed_z)


def _approach(program: Program, safe: float, profile: Profile) -> Program:
    """Add the move at height `safe` to the place above the first extrusion."""
    moved = _insert_moves(program, 0, np.array([[*program.xyz[0, :2], safe]]), profile.speeds.travel)
    speed = moved.speed.copy()
    speed[1] = _get_lift_speed(profile)  # straight down
    return replace(moved, speed=speed)


def _deretract_first(program: Program, profile: Profile) -> Program:
    """Add a deretraction before the first extrusion."""
    printer = profile.printer
    if not printer.retract_length:
        return program
    first = int((program.role != Role.TRAVEL).argmax())
    filament = printer.retract_length + printer.deretract_extra
    return _insert_moves(program, first, program.xyz[first - 1 : first], printer.deretract_speed, filament)


def _leave(program: Program, safe: float, profile: Profile) -> Program:
    """Add a lift at the end, and a short move down to height `safe`.

    Labels of objects stand before the latter, and its row repeats the position. So a printer that has skipped a
    cancelled object first goes to the end of it, where no finished object is in the way.
    """
    x, y = program.xyz[-1, :2]
    ends = np.array([[x, y, min(safe + _SINK, profile.printer.bed_z)], [x, y, safe]])
    return _insert_moves(program, program.n_moves, ends, _get_lift_speed(profile))


def _concatenate(plan: LayerPlan, pieces: Sequence[Program], profile: Profile) -> Program:
    """Concatenate programs whose moves follow each other, and restore the machine's state between them."""
    names = ("xyz", "filament", "speed", "layer", "role", "width", "height", "z_top", "tool")
    columns = {name: np.concatenate([getattr(one, name) for one in pieces]) for name in names}
    if any(one.has_arcs for one in pieces):
        columns["centre"] = np.concatenate([one.centre for one in pieces])
    first = np.cumsum([0, *(one.n_moves for one in pieces)]).tolist()
    events = [
        replace(event, index=event.index + begin)
        for one, begin in zip(pieces, first, strict=False)
        for event in [*_list_starting_events(one, profile), *one.events]
    ]
    return Program(plan, pieces[0].origin, **columns, events=tuple(_drop_unneeded(events, profile)))


def _list_starting_events(program: Program, profile: Profile) -> list[Event]:
    """Return the changes that bring the machine into the state in which a program begins.

    The nozzle gets the temperature of first layers again; the printer does not wait for it. The bed stays as it is.
    """
    tool, acceleration = int(program.tool[0]), profile.printer.acceleration
    heat = Heat(0, profile.material.first_layer_nozzle_temperature)
    return [heat, Fan(0, 0.0), ToolChange(0, tool), Acceleration(0, acceleration)]


def _drop_unneeded(events: Sequence[Event], profile: Profile) -> Iterator[Event]:
    """Yield the events that change the state of the machine, which after the start G-code is known."""
    material = profile.material
    bed: float | None = material.first_layer_bed_temperature
    nozzles: dict[int, float | None] = {0: material.first_layer_nozzle_temperature}
    state: dict[type[Event], Event] = {
        Fan: Fan(0, 0.0),
        ToolChange: ToolChange(0, 0),
        Acceleration: Acceleration(0, profile.printer.acceleration),
    }
    for event in events:
        if isinstance(event, Heat):
            nozzle = None if event.nozzle == nozzles.get(event.tool) else event.nozzle
            warmed = None if event.bed == bed else event.bed
            if nozzle is not None or warmed is not None:
                yield replace(event, nozzle=nozzle, bed=warmed)
            nozzles[event.tool] = nozzles.get(event.tool) if nozzle is None else nozzle
            bed = bed if warmed is None else warmed
        elif replace(event, index=0) != state.get(type(event)):
            state[type(event)] = replace(event, index=0)
            yield event
