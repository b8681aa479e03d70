"""Commands that ask, tell or set something: reports, messages, limits, counters."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.machine import AXES, replaced

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.board import Board
    from printer_slicer.sim.words import Command

__all__ = ["TABLE", "limit_accelerations", "nothing", "positive"]


def _temperatures(board: Board, _: Command) -> None:
    """M105: the answer is part of the ok."""
    board.ok_tail = " " + board.temperatures()


def _seconds(command: Command) -> int | None:
    """The whole seconds behind S, as firmware keeps them: at most a minute."""
    seconds = command.value("S")
    return None if seconds is None else min(max(int(seconds), 0), 60)


def _temperature_reports(board: Board, command: Command) -> None:
    """M155."""
    seconds = _seconds(command)
    if seconds is not None:
        board.repeat("temperatures", seconds, lambda: " " + board.temperatures())


def _position_reports(board: Board, command: Command) -> None:
    """M154."""
    if not board.front_end.reports_position:
        board.unknown(command.text)
        return
    seconds = _seconds(command)
    if seconds is not None:
        board.repeat("position", seconds, board.place)


def _busy_reports(board: Board, command: Command) -> None:
    """M113."""
    seconds = _seconds(command)
    if seconds is None:
        board.say(f"echo:M113 S{board.busy_seconds:.0f}")
    else:
        board.busy_seconds = float(seconds)


def _line_number(board: Board, command: Command) -> None:
    """M110; the reader of lines has obeyed already when the line itself had a number."""
    number = command.value("N")
    if number is not None:
        board.renumber = int(number)
    elif board.front_end.counts:
        board.say(f"echo: M110 N{board.last_line}")


def _kill(board: Board, _: Command) -> None:
    """M112, when nothing saw it earlier."""
    board.violated("emergency stop")
    board.kill("M112 Shutdown")


def _place(board: Board, _: Command) -> None:
    """M114."""
    board.say(board.place())


def _firmware(board: Board, _: Command) -> None:
    """M115."""
    front_end, machine = board.front_end, board.machine
    told, bare, identity = front_end.identity.format(name=front_end.name, tools=machine.extruders).partition(
        "ok "
    )
    if bare:
        board.ok_tail = f" {identity}"
    else:
        board.say(told)
    if not front_end.lists_capabilities:
        return
    for name, present in front_end.capabilities(machine):
        board.say(f"Cap:{name}:{int(present)}")
    if front_end.reports_area:
        low, high = (
            ",".join(f"{letter}:{at:.2f}" for letter, at in zip("xyz", corner, strict=True))
            for corner in (machine.box_min, machine.box_max)
        )
        area = f"{{min:{{{low}}},max:{{{high}}}}}"
        board.say(f"area:{{full:{area},work:{area}}}")


def _show(board: Board, command: Command) -> None:
    """M117."""
    if command.rest:
        board.notify(command.rest)


def _tell(board: Board, command: Command) -> None:
    """M118: E1 in front says it as an echo, A1 as a comment for the host."""
    text, lead = command.rest, ""
    while len(text) >= 2 and text[0] in "AEP" and text[1].isdigit():
        option, _, text = text.partition(" ")
        if option[1:] != "0":
            lead = {"E": "echo:", "A": "// "}.get(option[0], lead)
    board.say(lead + text)


def _endstops(board: Board, _: Command) -> None:
    """M119."""
    board.say("Reporting endstop status")
    at = board.mover.position(board.now)
    for axis, letter in enumerate("xyz"):
        closed = (
            board.homed[axis] and at[axis] <= board.machine.home[axis] and axis not in board.stuck_endstops
        )
        board.say(f"{letter}_min: {'TRIGGERED' if closed else 'open'}")


def _soft_endstops(board: Board, command: Command) -> None:
    """M211."""
    switch = command.value("S")
    if switch is not None:
        board.soft_endstops = bool(switch)
        board.guard()
        return
    low, high = (
        " ".join(f"{letter}{at:.2f}" for letter, at in zip("XYZ", corner, strict=True))
        for corner in (board.machine.box_min, board.machine.box_max)
    )
    board.say(f"echo:Soft endstops: {'On' if board.soft_endstops else 'Off'}  Min:  {low}   Max:  {high}")


def _steps(board: Board, command: Command) -> None:
    """M92."""
    board.steps = replaced(board.steps, command.values(AXES))


def _accelerations(board: Board, command: Command) -> None:
    """M201."""
    most = replaced(board.limits.max_acceleration, positive(command, AXES))
    board.set_limits(replace(board.limits, max_acceleration=most))


def _speeds(board: Board, command: Command) -> None:
    """M203."""
    most = replaced(board.limits.max_speed, positive(command, AXES))
    board.set_limits(replace(board.limits, max_speed=most))


def _move_accelerations(board: Board, command: Command) -> None:
    """M204: P printing, T travel, R retraction; S is the old word for P and T."""
    new = positive(command, "PRST")
    both = new.get("S")
    limit_accelerations(board, new.get("P", both), new.get("T", both), new.get("R"))


def limit_accelerations(
    board: Board, printing: float | None = None, travel: float | None = None, retract: float | None = None
) -> None:
    """Set accelerations, mm/s²; None leaves one as it is."""
    old = board.limits
    board.set_limits(
        replace(
            old,
            acceleration=printing or old.acceleration,
            travel_acceleration=travel or old.travel_acceleration,
            retract_acceleration=retract or old.retract_acceleration,
        )
    )


def _retraction(board: Board, command: Command) -> None:
    """M207: S mm, F mm/min, and forward T mm/min and R mm more."""
    new, (length, back, forward, extra) = command.values("SFTR"), board.retraction
    back, forward = new.get("F", back * 60) / 60, new.get("T", forward * 60) / 60
    board.retraction = new.get("S", length), back, forward, new.get("R", extra)


def _deretraction(board: Board, command: Command) -> None:
    """M208: forward F mm/min, and S mm more."""
    new, (length, back, forward, extra) = command.values("FS"), board.retraction
    board.retraction = length, back, new.get("F", forward * 60) / 60, new.get("S", extra)


def _corners(board: Board, command: Command) -> None:
    """M205: J junction deviation, X Y Z E jerk."""
    old = board.limits
    deviation = positive(command, "J").get("J", old.junction_deviation)
    jerk = replaced(old.jerk, positive(command, AXES))
    board.set_limits(replace(old, junction_deviation=deviation, jerk=jerk))


LEAST: Final = 1e-6
"""Smaller numbers are zero to a firmware that keeps them in 32 bits and prints two decimals."""


def positive(command: Command, letters: str) -> dict[str, float]:
    """The values that can be limits; a machine with a limit of zero would never arrive."""
    return {letter: value for letter, value in command.values(letters).items() if value > LEAST}


def _speed_ratio(board: Board, command: Command) -> None:
    """M220."""
    percent = command.value("S")
    if percent is None:
        board.say(f"FR:{board.speed_ratio * 100:.0f}%")
    else:
        board.speed_ratio = min(max(percent, 1.0), 999.0) / 100.0


def _flow_ratio(board: Board, command: Command) -> None:
    """M221."""
    percent = command.value("S")
    if percent is None:
        board.say(f"echo:E0 Flow: {board.flow_ratio * 100:.0f}%")
    else:
        board.flow_ratio = max(percent, 0.0) / 100.0
        board.reckon_e()


def _settings(board: Board, command: Command) -> None:
    """M503: the settings that the simulated firmware has."""
    limits, plain = board.limits, command.value("S") == 0.0
    general, retracting, travel = limits.acceleration, limits.retract_acceleration, limits.travel_acceleration
    lines = (
        ("; Linear Units:", "  G21 ; (mm)"),
        ("; Steps per unit:", f"  M92 {_words(board.steps)}"),
        ("; Max feedrates (units/s):", f"  M203 {_words(limits.max_speed)}"),
        ("; Max Acceleration (units/s2):", f"  M201 {_words(limits.max_acceleration)}"),
        ("; Acceleration (units/s2):", f"  M204 P{general:.2f} R{retracting:.2f} T{travel:.2f}"),
        ("; Advanced:", f"  M205 B20000.00 S0.00 T0.00 {_corner_words(limits)}"),
    )
    for heading, line in lines:
        if not plain:
            board.say(f"echo:{heading}")
        board.say(line if plain else f"echo:{line}")


def _words(axes: Axes) -> str:
    """X, Y, Z and E with their values, as settings are said."""
    return " ".join(f"{letter}{value:.2f}" for letter, value in zip(AXES, axes, strict=True))


def _corner_words(limits: MotionLimits) -> str:
    """J or X, Y, Z and E, whichever the machine's corner rule goes by."""
    if limits.corner == "junction_deviation":
        return f"J{limits.junction_deviation:.2f}"
    return _words(limits.jerk)


def _timer(board: Board, command: Command) -> None:
    """M75 starts the print timer, M76 and M77 stop it."""
    board.stop_timer()
    if command.code == "M75":
        board.timer_began = board.now


def _timer_reading(board: Board, _: Command) -> None:
    """M31."""
    running = 0.0 if board.timer_began is None else board.now - board.timer_began
    seconds = int(board.timer_seconds + running)
    parts = [(seconds // 86400, "d"), (seconds // 3600 % 24, "h"), (seconds // 60 % 60, "m")]
    while parts and parts[0][0] == 0:
        parts.pop(0)
    board.say("echo:Print time: " + "".join(f"{n}{unit} " for n, unit in parts) + f"{seconds % 60}s")


def nothing(_: Board, __: Command) -> None:
    """Known, and without an effect that could be seen from outside."""


def _volumetric(board: Board, command: Command) -> None:
    """M200: E counts volume of a filament of diameter D; D0 or S0 ends it, S1 goes back to it."""
    diameter, switch = command.value("D"), command.value("S")
    new = positive(command, "D")
    if new:
        board.diameter = new["D"] * board.unit
    if diameter is not None or switch is not None:
        board.volumetric = bool(new) if switch is None else bool(switch)
    board.reckon_e()


TABLE: Final = {
    "M17": nothing,
    "M31": _timer_reading,
    "M73": nothing,
    "M75": _timer,
    "M76": _timer,
    "M77": _timer,
    "M92": _steps,
    "M105": _temperatures,
    "M108": nothing,
    "M110": _line_number,
    "M112": _kill,
    "M113": _busy_reports,
    "M114": _place,
    "M115": _firmware,
    "M117": _show,
    "M118": _tell,
    "M119": _endstops,
    "M154": _position_reports,
    "M155": _temperature_reports,
    "M200": _volumetric,
    "M201": _accelerations,
    "M203": _speeds,
    "M204": _move_accelerations,
    "M205": _corners,
    "M207": _retraction,
    "M208": _deretraction,
    "M211": _soft_endstops,
    "M220": _speed_ratio,
    "M221": _flow_ratio,
    "M300": nothing,
    "M486": nothing,
    "M503": _settings,
    "M999": nothing,
}
