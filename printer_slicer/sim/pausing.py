"""Commands that wait for a person, and how the person is asked.

A firmware with host prompts shows a question and a button (`//action:prompt_begin` and so on) and takes `M876 S0` for
the button. Without them M108 goes on, or the person at the printer's own button, if the machine has one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.words import Command

__all__ = ["TABLE", "ask_person"]


def ask_person(board: Board, command: Command) -> Steps:
    """M0 and M1: wait for M108, for the time given, or for the person of this machine."""
    yield from board.drained()
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    yield from _asked(board, f"{command.code or 'M0'} Break Called", seconds)


def _change_filament(board: Board, _: Command) -> Steps:
    """M600: wait until a person has put another filament in."""
    yield from board.drained()
    board.act("paused")
    yield from _asked(board, "Nozzle Parked", 0.0)
    board.loaded()
    board.act("resumed")


def _asked(board: Board, question: str, seconds: float) -> Steps:
    """Ask, and wait: for so many seconds if they are not 0, else as long as the person takes."""
    _prompt(board, f"prompt_begin {question}", "prompt_button Continue", "prompt_show")
    until = board.now + (seconds if seconds > 0.0 else board.machine.person_seconds)
    board.waiting, board.busy_with = True, "paused for user"
    while board.waiting and board.now < until:
        yield until
    board.waiting, board.busy_with = False, "processing"
    _prompt(board)


def _prompt(board: Board, *lines: str) -> None:
    """A question, or none any more, in the words of Marlin's host prompts."""
    if board.front_end.prompts:
        for line in ("prompt_end", *lines):
            board.say(f"//action:{line}")


def _answer(board: Board, command: Command) -> None:
    """M876: the button that the host's person pressed."""
    if not board.front_end.prompts:
        board.unknown(command.text)
    elif command.value("S") is not None:
        board.waiting = False


TABLE: Final = {
    "M0": ask_person,
    "M1": ask_person,
    "M600": _change_filament,
    "M601": ask_person,
    "M876": _answer,
}
