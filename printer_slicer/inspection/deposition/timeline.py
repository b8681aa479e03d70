"""Record the speed of the nozzle over the time in motion, in memory that does not grow with the job."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.inspection.deposition.height_map import COMMAND, END, START
from printer_slicer.values import Struct

__all__ = ["Timeline", "TimelineRecorder"]

_SAMPLES: Final = 1024
_FIRST_STEP: Final = 0.25  # s


class Timeline(Struct, frozen=True, eq=False):
    """Mean speed of the nozzle in each of many equal steps of the time in motion.

    Attributes:
        step: s, duration of a step.
        speed: (n,) mm/s, mean speed in each step.
        command: (n,) the command that is executed at the start of each step, counted from 1.
    """

    step: float
    speed: Float
    command: Int

    @property
    def seconds(self) -> float:
        """End of the last step, s."""
        return self.step * len(self.speed)

    def time_of(self, command: Int) -> Float:
        """Return the times (m,) at which commands (m,) are executed, s, rounded down to a step."""
        index = np.searchsorted(self.command, command, side="right") - 1
        return np.asarray(np.maximum(index, 0) * self.step)


class TimelineRecorder:
    """Adds up the distance moved in each time step; when there are too many steps, their length doubles."""

    def __init__(self) -> None:
        self._step = _FIRST_STEP
        self._distance = np.zeros(_SAMPLES)
        self._command = np.zeros(_SAMPLES, np.int64)
        self._now = 0.0

    def add_moves(self, rows: Float, seconds: Float) -> None:
        """Add consecutive moves: rows (n, 9) of `sim.move_log`, and the duration of each, (n,) s."""
        if not len(rows):
            return
        distance = np.sqrt(((rows[:, END] - rows[:, START]) ** 2).sum(axis=1))
        ends = self._now + np.cumsum(seconds)
        while ends[-1] > self._step * _SAMPLES:
            self._double_step()
        first, last = int(self._now / self._step), min(int(ends[-1] / self._step), _SAMPLES - 1)
        edges = np.arange(first, last + 2) * self._step
        time, total = np.append(self._now, ends), np.append(0.0, np.cumsum(distance))
        self._distance[first : last + 1] += np.diff(np.interp(edges, time, total))
        starting = np.flatnonzero(edges[:-1] >= self._now)
        move = np.minimum(np.searchsorted(ends, edges[starting], side="right"), len(rows) - 1)
        self._command[first + starting] = rows[move, COMMAND].astype(np.int64)
        self._now = float(ends[-1])

    def close(self) -> Timeline:
        """Return the timeline of all moves so far."""
        used = int(np.ceil(self._now / self._step))
        speed = self._distance[:used] / self._step
        if used:  # the last step is incomplete
            speed[-1] *= self._step / max(self._now - (used - 1) * self._step, 1e-9)
        return Timeline(self._step, speed, np.maximum.accumulate(self._command[:used]))

    def _double_step(self) -> None:
        """Merge pairs of steps, so that each step is twice as long."""
        half = _SAMPLES // 2
        distance, command = self._distance.reshape(half, 2).sum(axis=1), self._command[::2]
        self._distance = np.append(distance, np.zeros(half))
        self._command = np.append(command, np.zeros(half, np.int64))
        self._step *= 2
