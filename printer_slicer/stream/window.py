"""How many lines may be in flight: two at first, one after an error, more only where that cannot do harm.

Why not always more: Marlin throws away what has arrived when a line is bad. What is still on the wire then begins in
the middle of a line; without its number it needs no checksum, and is executed. With two lines in flight the second has
arrived before the error is told, with three the third has not.

lines           where
one             always, where the firmware does not look at line numbers, see `doubt`
one             for 300 lines after any error or doubt on this cable, and never more than two again
three and more  the firmware refuses lines without a number: it cannot execute the tail of one
three and more  answers come sooner than the set speed of a serial port could bring them: the port is USB all the way,
                which loses nothing and makes the sender wait
three and more  `ok N P B`, which would show that a tail was executed, says that the planner runs dry, and there was no
                error in 500 lines: the cable is good, and the printer needs them
two             everywhere else

Three and more are never more than the commands that the firmware reads ahead, less one place kept free so that it can
read M112; all of them where an emergency parser sees M112 as it arrives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.firmware import WireDialect

__all__ = ["QUESTION_ROOM", "Window"]

QUESTION_ROOM: Final = 16
"""Bytes of the window kept for a question about the lines in flight."""

_CAREFUL_LINES: Final = 300
"""Lines sent one at a time after an error."""

_CLEAN_LINES: Final = 200
"""Lines without an error before more than two are sent."""

_CLEAN_FOR_ADVANCED: Final = 500

_QUICK_ANSWERS: Final = 3
"""Answers that came too soon for a serial port, before it is believed to be none."""

_SHORTEST_ANSWER: Final = len("ok T:20.0 /0.0\n")
_BITS: Final = 10  # of a byte, with start and stop
_FAR_TOO_SOON: Final = 0.7

_DRY: Final = 0.75
"""Share of the planner that is free when it runs dry."""

_DRY_ANSWERS: Final = 32
"""Answers in a row that say so."""


class Window:
    """The limit of lines and bytes in flight.

    Args:
        lines: at first, and at most on a cable that is not known to be better.
        size: bytes; the receive buffer holds one more.
        baud: of the serial port, if that means anything; without it no port is found to be quicker.

    Attributes:
        lines: that may be in flight now.
        size: bytes that may be in flight now.
    """

    def __init__(self, lines: int, size: int, baud: int | None = None) -> None:
        self.lines, self.size = lines, size
        self._first = lines
        self._baud = baud
        self._most = lines
        self._places = 0  # commands read ahead, as `ok B` shows; 0 as long as it does not
        self._planner = 0  # moves that fit into the planner, as `ok P` shows
        self._dry = 0  # answers in a row that say that the planner runs dry
        self._dialect: WireDialect | None = None
        self._parser = False
        self._careful = self._clean = self._quick = 0
        self._bad = False

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """The firmware is known now."""
        self._dialect, self._parser = dialect, emergency_parser
        if not dialect.checks_line_numbers:
            # A line behind a lost one would be executed without it.
            self._first = 1
        self._settle()

    @property
    def careful(self) -> bool:
        """Whether an error was not long ago."""
        return self._careful > 0

    def error(self) -> None:
        """A line or an answer was lost or damaged: one line at a time for a while, and never more than two again."""
        self._careful = _CAREFUL_LINES
        self._bad = True
        self.lines = 1

    def accepted(self, count: int) -> None:
        """So many lines were accepted."""
        self._clean += count
        if self._careful:
            self._careful = max(0, self._careful - count)
            if not self._careful:
                self._settle()
        elif self._clean % _CLEAN_LINES < count:
            self._settle()

    def timed(self, size: int, seconds: float) -> None:
        """A question of `size` bytes was answered in so many seconds, by what answers nothing else."""
        if self._baud is None:
            return
        soonest = (size + _SHORTEST_ANSWER) * _BITS / self._baud
        self._quick = self._quick + 1 if seconds < _FAR_TOO_SOON * soonest else 0

    def heard(self, planner: int, places: int) -> None:
        """An ok told the free places of the planner and of the command queue."""
        self._planner = max(self._planner, planner)
        # The command that is answered still holds its place.
        self._places = max(self._places, places + 1)
        self._dry = self._dry + 1 if planner >= _DRY * self._planner else 0

    def _settle(self) -> None:
        """Set the limits anew."""
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
