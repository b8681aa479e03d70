"""The motion planner in simulated time: a queue of moves that the motors execute.

As in firmware, `motion.rules.Lookahead` fixes the duration of a move when the move before it ends. Later moves cannot
change it. The queue changes only in calls; `advance` executes the moves that have started since the last call.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.motion.rules import Axes, Block, Lookahead, MotionLimits

if TYPE_CHECKING:
    from printer_slicer.sim.statistics import Statistics

__all__ = ["MotionQueue", "PlannedMotion"]

MAX_UNDERRUN: Final = 2.0
"""Maximum duration of a buffer underrun, s; a longer standstill is a wait for a person or a program."""

MOVES_TO_START: Final = 3
"""Number of queued moves at which an idle machine starts without delay, as in Marlin."""


class PlannedMotion(NamedTuple):
    """The running move and the waiting moves of a queue while the machine moves.

    Attributes:
        queue: waiting blocks, each with the squared speed of the corner before it.
        last: block that was added last.
        square: squared speed at the end of the running block, (mm/s)².
        targets: ends of the running block and of each waiting one, x, y, z, e, mm.
        standing: position at the start of the running block, x, y, z, e, mm.
        began, ends: times at which the running block started and ends, s.
    """

    queue: tuple[tuple[Block, float], ...]
    last: Block | None
    square: float
    targets: tuple[Axes, ...]
    standing: Axes
    began: float
    ends: float


_NO_DIRECTION: Final[Axes] = (0.0, 0.0, 0.0, 0.0)
_INSTANT_ACCELERATION: Final = 1e12
"""Acceleration of a pause, mm/s², practically infinite; a pause is a block at 1 mm/s that moves no axis."""


class MotionQueue:
    """A queue of planned moves, which the motors execute one after the other.

    A ring buffer of n blocks has n - 1 places, because one must stay empty. The running block occupies one of them.

    Args:
        limits: motion limits of the machine, including the number of planner blocks.
        first_move_delay: time that an idle machine waits for more moves before it starts, s.
        statistics: statistics of the print, which the queue updates.
        horizon: maximum motion planned ahead at the requested speeds, s; it applies in addition to the places.

    Attributes:
        ends: time at which the running move ends or the idle machine will start, s; infinite without moves.
        targets: ends of the running move and of each waiting move, x, y, z, e, mm.
        expects_stop: whether a command waits for the end of motion, so that an empty queue is no buffer underrun.
    """

    __slots__ = (
        "_ahead",
        "_began",
        "_delay",
        "_empty_since",
        "_horizon",
        "_lookahead",
        "_places",
        "_rest_position",
        "_running",
        "_seconds",
        "_statistics",
        "_woken_by",
        "ends",
        "expects_stop",
        "targets",
    )

    def __init__(
        self, limits: MotionLimits, first_move_delay: float, statistics: Statistics, horizon: float = inf
    ) -> None:
        self.ends = inf
        self.targets: deque[Axes] = deque()
        self.expects_stop = True
        self._lookahead = Lookahead(limits)
        self._places = max(limits.planner_blocks - 1, 1)
        self._delay = first_move_delay
        self._statistics = statistics
        self._running = False
        self._began = 0.0
        self._empty_since = -inf
        self._woken_by = 0
        self._rest_position: Axes = (0.0, 0.0, 0.0, 0.0)
        self._horizon = horizon
        self._ahead = 0.0
        self._seconds: deque[float] = deque()  # durations of the moves in `targets`, for the horizon

    @property
    def is_busy(self) -> bool:
        """Whether a move runs or is about to start."""
        return self.ends != inf

    @property
    def free_places(self) -> int:
        """Number of free places in the queue."""
        if self._ahead > self._horizon:
            return 0
        return self._places - len(self.targets)

    def set_limits(self, limits: MotionLimits) -> None:
        """Set the motion limits of all moves that are added from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, target: Axes, now: float) -> None:
        """Add a move that ends at `target`; the caller must call `advance(now)` and check `free_places` before."""
        self._lookahead.push(block)
        if (move_log := self._statistics.move_log) is not None:
            start = self.targets[-1] if self.targets else self._rest_position
            move_log.log_planned_move(self._statistics.lines, start, target, block.speed)
        self.targets.append(target)
        if self._horizon != inf:
            self._seconds.append(block.length / block.speed)
            self._ahead += self._seconds[-1]
        if self._running:
            return
        if self.ends == inf:
            self.ends = now + self._delay
            if self.expects_stop or now - self._empty_since > MAX_UNDERRUN:
                self._empty_since = -inf
            self.expects_stop = False
            self._woken_by = self._statistics.lines
        elif len(self.targets) >= MOVES_TO_START:
            self.ends = min(self.ends, now)

    def push_pause(self, seconds: float, target: Axes, now: float) -> None:
        """Add a pause of `seconds` at `target` behind the waiting moves; callers prepare as for `push`."""
        self._lookahead.stop()
        self.push(Block(seconds, _NO_DIRECTION, 1.0, _INSTANT_ACCELERATION), target, now)
        self._lookahead.stop()

    def advance(self, now: float) -> None:
        """Execute all moves that start up to the time `now`, s."""
        while self.ends <= now:
            at = self.ends
            if self._running:
                self._rest_position = self.targets.popleft()
                if self._seconds:
                    self._ahead -= self._seconds.popleft()
            if self.targets:
                if not self._running:
                    self._start_moving(at)
                seconds = self._lookahead.pop()
                self._statistics.motion_seconds += seconds
                if self._statistics.move_log is not None:
                    self._statistics.move_log.log_move_start(seconds)
                self._began = at
                self.ends = at + seconds
            else:
                self._running = False
                self.ends = inf
                self._empty_since = at

    def position(self, now: float) -> Axes:
        """Return the position of the motors at `now`, s, interpolated linearly in time within a move."""
        self.advance(now)
        if not self._running:
            return self._rest_position
        share = (now - self._began) / (self.ends - self._began)
        x, y, z, e = (a + share * (b - a) for a, b in zip(self._rest_position, self.targets[0], strict=True))
        return x, y, z, e

    def set_position(self, position: Axes) -> None:
        """Set the position of the idle machine; do nothing while the machine moves."""
        if not self.is_busy:
            self._rest_position = position

    @property
    def planned(self) -> PlannedMotion | None:
        """The running move and the waiting moves; None while the machine stands still."""
        if not self._running:
            return None
        queue, last, square = self._lookahead.get_queue_state()
        return PlannedMotion(
            tuple(queue), last, square, tuple(self.targets), self._rest_position, self._began, self.ends
        )

    def skip_to(self, planned: PlannedMotion, seconds: float) -> None:
        """Replace the content of the queue after further moves, which took `seconds` in total.

        The caller must have computed them by the rules of this planner; see `motion.ahead`.
        """
        self._lookahead.skip_to(planned.queue, planned.last, planned.square)
        self.targets = deque(planned.targets)
        self._rest_position, self._began, self.ends = planned.standing, planned.began, planned.ends
        self._statistics.motion_seconds += seconds

    def stop(self, now: float) -> tuple[Axes, float]:
        """Stop at once and discard all moves; return the position and the filament that was not fed, mm."""
        position = self.position(now)
        unfed = self.targets[-1][3] - position[3] if self.targets else 0.0
        if self._running:
            self._statistics.motion_seconds -= self.ends - now
        self.targets.clear()
        self._seconds.clear()
        self._ahead = 0.0
        if self._statistics.move_log is not None:
            self._statistics.move_log.discard_waiting_moves()
        self._lookahead = Lookahead(self._lookahead.limits)
        self._running = False
        self.ends = inf
        self.expects_stop = True
        self._rest_position = position
        return position, unfed

    def _start_moving(self, at: float) -> None:
        """Start moving at the time `at`, s; count the buffer underrun if one ends here."""
        self._running = True
        if self._empty_since != -inf:
            self._statistics.count_underrun(at - self._empty_since, self._woken_by)
