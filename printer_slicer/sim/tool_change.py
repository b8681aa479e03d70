"""Tool changes, and the choice of the hotend for a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.parsed_command import Command

__all__ = ["change_tool", "find_hotend"]


def change_tool(state: FirmwareState, command: Command) -> Steps | None:
    """T0, T1 and so on: change to this tool."""
    number = command.code[1:]
    if not number.isdecimal() or int(number) >= state.machine.extruders:
        _reject_tool(state, number)
        return None
    return _wait_and_change_tool(state, int(number)) if state.machine.extruders > 1 else None


def _wait_and_change_tool(state: FirmwareState, tool: int) -> Steps:
    """Wait for the end of motion, then change the tool."""
    if tool != state.heaters.tool:
        yield from state.wait_for_moves()
        yield from state.wait_until(state.now + state.machine.tool_change)
        state.apply_flow_cooling()
        state.heaters.select_tool(tool)
        state.hot = False
    state.send_line(f"echo:Active Extruder: {tool}")


def find_hotend(state: FirmwareState, command: Command, letter: str = "T") -> Heater | None:
    """Return the hotend of the tool in a command, by default of the active tool; None without such a tool."""
    tool = command.value(letter)
    if tool is None:
        return state.hotend
    if 0 <= tool < state.machine.extruders:
        return state.heaters.hotends[int(tool)]
    _reject_tool(state, f"{tool:.0f}", f"{command.code} ")
    return None


def _reject_tool(state: FirmwareState, number: str, lead: str = "") -> None:
    """Report that no tool has this number; `lead` is the code of the command that contains the number."""
    if state.firmware.language == "klipper":
        state.send_line("!! Extruder not configured")
    elif lead:
        state.send_line(f"echo:{lead}Invalid extruder {number}")
    else:
        state.send_line(f"echo:T{number} Invalid extruder")
    state.record_violation("no such extruder")
