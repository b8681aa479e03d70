"""Commands of the SD card. Replies follow Marlin's cardreader.cpp; they were not recorded from a real printer."""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.sd_card import shortened

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "abort", "finished", "write_line"]


def _with_reader(
    handler: Callable[[FirmwareState, Command], Steps | None],
) -> Callable[[FirmwareState, Command], Steps | None]:
    """Make a command unknown to a printer without a card reader."""

    @wraps(handler)
    def checked(state: FirmwareState, command: Command) -> Steps | None:
        if state.machine.card:
            return handler(state, command)
        state.unknown(command.text)
        return None

    return checked


def _name(command: Command) -> str:
    """Return the file name of a command."""
    return shortened(command.rest.removeprefix("/").removeprefix("!").rstrip("#"))


def _list(state: FirmwareState, _: Command) -> None:
    """M20: list the files."""
    state.say("Begin file list")
    for name, data in state.card.files.items() if state.card.present else ():
        state.say(f"{name} {len(data)}")
    state.say("End file list")


def _mount(state: FirmwareState, command: Command) -> None:
    """M21: mount the card; M22: release it."""
    state.card.stop()
    state.card.present = command.code == "M21"
    state.say("echo:SD card ok" if state.card.present else "echo:SD card released")


def _select(state: FirmwareState, command: Command) -> None:
    """M23: select a file."""
    name = _name(command)
    if not state.card.select(name):
        state.say(f"open failed, File: {name}.")
        return
    state.say(f"echo:Now fresh file: {name}")
    state.say(f"File opened: {name} Size: {state.card.size}")
    state.say("File selected")


def _start(state: FirmwareState, command: Command) -> None:
    """M24: start or resume the print."""
    card = state.card
    if not card.selected:
        return
    at = command.value("S")
    card.at = card.at if at is None else min(max(int(at), 0), card.size)
    if state.timer_began is None:
        state.timer_began = state.now
    card.printing = True
    state.act("resume")


def _pause(state: FirmwareState, _: Command) -> None:
    """M25: pause the print; planned moves are still executed."""
    if state.card.printing:
        state.card.stop()
        state.stop_timer()
        state.act("paused")


def _position(state: FirmwareState, command: Command) -> None:
    """M26: set the read position."""
    at = command.value("S")
    if at is not None and state.card.selected:
        state.card.at = min(max(int(at), 0), state.card.size)


def _progress(state: FirmwareState, command: Command) -> None:
    """M27: report the progress, once or every S seconds; with C the file name."""
    seconds = command.value("S")
    if "C" in command.words:
        state.say(f"Current file: {state.card.selected or '(no file)'}")
    elif seconds is None:
        state.say(_status(state))
    else:
        state.report_every("card", min(max(int(seconds), 0), 60), lambda: _status(state))


def _status(state: FirmwareState) -> str:
    card = state.card
    return f"SD printing byte {card.at}/{card.size}" if card.printing else "Not SD printing"


def _write(state: FirmwareState, command: Command) -> None:
    """M28: start writing lines to a file."""
    name = _name(command)
    if not state.card.present or not name:
        state.say(f"open failed, File: {name}.")
        return
    state.card.stop()
    state.card.begin(name)
    state.say(f"Writing to file: {name}")


def write_line(state: FirmwareState, text: str) -> None:
    """Write a command to the open file; M29 closes it."""
    if text.startswith("M29"):
        state.card.end()
        state.say("Done saving file.")
    elif not state.card.write(text):
        state.say("Error:error writing to file")


def _delete(state: FirmwareState, command: Command) -> None:
    """M30: delete a file."""
    name = _name(command)
    if state.card.present and name in state.card.files:
        if state.card.selected == name:
            state.card.select("")
        del state.card.files[name]
        state.say(f"File deleted:{name}")
    else:
        state.say(f"Deletion failed, File: {name}.")


def _print(state: FirmwareState, command: Command) -> None:
    """M32: select a file and start the print."""
    _select(state, command)
    _start(state, command)


def abort(state: FirmwareState, _: Command | None = None) -> None:
    """M524: abort the print and switch the heaters off."""
    if not state.card.printing:
        return
    state.card.select("")
    state.stop_moving()
    state.stop_timer()
    for heater in state.heaters.all():
        state.set_target_of(heater, 0.0)
    state.act("cancel")


def finished(state: FirmwareState) -> None:
    """Finish the print at the end of the file."""
    state.card.stop()
    state.card.at = 0
    state.stop_timer()
    state.say("Done printing file")


def _nothing_is_written(_: FirmwareState, __: Command) -> None:
    """M29 without an open file: do nothing."""


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
