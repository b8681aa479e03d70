"""Commands of other dialects than that of Marlin 2, or with a different meaning there.

The simulated printer replies as Marlin does; these tables let it execute files for other firmwares. The `firmware`
package names the sources.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.heater_commands import tool_target, wait_for_all
from printer_slicer.sim.klipper import unparsed
from printer_slicer.sim.machine import AXES, replaced
from printer_slicer.sim.move_commands import (
    firmware_retraction,
    linear_move,
    linear_move_with_zeros,
    machine_move,
    offset_next_homing,
    probe,
)
from printer_slicer.sim.pause_commands import ask_person
from printer_slicer.sim.settings_commands import limit_accelerations, nothing, positive

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["DIALECT_COMMANDS"]

_MINUTE: Final = 60.0


def _velocity_limit(state: FirmwareState, command: Command) -> None:
    """SET_VELOCITY_LIMIT of Klipper: set the acceleration of all moves."""
    value = command.setting("ACCEL")
    limit_accelerations(state, value, value, value)


def _retraction(state: FirmwareState, command: Command) -> None:
    """SET_RETRACTION of Klipper: set lengths and speeds of retraction."""
    names = ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH")
    new = zip((command.setting(name) for name in names), state.retraction, strict=True)
    length, back, forward, extra = (old if value is None else value for value, old in new)
    state.retraction = length, back, forward, extra


def _speeds_per_minute(state: FirmwareState, command: Command) -> None:
    """M203 of RepRapFirmware: set maximum speeds in mm/min."""
    new = {axis: value / _MINUTE for axis, value in positive(command, AXES).items()}
    state.set_limits(replace(state.limits, max_speed=replaced(state.limits.max_speed, new)))


def _jerks_per_minute(state: FirmwareState, command: Command) -> None:
    """M566 of RepRapFirmware: set jerk in mm/min."""
    new = {axis: value / _MINUTE for axis, value in positive(command, AXES).items()}
    state.set_limits(replace(state.limits, jerk=replaced(state.limits.jerk, new)))


def _print_acceleration(state: FirmwareState, command: Command) -> None:
    """M201 of Repetier: set the printing acceleration."""
    limit_accelerations(state, printing=min(positive(command, "XY").values(), default=None))


def _travel_acceleration(state: FirmwareState, command: Command) -> None:
    """M202 of Repetier: set the travel acceleration."""
    limit_accelerations(state, travel=min(positive(command, "XY").values(), default=None))


def _jerks(state: FirmwareState, command: Command) -> None:
    """M207 of Repetier: set jerk; X applies to Y too."""
    new = positive(command, AXES)
    new |= {"Y": new["X"]} if "X" in new else {}
    state.set_limits(replace(state.limits, jerk=replaced(state.limits.jerk, new)))


def _accelerations(state: FirmwareState, command: Command) -> None:
    """M204 of Smoothieware: set accelerations, S for all moves, E for the extruder alone."""
    new = positive(command, "SE")
    limit_accelerations(state, new.get("S"), new.get("S"), new.get("E"))


def _junction_deviation(state: FirmwareState, command: Command) -> None:
    """M205 of Smoothieware: set the junction deviation."""
    deviation = positive(command, "X").get("X", state.limits.junction_deviation)
    state.set_limits(replace(state.limits, junction_deviation=deviation))


def _retract_or_set_tool_temperature(state: FirmwareState, command: Command) -> Steps | None:
    """G10 of RepRapFirmware: with P set a tool temperature (Duet3D's G-code dictionary, "G10"), else retract."""
    if command.value("P") is None:
        return firmware_retraction(state, command)
    tool_target(state, command)
    return None


def _parsed_line(state: FirmwareState, command: Command) -> Steps | None:
    """G0, G1 of Klipper: reject invalid numbers."""
    return None if unparsed(state, command) else linear_move(state, command)


DIALECT_COMMANDS: Final[dict[str, dict[str, Callable[[FirmwareState, Command], Steps | None]]]] = {
    "marlin": {},
    "marlin_legacy": {},
    "prusa": {
        "G0": linear_move_with_zeros,
        "G1": linear_move_with_zeros,
        "G80": probe,
        "M403": nothing,  # filament type for the MMU
        "M862.1": nothing,  # nozzle, model, firmware: whether the file is for this printer
        "M862.2": nothing,
        "M862.3": nothing,
        "M862.4": nothing,
        "M862.5": nothing,
        "M862.6": nothing,
        "M907": nothing,
    },
    "klipper": {
        "G0": _parsed_line,
        "G1": _parsed_line,
        "M200": lambda state, command: state.unknown(command.text),
        "PAUSE": ask_person,
        "SET_RETRACTION": _retraction,
        "SET_VELOCITY_LIMIT": _velocity_limit,
    },
    "reprapfirmware": {
        "G10": _retract_or_set_tool_temperature,
        "G53": machine_move,
        "M116": wait_for_all,
        "M203": _speeds_per_minute,
        "M226": ask_person,
        "M566": _jerks_per_minute,
        "M568": tool_target,
        "M572": nothing,
    },
    "repetier": {
        "G0": linear_move_with_zeros,
        "G1": linear_move_with_zeros,
        "@pause": ask_person,
        "M201": _print_acceleration,
        "M202": _travel_acceleration,
        "M203": nothing,
        "M204": nothing,
        "M205": nothing,
        "M206": nothing,
        "M207": _jerks,
        "M208": nothing,
    },
    "smoothie": {
        "G0": linear_move_with_zeros,
        "G1": linear_move_with_zeros,
        "M204": _accelerations,
        "M205": _junction_deviation,
        "G53": machine_move,
        "M206": offset_next_homing,
    },
}
