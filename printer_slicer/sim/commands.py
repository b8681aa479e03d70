"""The tables of commands that the simulated firmwares know."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from printer_slicer.printer_macros import macro_temperatures, match_end_macro, match_start_macro
from printer_slicer.sim import answers, card_commands, heating, klipper, moves, pausing, virtual
from printer_slicer.sim.flavours import FLAVOURS
from printer_slicer.sim.tools import change_tool
from printer_slicer.sim.words import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.switches import FrontEnd

    Handler = Callable[[Board, Command], Steps | None]
    Straight = Callable[[Board, Sequence[str | float | None]], Steps | None]

__all__ = ["run", "straight_of"]

_MARLIN: Final[dict[str, Handler]] = {
    **moves.TABLE,
    **heating.TABLE,
    **answers.TABLE,
    **pausing.TABLE,
    **card_commands.TABLE,
}
_OWN: Final[dict[str, dict[str, Handler]]] = {
    "marlin": _MARLIN,
    "klipper": {code: handler for code, handler in _MARLIN.items() if code in klipper.KNOWN},
    "virtual": _MARLIN,
}
_TABLES: Final[dict[tuple[str, str], dict[str, Handler]]] = {
    (language, flavour): {
        **own,
        **meant,
        **(klipper.TABLE if language == "klipper" else {}),
        **(virtual.TABLE if language == "virtual" else {}),
    }
    for language, own in _OWN.items()
    for flavour, meant in FLAVOURS.items()
}

_EXTENDED: Final = re.compile(r"(?i)_?[A-Z]+_[A-Z_]+\b").match
"""Matches an extended command of Klipper, a word with an underscore, in either case."""


def run(board: Board, text: str) -> Steps | None:
    """Begin a command: None when it is done, otherwise what is left of it."""
    command = Command(text, any_case=board.front_end.any_case)
    code = command.code or command.name
    if board.shut_down and code not in klipper.ANYWAY:
        klipper.refuse_shut_down(board)
        return None
    front_end = board.front_end
    handler = _TABLES[front_end.language, front_end.flavour].get(code)
    if handler is None and command.code.startswith("T") and front_end.language != "klipper":
        handler = change_tool
    if handler is not None:
        return handler(board, command)
    has_macros = front_end.ignores_extended or front_end.language == "klipper"
    if has_macros and match_start_macro(text):
        return _made_ready(board, text)
    if not ((front_end.ignores_extended and _EXTENDED(text)) or (has_macros and match_end_macro(text))):
        board.unknown(text)
    return None


def _made_ready(board: Board, text: str) -> Steps:
    """A macro of the printer's own that starts prints: it homes, and heats to what it is told or to what it knows."""
    asked = macro_temperatures(text)
    codes = {"bed": "M190", "nozzle": "M109"}
    lines = [] if all(board.homed) else ["G28"]
    lines += [f"{codes[heater]} S{degrees:g}" for heater, degrees in asked.items()]
    for line in lines:
        left = run(board, line)
        if left is not None:
            yield from left
    if board.hotend.target < board.coldest_extrusion:  # how hot it makes the nozzle is in the printer
        board.cold_allowed, board.hot = True, False


def straight_of(front_end: FrontEnd) -> Straight:
    """What makes a G0 or G1 of the usual form, the one command that has to be quick."""
    return klipper.straight if front_end.language == "klipper" else moves.straight
