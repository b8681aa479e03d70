"""Commands that OctoPrint's virtual printer handles differently from Marlin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE"]


def _report_position(state: FirmwareState, _: Command) -> None:
    """M114: report the position in the same line as the ok."""
    state.ok_tail = " " + state.format_position_report()


def _mute_replies(state: FirmwareState, command: Command) -> None:
    """`!!DEBUG:dont_answer`: send no ok for this command and for the next command."""
    if command.text == "!!DEBUG:dont_answer":
        state.muted = 2


TABLE: Final = {
    "M114": _report_position,
    "!!DEBUG:dont_answer": _mute_replies,
}
