"""Run a job on the simulated printer without sending bytes, at the times that a serial link would give.

Handshake and firmware detection go over the port as usual. After that, the firmware gets every line at the moment it
would arrive with two lines in flight. Where nothing else can happen, the effect of thousands of lines is computed at
once and applied to the firmware, see `command_runs` and `printer_slicer.link_model`. Commands and times are the same
as over the link, except for the bytes of some replies that the host does not wait for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.inspection.dry_run.command_runs import Chunk, CommandRun, limits_at
from printer_slicer.link_model import (
    HANDSHAKE_LINES,
    BatchRetry,
    BatchTimes,
    LineBatch,
    LinkState,
    SerialLink,
    can_batch,
    send_batch,
)
from printer_slicer.motion.planner_clock import PlannerState
from printer_slicer.sim.batch import Batch, BatchStart
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.motion_queue import Planned
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Identified
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

__all__ = ["LONGEST_COMMAND", "LONGEST_PRINT", "EndlessPrintError", "FastRunner"]

LONGEST_COMMAND: Final = 86400.0
"""s; what a printer has not done by then it never will, or somebody wrote far too large a number."""

LONGEST_PRINT: Final = 30 * LONGEST_COMMAND
"""s; no print takes that long, but a slip in a file may."""

_AT_ONCE: Final = 8192  # commands that are read at once
_CLOSING: Final = (b"M400", b"M105", b"M114")
_ROW: Final = 9


class _IdentifiedError(Exception):
    """Raised to end the handshake, once the host has identified the printer."""


class EndlessPrintError(Exception):
    """A command takes longer than a day, or the whole print longer than 30 days."""


class FastRunner:
    """Executes a job on a simulated printer.

    Args:
        printer: the printer, as it was switched on.
        port: the port to it, for the handshake.
        link: baud rate, latency and window.
        on_many: called with commands that were executed in order.

    Attributes:
        batched: number of commands that were applied in batches.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        port: VirtualPort,
        link: SerialLink,
        on_many: Callable[[Sequence[bytes]], None],
    ) -> None:
        self._printer, self._port = printer, port
        self._on_many = on_many
        self._link = LinkState.idle(link, 0.0)
        self._number = HANDSHAKE_LINES
        self._retry = BatchRetry()
        self.batched = 0

    @property
    def now(self) -> float:
        """Time at which the host received the last reply, s."""
        return self._link.answered[-1]

    def greet(self, streamer: Streamer) -> list[Event]:
        """Perform the handshake over the port, and return what the host learned about the printer."""
        heard: list[Event] = []

        def record(events: Sequence[Event]) -> None:
            heard.extend(events)
            if any(isinstance(event, Identified) for event in events):
                raise _IdentifiedError

        with suppress(_IdentifiedError):
            run(streamer, self._port, self._port.now, record=record)
        self._link = LinkState.idle(self._link.link, self._port.now())
        return heard

    def execute(self, commands: Sequence[bytes], on_progress: Callable[[int], None]) -> int:
        """Execute a job, and return how many commands were executed before the end or a halt.

        Raises:
            EndlessPrintError: a command takes longer than a day, or the print longer than 30 days.
        """
        done = 0
        while done < len(commands) and not self._printer.state.killed:
            chunk = Chunk(commands[done : done + _AT_ONCE], self._number - HANDSHAKE_LINES)
            done += self._execute(chunk)
            on_progress(done)
        return done

    def close(self) -> str:
        """Wait for the end of the motion, query the position as the host does, and return the reply.

        Raises:
            EndlessPrintError: the motion does not end.
        """
        said = ""
        for command in _CLOSING:
            # Each of these questions waits for the answer to what was said before.
            self._link.wait_for_all_answers()
            chunk = Chunk([command], self._number - HANDSHAKE_LINES)
            said = self._one(chunk, 0)
        self._printer.send(self.now)  # it lives until the host has heard that
        return said

    def _execute(self, chunk: Chunk) -> int:
        """Execute a chunk, and return how many of its commands were executed."""
        at = 0
        while at < len(chunk) and not self._printer.state.killed:
            count = 0
            if self._retry.is_due(chunk.break_after(at) - at):
                count = self._batch(chunk, at)
                self._retry.record_batch(count)
            if not count:
                self._one(chunk, at)
                self._retry.record_single_line()
                count = 1
            at += count
        return at

    def _one(self, chunk: Chunk, at: int) -> str:
        """Execute one command on the firmware, and return the reply."""
        printer, link = self._printer, self._link
        now = link.send(int(chunk.sizes[at]), int(chunk.rooms[at]))
        while (due := printer.wakeup()) is not None and due <= now:
            link.send_answer(len(printer.send(due)), due)
        self._number += 1
        printer.receive_line(self._number, chunk.texts[at], now)
        said, latest = [], min(now + LONGEST_COMMAND, LONGEST_PRINT)
        while True:
            if new := printer.send(now):
                link.send_answer(len(new), now)
                said.append(new)
            if not printer.has_unanswered_command:
                break
            due = printer.wakeup()
            if due is None:
                break
            if due > latest:
                raise EndlessPrintError
            now = due
        link.acknowledge(now)
        return b"".join(said).decode("latin-1")

    def _batch(self, chunk: Chunk, at: int) -> int:
        """Execute as many commands as possible in one batch, and return their number."""
        start = self._printer.start_batch(self._link.executed)
        if start is None or not can_batch(start.limits):
            return 0
        command_run = CommandRun.read(chunk, at, start)
        if command_run is None:
            return 0
        lines, planned = command_run.lines(chunk, start.limits), start.planned
        before = PlannerState(planned.queue, planned.last, planned.square, planned.ends)
        busy = start.busy_seconds, start.busy_bytes
        times = send_batch(lines, before, self._link, start.limits, busy)
        if not times.done or times.executed[-1] >= start.until:
            return 0
        self._apply(chunk, command_run, lines, times, start)
        return times.done

    def _apply(
        self, chunk: Chunk, command_run: CommandRun, lines: LineBatch, times: BatchTimes, start: BatchStart
    ) -> None:
        """Apply a computed batch to the state of the firmware."""
        count = times.done
        self.batched += count
        begin = command_run.begin
        self._on_many(chunk.commands[begin : begin + count])
        self._number += count
        x, y, z, e = command_run.position[count - 1].tolist()
        ways = command_run.delta[:count, 3]
        rows, laid = _rows(command_run, lines, times, start.commands)
        feeding = np.flatnonzero(ways != 0)
        batch = Batch(
            texts=chunk.texts[begin : begin + count],
            number=self._number,
            now=float(times.executed[-1]),
            timed=[
                (float(times.executed[place]), text) for place, text in command_run.timed if place < count
            ],
            extruded_at=float(times.executed[feeding[-1]]) if len(feeding) else -np.inf,
            position=(x, y, z, e),
            feed=float(command_run.feed[count - 1]),
            limits=limits_at(command_run, count, start.limits),
            planned=_planned_after(command_run, lines, times, start),
            seconds=float(times.seconds.sum()),
            fed=float(ways[ways > 0].sum()),
            retracted=-float(ways[ways < 0].sum()),
            **laid,
            rows=rows.tobytes(),
            row_seconds=times.seconds.tobytes(),
        )
        self._printer.apply_batch(batch)
        self._link = times.state


def _rows(
    command_run: CommandRun, lines: LineBatch, times: BatchTimes, commands: int
) -> tuple[Float, dict[str, Any]]:
    """Return the rows of the moves for `MoveLog`, and the extrusion of the moves for `Batch`."""
    moving = lines.moving[lines.moving < times.done]
    own = slice(0, len(moving))
    end, delta = command_run.position[moving], command_run.delta[moving]
    rows = np.zeros((len(moving), _ROW))
    rows[:, 0] = commands + moving + 1
    rows[:, 1:4] = end[:, :3] - delta[:, :3]
    rows[:, 4:7] = end[:, :3]
    rows[:, 7] = delta[:, 3]
    rows[:, 8] = lines.blocks.speed[own]
    lays = (delta[:, 3] > 0) & ((delta[:, 0] != 0) | (delta[:, 1] != 0))
    if not lays.any():
        return rows, {"low": None, "high": None, "heights": (), "peak_feed": 0.0}
    corners = rows[lays, 1:7].reshape(-1, 3)
    heights = end[lays, 2]
    changes = heights[np.flatnonzero(np.diff(heights, prepend=np.nan) != 0)]
    return rows, {
        "low": tuple(corners.min(axis=0).tolist()),
        "high": tuple(corners.max(axis=0).tolist()),
        "heights": list(dict.fromkeys(changes.tolist())),
        "peak_feed": float((delta[lays, 3] / lines.blocks.length[own][lays] * rows[lays, 8]).max()),
    }


def _planned_after(
    command_run: CommandRun, lines: LineBatch, times: BatchTimes, start: BatchStart
) -> Planned:
    """Return the current move and the planned moves after a batch."""
    before, after, began = start.planned, times.planner, len(times.begins)
    # Where the running block, each that waited, and each new one ends; e as filament fed.
    fed = start.filament + np.cumsum(command_run.delta[lines.moving, 3])
    new = np.column_stack([command_run.position[lines.moving, :3], fed])
    targets = np.concatenate([np.array(before.targets).reshape(-1, 4), new])[: times.pushed + 1]
    rows = [tuple(row) for row in targets[max(began - 1, 0) :].tolist()]
    planned = before._replace(queue=after.queue, last=after.last)
    if began == 0:
        return planned._replace(targets=tuple(rows))
    return planned._replace(
        square=after.square,
        targets=tuple(rows[1:]),
        standing=rows[0],
        began=float(times.begins[-1]),
        ends=after.ends,
    )
