"""Tool changes, and the hotend that a command refers to."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.parsed_command import Command

__all__ = ["change_tool", "hotend_of"]


def change_tool(state: FirmwareState, command: Command) -> Steps | None:
    """T0, T1 and so on: change the tool."""
    number = command.code[1:]
    if not number.isdecimal() or int(number) >= state.machine.extruders:
        _refuse(state, number)
        return None
    return _changing(state, int(number)) if state.machine.extruders > 1 else None


def _changing(state: FirmwareState, tool: int) -> Steps:
    """Wait for the end of motion, then change the tool."""
    if tool != state.heaters.tool:
        yield from state.wait_for_moves()
        yield from state.until(state.now + state.machine.tool_change)
        state.apply_flow_cooling()
        state.heaters.use(tool)
        state.hot = False
    state.say(f"echo:Active Extruder: {tool}")


def hotend_of(state: FirmwareState, command: Command, letter: str = "T") -> Heater | None:
    """Return the hotend of the tool that a command names, or of the active one; None if there is no such tool."""
    tool = command.value(letter)
    if tool is None:
        return state.hotend
    if 0 <= tool < state.machine.extruders:
        return state.heaters.hotends[int(tool)]
    _refuse(state, f"{tool:.0f}", f"{command.code} ")
    return None


def _refuse(state: FirmwareState, number: str, lead: str = "") -> None:
    if state.firmware.language == "klipper":
        state.say("!! Extruder not configured")
    elif lead:
        state.say(f"echo:{lead}Invalid extruder {number}")
    else:
        state.say(f"echo:T{number} Invalid extruder")
    state.record_violation("no such extruder")
