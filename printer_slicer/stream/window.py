"""Limit of lines in flight: two at first, one after an error, more only where it is safe.

More than two lines are not always safe: after a damaged line Marlin discards received data. The data that it reads next
may start in the middle of a line. Without a number it needs no checksum and is executed. With two lines in flight the
second has arrived before the error is reported; with three, the third has not.

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

__all__ = ["PROBE_BYTES", "Window"]

PROBE_BYTES: Final = 16
"""Bytes of the window reserved for a probe."""

_CAREFUL_LINES: Final = 300
"""Number of lines that are sent one at a time after an error."""

_CLEAN_LINES: Final = 200
"""Number of lines without an error before more than two may be in flight."""

_CLEAN_LINES_FOR_ADVANCED_OK: Final = 500
"""Number of lines without an error before more than two may be in flight, if only `ok N P B` suggests it."""

_QUICK_ANSWERS: Final = 3
"""Number of answers faster than the baud rate allows before the link counts as native USB."""

_SHORTEST_ANSWER: Final = len("ok T:20.0 /0.0\n")
_BITS_PER_BYTE: Final = 10  # with start and stop bit
_USB_TIME_RATIO: Final = 0.7

_EMPTY_SHARE: Final = 0.75
"""Fraction of free places in the planner from which the planner counts as running empty."""

_EMPTY_ANSWERS: Final = 32
"""Number of consecutive answers that report an almost empty planner before more lines may be in flight."""


class Window:
    """Limit of lines and bytes that may be in flight.

    Args:
        lines: limit of lines at the start, and on any cable that has not proved to be good.
        size: limit of bytes; the receive buffer holds one byte more.
        baud: baud rate of the serial port; None: native USB is not detected.

    Attributes:
        lines: current limit of lines in flight.
        size: current limit of bytes in flight.
    """

    def __init__(self, lines: int, size: int, baud: int | None = None) -> None:
        self.lines, self.size = lines, size
        self._initial_lines = lines
        self._baud = baud
        self._queue_size = 0  # size of the command queue as `ok B` shows; 0 while unknown
        self._planner_size = 0  # size of the planner as `ok P` shows
        self._n_empty_answers = 0  # consecutive answers that report an almost empty planner
        self._dialect: WireDialect | None = None
        self._has_emergency_parser = False
        self._careful_lines_left = self._n_clean_lines = self._n_quick_answers = 0
        self._has_had_error = False

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """Apply the protocol rules of the firmware that the printer has reported."""
        self._dialect, self._has_emergency_parser = dialect, emergency_parser
        if not dialect.checks_line_numbers:
            # The firmware would execute the line after a lost line.
            self._initial_lines = 1
        self._update_limits()

    @property
    def is_careful(self) -> bool:
        """Return whether only one line may be in flight, because of a recent error."""
        return self._careful_lines_left > 0

    def on_error(self) -> None:
        """Allow only one line in flight for a while, and then two, because a line or an answer was lost."""
        self._careful_lines_left = _CAREFUL_LINES
        self._has_had_error = True
        self.lines = 1

    def on_accepted(self, count: int) -> None:
        """Count `count` accepted lines, and raise the limit after enough lines without an error."""
        self._n_clean_lines += count
        if self._careful_lines_left:
            self._careful_lines_left = max(0, self._careful_lines_left - count)
            if not self._careful_lines_left:
                self._update_limits()
        elif self._n_clean_lines % _CLEAN_LINES < count:
            self._update_limits()

    def on_probe_answer(self, size: int, seconds: float) -> None:
        """Record the response time, s, of a probe of `size` bytes."""
        if self._baud is None:
            return
        shortest_time = (size + _SHORTEST_ANSWER) * _BITS_PER_BYTE / self._baud
        self._n_quick_answers = self._n_quick_answers + 1 if seconds < _USB_TIME_RATIO * shortest_time else 0

    def on_queue_report(self, planner: int, places: int) -> None:
        """Handle an ok that reports the free places of the planner and of the command queue."""
        self._planner_size = max(self._planner_size, planner)
        # The acknowledged command still occupies its place.
        self._queue_size = max(self._queue_size, places + 1)
        self._n_empty_answers = (
            self._n_empty_answers + 1 if planner >= _EMPTY_SHARE * self._planner_size else 0
        )

    def _update_limits(self) -> None:
        """Recompute the limits of lines and bytes in flight."""
        if self._careful_lines_left:
            return
        self.lines = self._initial_lines
        if self._dialect is None or self._has_had_error or self._n_clean_lines < _CLEAN_LINES:
            return
        is_usb = self._n_quick_answers >= _QUICK_ANSWERS
        needs_lines = (
            self._n_clean_lines >= _CLEAN_LINES_FOR_ADVANCED_OK and self._n_empty_answers >= _EMPTY_ANSWERS
        )
        if is_usb or needs_lines or self._dialect.unnumbered_lines == "refused":
            places = self._queue_size or self._dialect.queue_size
            free = places if self._has_emergency_parser else places - 1
            self.lines = max(self._initial_lines, min(self._dialect.max_lines_in_flight, free))
        if is_usb:
            self.size = max(self.size, self._dialect.max_lines_in_flight * (self._dialect.max_line_bytes + 1))
