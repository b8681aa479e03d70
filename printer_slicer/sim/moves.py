"""Commands that move: straight lines, arcs, homing, probing, and the standing still in between.

A move is executed, and answered, when it has a place in the planner; that it is made later is the planner's
business.
"""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, Final

from printer_slicer.motion.arcs import arc_points, centre_by_offset, centre_by_radius
from printer_slicer.motion.rules import Axes, Block, make_block
from printer_slicer.sim.machine import AXES
from printer_slicer.sim.words import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.machine import Position

__all__ = [
    "FARTHEST",
    "HARMLESS_LIFT",
    "STOP_SECONDS",
    "TABLE",
    "firmware_retraction",
    "goal_of",
    "line",
    "line_of_zeros",
    "machine_move",
    "offset_next_homing",
    "probe",
    "straight",
]

LARGEST_RADIUS: Final = 10_000.0
"""mm; an arc of a larger circle has more chords than a firmware can count."""

FARTHEST: Final = 1000.0
"""mm outside the machine where nothing guards its edges: a number beyond is a slip, and no frame lets it come true."""

HOMING_REACH: Final = 1.5
HARMLESS_LIFT: Final = 10.0
"""mm up that a printer has room for wherever its nozzle stands; Klipper refuses to go there before homing."""

LARGEST_BABYSTEP: Final = 2.0
BABYSTEP_SPEED: Final = 2.0
"""mm and mm/s."""

STOP_SECONDS: Final = 1.0
"""s after M410 in which Marlin takes no moves."""


def straight(board: Board, words: Sequence[str | float | None]) -> Steps | None:
    """G0 and G1, with the words X, Y, Z, E, F or None for each."""
    feed = words[4]
    if feed is not None and float(feed) > 0.0:
        board.feed = float(feed) * board.unit / 60.0
    goal = goal_of(board, words)
    block = _prepared(board, goal)
    if block is None:
        return None
    mover = board.mover
    mover.advance(board.now)
    x, y, z, _ = board.position
    target = (x, y, z, board.filament)
    if mover.room <= 0:
        return _pushed_later(board, block, target)
    mover.push(block, target, board.now)
    return None


def goal_of(board: Board, words: Sequence[str | float | None]) -> Axes:
    """Where the words lead from the present position; not yet kept inside the machine."""
    x, y, z, e = board.position
    unit = board.unit
    x_word, y_word, z_word, e_word = words[0], words[1], words[2], words[3]
    if board.relative:
        base: Position = (x, y, z)
    else:
        offset = board.offset
        base = (-offset[0], -offset[1], -offset[2])
    if x_word is not None:
        x = float(x_word) * unit + base[0]
    if y_word is not None:
        y = float(y_word) * unit + base[1]
    if z_word is not None:
        z = float(z_word) * unit + base[2]
    if e_word is not None:
        e = float(e_word) * unit + (e if board.relative_e else 0.0)
    return x, y, z, e


def _prepared(board: Board, goal: Axes) -> Block | None:
    """The block to `goal` as the firmware allows it, with everything but its motion accounted for."""
    old = board.position
    low, high = board.machine.box_min, board.machine.box_max
    over = 0.0 if board.guarded else FARTHEST
    x, y, z, e = goal
    if not board.guarded and not board.warned_unhomed and not all(board.homed) and goal[:3] != old[:3]:
        if _lifts(board, old, goal):
            board.violated("raised the nozzle before homing")
        else:
            board.warned_unhomed = True
            board.violated("moved before homing")
    if not (
        low[0] - over <= x <= high[0] + over
        and low[1] - over <= y <= high[1] + over
        and low[2] - over <= z <= high[2] + over
    ):
        x, y, z, e = goal = _clamped(board, goal, over)
    board.position = goal
    dx, dy, dz = x - old[0], y - old[1], z - old[2]
    de = (e - old[3]) * board.e_ratio
    if de and ((not board.hot and not board.warm_enough()) or abs(de) > board.machine.longest_extrusion):
        _refuse_extrusion(board)
        de = 0.0
    block = make_block(board.limits, (dx, dy, dz, de), board.feed * board.speed_ratio)
    if de > 0.0:
        board.filament += de
        board.tally.filament_fed += de
        if board.filament > board.spool_end:
            board.spool_ended()
        if block is not None and (dx or dy):
            board.tally.laid(old, goal)
            if board.loose:
                board.loose.clear()  # once is enough
                board.violated("moved before homing, after the motors were off")
            rate = de / block.length * block.speed
            board.tally.peak_feed = max(board.tally.peak_feed, rate)
    elif de < 0.0:
        board.filament += de
        board.tally.filament_retracted -= de
    return block


def _lifts(board: Board, old: Axes, goal: Axes) -> bool:
    """Whether a move only raises the nozzle a little, as many start G-codes do on their way to homing."""
    lift = goal[2] - old[2]
    return board.front_end.flavour != "klipper" and goal[:2] == old[:2] and 0.0 < lift <= HARMLESS_LIFT


def _refuse_extrusion(board: Board) -> None:
    """Say why the extruder does not turn; the firmware takes the filament for fed and moves the rest."""
    what = "too long extrusion" if board.hot or board.warm_enough() else "cold extrusion"
    board.say(f"echo: {what} prevented")
    board.violated(f"{what} prevented")


def _clamped(board: Board, goal: Axes, over: float) -> Axes:
    """`goal` moved to the nearest place not more than `over` mm outside the machine."""
    box = zip(goal[:3], board.machine.box_min, board.machine.box_max, strict=True)
    x, y, z = (min(max(at, low - over), high + over) for at, low, high in box)
    for letter, at, kept in zip("XYZ", goal, (x, y, z), strict=False):
        if at != kept:
            board.violated(f"out of the machine: {letter} {at:.3f}, stopped at {kept:.3f}")
    return x, y, z, goal[3]


def _pushed_later(board: Board, block: Block, target: Axes) -> Steps:
    """Wait for a place in the planner. A move that M410 finds waiting is lost."""
    mover, stops = board.mover, board.stops
    while mover.room <= 0:
        yield mover.ends
        if board.stops != stops:
            return
    mover.push(block, target, board.now)


def line(board: Board, command: Command) -> Steps | None:
    """G0 and G1."""
    return straight(board, [command.value(letter) for letter in "XYZEF"])


def line_of_zeros(board: Board, command: Command) -> Steps | None:
    """G0 and G1 of firmwares that parse numbers with C's strtod, which reads a letter alone as 0."""
    zeros = {letter: 0.0 for letter in command.without_number("XYZE") if not command.words[letter]}
    return straight(board, [zeros.get(letter, command.value(letter)) for letter in "XYZEF"])


def _arc(board: Board, command: Command) -> Steps | None:
    """G2 and G3 by centre (I, J) or radius (R), in the xy plane."""
    words = [command.value(letter) for letter in "XYZEF"]
    if words[4] is not None and words[4] > 0.0:
        board.feed = words[4] * board.unit / 60.0
    start, goal = board.position, goal_of(board, words)
    centre = _centre(board, command, goal)
    if centre is None or hypot(start[0] - centre[0], start[1] - centre[1]) > LARGEST_RADIUS:
        board.say("Error:G2/G3 bad parameters")
        board.violated("arc without a centre")
        return None
    return _chords(board, arc_points(start, goal, centre, clockwise=command.code == "G2"))


def _centre(board: Board, command: Command, goal: Axes) -> tuple[float, float] | None:
    """Centre of the arc from the present position to `goal`, mm; None when the words do not give one."""
    start = board.position[0], board.position[1]
    radius = command.value("R")
    if radius is None:
        i, j = (command.value(letter) or 0.0 for letter in "IJ")
        return centre_by_offset(start, i * board.unit, j * board.unit)
    return centre_by_radius(start, (goal[0], goal[1]), radius * board.unit, clockwise=command.code == "G2")


def _chords(board: Board, points: Iterator[Axes]) -> Steps:
    """Push the chords one after the other, waiting for places."""
    stops = board.stops
    for point in points:
        block = _prepared(board, point)
        board.mover.advance(board.now)
        if block is None:
            continue
        x, y, z, _ = board.position
        yield from _pushed_later(board, block, (x, y, z, board.filament))
        if board.stops != stops:
            return


def firmware_retraction(board: Board, command: Command) -> Steps | None:
    """G10 and G11: turn the extruder by mm of filament, unless it is turned so already; E stays what it was."""
    back = command.code == "G10"
    if command.words or back == board.retracted:
        return None
    board.retracted = back
    length, out, forward, extra = board.retraction
    feed, position, ratio = board.feed, board.position, board.e_ratio
    board.feed, board.e_ratio = out if back else forward, 1.0
    x, y, z, e = position
    block = _prepared(board, (x, y, z, e - length if back else e + length + extra))
    board.feed, board.position, board.e_ratio = feed, position, ratio
    board.mover.advance(board.now)
    return None if block is None else _pushed_later(board, block, (x, y, z, board.filament))


def _dwell(board: Board, command: Command) -> Steps:
    """G4: stand still, then wait."""
    yield from board.drained()
    seconds = (command.value("P") or 0.0) / 1000.0
    seconds = command.value("S") or seconds
    if seconds > 0.0:
        began = board.now
        board.notify("Sleep...")
        yield from board.until(began + seconds)
        board.tally.dwell_seconds += board.now - began


def _home(board: Board, command: Command) -> Steps:
    """G28: drive to the endstops, x, y and z in turn."""
    yield from board.drained()
    machine = board.machine
    named = [axis for axis, letter in enumerate("XYZ") if letter in command.words]
    began = board.now
    position, offset = list(board.position), list(board.offset)
    for axis in named or range(3):
        way = abs(position[axis] - machine.home[axis])
        if axis in board.stuck_endstops:
            # It drives half as far again as the axis is long before it gives up.
            way = HOMING_REACH * (machine.box_max[axis] - machine.box_min[axis])
            yield from board.until(board.now + way / machine.homing_speed[axis])
            board.homing_failed("xyz"[axis])
            return
        yield from board.until(board.now + way / machine.homing_speed[axis] + machine.homing_bump)
        position[axis] = machine.home[axis]
        offset[axis] = board.home_offset[axis]
        board.homed[axis] = True
        board.loose.discard(axis)
        board.position = (position[0], position[1], position[2], position[3])
        board.offset = (offset[0], offset[1], offset[2])
        board.mover.place((position[0], position[1], position[2], board.filament))
    board.tally.homing_seconds += board.now - began
    board.guard()
    if board.front_end.language == "marlin":
        board.say(board.place())


def probe(board: Board, command: Command) -> Steps | None:
    """G29: touch the bed at some points; what is found changes nothing, the simulated bed is flat."""
    if board.machine.probe_points <= 0:
        board.unknown(command.text)
        return None
    if not all(board.homed):
        board.say("echo:Home XYZ First")
        board.violated("probed before homing")
        return None
    return _probing(board)


def _stored_mesh(board: Board, command: Command) -> None:
    """M420: use what G29 found, or not; the simulated bed is flat."""
    if board.machine.probe_points <= 0:
        board.unknown(command.text)


def _probing(board: Board) -> Steps:
    yield from board.drained()
    began = board.now
    yield from board.until(began + board.machine.probe_points * board.machine.probe_seconds)
    board.tally.homing_seconds += board.now - began


def _finish(board: Board, _: Command) -> Steps:
    """M400, M900: go on when everything planned was executed."""
    yield from board.drained()


def _motors_off(board: Board, command: Command) -> Steps | None:
    """M84 and M18; with S they only set a time limit."""
    return None if "S" in command.words else _loosening(board, command)


def _loosening(board: Board, command: Command) -> Steps:
    """Switch motors off, those named or all. Marlin then knows that they may be anywhere, and moves all the same."""
    yield from board.drained()
    named = [axis for axis, letter in enumerate(AXES) if letter in command.words]
    board.loose.update(axis for axis in named or range(3) if AXES[axis] != "E")


def _quick_stop(board: Board, _: Command) -> Steps | None:
    """M410. With an emergency parser it has acted long ago."""
    if board.front_end.emergency_parser:
        return None
    return _stopping(board)


def _stopping(board: Board) -> Steps:
    board.stop_moving()
    yield from board.until(board.now + STOP_SECONDS)


def _set_position(board: Board, command: Command) -> None:
    """G92: call the present position something else. E is simply set, the others get an offset."""
    named = {letter: value * board.unit for letter, value in command.values(AXES).items()}
    x, y, z, e = board.position
    board.position = (x, y, z, named.get("E", e))
    at = zip("XYZ", (x, y, z), board.offset, strict=True)
    new = [named[letter] - here if letter in named else old for letter, here, old in at]
    board.offset = (new[0], new[1], new[2])
    if board.front_end.language == "marlin":
        board.say(board.place())


def _offset_home(board: Board, command: Command) -> None:
    """M206: set the home offset without moving."""
    for axis, letter in enumerate("XYZ"):
        value = command.value(letter)
        if value is not None:
            by = value * board.unit - board.home_offset[axis]
            board.home_offset = _raised(board.home_offset, axis, by)
            board.offset = _raised(board.offset, axis, by)


def offset_next_homing(board: Board, command: Command) -> None:
    """M206 of Smoothieware, which applies it at the next homing and takes it in mm even after G20 (Endstops.cpp)."""
    for axis, letter in enumerate("XYZ"):
        value = command.value(letter)
        if value is not None:
            board.home_offset = _raised(board.home_offset, axis, value - board.home_offset[axis])


def _raised(place: Position, axis: int, by: float) -> Position:
    x, y, z = (at + (by if axis == number else 0.0) for number, at in enumerate(place))
    return x, y, z


def machine_move(board: Board, command: Command) -> Steps | None:
    """G53 before a move: use machine coordinates."""
    inner = Command(command.rest, any_case=board.front_end.any_case)
    move = {"G0": line, "G1": line, "G2": _arc, "G3": _arc}.get(inner.code)
    if move is None:
        return None
    offset, board.offset = board.offset, (0.0, 0.0, 0.0)
    steps = move(board, inner)
    board.offset = offset
    return steps


def _babystep(board: Board, command: Command) -> Steps | None:
    """M290: the nozzle goes up or down, and what the program calls its place stays."""
    if not board.front_end.babysteps:
        board.unknown(command.text)
        return None
    step = command.value("Z") or command.value("S")
    if not step or not abs(step) <= LARGEST_BABYSTEP:
        return None
    z = board.position[2]
    feed, relative = board.feed, board.relative
    board.feed, board.relative = BABYSTEP_SPEED, True
    steps = straight(board, (None, None, step / board.unit, None, None))
    board.feed, board.relative = feed, relative
    dx, dy, dz = board.offset
    board.offset = (dx, dy, dz - (board.position[2] - z))
    return steps


def _counts(board: Board, command: Command) -> None:
    """G90, G91, M82 and M83."""
    board.counting = board.counting.after(command.code)
    board.relative, board.relative_e = board.counting.axes, board.counting.e


def _units(board: Board, command: Command) -> None:
    board.unit = 25.4 if command.code == "G20" else 1.0
    board.reckon_e()


TABLE: Final = {
    "G0": line,
    "G1": line,
    "G2": _arc,
    "G3": _arc,
    "G4": _dwell,
    "G10": firmware_retraction,
    "G11": firmware_retraction,
    "G20": _units,
    "G21": _units,
    "G28": _home,
    "G29": probe,
    "G90": _counts,
    "G91": _counts,
    "G92": _set_position,
    "M18": _motors_off,
    "M82": _counts,
    "M83": _counts,
    "M84": _motors_off,
    "M206": _offset_home,
    "M290": _babystep,
    "M400": _finish,
    "M410": _quick_stop,
    "M420": _stored_mesh,
    "M900": _finish,
}
