"""Many commands at once: what a printer would have done by a moment, reckoned by others by its own rules.

Commands that only move, or set something, need no firmware to be gone through one by one where nothing else can happen:
no fault, no report, nobody who waits. Who takes this way has to know all that it says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from printer_slicer.sim.commands import run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes, Limits
    from printer_slicer.sim.board import Board
    from printer_slicer.sim.machine import Position
    from printer_slicer.sim.mover import Planned

__all__ = ["Leap"]


@dataclass(frozen=True, slots=True)
class Leap:
    """What was done between two moments.

    Attributes:
        texts: of the commands that were executed.
        number: of the last of their lines.
        now: s, when the last was executed.
        timed: those of them that change heaters, fans and displays, with their moments, s.
        extruded_at: s, when filament was fed for the last time; before everything if it was not.
        position: where the plan ends, x, y, z, e.
        feed: mm/s asked for last.
        limits: in force at the end.
        planned: what is being made and what waits at the end.
        seconds: of all moves that were begun.
        fed, retracted: mm of filament.
        low, high: corners of the box around everything laid, mm; None where nothing was.
        heights: z at which plastic was laid, mm, in order of the first time.
        peak_feed: mm/s of filament while laying, at the cruise speed of a move.
        rows, row_seconds: of the moves that were planned, and of those that were begun, as `Track` has them, in bytes.
    """

    texts: Sequence[str]
    number: int
    now: float
    timed: Sequence[tuple[float, str]]
    extruded_at: float
    position: Axes
    feed: float
    limits: Limits
    planned: Planned
    seconds: float
    fed: float
    retracted: float
    low: Position | None
    high: Position | None
    heights: Sequence[float]
    peak_feed: float
    rows: bytes = b""
    row_seconds: bytes = b""

    def land(self, board: Board) -> None:
        """Bring a board to where all this has led."""
        board.settle()
        board.heaters.flow(self.fed - self.retracted, self.now - board.now)
        for moment, text in self.timed:
            board.now = moment
            run(board, text)
        board.now = self.now
        if not board.hot and self.extruded_at > (self.timed[-1][0] if self.timed else board.now):
            board.warm_enough()
        board.position, board.feed = self.position, self.feed
        board.filament += self.fed - self.retracted
        if board.limits != self.limits:
            board.set_limits(self.limits)
        board.mover.leap(self.planned, self.seconds)
        board.heaters.flowed(board.mover.position(self.now)[3], self.now)
        tally = board.tally
        if tally.track is not None:
            tally.track.leapt(self.rows, self.row_seconds)
        tally.executed_all(self.texts)
        tally.filament_fed += self.fed
        tally.filament_retracted += self.retracted
        tally.peak_feed = max(tally.peak_feed, self.peak_feed)
        if self.low is not None and self.high is not None:
            tally.laid_within(self.low, self.high, self.heights)
