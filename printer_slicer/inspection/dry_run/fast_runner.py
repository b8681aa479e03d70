"""A job on the simulated printer without its bytes: the times are those that the conversation would take.

Host and printer greet each other as they do. Then every line goes to the firmware at the moment at which it would have
arrived, with two lines in flight; and where nothing else can happen, the effect of thousands of lines is computed at
once and handed to the firmware, see `command_runs` and `link_timing`. What is executed, and when, is the same as over
the wire, but for bytes of some answers that nobody waits for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.inspection.dry_run.command_runs import GREETING, Chunk, CommandRun, limits_at
from printer_slicer.inspection.dry_run.link_timing import Paced, TimedLink, WireState, pace
from printer_slicer.sim.batch import Batch, BatchStart
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Identified
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

__all__ = ["LONGEST_COMMAND", "LONGEST_PRINT", "FastRunner", "NeverDoneError"]

LONGEST_COMMAND: Final = 86400.0
"""s; what a printer has not done by then it never will, or somebody wrote far too large a number."""

LONGEST_PRINT: Final = 30 * LONGEST_COMMAND
"""s; no print takes that long, but a slip in a file may."""

_AT_ONCE: Final = 8192  # commands that are read at once
_WORTH: Final = 48  # commands in a stretch from which on it is worth the way
_PATIENCE: Final = (16, 256)  # commands that go one by one where the planner runs short, at first and at most
_CLOSING: Final = (b"M400", b"M105", b"M114")
_ROW: Final = 9


class _MetError(Exception):
    """Host and printer know each other now."""


class NeverDoneError(Exception):
    """A command, or the whole print, takes longer than anybody would wait."""


class FastRunner:
    """Executes a job.

    Args:
        printer: that executes it, as it was switched on.
        port: to it, over which they greet each other.
        link: how long bytes take.
        on_many: is told of commands that were executed in their order.

    Attributes:
        reckoned: commands of which the firmware only took note.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        port: VirtualPort,
        link: TimedLink,
        on_many: Callable[[Sequence[bytes]], None],
    ) -> None:
        self._printer, self._port, self._link = printer, port, link
        self._on_many = on_many
        self._wire = WireState(0.0, 0.0, (0.0, 0.0), 0.0, 0)
        self._number = GREETING
        self._patience = _PATIENCE[0]
        self.reckoned = 0

    @property
    def now(self) -> float:
        """When the host had the last answer, s."""
        return self._wire.answered[1]

    def greet(self, streamer: Streamer) -> list[Event]:
        """Let host and printer meet over the port; what the host was told."""
        heard: list[Event] = []

        def record(events: Sequence[Event]) -> None:
            heard.extend(events)
            if any(isinstance(event, Identified) for event in events):
                raise _MetError

        with suppress(_MetError):
            run(streamer, self._port, self._port.now, record=record)
        now = self._port.now()
        self._wire = WireState(now, now, (now, now), now, 0)
        return heard

    def execute(self, commands: Sequence[bytes], on_progress: Callable[[int], None]) -> int:
        """Execute a job; how many of its commands were, before the printer halted.

        Raises:
            NeverDoneError: one of them takes longer than a day, or all of them longer than 30.
        """
        done = 0
        while done < len(commands) and not self._printer.board.killed:
            chunk = Chunk(commands[done : done + _AT_ONCE], self._number - GREETING)
            done += self._execute(chunk)
            on_progress(done)
        return done

    def close(self) -> str:
        """Wait for the end of the motion and ask where the printer is, as the host does; what it says.

        Raises:
            NeverDoneError: the motion does not end.
        """
        said = ""
        for command in _CLOSING:
            # Each of these questions waits for the answer to what was said before.
            self._wire.answered = (self._wire.answered[1],) * 2
            chunk = Chunk([command], self._number - GREETING)
            said = self._one(chunk, 0)
        self._printer.send(self.now)  # it lives until the host has heard that
        return said

    def _execute(self, chunk: Chunk) -> int:
        """Execute a chunk; how many of its commands were."""
        at, patience = 0, 0
        while at < len(chunk) and not self._printer.board.killed:
            count = 0
            if patience <= 0 and chunk.break_after(at) - at >= _WORTH:
                count = self._leap(chunk, at)
                first, most = _PATIENCE
                self._patience = first if count >= _WORTH else min(2 * self._patience, most)
                patience = 0 if count >= _WORTH else self._patience
            if not count:
                self._one(chunk, at)
                count = 1
                patience -= 1
            at += count
        return at

    def _one(self, chunk: Chunk, at: int) -> str:
        """Have one command executed by the firmware; what is said to it."""
        printer, wire, link = self._printer, self._wire, self._link
        now = wire.send(int(chunk.sizes[at]), int(chunk.rooms[at]), link)
        while (due := printer.wakeup()) is not None and due <= now:
            wire.say(len(printer.send(due)), due, link)
        self._number += 1
        printer.hear(self._number, chunk.texts[at], now)
        said, latest = [], min(now + LONGEST_COMMAND, LONGEST_PRINT)
        while True:
            if new := printer.send(now):
                wire.say(len(new), now, link)
                said.append(new)
            if not printer.working:
                break
            due = printer.wakeup()
            if due is None:
                break
            if due > latest:
                raise NeverDoneError
            now = due
        wire.hear(now, link)
        return b"".join(said).decode("latin-1")

    def _leap(self, chunk: Chunk, at: int) -> int:
        """Execute as many commands at once as can be; how many that were."""
        start = self._printer.start_batch(self._wire.executed)
        if start is None or start.limits.minimum_cruise_ratio > 0 or start.limits.planner_blocks < 4:
            return 0
        stretch = CommandRun.read(chunk, at, start)
        if stretch is None:
            return 0
        cut = slice(at, at + len(stretch))
        paced = pace(stretch, (chunk.sizes[cut], chunk.rooms[cut]), start, self._wire, self._link)
        count = paced.done
        if count and paced.executed[-1] >= start.until:
            count = 0
        if count:
            self._land(chunk, stretch, paced, start)
        return count

    def _land(self, chunk: Chunk, stretch: CommandRun, paced: Paced, start: BatchStart) -> None:
        """Have the firmware take note of what was reckoned."""
        count = paced.done
        self.reckoned += count
        begin = stretch.begin
        self._on_many(chunk.commands[begin : begin + count])
        self._number += count
        x, y, z, e = stretch.position[count - 1].tolist()
        ways = stretch.delta[:count, 3]
        rows, laid = _rows(stretch, paced, start.commands)
        feeding = np.flatnonzero(ways != 0)
        batch = Batch(
            texts=chunk.texts[begin : begin + count],
            number=self._number,
            now=float(paced.executed[-1]),
            timed=[(float(paced.executed[place]), text) for place, text in stretch.timed if place < count],
            extruded_at=float(paced.executed[feeding[-1]]) if len(feeding) else -np.inf,
            position=(x, y, z, e),
            feed=float(stretch.feed[count - 1]),
            limits=limits_at(stretch, count, start.limits),
            planned=paced.planned,
            seconds=float(paced.seconds.sum()),
            fed=float(ways[ways > 0].sum()),
            retracted=-float(ways[ways < 0].sum()),
            **laid,
            rows=rows.tobytes(),
            row_seconds=paced.seconds.tobytes(),
        )
        self._printer.apply_batch(batch)
        self._wire = paced.wire


def _rows(stretch: CommandRun, paced: Paced, lines: int) -> tuple[Float, dict[str, Any]]:
    """What `Track` wants to know of the moves, and what `Batch` wants to know of what they lay."""
    moving = paced.moving[paced.moving < paced.done]
    own = slice(0, len(moving))
    end, delta = stretch.position[moving], stretch.delta[moving]
    rows = np.zeros((len(moving), _ROW))
    rows[:, 0] = lines + moving + 1
    rows[:, 1:4] = end[:, :3] - delta[:, :3]
    rows[:, 4:7] = end[:, :3]
    rows[:, 7] = delta[:, 3]
    rows[:, 8] = paced.blocks.speed[own]
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
        "peak_feed": float((delta[lays, 3] / paced.blocks.length[own][lays] * rows[lays, 8]).max()),
    }
