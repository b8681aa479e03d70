"""Replies of a firmware to lines it rejects: error messages and resend requests."""

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
    """Replies to lines that `LineReader` rejected, skipped or lost.

    Attributes:
        asking: whether a rejected line still needs its resend request.
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
        self.asking = False
        self.last_byte = now
        self._reader = reader
        self._state = state
        self._firmware = firmware
        self._statistics = statistics

    def answer(self) -> None:
        """Reply to a line that was not accepted, or to a buffer overflow once everything is read."""
        reader = self._reader
        if reader.refused:
            self._refuse()
        elif reader.passed is not None:
            for said in reader.passed:
                self._state.say(said)
            reader.passed = None
        else:
            self._look_at_overflow()

    def ask_again(self) -> None:
        """Request a resend of the line after the last good one."""
        self.asking = False
        if self._firmware.flushes_on_error:
            self._reader.flush()
        self._statistics.resends += 1
        self._state.say(self._firmware.resend.format(wanted=self._reader.last + 1))
        if self._firmware.ok_after_resend:
            self._state.say("ok")

    def due(self) -> float:
        """Return the timeout for the rest of a line or for a requested line, s; infinite for never."""
        reader, firmware = self._reader, self._firmware
        asked = firmware.partial_asks and reader.skipping >= 0 and not reader.waiting
        return self.last_byte + firmware.partial_seconds if asked or reader.partial else inf

    def abandon(self, now: float) -> None:
        """Discard a partial line, and request it again if the firmware does so."""
        self.last_byte = now
        self._reader.abandon()
        if self._firmware.partial_asks:
            self.asking = True
        else:
            self._state.report("RX timeout")

    def _refuse(self) -> None:
        """Report an error of a line; more bytes may arrive in the meantime."""
        reader = self._reader
        if reader.fault:
            self._state.say(reader.fault)
        reader.fault, reader.refused = "", False
        self._statistics.line_errors += 1
        self.asking = True

    def _look_at_overflow(self) -> None:
        """Report a buffer overflow if there was one."""
        reader = self._reader
        if reader.overflowed and self._firmware.tells_overflow:
            reader.abandon()
            self._state.say("Full RX Buffer")
        reader.overflowed = False
