"""Every move as the machine made it, handed on in chunks: whoever looks at them decides how long they are kept."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes

__all__ = ["COLUMNS", "Taker", "Track"]

COLUMNS: Final = 9
"""Numbers of a row: the executed command that moved, counted from 1; x, y, z where the move begins and where it ends;
mm of filament fed; the cruise speed, mm/s."""

ROWS: Final = 8192

Taker: TypeAlias = Callable[["array[float]", "array[float]", float], None]
"""Is given rows of moves that have begun, one after the other, how long each takes, s, and which share of the filament
they feed does not come out."""


class Track:
    """Moves and their times, in order.

    Args:
        take: is given them, some thousand at a time.
    """

    __slots__ = ("_kept_back", "_rows", "_seconds", "_take")

    def __init__(self, take: Taker) -> None:
        self._take = take
        self._kept_back = 0.0
        self._rows = array("d")
        self._seconds = array("d")

    def planned(self, command: int, start: Axes, end: Axes, speed: float) -> None:
        """A move has its place in the planner."""
        x, y, z, e = end
        self._rows.extend((command, start[0], start[1], start[2], x, y, z, e - start[3], speed))

    def begun(self, seconds: float) -> None:
        """The oldest planned move that had not begun has, and takes so long."""
        self._seconds.append(seconds)
        if len(self._seconds) >= ROWS:
            self.flush()

    def add_batch(self, rows: bytes, seconds: bytes) -> None:
        """Many moves were planned, and many begun."""
        self._rows.frombytes(rows)
        self._seconds.frombytes(seconds)
        if len(self._seconds) >= ROWS:
            self.flush()

    def keep_back(self, share: float) -> None:
        """From now on so much of the filament that moves feed does not come out."""
        if share != self._kept_back:
            self.flush()
            self._kept_back = share

    def forget(self) -> None:
        """What was planned and has not begun never will."""
        del self._rows[len(self._seconds) * COLUMNS :]

    def flush(self) -> None:
        """Hand on what has begun."""
        count = len(self._seconds)
        if count:
            rows, self._rows = self._rows[: count * COLUMNS], self._rows[count * COLUMNS :]
            seconds, self._seconds = self._seconds, array("d")
            self._take(rows, seconds, self._kept_back)
