"""Decide whether a line or only its acknowledgement was lost, for firmware that ignores line numbers.

Such firmware accepts any line at any time. It would execute a repeated line twice and a line after a lost one without
it, and probing the next number reveals neither. So only one line is in flight. If its acknowledgement is missing, two
queries follow it: the position (M114) and the temperatures (M105). Answers keep their order, and the answer to M105
cannot be mistaken for another one. Once it has arrived, no earlier answer is outstanding.

received before it             conclusion about the line
the position after the line    executed
the position before the line   lost; it is sent again
two plain oks                  executed: one ok is for the line, one for M114. Not so if the printer reported
                               a command that was not sent, the remains of a query, because that gets an ok too
neither                        unknown. If the command only sets a value or moves to an absolute position, it is sent
                               again, because twice has the same effect as once. Otherwise the queries are repeated,
                               and finally the print ends
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import Effect, commands_that

if TYPE_CHECKING:
    from printer_slicer.gcode.state import Place

__all__ = ["LineFate", "UnackedLine", "is_repeatable"]

_CLOSE: Final = 0.006
"""mm; firmware reports two or three decimals."""

_ROUNDS: Final = 3

_REPEATABLE: Final = commands_that(Effect.REPEATABLE)
_LINES: Final = commands_that(Effect.MOVES) - commands_that(Effect.ARC)


class LineFate(Enum):
    """What happened to the line."""

    EXECUTED = "executed"
    LOST = "lost"
    OPEN = "open"
    UNKNOWN = "unknown"


def is_repeatable(word: bytes, *, relative: bool) -> bool:
    """Return whether executing a command twice has the same effect as once; `relative`: it is a relative move."""
    return word in _REPEATABLE or word.startswith(b"T") or (word in _LINES and not relative)


class UnackedLine:
    """Queries about one line whose acknowledgement is missing.

    Args:
        before, after: end position of the motion without and with the line.
        repeatable: whether the line may be executed twice.
        is_probe: whether the line is itself an M105, so that its own answer looks like that to the last query.

    Attributes:
        position: reported position, None until reported.
        needs_position: whether to send both queries next; else only the second.
    """

    def __init__(self, before: Place, after: Place, *, repeatable: bool, is_probe: bool = False) -> None:
        self.position: Place | None = None
        self.needs_position = True
        self._places = (before, after)
        self._repeatable = repeatable
        self._oks = 0
        self._rounds = 0
        self._own_answer = is_probe

    def on_bare_ok(self) -> None:
        """Count an ok without temperatures: it belongs to the line or to the first query."""
        self._oks += 1

    def on_stray_command(self) -> None:
        """Ignore one ok, because the printer has read a command that was not sent."""
        self._oks -= 1

    def resolve(self) -> LineFate | None:
        """Conclude what happened to the line when temperatures arrive; None if they may answer the line itself."""
        if self._own_answer and self.position is None and not self._oks:
            self._own_answer = False
            return None
        self._rounds += 1
        fate = self._fate()
        if fate is LineFate.OPEN and self._rounds >= _ROUNDS:
            return LineFate.UNKNOWN
        self.needs_position, self.position, self._oks = True, None, 0
        return fate

    def _fate(self) -> LineFate:
        was, is_now = (_matches(self.position, place) for place in self._places)
        if self.position is not None and was != is_now:
            return LineFate.EXECUTED if is_now else LineFate.LOST
        if self._oks >= 2:
            return LineFate.EXECUTED
        return LineFate.LOST if self._repeatable else LineFate.OPEN


def _matches(reported: Place | None, place: Place) -> bool:
    """Return whether the reported position agrees with `place`."""
    return reported is None or all(
        is_at is None or to_be is None or abs(is_at - to_be) <= _CLOSE
        for is_at, to_be in zip(reported, place, strict=True)
    )
