"""Commands of the memory card. What they say follows Marlin's cardreader.cpp; no card was at hand to record it."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.card import shortened

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.words import Command

__all__ = ["TABLE", "abort", "finished", "write_line"]


def _with_reader(
    handler: Callable[[Board, Command], Steps | None],
) -> Callable[[Board, Command], Steps | None]:
    """The same, unknown to a printer without a card reader."""

    @wraps(handler)
    def checked(board: Board, command: Command) -> Steps | None:
        if board.machine.card:
            return handler(board, command)
        board.unknown(command.text)
        return None

    return checked


def _name(command: Command) -> str:
    """The file that a command is about."""
    return shortened(command.rest.removeprefix("/").removeprefix("!").rstrip("#"))


def _list(board: Board, _: Command) -> None:
    """M20."""
    board.say("Begin file list")
    for name, data in board.card.files.items() if board.card.present else ():
        board.say(f"{name} {len(data)}")
    board.say("End file list")


def _mount(board: Board, command: Command) -> None:
    """M21 takes the card, M22 lets go of it."""
    board.card.stop()
    board.card.present = command.code == "M21"
    board.say("echo:SD card ok" if board.card.present else "echo:SD card released")


def _select(board: Board, command: Command) -> None:
    """M23: print a file when told to."""
    name = _name(command)
    if not board.card.select(name):
        board.say(f"open failed, File: {name}.")
        return
    board.say(f"echo:Now fresh file: {name}")
    board.say(f"File opened: {name} Size: {board.card.size}")
    board.say("File selected")


def _start(board: Board, command: Command) -> None:
    """M24: begin or go on."""
    card = board.card
    if not card.selected:
        return
    at = command.value("S")
    card.at = card.at if at is None else min(max(int(at), 0), card.size)
    if board.timer_began is None:
        board.timer_began = board.now
    card.printing = True
    board.act("resume")


def _pause(board: Board, _: Command) -> None:
    """M25: the moves that are planned are made."""
    if board.card.printing:
        board.card.stop()
        board.stop_timer()
        board.act("paused")


def _position(board: Board, command: Command) -> None:
    """M26."""
    at = command.value("S")
    if at is not None and board.card.selected:
        board.card.at = min(max(int(at), 0), board.card.size)


def _progress(board: Board, command: Command) -> None:
    """M27: how far it is, once, or every S seconds; C says which file."""
    seconds = command.value("S")
    if "C" in command.words:
        board.say(f"Current file: {board.card.selected or '(no file)'}")
    elif seconds is None:
        board.say(_status(board))
    else:
        board.repeat("card", min(max(int(seconds), 0), 60), lambda: _status(board))


def _status(board: Board) -> str:
    card = board.card
    return f"SD printing byte {card.at}/{card.size}" if card.printing else "Not SD printing"


def _write(board: Board, command: Command) -> None:
    """M28: from now on lines go to the card."""
    name = _name(command)
    if not board.card.present or not name:
        board.say(f"open failed, File: {name}.")
        return
    board.card.stop()
    board.card.begin(name)
    board.say(f"Writing to file: {name}")


def write_line(board: Board, text: str) -> None:
    """A command while a file is written: it goes there, and M29 ends that."""
    if text.startswith("M29"):
        board.card.end()
        board.say("Done saving file.")
    elif not board.card.write(text):
        board.say("Error:error writing to file")


def _delete(board: Board, command: Command) -> None:
    """M30."""
    name = _name(command)
    if board.card.present and name in board.card.files:
        if board.card.selected == name:
            board.card.select("")
        del board.card.files[name]
        board.say(f"File deleted:{name}")
    else:
        board.say(f"Deletion failed, File: {name}.")


def _print(board: Board, command: Command) -> None:
    """M32: choose and begin."""
    _select(board, command)
    _start(board, command)


def abort(board: Board, _: Command | None = None) -> None:
    """M524: give the print up, heaters off."""
    if not board.card.printing:
        return
    board.card.select("")
    board.stop_moving()
    board.stop_timer()
    for heater in board.heaters.all():
        board.aim(heater, 0.0)
    board.act("cancel")


def finished(board: Board) -> None:
    """The file has been read to its end."""
    board.card.stop()
    board.card.at = 0
    board.stop_timer()
    board.say("Done printing file")


def _nothing_is_written(_: Board, __: Command) -> None:
    """M29 while no file is written."""


TABLE: Final = {
    code: _with_reader(handler)
    for code, handler in {
        "M20": _list,
        "M21": _mount,
        "M22": _mount,
        "M23": _select,
        "M24": _start,
        "M25": _pause,
        "M26": _position,
        "M27": _progress,
        "M28": _write,
        "M29": _nothing_is_written,
        "M30": _delete,
        "M32": _print,
        "M524": abort,
    }.items()
}
