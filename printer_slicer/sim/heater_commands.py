"""Commands for the heaters and the fan."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.tool_change import find_hotend

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "set_tool_temperature", "wait_for_all_heaters"]

REPORT_INTERVAL: Final = 1.0
COOLING_CHECK_SECONDS: Final = 60.0
MIN_COOLING: Final = 1.5
"""A wait for cooling ends if the heater cools less than this in a minute, °C; M109 R0 would never end."""


def _set_hotend_temperature(state: FirmwareState, command: Command) -> None:
    """M104: set the hotend temperature."""
    heater = find_hotend(state, command)
    if heater is not None:
        _set_target(state, heater, command, "S")


def set_tool_temperature(state: FirmwareState, command: Command) -> None:
    """G10 and M568 of RepRapFirmware: set the temperature S of tool P, or of the active tool without P."""
    heater = find_hotend(state, command, "P")
    if heater is not None:
        _set_target(state, heater, command, "S")


def wait_for_all_heaters(state: FirmwareState, _: Command) -> Steps:
    """M116 of RepRapFirmware: wait until all heaters reach their targets."""
    for heater in state.heaters.all_heaters():
        if heater.target > 0:
            yield from _wait_for_target(state, heater)


def _set_bed_temperature(state: FirmwareState, command: Command) -> None:
    """M140: set the bed temperature."""
    _set_target(state, state.bed, command, "S")


def _heat_hotend_and_wait(state: FirmwareState, command: Command) -> Steps | None:
    """M109: set the hotend temperature and wait; S waits for heating only, R for cooling too."""
    heater = find_hotend(state, command)
    return None if heater is None else _set_target_and_wait(state, heater, command)


def _heat_bed_and_wait(state: FirmwareState, command: Command) -> Steps | None:
    """M190: set the bed temperature and wait; S waits for heating only, R for cooling too."""
    return _set_target_and_wait(state, state.bed, command)


def _set_target(state: FirmwareState, heater: Heater, command: Command, letters: str) -> bool:
    """Set the target from the first of these letters with a number; return whether there is such a letter."""
    for letter in letters:
        target = command.value(letter)
        if target is not None:
            highest = heater.spec.highest
            if target > highest:
                name = "bed" if heater is state.bed else "hotend"
                state.record_violation(
                    f"{name} target {target:.0f} °C is above the maximum of {highest:.0f} °C"
                )
            state.set_heater_target(heater, min(max(target, 0.0), highest))
            return True
    return False


def _set_target_and_wait(state: FirmwareState, heater: Heater, command: Command) -> Steps | None:
    """Set the target of a heater and wait for it; return None if there is nothing to wait for."""
    cools_too = command.value("S") is None
    if not _set_target(state, heater, command, "SR"):
        return None
    if not cools_too and heater.sensor_reading(state.now) > heater.target:
        return None
    return _wait_for_target(state, heater)


def _wait_for_target(state: FirmwareState, heater: Heater) -> Steps:
    """Wait until the temperature has stayed near the target for some time; send a report every second.

    As in Marlin, there is no wait if the heater is near the target at the start.
    """
    began = state.now
    state.waiting = True
    state.motion_queue.expects_stop = True
    fault_changes, arrives, done = state.heaters.fault_changes, *_estimate_wait(heater, began, began)
    report = began
    before = heater.sensor_reading(began)
    check = began + COOLING_CHECK_SECONDS if before > heater.target else inf
    while state.waiting:
        if state.heaters.fault_changes != fault_changes:
            fault_changes, arrives, done = (
                state.heaters.fault_changes,
                *_estimate_wait(heater, state.now, began),
            )
        if state.now >= report:
            rest = "?" if state.now < arrives or arrives == began else str(int(done - state.now))
            _send_wait_report(state, rest)
            report += REPORT_INTERVAL
        if state.now >= check:
            check += COOLING_CHECK_SECONDS
            before, last = heater.sensor_reading(state.now), before
            if last - before < MIN_COOLING:
                break
        if state.now >= done:
            break
        yield min(report, done, check)
    state.waiting = False
    state.statistics.heating_seconds += state.now - began


def _estimate_wait(heater: Heater, now: float, began: float) -> tuple[float, float]:
    """Return when the temperature will get near the target, and when the wait will end, both in s."""
    arrives = _estimate_arrival(heater, now)
    return arrives, began if arrives == began else arrives + heater.spec.residency


def _send_wait_report(state: FirmwareState, rest: str) -> None:
    """Send the temperature report of a waiting command, with `rest`, the remaining seconds."""
    language = state.firmware.language
    if language == "klipper":
        state.send_report(state.format_temperature_report())
    elif language == "virtual":
        state.send_report(f"T:{state.hotend.sensor_reading(state.now):.2f}")
    else:
        state.send_report(f" {state.format_temperature_report()} W:{rest}")


def _estimate_arrival(heater: Heater, now: float) -> float:
    """Return the time, s, at which the sensor reading gets near the target; infinite for never."""
    missing = heater.target - heater.sensor_reading(now)
    window = heater.spec.window
    if abs(missing) < window:
        return now
    if heater.stuck_at is not None:
        return inf
    edge = heater.target - window if missing > 0.0 else heater.target + window
    return now + heater.seconds_until(edge, now)


def _set_fan(state: FirmwareState, command: Command) -> None:
    """M106, M107: set the part cooling fan, which also cools the hotend."""
    if command.value("P"):
        return
    speed = command.value("S")
    ratio = 0.0 if command.code == "M107" else min(max(255.0 if speed is None else speed, 0.0), 255.0) / 255.0
    state.apply_flow_cooling()
    state.hotend.set_fan(ratio, state.now)
    state.hot = False


def _set_cold_extrusion(state: FirmwareState, command: Command) -> None:
    """M302: set the minimum temperature for extrusion, or allow cold extrusion."""
    coldest, allowed = command.value("S"), command.value("P")
    if coldest is not None:
        state.coldest_extrusion = coldest
    if coldest is None and allowed is None:
        prefix = "en" if state.cold_allowed else "dis"
        state.send_line(f"echo:Cold extrudes are {prefix}abled (min temp {state.coldest_extrusion:.0f}C)")
        return
    state.cold_allowed = state.coldest_extrusion == 0.0 or bool(allowed)
    state.hot = False


TABLE: Final = {
    "M104": _set_hotend_temperature,
    "M106": _set_fan,
    "M107": _set_fan,
    "M109": _heat_hotend_and_wait,
    "M140": _set_bed_temperature,
    "M190": _heat_bed_and_wait,
    "M302": _set_cold_extrusion,
}
