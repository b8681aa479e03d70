"""Commands that Klipper handles differently: its rejections, errors and replies after a shutdown.

Every line gets an ok. Errors are lines that start with `!!`.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.heater_commands import TABLE as HEATER_TABLE
from printer_slicer.sim.move_commands import execute_move as execute_marlin_move
from printer_slicer.sim.move_commands import find_move_target

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = [
    "ALLOWED_AFTER_SHUTDOWN",
    "SHARED_COMMANDS",
    "TABLE",
    "execute_move",
    "reject_invalid_numbers",
    "send_shutdown_reply",
]

ALLOWED_AFTER_SHUTDOWN: Final = frozenset({"M105", "M110", "M112", "M115", "FIRMWARE_RESTART", "RESTART"})
"""Commands that are executed even after a shutdown."""

SHARED_COMMANDS: Final = frozenset(
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
"""Commands of Marlin that Klipper knows too, with the configuration from which replies were recorded."""

RESTART_SECONDS: Final = 1.7
MAX_EXTRUDE_ONLY_LENGTH: Final = 50.0
"""Maximum extrusion without motion, mm of filament: the option max_extrude_only_distance."""

_SHUTDOWN_REPLY: Final = (
    "// Once the underlying issue is corrected, use the",
    '// "FIRMWARE_RESTART" command to reset the firmware, reload the',
    "// config, and restart the host software.",
    "// Printer is shutdown",
)


def send_shutdown_reply(state: FirmwareState) -> None:
    """Reply that the printer is shut down, and record the violation."""
    first = "Shutdown due to M112 command" if "M112" in state.shut_down else state.shut_down
    for line in (f"// {first}", *_SHUTDOWN_REPLY, f"!! {first}"):
        state.send_line(line)
    state.record_violation("the printer has shut down")


def execute_move(state: FirmwareState, words: Sequence[str | float | None]) -> Steps | None:
    """G0 and G1: reject an invalid move completely, whereas Marlin would execute part of the move."""
    if state.shut_down:
        send_shutdown_reply(state)
        return None
    goal = find_move_target(state, words)
    error = _explain_unreachable(state, goal) or _explain_rejected_extrusion(state, goal)
    if error:
        state.send_line(f"!! {error}")
        option = _CONFIG_OPTIONS.get(error.partition(" (")[0])
        if option:
            state.send_line(f"// See the '{option}' config option for details")
        state.record_violation(error)
        return None
    return execute_marlin_move(state, words)


_CONFIG_OPTIONS: Final = {
    "Extrude below minimum temp": "min_extrude_temp",
    "Extrude only move too long": "max_extrude_only_distance",
    "Move exceeds maximum extrusion": "max_extrude_cross_section",
}


def _explain_unreachable(state: FirmwareState, goal: Axes) -> str:
    """Return the error message for a target that cannot be reached; empty for a reachable target."""
    x, y, z, e = goal
    here = f"{x:.3f} {y:.3f} {z:.3f} [{e:.3f}]"
    low, high = state.machine.box_min, state.machine.box_max
    moved = [axis for axis in range(3) if goal[axis] != state.position[axis]]
    if not all(state.homed[axis] for axis in moved):
        return f"Must home axis first: {here}"
    if not all(low[axis] <= goal[axis] <= high[axis] for axis in moved):
        return f"Move out of range: {here}"
    return ""


def _explain_rejected_extrusion(state: FirmwareState, goal: Axes) -> str:
    """Return the error message for an extrusion that is not allowed; empty for an allowed extrusion."""
    fed = (goal[3] - state.position[3]) * state.e_ratio
    if not fed:
        return ""
    if not state.hot and not state.is_hot_enough_to_extrude():
        return "Extrude below minimum temp"
    way = sqrt(sum((goal[axis] - state.position[axis]) ** 2 for axis in range(3)))
    if not way:
        longest = MAX_EXTRUDE_ONLY_LENGTH
        return (
            f"Extrude only move too long ({abs(fed):.3f}mm vs {longest:.3f}mm)" if abs(fed) > longest else ""
        )
    machine = state.machine
    filament, most = pi * machine.filament_diameter**2 / 4.0, 4.0 * machine.nozzle**2
    area = fed / way * filament
    if area > most and fed > machine.nozzle * most / filament:
        return f"Move exceeds maximum extrusion ({area:.3f}mm^2 vs {most:.3f}mm^2)"
    return ""


def reject_invalid_numbers(state: FirmwareState, command: Command) -> bool:
    """Reject a move with an invalid number, such as `G1 Z.2.3`; return whether the move was rejected."""
    if not command.letters_without_number("XYZEF"):
        return False
    state.send_line(f"!! Unable to parse move '{command.text}'")
    state.record_violation("move that cannot be parsed")
    return True


def _move_if_valid(state: FirmwareState, command: Command) -> Steps | None:
    """G0, G1: move, unless the command has an invalid number."""
    if not state.shut_down and reject_invalid_numbers(state, command):
        return None
    return execute_move(state, [command.value(letter) for letter in "XYZEF"])


def _queue_dwell(state: FirmwareState, command: Command) -> Steps | None:
    """G4: queue a pause behind the planned moves."""
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    if seconds <= 0.0:
        return None
    state.statistics.dwell_seconds += seconds
    state.statistics.motion_seconds -= seconds  # the planner will count it
    return _queue_dwell_and_wait(state, seconds)


def _queue_dwell_and_wait(state: FirmwareState, seconds: float) -> Steps:
    """Queue a pause; wait for the end of a long pause."""
    yield from state.queue_pause(seconds)
    if seconds > state.firmware.ahead_seconds:  # a longer pause is acknowledged at its end
        yield from state.wait_until(state.now + seconds)


def _disable_motors(state: FirmwareState, _: Command) -> Steps:
    """M84, M18: switch all motors off, after which all axes must be homed again."""
    yield from state.wait_for_moves()
    state.homed = [False, False, False]
    state.update_clipping()


def _send_text(state: FirmwareState, command: Command) -> None:
    """M118: send a text to the host."""
    state.send_line(f"echo: {command.rest}")


def _emergency_stop(state: FirmwareState, _: Command) -> None:
    """M112: record the emergency stop; the firmware already shut down when this line was queued."""
    state.record_violation("emergency stop")
    if not state.shut_down:
        state.kill("M112 Shutdown")


def _restart_firmware(state: FirmwareState, _: Command) -> None:
    """FIRMWARE_RESTART, RESTART: restart the firmware after the ok."""

    def disconnect() -> None:
        """Announce the disconnection, and set the alarm for the reset."""
        state.send_line("// Klipper state: Disconnect")
        state.set_alarm("restart", state.now + RESTART_SECONDS, state.reset)

    state.set_alarm("restart", state.now, disconnect)


def _set_temperature(code: str, command: Command, state: FirmwareState) -> Steps | None:
    """Set a temperature; reject a temperature that is out of range instead of lowering it."""
    heater = state.bed if code in {"M140", "M190"} else state.hotend
    target = command.value("S")
    if target is not None and not 0.0 <= target <= heater.spec.highest:
        state.send_line(
            f"!! Requested temperature ({target:.1f}) out of range (0.0:{heater.spec.highest:.1f})"
        )
        state.record_violation("temperature out of range")
        return None
    return HEATER_TABLE[code](state, command)


def _ignore_command(_: FirmwareState, __: Command) -> None:
    """Accept a command that has no visible effect."""


TABLE: Final = {
    "G0": _move_if_valid,
    "G1": _move_if_valid,
    "G4": _queue_dwell,
    "M84": _disable_motors,
    "M18": _disable_motors,
    "M112": _emergency_stop,
    "M118": _send_text,
    "FIRMWARE_RESTART": _restart_firmware,
    "RESTART": _restart_firmware,
    "SET_GCODE_OFFSET": _ignore_command,
    "SET_PRESSURE_ADVANCE": _ignore_command,
    "STATUS": _ignore_command,
    **{
        code: lambda state, command: _set_temperature(command.code, command, state)
        for code in ("M104", "M109", "M140", "M190")
    },
}
