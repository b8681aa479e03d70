"""Decide whether a line or only its acknowledgement was lost, for firmware that ignores line numbers.

Such firmware accepts any line at any time. It would execute a repeated line twice, and it would execute the line after
a lost line. Probing the next number reveals neither. So only one line is in flight. If its acknowledgement is missing,
two queries follow it: the position (M114) and the temperatures (M105). Answers keep their order, and the answer to M105
cannot be mistaken for another one. Once it has arrived, no earlier answer is outstanding.

received before it             conclusion about the line
the position after the line    executed
the position before the line   lost; it is sent again
two plain oks                  executed: one ok is for the line, one for M114. An ok does not count if the printer
                               reported a command that was not sent (part of a query), because that gets an ok too
neither                        unknown. If the command only sets a value or moves to an absolute position, it is sent
                               again, because twice has the same effect as once. Otherwise the queries are repeated,
                               and finally the print ends
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import Effect, find_codes

if TYPE_CHECKING:
    from printer_slicer.gcode.state import Place

__all__ = ["LineFate", "UnackedLine", "is_repeatable"]

_POSITION_TOLERANCE: Final = 0.006
"""mm; firmware reports two or three decimals."""

_MAX_ROUNDS: Final = 3

_REPEATABLE: Final = find_codes(Effect.REPEATABLE)
_STRAIGHT_MOVES: Final = find_codes(Effect.MOVES) - find_codes(Effect.ARC)


class LineFate(Enum):
    """Fate of a line whose acknowledgement is missing."""

    EXECUTED = "executed"
    LOST = "lost"
    UNDECIDED = "undecided"
    UNKNOWN = "unknown"


def is_repeatable(word: bytes, *, relative: bool) -> bool:
    """Return whether a command may be executed twice; `relative` says whether moves are relative."""
    return word in _REPEATABLE or word.startswith(b"T") or (word in _STRAIGHT_MOVES and not relative)


class UnackedLine:
    """Finds out whether the printer has executed a line whose acknowledgement is missing.

    Args:
        before, after: end position of the motion without and with the line.
        repeatable: whether the line may be executed twice.
        is_probe: whether the line is itself an M105, whose answer looks like the answer to the last query.

    Attributes:
        position: reported position, None until reported.
        needs_position: whether to query position and temperatures next; False: only temperatures.
    """

    def __init__(self, before: Place, after: Place, *, repeatable: bool, is_probe: bool = False) -> None:
        self.position: Place | None = None
        self.needs_position = True
        self._positions = (before, after)
        self._repeatable = repeatable
        self._n_oks = 0
        self._n_rounds = 0
        self._expects_own_answer = is_probe

    def on_bare_ok(self) -> None:
        """Count an ok without temperatures, which answers the line or the position query."""
        self._n_oks += 1

    def on_stray_command(self) -> None:
        """Ignore one ok, because the printer has read a command that was not sent."""
        self._n_oks -= 1

    def resolve_fate(self) -> LineFate | None:
        """Return the fate of the line after an ok with temperatures; None if that ok may answer the line."""
        if self._expects_own_answer and self.position is None and not self._n_oks:
            self._expects_own_answer = False
            return None
        self._n_rounds += 1
        fate = self._decide_fate()
        if fate is LineFate.UNDECIDED and self._n_rounds >= _MAX_ROUNDS:
            return LineFate.UNKNOWN
        self.needs_position, self.position, self._n_oks = True, None, 0
        return fate

    def _decide_fate(self) -> LineFate:
        """Return the fate of the line by the table of this module."""
        is_before, is_after = (_matches_position(self.position, place) for place in self._positions)
        if self.position is not None and is_before != is_after:
            return LineFate.EXECUTED if is_after else LineFate.LOST
        if self._n_oks >= 2:
            return LineFate.EXECUTED
        return LineFate.LOST if self._repeatable else LineFate.UNDECIDED


def _matches_position(reported: Place | None, place: Place) -> bool:
    """Return whether the reported position agrees with `place`; unknown coordinates always agree."""
    return reported is None or all(
        reported_value is None
        or expected_value is None
        or abs(reported_value - expected_value) <= _POSITION_TOLERANCE
        for reported_value, expected_value in zip(reported, place, strict=True)
    )
