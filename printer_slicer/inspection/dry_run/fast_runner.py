"""Run a job on the simulated printer without sending bytes, at the times that a serial link would give.

Handshake and firmware detection go over the port as usual. After that, the firmware gets every line at the moment at
which it would arrive with two lines in flight. For runs of simple commands, the effect of thousands of lines is
computed at once and applied to the firmware, see `command_runs` and `printer_slicer.link_model`. Commands and times are
the same as over the link, except for the bytes of some replies that the host does not wait for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.inspection.dry_run.command_runs import Chunk, CommandRun, limits_after_count
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
from printer_slicer.sim.motion_queue import PlannedMotion
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Identified
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

__all__ = ["LONGEST_COMMAND", "LONGEST_PRINT", "EndlessPrintError", "FastRunner"]

LONGEST_COMMAND: Final = 86400.0
"""Maximum duration of one command, s; a longer command never ends, or is a mistake in the file."""

LONGEST_PRINT: Final = 30 * LONGEST_COMMAND
"""Maximum duration of a print, s; a longer print is a mistake in the file."""

_CHUNK_SIZE: Final = 8192  # number of commands that are parsed together
_FINAL_COMMANDS: Final = (b"M400", b"M105", b"M114")
_N_COLUMNS: Final = 9


class _IdentifiedError(Exception):
    """Ends the handshake: the host has identified the printer."""


class EndlessPrintError(Exception):
    """A command takes longer than a day, or the print takes longer than 30 days."""


class FastRunner:
    """Executes a job on a simulated printer without sending bytes.

    Args:
        printer: the printer, just switched on.
        port: the port of the printer, for the handshake.
        link: baud rate, latency and window of the serial link.
        on_batch: function that is called with commands that were executed in order.

    Attributes:
        batched: number of commands that were applied in batches.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        port: VirtualPort,
        link: SerialLink,
        on_batch: Callable[[Sequence[bytes]], None],
    ) -> None:
        self._printer, self._port = printer, port
        self._on_batch = on_batch
        self._link = LinkState.idle(link, 0.0)
        self._number = HANDSHAKE_LINES
        self._retry = BatchRetry()
        self.batched = 0

    @property
    def now(self) -> float:
        """Time, s, at which the host received the last reply."""
        return self._link.answered[-1]

    def run_handshake(self, streamer: Streamer) -> list[Event]:
        """Perform the handshake through the port, and return the events of the host."""
        received: list[Event] = []

        def record(events: Sequence[Event]) -> None:
            received.extend(events)
            if any(isinstance(event, Identified) for event in events):
                raise _IdentifiedError

        with suppress(_IdentifiedError):
            run(streamer, self._port, self._port.now, record=record)
        self._link = LinkState.idle(self._link.link, self._port.now())
        return received

    def execute(self, commands: Sequence[bytes], on_progress: Callable[[int], None]) -> int:
        """Execute a job, and return the number of commands that were executed before the end or a halt.

        Raises:
            EndlessPrintError: a command takes longer than a day, or the print longer than 30 days.
        """
        done = 0
        while done < len(commands) and not self._printer.state.killed:
            chunk = Chunk(commands[done : done + _CHUNK_SIZE], self._number - HANDSHAKE_LINES)
            done += self._execute_chunk(chunk)
            on_progress(done)
        return done

    def close(self) -> str:
        """Wait for the end of the motion, query the position as the host does, and return the reply.

        Raises:
            EndlessPrintError: the motion does not end.
        """
        reply = ""
        for command in _FINAL_COMMANDS:
            # Each of these queries waits until all earlier replies have arrived.
            self._link.wait_for_all_answers()
            chunk = Chunk([command], self._number - HANDSHAKE_LINES)
            reply = self._execute_one(chunk, 0)
        self._printer.send(self.now)  # the printer runs until the host has received the reply
        return reply

    def _execute_chunk(self, chunk: Chunk) -> int:
        """Execute a chunk, and return the number of its commands that were executed."""
        at = 0
        while at < len(chunk) and not self._printer.state.killed:
            count = 0
            if self._retry.is_due(chunk.next_single_command(at) - at):
                count = self._execute_batch(chunk, at)
                self._retry.record_batch(count)
            if not count:
                self._execute_one(chunk, at)
                self._retry.record_single_line()
                count = 1
            at += count
        return at

    def _execute_one(self, chunk: Chunk, at: int) -> str:
        """Execute one command on the firmware, and return the reply."""
        printer, link = self._printer, self._link
        now = link.send(int(chunk.sizes[at]), int(chunk.reserved_sizes[at]))
        while (due := printer.wakeup()) is not None and due <= now:
            link.send_answer(len(printer.send(due)), due)
        self._number += 1
        printer.receive_line(self._number, chunk.texts[at], now)
        replies, latest = [], min(now + LONGEST_COMMAND, LONGEST_PRINT)
        while True:
            if new := printer.send(now):
                link.send_answer(len(new), now)
                replies.append(new)
            if not printer.has_unanswered_command:
                break
            due = printer.wakeup()
            if due is None:
                break
            if due > latest:
                raise EndlessPrintError
            now = due
        link.acknowledge(now)
        return b"".join(replies).decode("latin-1")

    def _execute_batch(self, chunk: Chunk, at: int) -> int:
        """Execute as many commands as possible in one batch, and return their number."""
        start = self._printer.start_batch(self._link.executed)
        if start is None or not can_batch(start.limits):
            return 0
        command_run = CommandRun.read(chunk, at, start)
        if command_run is None:
            return 0
        lines, planned = command_run.make_line_batch(chunk, start.limits), start.planned
        before = PlannerState(planned.queue, planned.last, planned.square, planned.ends)
        busy = start.busy_seconds, start.busy_bytes
        times = send_batch(lines, before, self._link, start.limits, busy)
        if not times.done or times.executed[-1] >= start.until:
            return 0
        self._apply_batch(chunk, command_run, lines, times, start)
        return times.done

    def _apply_batch(
        self, chunk: Chunk, command_run: CommandRun, lines: LineBatch, times: BatchTimes, start: BatchStart
    ) -> None:
        """Apply a computed batch to the state of the firmware."""
        count = times.done
        self.batched += count
        begin = command_run.begin
        self._on_batch(chunk.commands[begin : begin + count])
        self._number += count
        x, y, z, e = command_run.position[count - 1].tolist()
        fed = command_run.delta[:count, 3]
        rows, extrusion = _log_rows(command_run, lines, times, start.commands)
        feeding = np.flatnonzero(fed != 0)
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
            limits=limits_after_count(command_run, count, start.limits),
            planned=_planned_motion_after(command_run, lines, times, start),
            seconds=float(times.seconds.sum()),
            fed=float(fed[fed > 0].sum()),
            retracted=-float(fed[fed < 0].sum()),
            **extrusion,
            rows=rows.tobytes(),
            row_seconds=times.seconds.tobytes(),
        )
        self._printer.apply_batch(batch)
        self._link = times.state


def _log_rows(
    command_run: CommandRun, lines: LineBatch, times: BatchTimes, commands: int
) -> tuple[Float, dict[str, Any]]:
    """Return the rows of the moves for `MoveLog`, and the extrusion attributes of `Batch` as arguments."""
    moving = lines.moving[lines.moving < times.done]
    done = slice(0, len(moving))
    end, delta = command_run.position[moving], command_run.delta[moving]
    rows = np.zeros((len(moving), _N_COLUMNS))
    rows[:, 0] = commands + moving + 1
    rows[:, 1:4] = end[:, :3] - delta[:, :3]
    rows[:, 4:7] = end[:, :3]
    rows[:, 7] = delta[:, 3]
    rows[:, 8] = lines.blocks.speed[done]
    extrudes = (delta[:, 3] > 0) & ((delta[:, 0] != 0) | (delta[:, 1] != 0))
    if not extrudes.any():
        return rows, {"low": None, "high": None, "heights": (), "peak_feed": 0.0}
    corners = rows[extrudes, 1:7].reshape(-1, 3)
    heights = end[extrudes, 2]
    changes = heights[np.flatnonzero(np.diff(heights, prepend=np.nan) != 0)]
    return rows, {
        "low": tuple(corners.min(axis=0).tolist()),
        "high": tuple(corners.max(axis=0).tolist()),
        "heights": list(dict.fromkeys(changes.tolist())),
        "peak_feed": float(
            (delta[extrudes, 3] / lines.blocks.length[done][extrudes] * rows[extrudes, 8]).max()
        ),
    }


def _planned_motion_after(
    command_run: CommandRun, lines: LineBatch, times: BatchTimes, start: BatchStart
) -> PlannedMotion:
    """Return the running move and the waiting moves of the firmware after a batch."""
    before, after, n_begun = start.planned, times.planner, len(times.begins)
    # End positions of the running block, of the waiting blocks and of the new ones; e is the filament fed.
    fed = start.filament + np.cumsum(command_run.delta[lines.moving, 3])
    new = np.column_stack([command_run.position[lines.moving, :3], fed])
    targets = np.concatenate([np.array(before.targets).reshape(-1, 4), new])[: times.pushed + 1]
    rows = [tuple(row) for row in targets[max(n_begun - 1, 0) :].tolist()]
    planned = before._replace(queue=after.queue, last=after.last)
    if n_begun == 0:
        return planned._replace(targets=tuple(rows))
    return planned._replace(
        square=after.square,
        targets=tuple(rows[1:]),
        standing=rows[0],
        began=float(times.begins[-1]),
        ends=after.ends,
    )
