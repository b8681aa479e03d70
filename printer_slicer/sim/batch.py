"""Apply the combined effect of a run of simple commands.

Commands that only move, or set something, need no firmware to be gone through one by one where nothing else can happen:
no fault, no report, nobody who waits. `BatchStart` says, in plain numbers, all that such commands depend on; whoever
has computed their effect, with arrays or without, hands it back as a `Batch`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from printer_slicer.sim.commands import run
from printer_slicer.sim.moves import FARTHEST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.board import Board
    from printer_slicer.sim.machine import Position
    from printer_slicer.sim.mover import Planned

__all__ = ["Batch", "BatchStart"]


@dataclass(frozen=True, slots=True)
class BatchStart:
    """The state of a printer before a run of commands.

    Attributes:
        position: where the plan ends, x, y, z from the endstops, and e as the program counts it; mm.
        offset: logical minus machine coordinates of x, y, z, mm.
        relative, relative_e: whether words of x, y, z and of e are relative.
        unit: mm per unit of the program.
        feed: mm/s asked for last.
        speed_ratio: of M220.
        e_ratio: mm of filament for a unit of E.
        filament: mm fed since power-on, as planned.
        limits: in force.
        low, high: corners of the box in which moves are executed as they are written, mm.
        moves, feeds: whether moves are executed at all, and those that feed filament.
        longest_extrusion: mm of filament that one move may feed.
        targets, bed_targets: lowest and highest target, °C, that the firmware takes as it is, and that lets it extrude.
        planned: what is being made and what waits.
        busy_seconds: s after which, and again and again, a command that waits is told of; 0: never.
        busy_bytes: of that.
        commands: how many were executed.
        until: s, when something will happen that no command asked for.
        board: the firmware, for what only it can say; see the methods.
    """

    position: Axes
    offset: Position
    relative: bool
    relative_e: bool
    unit: float
    feed: float
    speed_ratio: float
    e_ratio: float
    filament: float
    limits: MotionLimits
    low: Position
    high: Position
    moves: bool
    feeds: bool
    longest_extrusion: float
    targets: tuple[float, float]
    bed_targets: tuple[float, float]
    planned: Planned
    busy_seconds: float
    busy_bytes: int
    commands: int
    until: float
    board: Board

    @classmethod
    def of(cls, board: Board, until: float) -> BatchStart | None:
        """Return the state of a board; None while nothing moves."""
        planned, machine = board.mover.planned, board.machine
        if planned is None:
            return None
        over = 0.0 if board.guarded else FARTHEST
        (x0, y0, z0), (x1, y1, z1) = machine.box_min, machine.box_max
        return cls(
            position=board.position,
            offset=board.offset,
            relative=board.relative,
            relative_e=board.relative_e,
            unit=board.unit,
            feed=board.feed,
            speed_ratio=board.speed_ratio,
            e_ratio=board.e_ratio,
            filament=board.filament,
            limits=board.limits,
            low=(x0 - over, y0 - over, z0 - over),
            high=(x1 + over, y1 + over, z1 + over),
            moves=board.guarded or board.warned_unhomed or all(board.homed),
            feeds=board.hot and not board.loose,
            longest_extrusion=machine.longest_extrusion,
            targets=(board.coldest_extrusion, board.hotend.spec.highest),
            bed_targets=(0.0, board.bed.spec.highest),
            planned=planned,
            busy_seconds=board.busy_seconds,
            busy_bytes=len(board.busy_report) + 1,
            commands=board.tally.lines,
            until=until,
            board=board,
        )

    def limits_after(self, texts: Sequence[str]) -> list[MotionLimits]:
        """Return the limits behind each of some M204, executed one after the other; the board stays as it is."""
        found: list[MotionLimits] = []
        for text in texts:
            run(self.board, text)
            found.append(self.board.limits)
        if found:
            self.board.set_limits(self.limits)
        return found

    def place_bytes(self, position: Axes) -> int:
        """Return the bytes of the line that says that the machine is at a position."""
        board, here = self.board, self.board.position
        board.position = position
        size = len(board.place()) + 1
        board.position = here
        return size


@dataclass(frozen=True, slots=True)
class Batch:
    """What a run of commands did between two moments.

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
    limits: MotionLimits
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

    def apply(self, board: Board) -> None:
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
        board.mover.skip_to(self.planned, self.seconds)
        board.heaters.flowed(board.mover.position(self.now)[3], self.now)
        tally = board.tally
        if tally.track is not None:
            tally.track.add_batch(self.rows, self.row_seconds)
        tally.executed_all(self.texts)
        tally.filament_fed += self.fed
        tally.filament_retracted += self.retracted
        tally.peak_feed = max(tally.peak_feed, self.peak_feed)
        if self.low is not None and self.high is not None:
            tally.laid_within(self.low, self.high, self.heights)
