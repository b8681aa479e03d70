"""Several extruders: changing from one to the other, and whose heater a command is about."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.words import Command

__all__ = ["change_tool", "hotend_of"]


def change_tool(board: Board, command: Command) -> Steps | None:
    """T0, T1 and so on."""
    number = command.code[1:]
    if not number.isdecimal() or int(number) >= board.machine.extruders:
        _refuse(board, number)
        return None
    return _changing(board, int(number)) if board.machine.extruders > 1 else None


def _changing(board: Board, tool: int) -> Steps:
    """Wait for the planned moves, then use the other one from now on."""
    if tool != board.heaters.tool:
        yield from board.drained()
        yield from board.until(board.now + board.machine.tool_change)
        board.settle()
        board.heaters.use(tool)
        board.hot = False
    board.say(f"echo:Active Extruder: {tool}")


def hotend_of(board: Board, command: Command, letter: str = "T") -> Heater | None:
    """The hotend that a command is about: of the tool behind a letter, or in use; None when there is no such tool."""
    tool = command.value(letter)
    if tool is None:
        return board.hotend
    if 0 <= tool < board.machine.extruders:
        return board.heaters.hotends[int(tool)]
    _refuse(board, f"{tool:.0f}", f"{command.code} ")
    return None


def _refuse(board: Board, number: str, lead: str = "") -> None:
    if board.front_end.language == "klipper":
        board.say("!! Extruder not configured")
    elif lead:
        board.say(f"echo:{lead}Invalid extruder {number}")
    else:
        board.say(f"echo:T{number} Invalid extruder")
    board.violated("no such extruder")
