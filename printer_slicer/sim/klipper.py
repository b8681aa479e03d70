"""Differences of Klipper from Marlin: rejected commands, error messages, and replies after a shutdown.

Every line gets an ok. Errors are lines that start with `!!`.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.heater_commands import TABLE as HEATING
from printer_slicer.sim.move_commands import execute_move as go
from printer_slicer.sim.move_commands import target_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["ANYWAY", "KNOWN", "TABLE", "execute_move", "refuse_shut_down", "unparsed"]

ANYWAY: Final = frozenset({"M105", "M110", "M112", "M115", "FIRMWARE_RESTART", "RESTART"})
"""Commands that are executed even after a shutdown."""

KNOWN: Final = frozenset(
    (
        *(
            "G0",
            "G1",
            "G20",
            "G21",
            "G28",
            "G90",
            "G91",
            "G92",
            "M18",
            "M82",
            "M83",
            "M84",
            "M104",
            "M105",
            "M106",
            "M107",
        ),
        *("M109", "M110", "M112", "M114", "M115", "M119", "M140", "M190", "M204", "M220", "M221", "M400"),
    )
)
"""Commands shared with Marlin, in the recorded configuration."""

RESTART_SECONDS: Final = 1.7
LONGEST_EXTRUSION: Final = 50.0
"""Longest extrusion without motion, mm of filament: the option max_extrude_only_distance."""

_SHUT_DOWN: Final = (
    "// Once the underlying issue is corrected, use the",
    '// "FIRMWARE_RESTART" command to reset the firmware, reload the',
    "// config, and restart the host software.",
    "// Printer is shutdown",
)


def refuse_shut_down(state: FirmwareState) -> None:
    """Reply that the printer is shut down."""
    first = "Shutdown due to M112 command" if "M112" in state.shut_down else state.shut_down
    for line in (f"// {first}", *_SHUT_DOWN, f"!! {first}"):
        state.say(line)
    state.record_violation("the printer has shut down")


def execute_move(state: FirmwareState, words: Sequence[str | float | None]) -> Steps | None:
    """G0 and G1: reject an invalid move as a whole, where Marlin would execute part of it."""
    if state.shut_down:
        refuse_shut_down(state)
        return None
    goal = target_of(state, words)
    why = _out_of_reach(state, goal) or _not_to_extrude(state, goal)
    if why:
        state.say(f"!! {why}")
        option = _OPTIONS.get(why.partition(" (")[0])
        if option:
            state.say(f"// See the '{option}' config option for details")
        state.record_violation(why)
        return None
    return go(state, words)


_OPTIONS: Final = {
    "Extrude below minimum temp": "min_extrude_temp",
    "Extrude only move too long": "max_extrude_only_distance",
    "Move exceeds maximum extrusion": "max_extrude_cross_section",
}


def _out_of_reach(state: FirmwareState, goal: Axes) -> str:
    """Return why a target cannot be reached; empty if it can."""
    x, y, z, e = goal
    here = f"{x:.3f} {y:.3f} {z:.3f} [{e:.3f}]"
    low, high = state.machine.box_min, state.machine.box_max
    moved = [axis for axis in range(3) if goal[axis] != state.position[axis]]
    if not all(state.homed[axis] for axis in moved):
        return f"Must home axis first: {here}"
    if not all(low[axis] <= goal[axis] <= high[axis] for axis in moved):
        return f"Move out of range: {here}"
    return ""


def _not_to_extrude(state: FirmwareState, goal: Axes) -> str:
    """Return why an extrusion is rejected; empty if it is allowed."""
    fed = (goal[3] - state.position[3]) * state.e_ratio
    if not fed:
        return ""
    if not state.hot and not state.is_warm_enough():
        return "Extrude below minimum temp"
    way = sqrt(sum((goal[axis] - state.position[axis]) ** 2 for axis in range(3)))
    if not way:
        longest = LONGEST_EXTRUSION
        return (
            f"Extrude only move too long ({abs(fed):.3f}mm vs {longest:.3f}mm)" if abs(fed) > longest else ""
        )
    machine = state.machine
    filament, most = pi * machine.filament_diameter**2 / 4.0, 4.0 * machine.nozzle**2
    area = fed / way * filament
    if area > most and fed > machine.nozzle * most / filament:
        return f"Move exceeds maximum extrusion ({area:.3f}mm^2 vs {most:.3f}mm^2)"
    return ""


def unparsed(state: FirmwareState, command: Command) -> bool:
    """Reject a move with an invalid number, as the real one does with `G1 Z.2.3`; return whether it was rejected."""
    if not command.without_number("XYZEF"):
        return False
    state.say(f"!! Unable to parse move '{command.text}'")
    state.record_violation("move that cannot be parsed")
    return True


def _move(state: FirmwareState, command: Command) -> Steps | None:
    if not state.shut_down and unparsed(state, command):
        return None
    return execute_move(state, [command.value(letter) for letter in "XYZEF"])


def _dwell(state: FirmwareState, command: Command) -> Steps | None:
    """G4: queue a pause as a move without distance."""
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    if seconds <= 0.0:
        return None
    state.statistics.dwell_seconds += seconds
    state.statistics.motion_seconds -= seconds  # the planner will count it
    return _dwelling(state, seconds)


def _dwelling(state: FirmwareState, seconds: float) -> Steps:
    yield from state.planned_pause(seconds)
    if seconds > state.firmware.ahead_seconds:  # a longer pause is acknowledged at its end
        yield from state.until(state.now + seconds)


def _motors_off(state: FirmwareState, _: Command) -> Steps:
    """M84, M18: switch all motors off; no axis is homed any more."""
    yield from state.wait_for_moves()
    state.homed = [False, False, False]
    state.update_clipping()


def _tell(state: FirmwareState, command: Command) -> None:
    """M118: send a text to the host."""
    state.say(f"echo: {command.rest}")


def _stop(state: FirmwareState, _: Command) -> None:
    """M112, which took effect when the line was queued."""
    state.record_violation("emergency stop")
    if not state.shut_down:
        state.kill("M112 Shutdown")


def _restart(state: FirmwareState, _: Command) -> None:
    """FIRMWARE_RESTART: restart after the ok."""

    def leave() -> None:
        """Disconnect, and reset later."""
        state.say("// Klipper state: Disconnect")
        state.set_alarm("restart", state.now + RESTART_SECONDS, state.reset)

    state.set_alarm("restart", state.now, leave)


def _heat(code: str, command: Command, state: FirmwareState) -> Steps | None:
    """Set a temperature; reject it above the maximum, instead of lowering it."""
    heater = state.bed if code in {"M140", "M190"} else state.hotend
    target = command.value("S")
    if target is not None and not 0.0 <= target <= heater.spec.highest:
        state.say(f"!! Requested temperature ({target:.1f}) out of range (0.0:{heater.spec.highest:.1f})")
        state.record_violation("temperature out of range")
        return None
    return HEATING[code](state, command)


def _nothing(_: FirmwareState, __: Command) -> None:
    """Accept a command that has no visible effect."""


TABLE: Final = {
    "G0": _move,
    "G1": _move,
    "G4": _dwell,
    "M84": _motors_off,
    "M18": _motors_off,
    "M112": _stop,
    "M118": _tell,
    "FIRMWARE_RESTART": _restart,
    "RESTART": _restart,
    "SET_GCODE_OFFSET": _nothing,
    "SET_PRESSURE_ADVANCE": _nothing,
    "STATUS": _nothing,
    **{
        code: lambda state, command: _heat(command.code, command, state)
        for code in ("M104", "M109", "M140", "M190")
    },
}
