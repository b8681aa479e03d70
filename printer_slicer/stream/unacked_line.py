"""Was the line lost, or only its answer? How to know where line numbers are not checked.

Such firmware takes any line at any time: a repeat is executed twice, a line behind a lost one is executed without it,
and no question about the next number brings that out. So only one line is in flight, and when its answer is missing two
questions go out behind it: where are you (M114), and what are your temperatures (M105). Answers keep their order, and
that of the second question cannot be taken for another: once it is here, all answers that will ever come are here.

in between came             then the line
the position behind it      was executed
the position before it      was lost, and goes out again
two bare oks                was executed: one is its own, the other that of M114; but not if the printer spoke of
                            a command that nobody sent, the remains of a question, which gets an ok too
neither, and the command    may have been executed. If it only sets something, or moves to a place that is given
                            without regard to where it is, twice is the same as once and it goes out again;
                            else the questions are asked again, and at last the print ends: nobody can know
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import Effect, commands_that

if TYPE_CHECKING:
    from printer_slicer.gcode.state import Place

__all__ = ["LineFate", "UnackedLine", "is_repeatable"]

_CLOSE: Final = 0.006
"""mm; firmware says two or three decimals."""

_ROUNDS: Final = 3

_REPEATABLE: Final = commands_that(Effect.REPEATABLE)
_LINES: Final = commands_that(Effect.MOVES) - commands_that(Effect.ARC)


class LineFate(Enum):
    """What became of the line."""

    EXECUTED = "executed"
    LOST = "lost"
    OPEN = "open"
    NEVER_KNOWN = "never known"


def is_repeatable(word: bytes, *, relative: bool) -> bool:
    """Whether a command twice in a row does the same as once; `relative`: as a move it counts from where it is."""
    return word in _REPEATABLE or word.startswith(b"T") or (word in _LINES and not relative)


class UnackedLine:
    """The questions about one line.

    Args:
        before, after: where the motion ends without and with it.
        repeatable: it may go out twice.
        asks: it is itself the question that ends a doubt, so its own answer looks like that.

    Attributes:
        place: where the printer says it is, None until it says so.
        pair: whether the next questions are both; else only the second.
    """

    def __init__(self, before: Place, after: Place, *, repeatable: bool, asks: bool = False) -> None:
        self.place: Place | None = None
        self.pair = True
        self._places = (before, after)
        self._repeatable = repeatable
        self._oks = 0
        self._rounds = 0
        self._own_answer = asks

    def bare_ok(self) -> None:
        """An ok without temperatures: one more that is the line's own or that of the first question."""
        self._oks += 1

    def misread(self) -> None:
        """The printer read something that was not sent, and says ok to that."""
        self._oks -= 1

    def closed(self) -> LineFate | None:
        """The answer with the temperatures is here: what became of the line; None if it may be the line's own."""
        if self._own_answer and self.place is None and not self._oks:
            self._own_answer = False
            return None
        self._rounds += 1
        fate = self._fate()
        if fate is LineFate.OPEN and self._rounds >= _ROUNDS:
            return LineFate.NEVER_KNOWN
        self.pair, self.place, self._oks = True, None, 0
        return fate

    def _fate(self) -> LineFate:
        was, is_now = (_fits(self.place, place) for place in self._places)
        if self.place is not None and was != is_now:
            return LineFate.EXECUTED if is_now else LineFate.LOST
        if self._oks >= 2:
            return LineFate.EXECUTED
        return LineFate.LOST if self._repeatable else LineFate.OPEN


def _fits(told: Place | None, place: Place) -> bool:
    """Whether the printer may be at `place` by what it told."""
    return told is None or all(
        is_at is None or to_be is None or abs(is_at - to_be) <= _CLOSE
        for is_at, to_be in zip(told, place, strict=True)
    )
