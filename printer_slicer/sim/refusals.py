"""What a firmware says of lines that it does not take, and how it asks for them again."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.sim.board import Board
    from printer_slicer.sim.line_reader import LineReader
    from printer_slicer.sim.switches import FrontEnd
    from printer_slicer.sim.tally import Tally

__all__ = ["Refusals"]


class Refusals:
    """Answers what the reader of lines refused, passed over or lost.

    Attributes:
        asking: a refused line still needs its request.
        last_byte: when the last byte arrived, s.
    """

    def __init__(
        self, reader: LineReader, board: Board, front_end: FrontEnd, tally: Tally, now: float
    ) -> None:
        self.asking = False
        self.last_byte = now
        self._reader = reader
        self._board = board
        self._front_end = front_end
        self._tally = tally

    def answer(self) -> None:
        """Answer a line that was not taken, or, when everything was read, what came too fast."""
        reader = self._reader
        if reader.refused:
            self._refuse()
        elif reader.passed is not None:
            for said in reader.passed:
                self._board.say(said)
            reader.passed = None
        else:
            self._look_at_overflow()

    def ask_again(self) -> None:
        """Ask for the line after the last good one."""
        self.asking = False
        if self._front_end.flushes_on_error:
            self._reader.flush()
        self._tally.resends += 1
        self._board.say(self._front_end.resend.format(wanted=self._reader.last + 1))
        if self._front_end.ok_after_resend:
            self._board.say("ok")

    def due(self) -> float:
        """When it will wait no longer for the rest of a line, or for one that it asked for, s; infinite for never."""
        reader, front_end = self._reader, self._front_end
        asked = front_end.partial_asks and reader.skipping >= 0 and not reader.waiting
        return self.last_byte + front_end.partial_seconds if asked or reader.partial else inf

    def abandon(self, now: float) -> None:
        """Throw the beginning of a line away, and ask for it again where the firmware does."""
        self.last_byte = now
        self._reader.abandon()
        if self._front_end.partial_asks:
            self.asking = True
        else:
            self._board.report("RX timeout")

    def _refuse(self) -> None:
        """Say what is wrong with a line; saying so may take time in which more arrives."""
        reader = self._reader
        if reader.fault:
            self._board.say(reader.fault)
        reader.fault, reader.refused = "", False
        self._tally.line_errors += 1
        self.asking = True

    def _look_at_overflow(self) -> None:
        """Everything was read: say whether some of it came too fast."""
        reader = self._reader
        if reader.overflowed and self._front_end.tells_overflow:
            reader.abandon()
            self._board.say("Full RX Buffer")
        reader.overflowed = False
