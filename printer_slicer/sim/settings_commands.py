"""Commands for reports, messages, motion limits and other settings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.sim.machine import AXES, replace_axis_values
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "ignore_command", "positive_values", "set_accelerations"]


def _report_temperatures(state: FirmwareState, _: Command) -> None:
    """M105: report the temperatures in the same line as the ok."""
    state.ok_tail = " " + state.format_temperature_report()


def _parse_interval(command: Command) -> int | None:
    """Return the interval S in whole seconds, at most a minute as in firmware; None without S."""
    seconds = command.value("S")
    return None if seconds is None else min(max(int(seconds), 0), 60)


def _set_temperature_reports(state: FirmwareState, command: Command) -> None:
    """M155: report the temperatures every S seconds."""
    seconds = _parse_interval(command)
    if seconds is not None:
        state.report_every("temperatures", seconds, lambda: " " + state.format_temperature_report())


def _set_position_reports(state: FirmwareState, command: Command) -> None:
    """M154: report the position every S seconds."""
    if not state.firmware.reports_position:
        state.reply_unknown_command(command.text)
        return
    seconds = _parse_interval(command)
    if seconds is not None:
        state.report_every("position", seconds, state.format_position_report)


def _set_busy_reports(state: FirmwareState, command: Command) -> None:
    """M113: set or report the interval of busy reports."""
    seconds = _parse_interval(command)
    if seconds is None:
        state.send_line(f"echo:M113 S{state.busy_seconds:.0f}")
    else:
        state.busy_seconds = float(seconds)


def _set_line_number(state: FirmwareState, command: Command) -> None:
    """M110: set or report the line number; `LineReader` has set it already if the line had a number."""
    number = command.value("N")
    if number is not None:
        state.renumber = int(number)
    elif state.firmware.reports_line_number:
        state.send_line(f"echo: M110 N{state.last_line}")


def _emergency_stop(state: FirmwareState, _: Command) -> None:
    """M112: halt the firmware, unless the command already took effect when it arrived."""
    state.record_violation("emergency stop")
    state.kill("M112 Shutdown")


def _report_position(state: FirmwareState, _: Command) -> None:
    """M114: report the position."""
    state.send_line(state.format_position_report())


def _report_firmware(state: FirmwareState, _: Command) -> None:
    """M115: report the firmware and its capabilities."""
    firmware, machine = state.firmware, state.machine
    reply, ok_reply, identity = firmware.identity.format(
        name=firmware.name, tools=machine.extruders
    ).partition("ok ")
    if ok_reply:
        state.ok_tail = f" {identity}"
    else:
        state.send_line(reply)
    if not firmware.lists_capabilities:
        return
    for name, present in firmware.list_capabilities(machine):
        state.send_line(f"Cap:{name}:{int(present)}")
    if firmware.reports_area:
        low, high = (
            ",".join(f"{letter}:{at:.2f}" for letter, at in zip("xyz", corner, strict=True))
            for corner in (machine.box_min, machine.box_max)
        )
        area = f"{{min:{{{low}}},max:{{{high}}}}}"
        state.send_line(f"area:{{full:{area},work:{area}}}")


def _show_message(state: FirmwareState, command: Command) -> None:
    """M117: show a message on the display."""
    if command.rest:
        state.show_message(command.rest)


def _send_text(state: FirmwareState, command: Command) -> None:
    """M118: send a text to the host; E1 puts `echo:` before it, A1 puts `//` before it."""
    text, lead = command.rest, ""
    while len(text) >= 2 and text[0] in "AEP" and text[1].isdigit():
        option, _, text = text.partition(" ")
        if option[1:] != "0":
            lead = {"E": "echo:", "A": "// "}.get(option[0], lead)
    state.send_line(lead + text)


def _report_endstops(state: FirmwareState, _: Command) -> None:
    """M119: report which endstops are triggered."""
    state.send_line("Reporting endstop status")
    at = state.motion_queue.position(state.now)
    for axis, letter in enumerate("xyz"):
        closed = (
            state.homed[axis] and at[axis] <= state.machine.home[axis] and axis not in state.stuck_endstops
        )
        state.send_line(f"{letter}_min: {'TRIGGERED' if closed else 'open'}")


def _switch_soft_endstops(state: FirmwareState, command: Command) -> None:
    """M211: switch the software endstops on or off, or report them."""
    switch = command.value("S")
    if switch is not None:
        state.soft_endstops = bool(switch)
        state.update_clipping()
        return
    low, high = (
        " ".join(f"{letter}{at:.2f}" for letter, at in zip("XYZ", corner, strict=True))
        for corner in (state.machine.box_min, state.machine.box_max)
    )
    state.send_line(
        f"echo:Soft endstops: {'On' if state.soft_endstops else 'Off'}  Min:  {low}   Max:  {high}"
    )


def _set_steps(state: FirmwareState, command: Command) -> None:
    """M92: set the steps per mm."""
    state.steps = replace_axis_values(state.steps, command.values(AXES))


def _set_max_accelerations(state: FirmwareState, command: Command) -> None:
    """M201: set the maximum accelerations of the axes."""
    most = replace_axis_values(state.limits.max_acceleration, positive_values(command, AXES))
    state.set_limits(replace(state.limits, max_acceleration=most))


def _set_max_speeds(state: FirmwareState, command: Command) -> None:
    """M203: set the maximum speeds of the axes."""
    most = replace_axis_values(state.limits.max_speed, positive_values(command, AXES))
    state.set_limits(replace(state.limits, max_speed=most))


def _set_move_accelerations(state: FirmwareState, command: Command) -> None:
    """M204: set the accelerations for printing (P), travel (T), retraction (R), or printing and travel (S)."""
    new = positive_values(command, "PRST")
    both = new.get("S")
    set_accelerations(state, new.get("P", both), new.get("T", both), new.get("R"))


def set_accelerations(
    state: FirmwareState,
    printing: float | None = None,
    travel: float | None = None,
    retract: float | None = None,
) -> None:
    """Set the accelerations of moves, mm/s²; None leaves an acceleration unchanged."""
    old = state.limits
    state.set_limits(
        replace(
            old,
            acceleration=printing or old.acceleration,
            travel_acceleration=travel or old.travel_acceleration,
            retract_acceleration=retract or old.retract_acceleration,
        )
    )


def _set_retraction(state: FirmwareState, command: Command) -> None:
    """M207: set retraction length S and extra deretraction R, mm; their speeds F and T, mm/min."""
    new, (length, back, forward, extra) = command.values("SFTR"), state.retraction
    back, forward = new.get("F", back * 60) / 60, new.get("T", forward * 60) / 60
    state.retraction = new.get("S", length), back, forward, new.get("R", extra)


def _set_deretraction(state: FirmwareState, command: Command) -> None:
    """M208: set deretraction speed F (mm/min) and extra deretraction length S (mm)."""
    new, (length, back, forward, extra) = command.values("FS"), state.retraction
    state.retraction = length, back, new.get("F", forward * 60) / 60, new.get("S", extra)


def _set_cornering(state: FirmwareState, command: Command) -> None:
    """M205: set the junction deviation (J) and the jerk of the axes."""
    old = state.limits
    deviation = positive_values(command, "J").get("J", old.junction_deviation)
    jerk = replace_axis_values(old.jerk, positive_values(command, AXES))
    state.set_limits(replace(old, junction_deviation=deviation, jerk=jerk))


MIN_LIMIT: Final = 1e-6
"""A limit below this value counts as zero, because firmware stores 32-bit floats and prints two decimals."""


def positive_values(command: Command, letters: str) -> dict[str, float]:
    """Return the values of these letters that are positive; with a limit of zero, no move would ever end."""
    return {letter: value for letter, value in command.values(letters).items() if value > MIN_LIMIT}


def _set_speed_ratio(state: FirmwareState, command: Command) -> None:
    """M220: set or report the speed override."""
    percent = command.value("S")
    if percent is None:
        state.send_line(f"FR:{state.speed_ratio * 100:.0f}%")
    else:
        state.speed_ratio = min(max(percent, 1.0), 999.0) / 100.0


def _set_flow_ratio(state: FirmwareState, command: Command) -> None:
    """M221: set or report the flow override."""
    percent = command.value("S")
    if percent is None:
        state.send_line(f"echo:E0 Flow: {state.flow_ratio * 100:.0f}%")
    else:
        state.flow_ratio = max(percent, 0.0) / 100.0
        state.update_e_ratio()


def _report_settings(state: FirmwareState, command: Command) -> None:
    """M503: report the settings; with S0, without comments."""
    limits, plain = state.limits, command.value("S") == 0.0
    general, retracting, travel = limits.acceleration, limits.retract_acceleration, limits.travel_acceleration
    lines = (
        ("; Linear Units:", "  G21 ; (mm)"),
        ("; Steps per unit:", f"  M92 {_format_axes(state.steps)}"),
        ("; Max feedrates (units/s):", f"  M203 {_format_axes(limits.max_speed)}"),
        ("; Max Acceleration (units/s2):", f"  M201 {_format_axes(limits.max_acceleration)}"),
        ("; Acceleration (units/s2):", f"  M204 P{general:.2f} R{retracting:.2f} T{travel:.2f}"),
        ("; Advanced:", f"  M205 B20000.00 S0.00 T0.00 {_format_cornering(limits)}"),
    )
    for heading, line in lines:
        if not plain:
            state.send_line(f"echo:{heading}")
        state.send_line(line if plain else f"echo:{line}")


def _format_axes(axes: Axes) -> str:
    """Return the words X, Y, Z and E with the values of the axes."""
    return " ".join(f"{letter}{value:.2f}" for letter, value in zip(AXES, axes, strict=True))


def _format_cornering(limits: MotionLimits) -> str:
    """Return the word of the junction deviation, or the words of the jerk if the machine uses jerk."""
    if limits.corner == "junction_deviation":
        return f"J{limits.junction_deviation:.2f}"
    return _format_axes(limits.jerk)


def _start_or_stop_timer(state: FirmwareState, command: Command) -> None:
    """M75: start the print timer; M76 and M77: stop the print timer."""
    state.stop_timer()
    if command.code == "M75":
        state.timer_began = state.now


def _report_print_time(state: FirmwareState, _: Command) -> None:
    """M31: report the print time."""
    running = 0.0 if state.timer_began is None else state.now - state.timer_began
    seconds = int(state.timer_seconds + running)
    parts = [(seconds // 86400, "d"), (seconds // 3600 % 24, "h"), (seconds // 60 % 60, "m")]
    while parts and parts[0][0] == 0:
        parts.pop(0)
    state.send_line("echo:Print time: " + "".join(f"{n}{unit} " for n, unit in parts) + f"{seconds % 60}s")


def ignore_command(_: FirmwareState, __: Command) -> None:
    """Accept a command that has no visible effect."""


def _set_volumetric_extrusion(state: FirmwareState, command: Command) -> None:
    """M200: make E a volume, for filament of diameter D; S0 or D0 switch this off, S1 on again."""
    diameter, switch = command.value("D"), command.value("S")
    new = positive_values(command, "D")
    if new:
        state.diameter = new["D"] * state.unit
    if diameter is not None or switch is not None:
        state.volumetric = bool(new) if switch is None else bool(switch)
    state.update_e_ratio()


TABLE: Final = {
    "M17": ignore_command,
    "M31": _report_print_time,
    "M73": ignore_command,
    "M75": _start_or_stop_timer,
    "M76": _start_or_stop_timer,
    "M77": _start_or_stop_timer,
    "M92": _set_steps,
    "M105": _report_temperatures,
    "M108": ignore_command,
    "M110": _set_line_number,
    "M112": _emergency_stop,
    "M113": _set_busy_reports,
    "M114": _report_position,
    "M115": _report_firmware,
    "M117": _show_message,
    "M118": _send_text,
    "M119": _report_endstops,
    "M154": _set_position_reports,
    "M155": _set_temperature_reports,
    "M200": _set_volumetric_extrusion,
    "M201": _set_max_accelerations,
    "M203": _set_max_speeds,
    "M204": _set_move_accelerations,
    "M205": _set_cornering,
    "M207": _set_retraction,
    "M208": _set_deretraction,
    "M211": _switch_soft_endstops,
    "M220": _set_speed_ratio,
    "M221": _set_flow_ratio,
    "M300": ignore_command,
    "M486": ignore_command,
    "M503": _report_settings,
    "M999": ignore_command,
}
