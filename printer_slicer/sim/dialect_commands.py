"""G-code commands that Marlin 2 does not have, or that other firmwares define differently.

The simulated printer replies as Marlin does; these tables let it execute files for other firmwares. The `firmware`
package names the sources.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.sim.heater_commands import set_tool_temperature, wait_for_all_heaters
from printer_slicer.sim.klipper import reject_invalid_numbers
from printer_slicer.sim.machine import AXES, replace_axis_values
from printer_slicer.sim.move_commands import (
    move_in_machine_coordinates,
    move_straight,
    move_straight_reading_zeros,
    offset_next_homing,
    probe_bed,
    retract_or_recover,
)
from printer_slicer.sim.pause_commands import wait_for_person
from printer_slicer.sim.settings_commands import ignore_command, positive_values, set_accelerations
from printer_slicer.values import replace

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["DIALECT_COMMANDS"]

_SECONDS_PER_MINUTE: Final = 60.0


def _set_velocity_limit(state: FirmwareState, command: Command) -> None:
    """SET_VELOCITY_LIMIT of Klipper: set the acceleration of all moves."""
    value = command.setting("ACCEL")
    set_accelerations(state, value, value, value)


def _set_retraction(state: FirmwareState, command: Command) -> None:
    """SET_RETRACTION of Klipper: set the lengths and speeds of retraction."""
    names = ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH")
    new = zip((command.setting(name) for name in names), state.retraction, strict=True)
    length, back, forward, extra = (old if value is None else value for value, old in new)
    state.retraction = length, back, forward, extra


def _set_speeds_per_minute(state: FirmwareState, command: Command) -> None:
    """M203 of RepRapFirmware: set the maximum speed of each axis, in mm/min."""
    new = {axis: value / _SECONDS_PER_MINUTE for axis, value in positive_values(command, AXES).items()}
    state.set_limits(replace(state.limits, max_speed=replace_axis_values(state.limits.max_speed, new)))


def _set_jerks_per_minute(state: FirmwareState, command: Command) -> None:
    """M566 of RepRapFirmware: set the jerk of each axis, in mm/min."""
    new = {axis: value / _SECONDS_PER_MINUTE for axis, value in positive_values(command, AXES).items()}
    state.set_limits(replace(state.limits, jerk=replace_axis_values(state.limits.jerk, new)))


def _set_print_acceleration(state: FirmwareState, command: Command) -> None:
    """M201 of Repetier: set the printing acceleration."""
    set_accelerations(state, printing=min(positive_values(command, "XY").values(), default=None))


def _set_travel_acceleration(state: FirmwareState, command: Command) -> None:
    """M202 of Repetier: set the travel acceleration."""
    set_accelerations(state, travel=min(positive_values(command, "XY").values(), default=None))


def _set_jerks(state: FirmwareState, command: Command) -> None:
    """M207 of Repetier: set the jerk; the value of X applies to Y too."""
    new = positive_values(command, AXES)
    new |= {"Y": new["X"]} if "X" in new else {}
    state.set_limits(replace(state.limits, jerk=replace_axis_values(state.limits.jerk, new)))


def _set_accelerations_of_smoothie(state: FirmwareState, command: Command) -> None:
    """M204 of Smoothieware: set accelerations, S for all moves, E for moves of the extruder alone."""
    new = positive_values(command, "SE")
    set_accelerations(state, new.get("S"), new.get("S"), new.get("E"))


def _set_junction_deviation(state: FirmwareState, command: Command) -> None:
    """M205 of Smoothieware: set the junction deviation."""
    deviation = positive_values(command, "X").get("X", state.limits.junction_deviation)
    state.set_limits(replace(state.limits, junction_deviation=deviation))


def _retract_or_set_tool_temperature(state: FirmwareState, command: Command) -> Steps | None:
    """G10 of RepRapFirmware: set a tool temperature if P is given, else retract (Duet3D's G-code dictionary)."""
    if command.value("P") is None:
        return retract_or_recover(state, command)
    set_tool_temperature(state, command)
    return None


def _move_if_valid(state: FirmwareState, command: Command) -> Steps | None:
    """G0, G1 of Klipper: move, unless the command has an invalid number."""
    return None if reject_invalid_numbers(state, command) else move_straight(state, command)


DIALECT_COMMANDS: Final[dict[str, dict[str, Callable[[FirmwareState, Command], Steps | None]]]] = {
    "marlin": {},
    "marlin_legacy": {},
    "prusa": {
        "G0": move_straight_reading_zeros,
        "G1": move_straight_reading_zeros,
        "G80": probe_bed,
        "M403": ignore_command,  # sets the filament type of the multi-material unit
        "M862.1": ignore_command,  # checks that nozzle, model and firmware fit the file
        "M862.2": ignore_command,
        "M862.3": ignore_command,
        "M862.4": ignore_command,
        "M862.5": ignore_command,
        "M862.6": ignore_command,
        "M907": ignore_command,
    },
    "klipper": {
        "G0": _move_if_valid,
        "G1": _move_if_valid,
        "M200": lambda state, command: state.reply_unknown_command(command.text),
        "PAUSE": wait_for_person,
        "SET_RETRACTION": _set_retraction,
        "SET_VELOCITY_LIMIT": _set_velocity_limit,
    },
    "reprapfirmware": {
        "G10": _retract_or_set_tool_temperature,
        "G53": move_in_machine_coordinates,
        "M116": wait_for_all_heaters,
        "M203": _set_speeds_per_minute,
        "M226": wait_for_person,
        "M566": _set_jerks_per_minute,
        "M568": set_tool_temperature,
        "M572": ignore_command,
    },
    "repetier": {
        "G0": move_straight_reading_zeros,
        "G1": move_straight_reading_zeros,
        "@pause": wait_for_person,
        "M201": _set_print_acceleration,
        "M202": _set_travel_acceleration,
        "M203": ignore_command,
        "M204": ignore_command,
        "M205": ignore_command,
        "M206": ignore_command,
        "M207": _set_jerks,
        "M208": ignore_command,
    },
    "smoothie": {
        "G0": move_straight_reading_zeros,
        "G1": move_straight_reading_zeros,
        "M204": _set_accelerations_of_smoothie,
        "M205": _set_junction_deviation,
        "G53": move_in_machine_coordinates,
        "M206": offset_next_homing,
    },
}
