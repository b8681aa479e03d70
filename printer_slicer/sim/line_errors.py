"""Replies of a firmware to lines that it rejects: error messages and resend requests."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.line_reader import LineReader
    from printer_slicer.sim.simulated_firmware import SimulatedFirmware
    from printer_slicer.sim.statistics import Statistics

__all__ = ["LineErrorReplies"]


class LineErrorReplies:
    """Sends the firmware's replies to lines that `LineReader` rejected, skipped or lost.

    Attributes:
        needs_resend: whether the resend request for a rejected line has not been sent yet.
        last_byte: arrival time of the last byte, s.
    """

    def __init__(
        self,
        reader: LineReader,
        state: FirmwareState,
        firmware: SimulatedFirmware,
        statistics: Statistics,
        now: float,
    ) -> None:
        self.needs_resend = False
        self.last_byte = now
        self._reader = reader
        self._state = state
        self._firmware = firmware
        self._statistics = statistics

    def send_reply(self) -> None:
        """Reply to a line that was not accepted, or to a buffer overflow once all received bytes are read."""
        reader = self._reader
        if reader.is_rejected:
            self._report_line_error()
        elif reader.skip_replies is not None:
            for reply in reader.skip_replies:
                self._state.send_line(reply)
            reader.skip_replies = None
        else:
            self._report_overflow()

    def request_resend(self) -> None:
        """Request a resend of the line after the last accepted one."""
        self.needs_resend = False
        if self._firmware.flushes_on_error:
            self._reader.flush()
        self._statistics.resends += 1
        self._state.send_line(self._firmware.resend.format(wanted=self._reader.last + 1))
        if self._firmware.ok_after_resend:
            self._state.send_line("ok")

    def next_event_time(self) -> float:
        """Return the time, s, at which waiting for missing bytes or a resend ends; infinite for never."""
        reader, firmware = self._reader, self._firmware
        asked = firmware.repeats_resend_request and reader.skipping >= 0 and not reader.has_unread_bytes
        return self.last_byte + firmware.line_timeout if asked or reader.has_partial_line else inf

    def discard_partial_line(self, now: float) -> None:
        """Discard a partial line at `now`, s; request a resend if this firmware does so."""
        self.last_byte = now
        self._reader.discard_partial_line()
        if self._firmware.repeats_resend_request:
            self.needs_resend = True
        else:
            self._state.send_report("RX timeout")

    def _report_line_error(self) -> None:
        """Send the error message for a rejected line; the resend request follows later."""
        reader = self._reader
        if reader.rejection:
            self._state.send_line(reader.rejection)
        reader.rejection, reader.is_rejected = "", False
        self._statistics.line_errors += 1
        self.needs_resend = True

    def _report_overflow(self) -> None:
        """Report a buffer overflow if one occurred and the firmware reports it."""
        reader = self._reader
        if reader.overflowed and self._firmware.reports_overflow:
            reader.discard_partial_line()
            self._state.send_line("Full RX Buffer")
        reader.overflowed = False
