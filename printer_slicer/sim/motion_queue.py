"""The motion planner in simulated time: a queue of moves that the motors execute.

As in firmware, `motion.rules.Lookahead` fixes the duration of a move when the move before it ends; later moves cannot
change it. Nothing happens between calls; `advance` catches up with the clock.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.motion.rules import Axes, Block, Lookahead, MotionLimits

if TYPE_CHECKING:
    from printer_slicer.sim.statistics import Statistics

__all__ = ["MotionQueue", "Planned"]

LONGEST_STARVATION: Final = 2.0
"""s; a longer standstill is not a buffer underrun but a wait for a person or a program."""

ENOUGH_TO_START: Final = 3
"""Number of moves with which an idle machine starts at once, as in Marlin."""


class Planned(NamedTuple):
    """The state of the queue while the machine moves.

    Attributes:
        queue: waiting blocks, each with the squared speed of the corner before it.
        last: the last block added.
        square: squared speed at the end of the running block, (mm/s)².
        targets: ends of the running block and of each waiting one, x, y, z, e, mm.
        standing: start of the running block.
        began, ends: its start and end times, s.
    """

    queue: tuple[tuple[Block, float], ...]
    last: Block | None
    square: float
    targets: tuple[Axes, ...]
    standing: Axes
    began: float
    ends: float


_NOWHERE: Final[Axes] = (0.0, 0.0, 0.0, 0.0)
_AT_ONCE: Final = 1e12
"""mm/s²; a pause is a block without distance at 1 mm/s, with a practically infinite acceleration."""


class MotionQueue:
    """Executes moves one after the other.

    A ring buffer of n blocks has n - 1 places, because one must stay empty; the running block occupies one.

    Args:
        limits: motion limits of the machine, including the number of planner blocks.
        first_move_delay: time that an idle machine waits for more moves, s.
        statistics: statistics.
        horizon: maximum motion planned ahead, s at the requested speeds, regardless of the number of moves.

    Attributes:
        ends: when the running move ends, or the idle machine will start; infinite without moves.
        targets: ends of the running move and of each waiting move, x, y, z, e, mm.
        expects_stop: a command waits for the end of motion, so an empty queue is no buffer underrun.
    """

    __slots__ = (
        "_ahead",
        "_began",
        "_delay",
        "_dry_since",
        "_horizon",
        "_lookahead",
        "_places",
        "_running",
        "_seconds",
        "_standing",
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
        self._dry_since = -inf
        self._woken_by = 0
        self._standing: Axes = (0.0, 0.0, 0.0, 0.0)
        self._horizon = horizon
        self._ahead = 0.0
        self._seconds: deque[float] = deque()  # of each target, only with a horizon

    @property
    def busy(self) -> bool:
        """Whether a move runs or is about to start."""
        return self.ends != inf

    @property
    def room(self) -> int:
        """Number of free places in the queue."""
        if self._ahead > self._horizon:
            return 0
        return self._places - len(self.targets)

    def set_limits(self, limits: MotionLimits) -> None:
        """Use other limits for moves added from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, target: Axes, now: float) -> None:
        """Add a move that ends at `target`; the caller must check `room` after `advance(now)`."""
        self._lookahead.push(block)
        if (move_log := self._statistics.move_log) is not None:
            start = self.targets[-1] if self.targets else self._standing
            move_log.add_planned(self._statistics.lines, start, target, block.speed)
        self.targets.append(target)
        if self._horizon != inf:
            self._seconds.append(block.length / block.speed)
            self._ahead += self._seconds[-1]
        if self._running:
            return
        if self.ends == inf:
            self.ends = now + self._delay
            if self.expects_stop or now - self._dry_since > LONGEST_STARVATION:
                self._dry_since = -inf
            self.expects_stop = False
            self._woken_by = self._statistics.lines
        elif len(self.targets) >= ENOUGH_TO_START:
            self.ends = min(self.ends, now)

    def hold(self, seconds: float, target: Axes, now: float) -> None:
        """Add a pause at `target`, s, behind the waiting moves; as `push`."""
        self._lookahead.stop()
        self.push(Block(seconds, _NOWHERE, 1.0, _AT_ONCE), target, now)
        self._lookahead.stop()

    def advance(self, now: float) -> None:
        """Execute all moves that start until `now`."""
        while self.ends <= now:
            at = self.ends
            if self._running:
                self._standing = self.targets.popleft()
                if self._seconds:
                    self._ahead -= self._seconds.popleft()
            if self.targets:
                if not self._running:
                    self._start(at)
                seconds = self._lookahead.pop()
                self._statistics.motion_seconds += seconds
                if self._statistics.move_log is not None:
                    self._statistics.move_log.start_next(seconds)
                self._began = at
                self.ends = at + seconds
            else:
                self._running = False
                self.ends = inf
                self._dry_since = at

    def position(self, now: float) -> Axes:
        """Return the position of the motors; within a move it is linear in time, without acceleration."""
        self.advance(now)
        if not self._running:
            return self._standing
        share = (now - self._began) / (self.ends - self._began)
        x, y, z, e = (a + share * (b - a) for a, b in zip(self._standing, self.targets[0], strict=True))
        return x, y, z, e

    def place(self, position: Axes) -> None:
        """Set the position of the idle machine; ignored while it moves."""
        if not self.busy:
            self._standing = position

    @property
    def planned(self) -> Planned | None:
        """The running and waiting moves; None while nothing moves."""
        if not self._running:
            return None
        queue, last, square = self._lookahead.planned()
        return Planned(
            tuple(queue), last, square, tuple(self.targets), self._standing, self._began, self.ends
        )

    def skip_to(self, planned: Planned, seconds: float) -> None:
        """Replace the queue by its later state, after moves that took `seconds` in total.

        The caller must have computed them by the rules of this planner; see `motion.ahead`.
        """
        self._lookahead.skip_to(planned.queue, planned.last, planned.square)
        self.targets = deque(planned.targets)
        self._standing, self._began, self.ends = planned.standing, planned.began, planned.ends
        self._statistics.motion_seconds += seconds

    def stop(self, now: float) -> tuple[Axes, float]:
        """Stop at once and discard all moves; return the position, and the mm of filament not fed."""
        position = self.position(now)
        unfed = self.targets[-1][3] - position[3] if self.targets else 0.0
        if self._running:
            self._statistics.motion_seconds -= self.ends - now
        self.targets.clear()
        self._seconds.clear()
        self._ahead = 0.0
        if self._statistics.move_log is not None:
            self._statistics.move_log.forget()
        self._lookahead = Lookahead(self._lookahead.limits)
        self._running = False
        self.ends = inf
        self.expects_stop = True
        self._standing = position
        return position, unfed

    def _start(self, at: float) -> None:
        """Start moving, and count a buffer underrun if there was one."""
        self._running = True
        if self._dry_since != -inf:
            self._statistics.waited(at - self._dry_since, self._woken_by)
