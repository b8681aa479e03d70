"""Meeting the printer: line numbers start anew, and it says who it is."""

from __future__ import annotations

from math import inf
from typing import Final

from printer_slicer.firmware import WIRE_DIALECTS, WireDialect, wire_dialect_name
from printer_slicer.stream.events import Identified
from printer_slicer.stream.replies import Capability, Identity
from printer_slicer.stream.send_history import ASK

__all__ = ["Handshake"]

_RESTART_COUNT: Final = b"\nN0 M110 N0*125\n"
_AGAIN: Final = 1.0
_MOST_INTRODUCTIONS: Final = 4
"""Line in which the name of the firmware is asked for the last time."""


class Handshake:
    """Asks for line 0 until the printer answers, and collects what it says about itself.

    A board that resets when the port opens hears nothing at first, so asking goes on; its `start` makes the
    next time at once.

    Attributes:
        firmware: name of the firmware, None until it is said.
    """

    def __init__(self, timeout: float, dialect: str | None = None) -> None:
        self._at = -inf
        self._dialect = dialect
        self.firmware: str | None = None
        self._capabilities: dict[str, bool] = {}
        self._timeout = timeout
        self._opened: float | None = None

    @property
    def begun(self) -> bool:
        """Whether it has asked."""
        return self._opened is not None

    @property
    def due(self) -> float:
        """When to ask next, s."""
        return self._at

    def late(self, now: float) -> bool:
        """Whether it has asked long enough."""
        return self._opened is not None and now >= self._opened + self._timeout

    def busy(self, now: float) -> None:
        """The printer cannot answer yet, but lives: the time it has for it begins anew."""
        if self._opened is not None:
            self._opened = now

    def send(self, now: float) -> bytes:
        """What to write now."""
        if self._opened is None:
            self._opened = now
        if now < self._at:
            return b""
        self._at = now + _AGAIN
        return _RESTART_COUNT

    def question(self, number: int) -> bytes | None:
        """What to ask in line `number`, None after the last question.

        The answer to the second shows how this firmware answers it, and that will settle doubts later. Where the name
        got lost it is asked for again: how lines must be sent depends on it.
        """
        if number == 2:
            return ASK
        return b"M115" if number == 1 or (self.firmware is None and number <= _MOST_INTRODUCTIONS) else None

    def forget(self, now: float) -> None:
        """The printer has just begun, or does not count as it should: ask at once, within the same time."""
        self._at = now
        self.firmware = None
        self._capabilities.clear()

    def hear(self, said: Identity | Capability) -> None:
        """Note what the printer says about itself."""
        if isinstance(said, Identity):
            self.firmware = said.firmware
        else:
            self._capabilities[said.name] = said.enabled

    def can(self, name: str) -> bool:
        """Whether the firmware says that it has this capability."""
        return self._capabilities.get(name, False)

    @property
    def dialect(self) -> WireDialect:
        """How to speak to it: as was wished, or as its name tells."""
        return WIRE_DIALECTS[self._dialect or wire_dialect_name(self.firmware or "")]

    def identified(self) -> Identified:
        """What it knows about the printer."""
        name = self._dialect or wire_dialect_name(self.firmware or "")
        return Identified(self.firmware or "", tuple(self._capabilities.items()), name, self.dialect.advice)
