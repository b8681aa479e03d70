"""Commands of the heaters and the fan."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.tool_change import hotend_of

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "tool_target", "wait_for_all"]

REPORT_SECONDS: Final = 1.0
COOLING_CHECK: Final = 60.0
COOLING_LEAST: Final = 1.5
"""A wait for cooling ends when a minute brings less than 1.5 °C; otherwise M109 R0 would never end."""


def _hotend_target(state: FirmwareState, command: Command) -> None:
    """M104: set the hotend temperature."""
    heater = hotend_of(state, command)
    if heater is not None:
        _aim(state, heater, command, "S")


def tool_target(state: FirmwareState, command: Command) -> None:
    """G10 P S and M568 of RepRapFirmware: set the temperature of a tool; without P, of the active one."""
    heater = hotend_of(state, command, "P")
    if heater is not None:
        _aim(state, heater, command, "S")


def wait_for_all(state: FirmwareState, _: Command) -> Steps:
    """M116 of RepRapFirmware: wait until all heaters reach their targets."""
    for heater in state.heaters.all():
        if heater.target > 0:
            yield from _waited(state, heater)


def _bed_target(state: FirmwareState, command: Command) -> None:
    """M140: set the bed temperature."""
    _aim(state, state.bed, command, "S")


def _hotend_wait(state: FirmwareState, command: Command) -> Steps | None:
    """M109: set the hotend temperature and wait; S waits for heating only, R for cooling too."""
    heater = hotend_of(state, command)
    return None if heater is None else _aim_and_wait(state, heater, command)


def _bed_wait(state: FirmwareState, command: Command) -> Steps | None:
    """M190: as M109, for the bed."""
    return _aim_and_wait(state, state.bed, command)


def _aim(state: FirmwareState, heater: Heater, command: Command, letters: str) -> bool:
    """Set the target from the first letter that has a number; return whether there was one."""
    for letter in letters:
        target = command.value(letter)
        if target is not None:
            highest = heater.spec.highest
            if target > highest:
                name = "bed" if heater is state.bed else "hotend"
                state.record_violation(
                    f"{name} asked for {target:.0f} °C, the printer allows {highest:.0f} °C"
                )
            state.set_target_of(heater, min(max(target, 0.0), highest))
            return True
    return False


def _aim_and_wait(state: FirmwareState, heater: Heater, command: Command) -> Steps | None:
    cools_too = command.value("S") is None
    if not _aim(state, heater, command, "SR"):
        return None
    if not cools_too and heater.reading(state.now) > heater.target:
        return None
    return _waited(state, heater)


def _waited(state: FirmwareState, heater: Heater) -> Steps:
    """Wait until the temperature has been near the target for a while, with a report every second.

    As in Marlin, there is no wait if the heater is near the target from the start.
    """
    began = state.now
    state.waiting = True
    state.motion_queue.expects_stop = True
    disturbances, arrives, done = state.heaters.disturbances, *_expected(heater, began, began)
    report = began
    before = heater.reading(began)
    check = began + COOLING_CHECK if before > heater.target else inf
    while state.waiting:
        if state.heaters.disturbances != disturbances:
            disturbances, arrives, done = state.heaters.disturbances, *_expected(heater, state.now, began)
        if state.now >= report:
            rest = "?" if state.now < arrives or arrives == began else str(int(done - state.now))
            _report(state, rest)
            report += REPORT_SECONDS
        if state.now >= check:
            check += COOLING_CHECK
            before, last = heater.reading(state.now), before
            if last - before < COOLING_LEAST:
                break
        if state.now >= done:
            break
        yield min(report, done, check)
    state.waiting = False
    state.statistics.heating_seconds += state.now - began


def _expected(heater: Heater, now: float, began: float) -> tuple[float, float]:
    """Return when the temperature will be near the target, and when the wait will end."""
    arrives = _arrival(heater, now)
    return arrives, began if arrives == began else arrives + heater.spec.residency


def _report(state: FirmwareState, rest: str) -> None:
    """Send the report of every second of a wait."""
    language = state.firmware.language
    if language == "klipper":
        state.report(state.temperatures())
    elif language == "virtual":
        state.report(f"T:{state.hotend.reading(state.now):.2f}")
    else:
        state.report(f" {state.temperatures()} W:{rest}")


def _arrival(heater: Heater, now: float) -> float:
    """Return when the reading enters the window around the target; infinite if never."""
    missing = heater.target - heater.reading(now)
    window = heater.spec.window
    if abs(missing) < window:
        return now
    if heater.stuck_at is not None:
        return inf
    edge = heater.target - window if missing > 0.0 else heater.target + window
    return now + heater.seconds_until(edge, now)


def _fan(state: FirmwareState, command: Command) -> None:
    """M106, M107: set the part cooling fan, which also cools the hotend."""
    if command.value("P"):
        return
    speed = command.value("S")
    ratio = 0.0 if command.code == "M107" else min(max(255.0 if speed is None else speed, 0.0), 255.0) / 255.0
    state.apply_flow_cooling()
    state.hotend.set_fan(ratio, state.now)
    state.hot = False


def _cold_extrusion(state: FirmwareState, command: Command) -> None:
    """M302: set the minimum extrusion temperature, or allow cold extrusion."""
    coldest, allowed = command.value("S"), command.value("P")
    if coldest is not None:
        state.coldest_extrusion = coldest
    if coldest is None and allowed is None:
        prefix = "en" if state.cold_allowed else "dis"
        state.say(f"echo:Cold extrudes are {prefix}abled (min temp {state.coldest_extrusion:.0f}C)")
        return
    state.cold_allowed = state.coldest_extrusion == 0.0 or bool(allowed)
    state.hot = False


TABLE: Final = {
    "M104": _hotend_target,
    "M106": _fan,
    "M107": _fan,
    "M109": _hotend_wait,
    "M140": _bed_target,
    "M190": _bed_wait,
    "M302": _cold_extrusion,
}
