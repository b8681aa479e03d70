"""Commands for reports, messages, motion limits and other settings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.machine import AXES, replaced

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "limit_accelerations", "nothing", "positive"]


def _temperatures(state: FirmwareState, _: Command) -> None:
    """M105: report temperatures in the ok."""
    state.ok_tail = " " + state.temperatures()


def _seconds(command: Command) -> int | None:
    """Return the integer interval of S, limited to a minute as in firmware."""
    seconds = command.value("S")
    return None if seconds is None else min(max(int(seconds), 0), 60)


def _temperature_reports(state: FirmwareState, command: Command) -> None:
    """M155: report temperatures at an interval."""
    seconds = _seconds(command)
    if seconds is not None:
        state.report_every("temperatures", seconds, lambda: " " + state.temperatures())


def _position_reports(state: FirmwareState, command: Command) -> None:
    """M154: report the position at an interval."""
    if not state.firmware.reports_position:
        state.unknown(command.text)
        return
    seconds = _seconds(command)
    if seconds is not None:
        state.report_every("position", seconds, state.position_report)


def _busy_reports(state: FirmwareState, command: Command) -> None:
    """M113: set the interval of busy reports."""
    seconds = _seconds(command)
    if seconds is None:
        state.say(f"echo:M113 S{state.busy_seconds:.0f}")
    else:
        state.busy_seconds = float(seconds)


def _line_number(state: FirmwareState, command: Command) -> None:
    """M110: set the line number; `LineReader` has done so if the line itself was numbered."""
    number = command.value("N")
    if number is not None:
        state.renumber = int(number)
    elif state.firmware.counts:
        state.say(f"echo: M110 N{state.last_line}")


def _kill(state: FirmwareState, _: Command) -> None:
    """M112, if nothing handled it earlier."""
    state.record_violation("emergency stop")
    state.kill("M112 Shutdown")


def _place(state: FirmwareState, _: Command) -> None:
    """M114: report the position."""
    state.say(state.position_report())


def _firmware(state: FirmwareState, _: Command) -> None:
    """M115: report firmware and capabilities."""
    firmware, machine = state.firmware, state.machine
    told, bare, identity = firmware.identity.format(name=firmware.name, tools=machine.extruders).partition(
        "ok "
    )
    if bare:
        state.ok_tail = f" {identity}"
    else:
        state.say(told)
    if not firmware.lists_capabilities:
        return
    for name, present in firmware.capabilities(machine):
        state.say(f"Cap:{name}:{int(present)}")
    if firmware.reports_area:
        low, high = (
            ",".join(f"{letter}:{at:.2f}" for letter, at in zip("xyz", corner, strict=True))
            for corner in (machine.box_min, machine.box_max)
        )
        area = f"{{min:{{{low}}},max:{{{high}}}}}"
        state.say(f"area:{{full:{area},work:{area}}}")


def _show(state: FirmwareState, command: Command) -> None:
    """M117: show a message."""
    if command.rest:
        state.notify(command.rest)


def _tell(state: FirmwareState, command: Command) -> None:
    """M118: send a text to the host; E1 sends it as echo, A1 as a comment."""
    text, lead = command.rest, ""
    while len(text) >= 2 and text[0] in "AEP" and text[1].isdigit():
        option, _, text = text.partition(" ")
        if option[1:] != "0":
            lead = {"E": "echo:", "A": "// "}.get(option[0], lead)
    state.say(lead + text)


def _endstops(state: FirmwareState, _: Command) -> None:
    """M119: report the endstops."""
    state.say("Reporting endstop status")
    at = state.motion_queue.position(state.now)
    for axis, letter in enumerate("xyz"):
        closed = (
            state.homed[axis] and at[axis] <= state.machine.home[axis] and axis not in state.stuck_endstops
        )
        state.say(f"{letter}_min: {'TRIGGERED' if closed else 'open'}")


def _soft_endstops(state: FirmwareState, command: Command) -> None:
    """M211: switch the software endstops, or report them."""
    switch = command.value("S")
    if switch is not None:
        state.soft_endstops = bool(switch)
        state.update_clipping()
        return
    low, high = (
        " ".join(f"{letter}{at:.2f}" for letter, at in zip("XYZ", corner, strict=True))
        for corner in (state.machine.box_min, state.machine.box_max)
    )
    state.say(f"echo:Soft endstops: {'On' if state.soft_endstops else 'Off'}  Min:  {low}   Max:  {high}")


def _steps(state: FirmwareState, command: Command) -> None:
    """M92: set steps per mm."""
    state.steps = replaced(state.steps, command.values(AXES))


def _accelerations(state: FirmwareState, command: Command) -> None:
    """M201: set maximum accelerations."""
    most = replaced(state.limits.max_acceleration, positive(command, AXES))
    state.set_limits(replace(state.limits, max_acceleration=most))


def _speeds(state: FirmwareState, command: Command) -> None:
    """M203: set maximum speeds."""
    most = replaced(state.limits.max_speed, positive(command, AXES))
    state.set_limits(replace(state.limits, max_speed=most))


def _move_accelerations(state: FirmwareState, command: Command) -> None:
    """M204: set accelerations: P printing, T travel, R retraction, S both P and T."""
    new = positive(command, "PRST")
    both = new.get("S")
    limit_accelerations(state, new.get("P", both), new.get("T", both), new.get("R"))


def limit_accelerations(
    state: FirmwareState,
    printing: float | None = None,
    travel: float | None = None,
    retract: float | None = None,
) -> None:
    """Set accelerations, mm/s²; None leaves one unchanged."""
    old = state.limits
    state.set_limits(
        replace(
            old,
            acceleration=printing or old.acceleration,
            travel_acceleration=travel or old.travel_acceleration,
            retract_acceleration=retract or old.retract_acceleration,
        )
    )


def _retraction(state: FirmwareState, command: Command) -> None:
    """M207: set retraction length S (mm), speed F (mm/min), recover speed T (mm/min), extra recover length R (mm)."""
    new, (length, back, forward, extra) = command.values("SFTR"), state.retraction
    back, forward = new.get("F", back * 60) / 60, new.get("T", forward * 60) / 60
    state.retraction = new.get("S", length), back, forward, new.get("R", extra)


def _deretraction(state: FirmwareState, command: Command) -> None:
    """M208: set recover speed F (mm/min) and extra recover length S (mm)."""
    new, (length, back, forward, extra) = command.values("FS"), state.retraction
    state.retraction = length, back, new.get("F", forward * 60) / 60, new.get("S", extra)


def _corners(state: FirmwareState, command: Command) -> None:
    """M205: set junction deviation J and jerk X Y Z E."""
    old = state.limits
    deviation = positive(command, "J").get("J", old.junction_deviation)
    jerk = replaced(old.jerk, positive(command, AXES))
    state.set_limits(replace(old, junction_deviation=deviation, jerk=jerk))


LEAST: Final = 1e-6
"""Smaller values count as zero: firmware keeps 32-bit floats and prints two decimals."""


def positive(command: Command, letters: str) -> dict[str, float]:
    """Return the positive values of a command; with a limit of zero, no move would ever end."""
    return {letter: value for letter, value in command.values(letters).items() if value > LEAST}


def _speed_ratio(state: FirmwareState, command: Command) -> None:
    """M220: set or report the speed override."""
    percent = command.value("S")
    if percent is None:
        state.say(f"FR:{state.speed_ratio * 100:.0f}%")
    else:
        state.speed_ratio = min(max(percent, 1.0), 999.0) / 100.0


def _flow_ratio(state: FirmwareState, command: Command) -> None:
    """M221: set or report the flow override."""
    percent = command.value("S")
    if percent is None:
        state.say(f"echo:E0 Flow: {state.flow_ratio * 100:.0f}%")
    else:
        state.flow_ratio = max(percent, 0.0) / 100.0
        state.update_e_ratio()


def _settings(state: FirmwareState, command: Command) -> None:
    """M503: report the settings."""
    limits, plain = state.limits, command.value("S") == 0.0
    general, retracting, travel = limits.acceleration, limits.retract_acceleration, limits.travel_acceleration
    lines = (
        ("; Linear Units:", "  G21 ; (mm)"),
        ("; Steps per unit:", f"  M92 {_words(state.steps)}"),
        ("; Max feedrates (units/s):", f"  M203 {_words(limits.max_speed)}"),
        ("; Max Acceleration (units/s2):", f"  M201 {_words(limits.max_acceleration)}"),
        ("; Acceleration (units/s2):", f"  M204 P{general:.2f} R{retracting:.2f} T{travel:.2f}"),
        ("; Advanced:", f"  M205 B20000.00 S0.00 T0.00 {_corner_words(limits)}"),
    )
    for heading, line in lines:
        if not plain:
            state.say(f"echo:{heading}")
        state.say(line if plain else f"echo:{line}")


def _words(axes: Axes) -> str:
    """Format the values of X, Y, Z and E."""
    return " ".join(f"{letter}{value:.2f}" for letter, value in zip(AXES, axes, strict=True))


def _corner_words(limits: MotionLimits) -> str:
    """Format junction deviation or jerk, depending on the corner rule of the machine."""
    if limits.corner == "junction_deviation":
        return f"J{limits.junction_deviation:.2f}"
    return _words(limits.jerk)


def _timer(state: FirmwareState, command: Command) -> None:
    """M75: start the print timer; M76, M77: stop it."""
    state.stop_timer()
    if command.code == "M75":
        state.timer_began = state.now


def _timer_reading(state: FirmwareState, _: Command) -> None:
    """M31: report the print time."""
    running = 0.0 if state.timer_began is None else state.now - state.timer_began
    seconds = int(state.timer_seconds + running)
    parts = [(seconds // 86400, "d"), (seconds // 3600 % 24, "h"), (seconds // 60 % 60, "m")]
    while parts and parts[0][0] == 0:
        parts.pop(0)
    state.say("echo:Print time: " + "".join(f"{n}{unit} " for n, unit in parts) + f"{seconds % 60}s")


def nothing(_: FirmwareState, __: Command) -> None:
    """Accept a command that has no visible effect."""


def _volumetric(state: FirmwareState, command: Command) -> None:
    """M200: let E count volume for filament diameter D; D0 or S0 switch it off, S1 on again."""
    diameter, switch = command.value("D"), command.value("S")
    new = positive(command, "D")
    if new:
        state.diameter = new["D"] * state.unit
    if diameter is not None or switch is not None:
        state.volumetric = bool(new) if switch is None else bool(switch)
    state.update_e_ratio()


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
