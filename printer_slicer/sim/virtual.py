"""OctoPrint's virtual printer as far as it is not Marlin: it knows everything and checks nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.board import Board
    from printer_slicer.sim.words import Command

__all__ = ["TABLE"]


def _place(board: Board, _: Command) -> None:
    """M114: the answer is part of the ok."""
    board.ok_tail = " " + board.place()


def _debug(board: Board, command: Command) -> None:
    """`!!DEBUG:dont_answer`: the next command gets no ok; this one gets none either."""
    if command.text == "!!DEBUG:dont_answer":
        board.muted = 2


TABLE: Final = {
    "M114": _place,
    "!!DEBUG:dont_answer": _debug,
}
