"""The command tables of the simulated firmwares."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from printer_slicer.printer_macros import match_end_macro, match_start_macro, read_macro_temperatures
from printer_slicer.sim import (
    card_commands,
    heater_commands,
    klipper,
    move_commands,
    octoprint_virtual,
    pause_commands,
    settings_commands,
)
from printer_slicer.sim.dialect_commands import DIALECT_COMMANDS
from printer_slicer.sim.parsed_command import Command
from printer_slicer.sim.tool_change import change_tool

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.simulated_firmware import SimulatedFirmware

    Handler = Callable[[FirmwareState, Command], Steps | None]
    MoveExecutor = Callable[[FirmwareState, Sequence[str | float | None]], Steps | None]

__all__ = ["choose_move_executor", "start_command"]

_MARLIN_COMMANDS: Final[dict[str, Handler]] = {
    **move_commands.TABLE,
    **heater_commands.TABLE,
    **settings_commands.TABLE,
    **pause_commands.TABLE,
    **card_commands.TABLE,
}
_LANGUAGE_COMMANDS: Final[dict[str, dict[str, Handler]]] = {
    "marlin": _MARLIN_COMMANDS,
    "klipper": {
        code: handler for code, handler in _MARLIN_COMMANDS.items() if code in klipper.SHARED_COMMANDS
    },
    "virtual": _MARLIN_COMMANDS,
}
_TABLES: Final[dict[tuple[str, str], dict[str, Handler]]] = {
    (language, dialect): {
        **language_commands,
        **dialect_handlers,
        **(klipper.TABLE if language == "klipper" else {}),
        **(octoprint_virtual.TABLE if language == "virtual" else {}),
    }
    for language, language_commands in _LANGUAGE_COMMANDS.items()
    for dialect, dialect_handlers in DIALECT_COMMANDS.items()
}

_match_extended: Final = re.compile(r"(?i)_?[A-Z]+_[A-Z_]+\b").match
"""Matches an extended command of Klipper: a word with an underscore, in upper or lower case."""


def start_command(state: FirmwareState, text: str) -> Steps | None:
    """Start a command; return its remaining steps, or None if the command is complete already."""
    command = Command(text, any_case=state.firmware.any_case)
    code = command.code or command.name
    if state.shut_down and code not in klipper.ALLOWED_AFTER_SHUTDOWN:
        klipper.send_shutdown_reply(state)
        return None
    firmware = state.firmware
    handler = _TABLES[firmware.language, firmware.dialect].get(code)
    if handler is None and command.code.startswith("T") and firmware.language != "klipper":
        handler = change_tool
    if handler is not None:
        return handler(state, command)
    has_macros = firmware.ignores_extended or firmware.language == "klipper"
    if has_macros and match_start_macro(text):
        return _run_start_macro(state, text)
    if not ((firmware.ignores_extended and _match_extended(text)) or (has_macros and match_end_macro(text))):
        state.reply_unknown_command(text)
    return None


def _run_start_macro(state: FirmwareState, text: str) -> Steps:
    """Execute a start macro of the printer: home, then heat to the temperatures in the macro's parameters."""
    temperatures = read_macro_temperatures(text)
    codes = {"bed": "M190", "nozzle": "M109"}
    lines = [] if all(state.homed) else ["G28"]
    lines += [f"{codes[heater]} S{degrees:g}" for heater, degrees in temperatures.items()]
    for line in lines:
        steps = start_command(state, line)
        if steps is not None:
            yield from steps
    if state.hotend.target < state.coldest_extrusion:
        # Without a parameter, the macro chooses the temperature, which is not known here.
        state.cold_allowed, state.hot = True, False


def choose_move_executor(firmware: SimulatedFirmware) -> MoveExecutor:
    """Return the function that executes an ordinary G0 or G1 directly, without the slower command tables."""
    return klipper.execute_move if firmware.language == "klipper" else move_commands.execute_move
