"""The table of commands that the simulated firmware knows."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from printer_slicer.sim import answers, heating, moves
from printer_slicer.sim.flavours import FLAVOURS
from printer_slicer.sim.words import Command

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.board import Board, Steps

    Handler = Callable[[Board, Command], Steps | None]

__all__ = ["run"]

_TABLE: Final[dict[str, Handler]] = {**moves.TABLE, **heating.TABLE, **answers.TABLE}
_TABLES: Final = {name: {**_TABLE, **own} for name, own in FLAVOURS.items()}

_EXTENDED: Final = re.compile(r"[A-Z]+_[A-Z_]+\b").match
"""A command of Klipper's kind, a word with an underscore."""


def run(board: Board, text: str) -> Steps | None:
    """Begin a command: None when it is done, otherwise what is left of it."""
    command = Command(text)
    handler = _TABLES[board.front_end.flavour].get(command.code or text.partition(" ")[0])
    if handler is None and command.code.startswith("T"):
        handler = answers.tool
    if handler is not None:
        return handler(board, command)
    if not (board.front_end.ignores_extended and _EXTENDED(text)):
        board.unknown(text)
    return None
