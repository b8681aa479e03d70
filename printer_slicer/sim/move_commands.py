"""Commands that move the machine or wait: straight lines, arcs, homing, probing, dwells.

A move is acknowledged when it has a place in the planner, which executes it later.
"""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, Final

from printer_slicer.motion.arcs import find_centre_by_offset, find_centre_by_radius, split_arc
from printer_slicer.motion.rules import Axes, Block, make_block
from printer_slicer.sim.machine import AXES
from printer_slicer.sim.parsed_command import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.machine import Position

__all__ = [
    "MAX_DISTANCE_OUTSIDE",
    "MAX_LIFT_BEFORE_HOMING",
    "STOP_SECONDS",
    "TABLE",
    "execute_move",
    "find_move_target",
    "move_in_machine_coordinates",
    "move_straight",
    "move_straight_reading_zeros",
    "offset_next_homing",
    "probe_bed",
    "retract_or_recover",
]

MAX_ARC_RADIUS: Final = 10_000.0
"""Maximum radius of an arc, mm; a larger arc would have too many segments."""

MAX_DISTANCE_OUTSIDE: Final = 1000.0
"""Distance outside the machine, mm, at which moves are clipped even without software endstops."""

HOMING_TRAVEL_RATIO: Final = 1.5
"""Travel after which homing fails if the endstop does not trigger, as a multiple of the axis length."""

MAX_LIFT_BEFORE_HOMING: Final = 10.0
"""Maximum upward move before homing that counts as harmless, mm; Klipper rejects every move before homing."""

MAX_BABYSTEP: Final = 2.0
BABYSTEP_SPEED: Final = 2.0
"""Maximum step of M290, mm, and its speed, mm/s."""

STOP_SECONDS: Final = 1.0
"""Time after M410 in which Marlin accepts no moves, s."""


def execute_move(state: FirmwareState, words: Sequence[str | float | None]) -> Steps | None:
    """Execute a G0 or G1; `words` are the values of X, Y, Z, E and F, with None for a missing word."""
    feed = words[4]
    if feed is not None and float(feed) > 0.0:
        state.feed = float(feed) * state.unit / 60.0
    goal = find_move_target(state, words)
    block = _prepare_block(state, goal)
    if block is None:
        return None
    motion_queue = state.motion_queue
    motion_queue.advance(state.now)
    x, y, z, _ = state.position
    target = (x, y, z, state.filament)
    if motion_queue.free_places <= 0:
        return _push_when_place_is_free(state, block, target)
    motion_queue.push(block, target, state.now)
    return None


def find_move_target(state: FirmwareState, words: Sequence[str | float | None]) -> Axes:
    """Return the target, mm, of a move before clipping; `words` are the values of X, Y, Z and E."""
    x, y, z, e = state.position
    unit = state.unit
    x_word, y_word, z_word, e_word = words[0], words[1], words[2], words[3]
    if state.relative:
        base: Position = (x, y, z)
    else:
        offset = state.offset
        base = (-offset[0], -offset[1], -offset[2])
    if x_word is not None:
        x = float(x_word) * unit + base[0]
    if y_word is not None:
        y = float(y_word) * unit + base[1]
    if z_word is not None:
        z = float(z_word) * unit + base[2]
    if e_word is not None:
        e = float(e_word) * unit + (e if state.relative_e else 0.0)
    return x, y, z, e


def _prepare_block(state: FirmwareState, goal: Axes) -> Block | None:
    """Clip a move to `goal` and update the state; return the planner block, or None if nothing moves."""
    old = state.position
    low, high = state.machine.box_min, state.machine.box_max
    over = 0.0 if state.clips_moves else MAX_DISTANCE_OUTSIDE
    x, y, z, e = goal
    if not state.clips_moves and not state.warned_unhomed and not all(state.homed) and goal[:3] != old[:3]:
        if _is_small_lift(state, old, goal):
            state.record_violation("raised the nozzle before homing")
        else:
            state.warned_unhomed = True
            state.record_violation("moved before homing")
    if not (
        low[0] - over <= x <= high[0] + over
        and low[1] - over <= y <= high[1] + over
        and low[2] - over <= z <= high[2] + over
    ):
        x, y, z, e = goal = _clip_to_machine(state, goal, over)
    state.position = goal
    dx, dy, dz = x - old[0], y - old[1], z - old[2]
    de = (e - old[3]) * state.e_ratio
    if de and (
        (not state.hot and not state.is_hot_enough_to_extrude()) or abs(de) > state.machine.longest_extrusion
    ):
        _reject_extrusion(state)
        de = 0.0
    block = make_block(state.limits, (dx, dy, dz, de), state.feed * state.speed_ratio)
    if de > 0.0:
        state.filament += de
        state.statistics.filament_fed += de
        if state.filament > state.spool_end:
            state.run_out_of_filament()
        if block is not None and (dx or dy):
            state.statistics.add_extrusion(old, goal)
            if state.unhomed_motors:
                state.unhomed_motors.clear()  # so that this violation is reported only once
                state.record_violation("moved before homing, after the motors were off")
            rate = de / block.length * block.speed
            state.statistics.peak_feed = max(state.statistics.peak_feed, rate)
    elif de < 0.0:
        state.filament += de
        state.statistics.filament_retracted -= de
    return block


def _is_small_lift(state: FirmwareState, old: Axes, goal: Axes) -> bool:
    """Return whether a move from `old` to `goal` only lifts the nozzle a little, as many start G-codes do."""
    lift = goal[2] - old[2]
    return (
        state.firmware.dialect != "klipper" and goal[:2] == old[:2] and 0.0 < lift <= MAX_LIFT_BEFORE_HOMING
    )


def _reject_extrusion(state: FirmwareState) -> None:
    """Report a rejected extrusion; the firmware updates E without extruding and moves the other axes."""
    kind = "too long extrusion" if state.hot or state.is_hot_enough_to_extrude() else "cold extrusion"
    state.send_line(f"echo: {kind} prevented")
    state.record_violation(f"{kind} prevented")


def _clip_to_machine(state: FirmwareState, goal: Axes, margin: float) -> Axes:
    """Return `goal`, clipped to at most `margin` mm outside the machine; record a violation if clipped."""
    box = zip(goal[:3], state.machine.box_min, state.machine.box_max, strict=True)
    x, y, z = (min(max(at, low - margin), high + margin) for at, low, high in box)
    for letter, at, kept in zip("XYZ", goal, (x, y, z), strict=False):
        if at != kept:
            state.record_violation(f"out of the machine: {letter} {at:.3f}, stopped at {kept:.3f}")
    return x, y, z, goal[3]


def _push_when_place_is_free(state: FirmwareState, block: Block, target: Axes) -> Steps:
    """Add a move to the queue as soon as there is a free place; M410 discards a move that still waits."""
    motion_queue, stops = state.motion_queue, state.stops
    while motion_queue.free_places <= 0:
        yield motion_queue.ends
        if state.stops != stops:
            return
    motion_queue.push(block, target, state.now)


def move_straight(state: FirmwareState, command: Command) -> Steps | None:
    """G0, G1: move in a straight line."""
    return execute_move(state, [command.value(letter) for letter in "XYZEF"])


def move_straight_reading_zeros(state: FirmwareState, command: Command) -> Steps | None:
    """G0, G1 of firmwares whose parser, C's strtod, reads a letter without a number as 0."""
    zeros = {letter: 0.0 for letter in command.letters_without_number("XYZE") if not command.words[letter]}
    return execute_move(state, [zeros.get(letter, command.value(letter)) for letter in "XYZEF"])


def _move_along_arc(state: FirmwareState, command: Command) -> Steps | None:
    """G2, G3: move along an arc in the xy plane, given by its centre (I, J) or radius (R)."""
    words = [command.value(letter) for letter in "XYZEF"]
    if words[4] is not None and words[4] > 0.0:
        state.feed = words[4] * state.unit / 60.0
    start, goal = state.position, find_move_target(state, words)
    centre = _find_arc_centre(state, command, goal)
    if centre is None or hypot(start[0] - centre[0], start[1] - centre[1]) > MAX_ARC_RADIUS:
        state.send_line("Error:G2/G3 bad parameters")
        state.record_violation("arc without a centre")
        return None
    return _push_chords(state, split_arc(start, goal, centre, clockwise=command.code == "G2"))


def _find_arc_centre(state: FirmwareState, command: Command, goal: Axes) -> tuple[float, float] | None:
    """Return the centre of an arc to `goal`, mm; None if the command defines no centre."""
    start = state.position[0], state.position[1]
    radius = command.value("R")
    if radius is None:
        i, j = (command.value(letter) or 0.0 for letter in "IJ")
        return find_centre_by_offset(start, i * state.unit, j * state.unit)
    return find_centre_by_radius(
        start, (goal[0], goal[1]), radius * state.unit, clockwise=command.code == "G2"
    )


def _push_chords(state: FirmwareState, points: Iterator[Axes]) -> Steps:
    """Add the chords of an arc to the queue, one after the other."""
    stops = state.stops
    for point in points:
        block = _prepare_block(state, point)
        state.motion_queue.advance(state.now)
        if block is None:
            continue
        x, y, z, _ = state.position
        yield from _push_when_place_is_free(state, block, (x, y, z, state.filament))
        if state.stops != stops:
            return


def retract_or_recover(state: FirmwareState, command: Command) -> Steps | None:
    """G10: retract the filament; G11: deretract the filament. The E coordinate does not change."""
    back = command.code == "G10"
    if command.words or back == state.retracted:
        return None
    state.retracted = back
    length, out, forward, extra = state.retraction
    feed, position, ratio = state.feed, state.position, state.e_ratio
    state.feed, state.e_ratio = out if back else forward, 1.0
    x, y, z, e = position
    block = _prepare_block(state, (x, y, z, e - length if back else e + length + extra))
    state.feed, state.position, state.e_ratio = feed, position, ratio
    state.motion_queue.advance(state.now)
    return None if block is None else _push_when_place_is_free(state, block, (x, y, z, state.filament))


def _dwell(state: FirmwareState, command: Command) -> Steps:
    """G4: wait for the end of motion, then pause for S seconds or P milliseconds."""
    yield from state.wait_for_moves()
    seconds = (command.value("P") or 0.0) / 1000.0
    seconds = command.value("S") or seconds
    if seconds > 0.0:
        began = state.now
        state.show_message("Sleep...")
        yield from state.wait_until(began + seconds)
        state.statistics.dwell_seconds += state.now - began


def _home_axes(state: FirmwareState, command: Command) -> Steps:
    """G28: home the given axes, by default all axes, one after the other."""
    yield from state.wait_for_moves()
    machine = state.machine
    named = [axis for axis, letter in enumerate("XYZ") if letter in command.words]
    began = state.now
    position, offset = list(state.position), list(state.offset)
    for axis in named or range(3):
        way = abs(position[axis] - machine.home[axis])
        if axis in state.stuck_endstops:
            # The axis moves 1.5 times its length before homing fails.
            way = HOMING_TRAVEL_RATIO * (machine.box_max[axis] - machine.box_min[axis])
            yield from state.wait_until(state.now + way / machine.homing_speed[axis])
            state.handle_homing_failure("xyz"[axis])
            return
        yield from state.wait_until(state.now + way / machine.homing_speed[axis] + machine.homing_bump)
        position[axis] = machine.home[axis]
        offset[axis] = state.home_offset[axis]
        state.homed[axis] = True
        state.unhomed_motors.discard(axis)
        state.position = (position[0], position[1], position[2], position[3])
        state.offset = (offset[0], offset[1], offset[2])
        state.motion_queue.set_position((position[0], position[1], position[2], state.filament))
    state.statistics.homing_seconds += state.now - began
    state.update_clipping()
    if state.firmware.language == "marlin":
        state.send_line(state.format_position_report())


def probe_bed(state: FirmwareState, command: Command) -> Steps | None:
    """G29: probe the bed; the simulated bed is flat."""
    if state.machine.probe_points <= 0:
        state.reply_unknown_command(command.text)
        return None
    if not all(state.homed):
        state.send_line("echo:Home XYZ First")
        state.record_violation("probed before homing")
        return None
    return _wait_for_probing(state)


def _switch_bed_levelling(state: FirmwareState, command: Command) -> None:
    """M420: switch bed levelling, which has no effect because the simulated bed is flat."""
    if state.machine.probe_points <= 0:
        state.reply_unknown_command(command.text)


def _wait_for_probing(state: FirmwareState) -> Steps:
    """Wait for the end of motion, then for the time that probing all points takes."""
    yield from state.wait_for_moves()
    began = state.now
    yield from state.wait_until(began + state.machine.probe_points * state.machine.probe_seconds)
    state.statistics.homing_seconds += state.now - began


def _wait_for_motion(state: FirmwareState, _: Command) -> Steps:
    """M400, M900: wait for the end of motion."""
    yield from state.wait_for_moves()


def _disable_motors(state: FirmwareState, command: Command) -> Steps | None:
    """M84, M18: switch motors off; with S, do nothing, because the idle timeout is not simulated."""
    return None if "S" in command.words else _disable_motors_after_motion(state, command)


def _disable_motors_after_motion(state: FirmwareState, command: Command) -> Steps:
    """Wait for the end of motion, then switch the given or all motors off; Marlin keeps them homed."""
    yield from state.wait_for_moves()
    named = [axis for axis, letter in enumerate(AXES) if letter in command.words]
    state.unhomed_motors.update(axis for axis in named or range(3) if AXES[axis] != "E")


def _quick_stop(state: FirmwareState, _: Command) -> Steps | None:
    """M410: stop at once, unless the emergency parser has already executed this command."""
    if state.firmware.emergency_parser:
        return None
    return _stop_and_wait(state)


def _stop_and_wait(state: FirmwareState) -> Steps:
    """Stop all motion, then wait until the firmware accepts moves again."""
    state.stop_moving()
    yield from state.wait_until(state.now + STOP_SECONDS)


def _set_position(state: FirmwareState, command: Command) -> None:
    """G92: set the coordinates of the current position; for X, Y and Z, this changes the offset."""
    named = {letter: value * state.unit for letter, value in command.values(AXES).items()}
    x, y, z, e = state.position
    state.position = (x, y, z, named.get("E", e))
    at = zip("XYZ", (x, y, z), state.offset, strict=True)
    new = [named[letter] - here if letter in named else old for letter, here, old in at]
    state.offset = (new[0], new[1], new[2])
    if state.firmware.language == "marlin":
        state.send_line(state.format_position_report())


def _set_home_offset(state: FirmwareState, command: Command) -> None:
    """M206: set the home offset without moving."""
    for axis, letter in enumerate("XYZ"):
        value = command.value(letter)
        if value is not None:
            by = value * state.unit - state.home_offset[axis]
            state.home_offset = _shift_axis(state.home_offset, axis, by)
            state.offset = _shift_axis(state.offset, axis, by)


def offset_next_homing(state: FirmwareState, command: Command) -> None:
    """M206 of Smoothieware: set the offset for the next homing, in mm even after G20 (Endstops.cpp)."""
    for axis, letter in enumerate("XYZ"):
        value = command.value(letter)
        if value is not None:
            state.home_offset = _shift_axis(state.home_offset, axis, value - state.home_offset[axis])


def _shift_axis(position: Position, axis: int, by: float) -> Position:
    """Return a position shifted along one axis, mm."""
    x, y, z = (at + (by if axis == number else 0.0) for number, at in enumerate(position))
    return x, y, z


def move_in_machine_coordinates(state: FirmwareState, command: Command) -> Steps | None:
    """G53: execute the move that follows on the same line in machine coordinates."""
    inner = Command(command.rest, any_case=state.firmware.any_case)
    move = {"G0": move_straight, "G1": move_straight, "G2": _move_along_arc, "G3": _move_along_arc}.get(
        inner.code
    )
    if move is None:
        return None
    offset, state.offset = state.offset, (0.0, 0.0, 0.0)
    steps = move(state, inner)
    state.offset = offset
    return steps


def _babystep(state: FirmwareState, command: Command) -> Steps | None:
    """M290: shift the nozzle up or down without a change of the program coordinates."""
    if not state.firmware.babysteps:
        state.reply_unknown_command(command.text)
        return None
    step = command.value("Z") or command.value("S")
    if not step or not abs(step) <= MAX_BABYSTEP:
        return None
    z = state.position[2]
    feed, relative = state.feed, state.relative
    state.feed, state.relative = BABYSTEP_SPEED, True
    steps = execute_move(state, (None, None, step / state.unit, None, None))
    state.feed, state.relative = feed, relative
    dx, dy, dz = state.offset
    state.offset = (dx, dy, dz - (state.position[2] - z))
    return steps


def _set_positioning_mode(state: FirmwareState, command: Command) -> None:
    """G90, G91, M82, M83: set absolute or relative mode."""
    state.positioning = state.positioning.with_command(command.code)
    state.relative, state.relative_e = state.positioning.has_relative_axes, state.positioning.has_relative_e


def _set_units(state: FirmwareState, command: Command) -> None:
    """G20: use inches; G21: use millimetres."""
    state.unit = 25.4 if command.code == "G20" else 1.0
    state.update_e_ratio()


TABLE: Final = {
    "G0": move_straight,
    "G1": move_straight,
    "G2": _move_along_arc,
    "G3": _move_along_arc,
    "G4": _dwell,
    "G10": retract_or_recover,
    "G11": retract_or_recover,
    "G20": _set_units,
    "G21": _set_units,
    "G28": _home_axes,
    "G29": probe_bed,
    "G90": _set_positioning_mode,
    "G91": _set_positioning_mode,
    "G92": _set_position,
    "M18": _disable_motors,
    "M82": _set_positioning_mode,
    "M83": _set_positioning_mode,
    "M84": _disable_motors,
    "M206": _set_home_offset,
    "M290": _babystep,
    "M400": _wait_for_motion,
    "M410": _quick_stop,
    "M420": _switch_bed_levelling,
    "M900": _wait_for_motion,
}
