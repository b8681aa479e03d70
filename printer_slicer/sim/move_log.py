"""A log of all executed moves, delivered in chunks."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes

__all__ = ["COLUMNS", "MoveConsumer", "MoveLog"]

COLUMNS: Final = 9
"""Columns of a row: number of the executed command, from 1; x, y, z at the start and at the end, mm; mm of filament
fed; cruise speed, mm/s."""

ROWS: Final = 8192

MoveConsumer: TypeAlias = Callable[["array[float]", "array[float]", float], None]
"""Receives rows of started moves, their durations, s, and the share of the fed filament that does not come out."""


class MoveLog:
    """Logs moves and their durations, in order.

    Args:
        take: receives the moves, several thousand at a time.
    """

    __slots__ = ("_kept_back", "_rows", "_seconds", "_take")

    def __init__(self, take: MoveConsumer) -> None:
        self._take = take
        self._kept_back = 0.0
        self._rows = array("d")
        self._seconds = array("d")

    def add_planned(self, command: int, start: Axes, end: Axes, speed: float) -> None:
        """Log a planned move."""
        x, y, z, e = end
        self._rows.extend((command, start[0], start[1], start[2], x, y, z, e - start[3], speed))

    def start_next(self, seconds: float) -> None:
        """Log the duration of the oldest planned move that had not started."""
        self._seconds.append(seconds)
        if len(self._seconds) >= ROWS:
            self.flush()

    def add_batch(self, rows: bytes, seconds: bytes) -> None:
        """Log many planned moves and the durations of many started ones."""
        self._rows.frombytes(rows)
        self._seconds.frombytes(seconds)
        if len(self._seconds) >= ROWS:
            self.flush()

    def keep_back(self, share: float) -> None:
        """Set the share of the fed filament that does not come out from now on."""
        if share != self._kept_back:
            self.flush()
            self._kept_back = share

    def forget(self) -> None:
        """Discard planned moves that have not started."""
        del self._rows[len(self._seconds) * COLUMNS :]

    def flush(self) -> None:
        """Deliver all started moves."""
        count = len(self._seconds)
        if count:
            rows, self._rows = self._rows[: count * COLUMNS], self._rows[count * COLUMNS :]
            seconds, self._seconds = self._seconds, array("d")
            self._take(rows, seconds, self._kept_back)
