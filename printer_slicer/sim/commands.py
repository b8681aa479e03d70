"""The command tables of the simulated firmwares."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from printer_slicer.printer_macros import macro_temperatures, match_end_macro, match_start_macro
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
    Straight = Callable[[FirmwareState, Sequence[str | float | None]], Steps | None]

__all__ = ["move_executor", "run"]

_MARLIN: Final[dict[str, Handler]] = {
    **move_commands.TABLE,
    **heater_commands.TABLE,
    **settings_commands.TABLE,
    **pause_commands.TABLE,
    **card_commands.TABLE,
}
_OWN: Final[dict[str, dict[str, Handler]]] = {
    "marlin": _MARLIN,
    "klipper": {code: handler for code, handler in _MARLIN.items() if code in klipper.KNOWN},
    "virtual": _MARLIN,
}
_TABLES: Final[dict[tuple[str, str], dict[str, Handler]]] = {
    (language, dialect): {
        **own,
        **meant,
        **(klipper.TABLE if language == "klipper" else {}),
        **(octoprint_virtual.TABLE if language == "virtual" else {}),
    }
    for language, own in _OWN.items()
    for dialect, meant in DIALECT_COMMANDS.items()
}

_EXTENDED: Final = re.compile(r"(?i)_?[A-Z]+_[A-Z_]+\b").match
"""Match an extended command of Klipper: a word with an underscore, in either case."""


def run(state: FirmwareState, text: str) -> Steps | None:
    """Start a command; return None if it is done, else its remaining steps."""
    command = Command(text, any_case=state.firmware.any_case)
    code = command.code or command.name
    if state.shut_down and code not in klipper.ANYWAY:
        klipper.refuse_shut_down(state)
        return None
    firmware = state.firmware
    handler = _TABLES[firmware.language, firmware.dialect].get(code)
    if handler is None and command.code.startswith("T") and firmware.language != "klipper":
        handler = change_tool
    if handler is not None:
        return handler(state, command)
    has_macros = firmware.ignores_extended or firmware.language == "klipper"
    if has_macros and match_start_macro(text):
        return _made_ready(state, text)
    if not ((firmware.ignores_extended and _EXTENDED(text)) or (has_macros and match_end_macro(text))):
        state.unknown(text)
    return None


def _made_ready(state: FirmwareState, text: str) -> Steps:
    """Execute a start macro of the printer: home, and heat to the given temperatures."""
    asked = macro_temperatures(text)
    codes = {"bed": "M190", "nozzle": "M109"}
    lines = [] if all(state.homed) else ["G28"]
    lines += [f"{codes[heater]} S{degrees:g}" for heater, degrees in asked.items()]
    for line in lines:
        left = run(state, line)
        if left is not None:
            yield from left
    if state.hotend.target < state.coldest_extrusion:  # the macro on the printer knows the temperature
        state.cold_allowed, state.hot = True, False


def move_executor(firmware: SimulatedFirmware) -> Straight:
    """Return the function that executes a G0 or G1 of the usual form, which has to be fast."""
    return klipper.execute_move if firmware.language == "klipper" else move_commands.execute_move
