"""Apply the combined effect of many consecutive simple commands to the simulated firmware.

Moves and settings need not be executed one by one while no fault, report or wait can occur between them. `BatchStart`
holds the state that such commands depend on. The caller computes their combined effect and returns it as a `Batch`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer.sim.commands import start_command
from printer_slicer.sim.move_commands import MAX_DISTANCE_OUTSIDE
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.firmware_state import FirmwareState
    from printer_slicer.sim.machine import Position
    from printer_slicer.sim.motion_queue import PlannedMotion

__all__ = ["Batch", "BatchStart"]


class BatchStart(Struct, frozen=True):
    """The state of a printer before a batch of simple commands.

    Attributes:
        position: end of the planned motion: x, y, z from the endstops, e as the program counts it; mm.
        offset: logical minus machine coordinates of x, y, z, mm.
        relative: whether the words X, Y and Z are relative.
        relative_e: whether the word E is relative.
        unit: mm per unit of the program.
        feed: last feed rate, mm/s.
        speed_ratio: speed override of M220, 1 for 100 %.
        e_ratio: mm of filament per unit of E.
        filament: mm of filament fed since power-on, at the end of the planned motion.
        limits: current motion limits.
        low, high: corners of the box in which moves are not clipped, mm.
        moves: whether moves cause no violation because of missing homing.
        feeds: whether moves may feed filament.
        longest_extrusion: mm of filament that one move may feed.
        targets: lowest target of the hotend that allows extrusion, and its highest target, °C.
        bed_targets: lowest and highest target of the bed, °C.
        planned: running and queued moves.
        busy_seconds: interval of busy reports, s; 0: none.
        busy_bytes: length of a busy report.
        commands: number of executed commands.
        until: time of the next event that no command causes, s.
        state: state of the firmware; used by the methods.
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
    planned: PlannedMotion
    busy_seconds: float
    busy_bytes: int
    commands: int
    until: float
    state: FirmwareState

    @classmethod
    def from_state(cls, state: FirmwareState, until: float) -> BatchStart | None:
        """Return the state before a batch that ends before `until`, s; None if the machine stands still."""
        planned, machine = state.motion_queue.planned, state.machine
        if planned is None:
            return None
        over = 0.0 if state.clips_moves else MAX_DISTANCE_OUTSIDE
        (x0, y0, z0), (x1, y1, z1) = machine.box_min, machine.box_max
        return cls(
            position=state.position,
            offset=state.offset,
            relative=state.relative,
            relative_e=state.relative_e,
            unit=state.unit,
            feed=state.feed,
            speed_ratio=state.speed_ratio,
            e_ratio=state.e_ratio,
            filament=state.filament,
            limits=state.limits,
            low=(x0 - over, y0 - over, z0 - over),
            high=(x1 + over, y1 + over, z1 + over),
            moves=state.clips_moves or state.warned_unhomed or all(state.homed),
            feeds=state.hot and not state.unhomed_motors,
            longest_extrusion=machine.longest_extrusion,
            targets=(state.coldest_extrusion, state.hotend.spec.highest),
            bed_targets=(0.0, state.bed.spec.highest),
            planned=planned,
            busy_seconds=state.busy_seconds,
            busy_bytes=len(state.busy_report) + 1,
            commands=state.statistics.lines,
            until=until,
            state=state,
        )

    def limits_after_commands(self, texts: Sequence[str]) -> list[MotionLimits]:
        """Return the motion limits after each of these M204 commands; the firmware state stays unchanged."""
        found: list[MotionLimits] = []
        for text in texts:
            start_command(self.state, text)
            found.append(self.state.limits)
        if found:
            self.state.set_limits(self.limits)
        return found

    def position_report_length(self, position: Axes) -> int:
        """Return the number of bytes in the position report (M114) that the firmware sends at a position."""
        state, here = self.state, self.state.position
        state.position = position
        size = len(state.format_position_report()) + 1
        state.position = here
        return size


class Batch(Struct, frozen=True):
    """The combined effect of a batch of commands.

    Attributes:
        texts: executed commands.
        number: line number of the last command.
        now: time of the last command, s.
        timed: commands that change heaters, fans and displays, with their times, s.
        extruded_at: time of the last extrusion, s; -infinity without any.
        position: end of the planned motion, x, y, z, e, mm.
        feed: last feed rate, mm/s.
        limits: motion limits at the end.
        planned: running and queued moves at the end.
        seconds: total duration of the moves that have started, s.
        fed, retracted: filament fed and retracted, mm.
        low, high: corners of the box around all extrusions, mm; None without any.
        heights: heights z with extrusion, mm, in the order of their first extrusion.
        peak_feed: highest feed of filament at the cruise speed of an extrusion, mm/s.
        rows: rows of the planned moves, as bytes, in the format of `MoveLog`.
        row_seconds: durations of the moves that have started, as bytes, in the format of `MoveLog`.
    """

    texts: Sequence[str]
    number: int
    now: float
    timed: Sequence[tuple[float, str]]
    extruded_at: float
    position: Axes
    feed: float
    limits: MotionLimits
    planned: PlannedMotion
    seconds: float
    fed: float
    retracted: float
    low: Position | None
    high: Position | None
    heights: Sequence[float]
    peak_feed: float
    rows: bytes = b""
    row_seconds: bytes = b""

    def apply(self, state: FirmwareState) -> None:
        """Apply the combined effect of the batch to a firmware state."""
        state.apply_flow_cooling()
        state.heaters.start_steady_flow(self.fed - self.retracted, self.now - state.now)
        for moment, text in self.timed:
            state.now = moment
            start_command(state, text)
        state.now = self.now
        if not state.hot and self.extruded_at > (self.timed[-1][0] if self.timed else state.now):
            state.is_hot_enough_to_extrude()
        state.position, state.feed = self.position, self.feed
        state.filament += self.fed - self.retracted
        if state.limits != self.limits:
            state.set_limits(self.limits)
        state.motion_queue.skip_to(self.planned, self.seconds)
        state.heaters.end_steady_flow(state.motion_queue.position(self.now)[3], self.now)
        statistics = state.statistics
        if statistics.move_log is not None:
            statistics.move_log.add_batch(self.rows, self.row_seconds)
        statistics.count_commands(self.texts)
        statistics.filament_fed += self.fed
        statistics.filament_retracted += self.retracted
        statistics.peak_feed = max(statistics.peak_feed, self.peak_feed)
        if self.low is not None and self.high is not None:
            statistics.add_extrusions_within(self.low, self.high, self.heights)
