"""Limit of lines in flight: two at first, one after an error, more only where it is safe.

More are not always safe: after a damaged line Marlin discards received data. The data that arrives next then starts in
the middle of a line. Without a number it needs no checksum and is executed. With two lines in flight the second has
arrived before the error is reported; with three the third has not.

lines          condition
one            the firmware ignores line numbers, see `unacked_line`
one            for 300 lines after any error on this cable, and never more than two again
three or more  the firmware rejects lines without a number, so it cannot execute the tail of a line
three or more  answers arrive faster than the baud rate allows: the link is native USB, which has flow control and
               loses nothing
three or more  `ok N P B` reports that the planner runs empty, and 500 lines had no error: the cable is good and the
               printer needs the lines. Such oks would also reveal that the tail of a line was executed
two            otherwise

The limit never exceeds the firmware's command queue. One place of it stays free so that the firmware can read M112,
unless an emergency parser reads M112 as it arrives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.firmware import WireDialect

__all__ = ["QUESTION_ROOM", "Window"]

QUESTION_ROOM: Final = 16
"""Bytes of the window reserved for a probe."""

_CAREFUL_LINES: Final = 300
"""Lines sent one at a time after an error."""

_CLEAN_LINES: Final = 200
"""Lines without an error before more than two may be in flight."""

_CLEAN_FOR_ADVANCED: Final = 500

_QUICK_ANSWERS: Final = 3
"""Number of answers faster than the baud rate allows before the link counts as native USB."""

_SHORTEST_ANSWER: Final = len("ok T:20.0 /0.0\n")
_BITS: Final = 10  # of a byte, with start and stop
_FAR_TOO_SOON: Final = 0.7

_DRY: Final = 0.75
"""Free share of the planner from which it counts as running empty."""

_DRY_ANSWERS: Final = 32
"""Number of consecutive answers that report it."""


class Window:
    """The limit of lines and bytes in flight.

    Args:
        lines: limit of lines at the start, and on any cable that is not known to be better.
        size: limit of bytes; the receive buffer holds one more.
        baud: baud rate of the serial port; None: native USB is not detected.

    Attributes:
        lines: current limit of lines in flight.
        size: current limit of bytes in flight.
    """

    def __init__(self, lines: int, size: int, baud: int | None = None) -> None:
        self.lines, self.size = lines, size
        self._first = lines
        self._baud = baud
        self._most = lines
        self._places = 0  # size of the command queue as `ok B` shows; 0 while unknown
        self._planner = 0  # size of the planner as `ok P` shows
        self._dry = 0  # consecutive answers that report an almost empty planner
        self._dialect: WireDialect | None = None
        self._parser = False
        self._careful = self._clean = self._quick = 0
        self._bad = False

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """Apply the rules of the reported firmware."""
        self._dialect, self._parser = dialect, emergency_parser
        if not dialect.checks_line_numbers:
            # A line after a lost one would be executed without it.
            self._first = 1
        self._settle()

    @property
    def is_careful(self) -> bool:
        """Return whether there was an error recently."""
        return self._careful > 0

    def on_error(self) -> None:
        """Handle a lost or damaged line or answer: one line at a time for a while, then never more than two."""
        self._careful = _CAREFUL_LINES
        self._bad = True
        self.lines = 1

    def on_accepted(self, count: int) -> None:
        """Count accepted lines."""
        self._clean += count
        if self._careful:
            self._careful = max(0, self._careful - count)
            if not self._careful:
                self._settle()
        elif self._clean % _CLEAN_LINES < count:
            self._settle()

    def on_probe_answer(self, size: int, seconds: float) -> None:
        """Record the response time, s, of a probe of `size` bytes."""
        if self._baud is None:
            return
        soonest = (size + _SHORTEST_ANSWER) * _BITS / self._baud
        self._quick = self._quick + 1 if seconds < _FAR_TOO_SOON * soonest else 0

    def on_queue_report(self, planner: int, places: int) -> None:
        """Handle an ok that reports the free places of the planner and of the command queue."""
        self._planner = max(self._planner, planner)
        # The acknowledged command still occupies its place.
        self._places = max(self._places, places + 1)
        self._dry = self._dry + 1 if planner >= _DRY * self._planner else 0

    def _settle(self) -> None:
        """Recompute the limits."""
        if self._careful:
            return
        self.lines = self._first
        if self._dialect is None or self._bad or self._clean < _CLEAN_LINES:
            return
        usb = self._quick >= _QUICK_ANSWERS
        needed = self._clean >= _CLEAN_FOR_ADVANCED and self._dry >= _DRY_ANSWERS
        if usb or needed or self._dialect.unnumbered_lines == "refused":
            places = self._places or self._dialect.queue_size
            free = places if self._parser else places - 1
            self.lines = max(self._first, min(self._dialect.max_lines_in_flight, free))
        if usb:
            self.size = max(self.size, self._dialect.max_lines_in_flight * (self._dialect.max_line_bytes + 1))
