"""Differences of OctoPrint's virtual printer from Marlin: it knows every command and checks nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE"]


def _place(state: FirmwareState, _: Command) -> None:
    """M114: report the position in the ok."""
    state.ok_tail = " " + state.position_report()


def _debug(state: FirmwareState, command: Command) -> None:
    """`!!DEBUG:dont_answer`: send no ok for this command and the next."""
    if command.text == "!!DEBUG:dont_answer":
        state.muted = 2


TABLE: Final = {
    "M114": _place,
    "!!DEBUG:dont_answer": _debug,
}
