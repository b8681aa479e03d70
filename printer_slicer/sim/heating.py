"""Commands of the heaters and the fan."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.tools import hotend_of

if TYPE_CHECKING:
    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.words import Command

__all__ = ["TABLE", "tool_target", "wait_for_all"]

REPORT_SECONDS: Final = 1.0
COOLING_CHECK: Final = 60.0
COOLING_LEAST: Final = 1.5
"""A wait for cooling gives up when a minute brought less than 1.5 °C: M109 R0 would never end otherwise."""


def _hotend_target(board: Board, command: Command) -> None:
    """M104."""
    heater = hotend_of(board, command)
    if heater is not None:
        _aim(board, heater, command, "S")


def tool_target(board: Board, command: Command) -> None:
    """G10 P S of RepRapFirmware, and M568: the temperature of a tool, of the one in use without P."""
    heater = hotend_of(board, command, "P")
    if heater is not None:
        _aim(board, heater, command, "S")


def wait_for_all(board: Board, _: Command) -> Steps:
    """M116 of RepRapFirmware: until every heater is where it should be."""
    for heater in board.heaters.all():
        if heater.target > 0:
            yield from _waited(board, heater)


def _bed_target(board: Board, command: Command) -> None:
    """M140."""
    _aim(board, board.bed, command, "S")


def _hotend_wait(board: Board, command: Command) -> Steps | None:
    """M109: S waits for heating only, R for cooling too."""
    heater = hotend_of(board, command)
    return None if heater is None else _aim_and_wait(board, heater, command)


def _bed_wait(board: Board, command: Command) -> Steps | None:
    """M190: as M109."""
    return _aim_and_wait(board, board.bed, command)


def _aim(board: Board, heater: Heater, command: Command, letters: str) -> bool:
    """Set the target by the first of the letters that has a number; whether there was one."""
    for letter in letters:
        target = command.value(letter)
        if target is not None:
            highest = heater.spec.highest
            if target > highest:
                name = "bed" if heater is board.bed else "hotend"
                board.violated(f"{name} asked for {target:.0f} °C, the machine allows {highest:.0f} °C")
            board.aim(heater, min(max(target, 0.0), highest))
            return True
    return False


def _aim_and_wait(board: Board, heater: Heater, command: Command) -> Steps | None:
    cools_too = command.value("S") is None
    if not _aim(board, heater, command, "SR"):
        return None
    if not cools_too and heater.reading(board.now) > heater.target:
        return None
    return _waited(board, heater)


def _waited(board: Board, heater: Heater) -> Steps:
    """Wait until the temperature has been near the target for a while, with a report every second.

    A heater that is near the target from the start is not waited for, as in Marlin.
    """
    began = board.now
    board.waiting = True
    board.mover.expects_stop = True
    upsets, arrives, done = board.heaters.upsets, *_expected(heater, began, began)
    report = began
    before = heater.reading(began)
    check = began + COOLING_CHECK if before > heater.target else inf
    while board.waiting:
        if board.heaters.upsets != upsets:
            upsets, arrives, done = board.heaters.upsets, *_expected(heater, board.now, began)
        if board.now >= report:
            rest = "?" if board.now < arrives or arrives == began else str(int(done - board.now))
            _report(board, rest)
            report += REPORT_SECONDS
        if board.now >= check:
            check += COOLING_CHECK
            before, last = heater.reading(board.now), before
            if last - before < COOLING_LEAST:
                break
        if board.now >= done:
            break
        yield min(report, done, check)
    board.waiting = False
    board.tally.heating_seconds += board.now - began


def _expected(heater: Heater, now: float, began: float) -> tuple[float, float]:
    """When the temperature will be near the target, and when the wait that began then will be over."""
    arrives = _arrival(heater, now)
    return arrives, began if arrives == began else arrives + heater.spec.residency


def _report(board: Board, rest: str) -> None:
    """What is said every second of a wait."""
    language = board.front_end.language
    if language == "klipper":
        board.report(board.temperatures())
    elif language == "virtual":
        board.report(f"T:{board.hotend.reading(board.now):.2f}")
    else:
        board.report(f" {board.temperatures()} W:{rest}")


def _arrival(heater: Heater, now: float) -> float:
    """When the sensor reads what lies within the window around the target; infinite when it never does."""
    missing = heater.target - heater.reading(now)
    window = heater.spec.window
    if abs(missing) < window:
        return now
    if heater.stuck_at is not None:
        return inf
    edge = heater.target - window if missing > 0.0 else heater.target + window
    return now + heater.seconds_until(edge, now)


def _fan(board: Board, command: Command) -> None:
    """M106 and M107: the part cooling fan, which also cools the hotend."""
    if command.value("P"):
        return
    speed = command.value("S")
    ratio = 0.0 if command.code == "M107" else min(max(255.0 if speed is None else speed, 0.0), 255.0) / 255.0
    board.settle()
    board.hotend.set_fan(ratio, board.now)
    board.hot = False


def _cold_extrusion(board: Board, command: Command) -> None:
    """M302: allow cold extrusion or say from which temperature on it is allowed."""
    coldest, allowed = command.value("S"), command.value("P")
    if coldest is not None:
        board.coldest_extrusion = coldest
    if coldest is None and allowed is None:
        state = "en" if board.cold_allowed else "dis"
        board.say(f"echo:Cold extrudes are {state}abled (min temp {board.coldest_extrusion:.0f}C)")
        return
    board.cold_allowed = board.coldest_extrusion == 0.0 or bool(allowed)
    board.hot = False


TABLE: Final = {
    "M104": _hotend_target,
    "M106": _fan,
    "M107": _fan,
    "M109": _hotend_wait,
    "M140": _bed_target,
    "M190": _bed_wait,
    "M302": _cold_extrusion,
}
