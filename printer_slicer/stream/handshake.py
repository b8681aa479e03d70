"""Handshake with the printer: reset line numbers and query firmware and capabilities."""

from __future__ import annotations

from math import inf
from typing import Final

from printer_slicer.firmware import WIRE_DIALECTS, WireDialect, match_wire_dialect
from printer_slicer.stream.events import Identified
from printer_slicer.stream.replies import Capability, Identity
from printer_slicer.stream.send_history import PROBE_COMMAND

__all__ = ["Handshake"]

_RESET_LINE_NUMBERS: Final = b"\nN0 M110 N0*125\n"
_REQUEST_INTERVAL: Final = 1.0
_LAST_FIRMWARE_QUERY: Final = 4
"""Number of the last line that queries the name of the firmware."""


class Handshake:
    """Resets line numbers until the printer answers, then collects the reported firmware and capabilities.

    A board that resets when the port opens receives nothing at first, so the request is repeated. When the board
    reports `start`, it is repeated at once.

    Args:
        timeout: s until a printer that does not answer counts as missing.
        dialect: key of `WIRE_DIALECTS`; None: chosen by the reported firmware.

    Attributes:
        firmware: name of the firmware, None until reported.
    """

    def __init__(self, timeout: float, dialect: str | None = None) -> None:
        self._next_request_at = -inf
        self._dialect = dialect
        self.firmware: str | None = None
        self._capabilities: dict[str, bool] = {}
        self._timeout = timeout
        self._timeout_start: float | None = None

    @property
    def has_started(self) -> bool:
        """Return whether the first request was sent."""
        return self._timeout_start is not None

    @property
    def next_request_at(self) -> float:
        """Return when to send the next request to reset line numbers, s."""
        return self._next_request_at

    def has_timed_out(self, now: float) -> bool:
        """Return whether the printer has not answered in time."""
        return self._timeout_start is not None and now >= self._timeout_start + self._timeout

    def on_busy(self, now: float) -> None:
        """Restart the timeout, because the printer reports that it is busy."""
        if self._timeout_start is not None:
            self._timeout_start = now

    def send(self, now: float) -> bytes:
        """Return the request to reset line numbers if it is due now, else nothing."""
        if self._timeout_start is None:
            self._timeout_start = now
        if now < self._next_request_at:
            return b""
        self._next_request_at = now + _REQUEST_INTERVAL
        return _RESET_LINE_NUMBERS

    def choose_query(self, number: int) -> bytes | None:
        """Return the query to send as line `number`; None if all queries were sent.

        The answer to line 2 shows how this firmware reports temperatures, which helps to resolve lost acknowledgements
        later. If the name of the firmware was lost, it is queried again, because the dialect depends on it.
        """
        if number == 2:
            return PROBE_COMMAND
        return b"M115" if number == 1 or (self.firmware is None and number <= _LAST_FIRMWARE_QUERY) else None

    def restart(self, now: float) -> None:
        """Repeat the handshake at once, because the printer was reset; the timeout keeps running."""
        self._next_request_at = now
        self.firmware = None
        self._capabilities.clear()

    def on_reply(self, reply: Identity | Capability) -> None:
        """Record the reported firmware or capability."""
        if isinstance(reply, Identity):
            self.firmware = reply.firmware
        else:
            self._capabilities[reply.name] = reply.enabled

    def has_capability(self, name: str) -> bool:
        """Return whether the firmware reports this capability as enabled."""
        return self._capabilities.get(name, False)

    @property
    def dialect(self) -> WireDialect:
        """Return the dialect that the caller chose, otherwise the dialect of the reported firmware."""
        return WIRE_DIALECTS[self._dialect or match_wire_dialect(self.firmware or "")]

    def make_identified_event(self) -> Identified:
        """Return the event with the firmware, capabilities and dialect of the printer."""
        name = self._dialect or match_wire_dialect(self.firmware or "")
        return Identified(self.firmware or "", tuple(self._capabilities.items()), name, self.dialect.advice)
