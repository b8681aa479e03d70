"""G-code commands for the SD card of the simulated printer.

Replies follow Marlin's cardreader.cpp; they were not recorded from a real printer.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.sd_card import shorten_file_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "abort_print", "finish_print", "write_to_file"]


def _require_card_reader(
    handler: Callable[[FirmwareState, Command], Steps | None],
) -> Callable[[FirmwareState, Command], Steps | None]:
    """Wrap a command handler: a printer without a card reader replies that the command is unknown."""

    @wraps(handler)
    def handle_with_reader(state: FirmwareState, command: Command) -> Steps | None:
        if state.machine.card:
            return handler(state, command)
        state.reply_unknown_command(command.text)
        return None

    return handle_with_reader


def _file_name(command: Command) -> str:
    """Return the file name that a command gives, in 8.3 form."""
    return shorten_file_name(command.rest.removeprefix("/").removeprefix("!").rstrip("#"))


def _list_files(state: FirmwareState, _: Command) -> None:
    """M20: list the files on the card."""
    state.send_line("Begin file list")
    for name, data in state.card.files.items() if state.card.present else ():
        state.send_line(f"{name} {len(data)}")
    state.send_line("End file list")


def _mount_card(state: FirmwareState, command: Command) -> None:
    """M21: mount the card; M22: release the card."""
    state.card.stop()
    state.card.present = command.code == "M21"
    state.send_line("echo:SD card ok" if state.card.present else "echo:SD card released")


def _select_file(state: FirmwareState, command: Command) -> None:
    """M23: select a file for printing."""
    name = _file_name(command)
    if not state.card.select_file(name):
        state.send_line(f"open failed, File: {name}.")
        return
    state.send_line(f"echo:Now fresh file: {name}")
    state.send_line(f"File opened: {name} Size: {state.card.size}")
    state.send_line("File selected")


def _start_print(state: FirmwareState, command: Command) -> None:
    """M24: start or resume the print of the selected file."""
    card = state.card
    if not card.selected:
        return
    at = command.value("S")
    card.at = card.at if at is None else min(max(int(at), 0), card.size)
    if state.timer_began is None:
        state.timer_began = state.now
    card.printing = True
    state.send_action("resume")


def _pause_print(state: FirmwareState, _: Command) -> None:
    """M25: pause the print from the SD card; planned moves are still executed."""
    if state.card.printing:
        state.card.stop()
        state.stop_timer()
        state.send_action("paused")


def _set_read_position(state: FirmwareState, command: Command) -> None:
    """M26: set the read position in the selected file."""
    at = command.value("S")
    if at is not None and state.card.selected:
        state.card.at = min(max(int(at), 0), state.card.size)


def _report_progress(state: FirmwareState, command: Command) -> None:
    """M27: report the print progress, once or every S seconds; with C, report the file name instead."""
    seconds = command.value("S")
    if "C" in command.words:
        state.send_line(f"Current file: {state.card.selected or '(no file)'}")
    elif seconds is None:
        state.send_line(_format_progress(state))
    else:
        state.report_every("card", min(max(int(seconds), 0), 60), lambda: _format_progress(state))


def _format_progress(state: FirmwareState) -> str:
    """Return the progress of the print as M27 reports it."""
    card = state.card
    return f"SD printing byte {card.at}/{card.size}" if card.printing else "Not SD printing"


def _start_writing_file(state: FirmwareState, command: Command) -> None:
    """M28: open a file on the card and write the following lines to it."""
    name = _file_name(command)
    if not state.card.present or not name:
        state.send_line(f"open failed, File: {name}.")
        return
    state.card.stop()
    state.card.begin_file(name)
    state.send_line(f"Writing to file: {name}")


def write_to_file(state: FirmwareState, text: str) -> None:
    """Write a command to the file that M28 has opened; M29 closes this file."""
    if text.startswith("M29"):
        state.card.end_file()
        state.send_line("Done saving file.")
    elif not state.card.write_line(text):
        state.send_line("Error:error writing to file")


def _delete_file(state: FirmwareState, command: Command) -> None:
    """M30: delete a file."""
    name = _file_name(command)
    if state.card.present and name in state.card.files:
        if state.card.selected == name:
            state.card.select_file("")
        del state.card.files[name]
        state.send_line(f"File deleted:{name}")
    else:
        state.send_line(f"Deletion failed, File: {name}.")


def _print_file(state: FirmwareState, command: Command) -> None:
    """M32: select a file and start its print."""
    _select_file(state, command)
    _start_print(state, command)


def abort_print(state: FirmwareState, _: Command | None = None) -> None:
    """M524: abort the print from the SD card and switch the heaters off."""
    if not state.card.printing:
        return
    state.card.select_file("")
    state.stop_moving()
    state.stop_timer()
    for heater in state.heaters.all_heaters():
        state.set_heater_target(heater, 0.0)
    state.send_action("cancel")


def finish_print(state: FirmwareState) -> None:
    """End the print from the SD card after the last line of the file."""
    state.card.stop()
    state.card.at = 0
    state.stop_timer()
    state.send_line("Done printing file")


def _ignore_end_of_writing(_: FirmwareState, __: Command) -> None:
    """M29 when no file is open for writing: accept the command and do nothing."""


TABLE: Final = {
    code: _require_card_reader(handler)
    for code, handler in {
        "M20": _list_files,
        "M21": _mount_card,
        "M22": _mount_card,
        "M23": _select_file,
        "M24": _start_print,
        "M25": _pause_print,
        "M26": _set_read_position,
        "M27": _report_progress,
        "M28": _start_writing_file,
        "M29": _ignore_end_of_writing,
        "M30": _delete_file,
        "M32": _print_file,
        "M524": abort_print,
    }.items()
}
