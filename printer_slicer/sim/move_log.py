"""A log that passes all executed moves, in chunks, to a consumer function."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes

__all__ = ["COLUMNS", "MoveConsumer", "MoveLog"]

COLUMNS: Final = 9
"""Columns of a row: number of the executed command, from 1; x, y, z at the start and at the end, mm; filament fed, mm;
cruise speed, mm/s."""

CHUNK_ROWS: Final = 8192
"""Number of started moves that are delivered together."""

MoveConsumer: TypeAlias = Callable[["array[float]", "array[float]", float], None]
"""A function that receives rows of started moves, their durations, s, and the clogged share of the
filament, which does not come out of the nozzle."""


class MoveLog:
    """A log of moves and their durations, in order of execution.

    Args:
        consumer: function that receives the moves, several thousand at a time.
    """

    __slots__ = ("_clogged_share", "_consumer", "_rows", "_seconds")

    def __init__(self, consumer: MoveConsumer) -> None:
        self._consumer = consumer
        self._clogged_share = 0.0
        self._rows = array("d")
        self._seconds = array("d")

    def log_planned_move(self, command: int, start: Axes, end: Axes, speed: float) -> None:
        """Log a planned move of a command, from `start` to `end`, mm, at a cruise speed, mm/s."""
        x, y, z, e = end
        self._rows.extend((command, start[0], start[1], start[2], x, y, z, e - start[3], speed))

    def log_move_start(self, seconds: float) -> None:
        """Log the start of the oldest waiting move, which takes `seconds`."""
        self._seconds.append(seconds)
        if len(self._seconds) >= CHUNK_ROWS:
            self.flush()

    def add_batch(self, rows: bytes, seconds: bytes) -> None:
        """Log many planned moves, and the durations of the moves that have started, both as bytes."""
        self._rows.frombytes(rows)
        self._seconds.frombytes(seconds)
        if len(self._seconds) >= CHUNK_ROWS:
            self.flush()

    def set_clogged_share(self, share: float) -> None:
        """Set which share of the fed filament does not come out of the nozzle from now on."""
        if share != self._clogged_share:
            self.flush()
            self._clogged_share = share

    def discard_waiting_moves(self) -> None:
        """Discard planned moves that have not started."""
        del self._rows[len(self._seconds) * COLUMNS :]

    def flush(self) -> None:
        """Pass all started moves to the consumer function."""
        count = len(self._seconds)
        if count:
            rows, self._rows = self._rows[: count * COLUMNS], self._rows[count * COLUMNS :]
            seconds, self._seconds = self._seconds, array("d")
            self._consumer(rows, seconds, self._clogged_share)
