"""The planner in simulated time: moves go in at one end, and leave it when the motors have made them.

How long a move takes is decided by `motion.rules.Lookahead` at the moment the move before it ends, as in a
firmware: what arrives later can no longer change it. Nothing happens between calls; `advance` catches up with
the clock.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.motion.rules import Axes, Block, Lookahead, MotionLimits

if TYPE_CHECKING:
    from printer_slicer.sim.tally import Tally

__all__ = ["Mover", "Planned"]

LONGEST_STARVATION: Final = 2.0
"""s; a machine that stands still for longer was not waiting for the cable but for a person or a program."""

ENOUGH_TO_START: Final = 3
"""Moves that make a standing machine start at once instead of waiting for more, as Marlin does."""


class Planned(NamedTuple):
    """The state of a planner whose machine moves.

    Attributes:
        queue: blocks that wait, each with the squared speed of the corner before it.
        last: the block pushed last.
        square: squared speed at the end of the running block, (mm/s)².
        targets: where the running block and each waiting one end, x, y, z, e, mm.
        standing: where the running block began.
        began, ends: s, when it did and will.
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
"""mm/s²; a pause is a block that goes nowhere at 1 mm/s, and is at full speed from its beginning to its end."""


class Mover:
    """Executes blocks one after the other.

    A planner of n blocks has n - 1 places, one of them held by the block that is being executed: a ring needs
    one empty place to be told from an empty ring.

    Args:
        limits: motion limits of the machine, including the size of its planner.
        first_move_delay: s that an idle machine waits for more moves.
        tally: statistics.
        horizon: maximum motion planned ahead, s at the requested speeds, regardless of the number of moves.

    Attributes:
        ends: when the running move ends, or the standing machine will start; infinite when it stands for
            good.
        targets: where the running move and each waiting move end, x, y, z, e, mm.
        expects_stop: a command asked for standing still, so running dry is no starvation.
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
        "_tally",
        "_woken_by",
        "ends",
        "expects_stop",
        "targets",
    )

    def __init__(
        self, limits: MotionLimits, first_move_delay: float, tally: Tally, horizon: float = inf
    ) -> None:
        self.ends = inf
        self.targets: deque[Axes] = deque()
        self.expects_stop = True
        self._lookahead = Lookahead(limits)
        self._places = max(limits.planner_blocks - 1, 1)
        self._delay = first_move_delay
        self._tally = tally
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
        """Whether something moves or is about to."""
        return self.ends != inf

    @property
    def room(self) -> int:
        """Moves that can be taken without waiting."""
        if self._ahead > self._horizon:
            return 0
        return self._places - len(self.targets)

    def set_limits(self, limits: MotionLimits) -> None:
        """Use other corner rules for the moves pushed from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, target: Axes, now: float) -> None:
        """Take a move that ends at `target`. The caller has looked at `room`, after `advance(now)`."""
        self._lookahead.push(block)
        if (track := self._tally.track) is not None:
            start = self.targets[-1] if self.targets else self._standing
            track.planned(self._tally.lines, start, target, block.speed)
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
            self._woken_by = self._tally.lines
        elif len(self.targets) >= ENOUGH_TO_START:
            self.ends = min(self.ends, now)

    def hold(self, seconds: float, target: Axes, now: float) -> None:
        """Stand still at `target` for so long, behind the moves that wait; as `push`."""
        self._lookahead.stop()
        self.push(Block(seconds, _NOWHERE, 1.0, _AT_ONCE), target, now)
        self._lookahead.stop()

    def advance(self, now: float) -> None:
        """Execute everything that begins until `now`."""
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
                self._tally.motion_seconds += seconds
                if self._tally.track is not None:
                    self._tally.track.begun(seconds)
                self._began = at
                self.ends = at + seconds
            else:
                self._running = False
                self.ends = inf
                self._dry_since = at

    def position(self, now: float) -> Axes:
        """Where the motors are; within a move by its share of time, so speeding up is not seen."""
        self.advance(now)
        if not self._running:
            return self._standing
        share = (now - self._began) / (self.ends - self._began)
        x, y, z, e = (a + share * (b - a) for a, b in zip(self._standing, self.targets[0], strict=True))
        return x, y, z, e

    def place(self, position: Axes) -> None:
        """Declare where the standing machine is; while it moves the moves know better."""
        if not self.busy:
            self._standing = position

    @property
    def planned(self) -> Planned | None:
        """What is being made and what waits; None while nothing moves."""
        if not self._running:
            return None
        queue, last, square = self._lookahead.planned()
        return Planned(
            tuple(queue), last, square, tuple(self.targets), self._standing, self._began, self.ends
        )

    def skip_to(self, planned: Planned, seconds: float) -> None:
        """Have made moves that took so many seconds, without a break, and be in the middle of others.

        Whoever has reckoned all that has done it by the rules of this planner; see `motion.ahead`.
        """
        self._lookahead.skip_to(planned.queue, planned.last, planned.square)
        self.targets = deque(planned.targets)
        self._standing, self._began, self.ends = planned.standing, planned.began, planned.ends
        self._tally.motion_seconds += seconds

    def stop(self, now: float) -> tuple[Axes, float]:
        """Stop at once and forget all moves: where that is, and the E (mm) that will not be fed."""
        position = self.position(now)
        unfed = self.targets[-1][3] - position[3] if self.targets else 0.0
        if self._running:
            self._tally.motion_seconds -= self.ends - now
        self.targets.clear()
        self._seconds.clear()
        self._ahead = 0.0
        if self._tally.track is not None:
            self._tally.track.forget()
        self._lookahead = Lookahead(self._lookahead.limits)
        self._running = False
        self.ends = inf
        self.expects_stop = True
        self._standing = position
        return position, unfed

    def _start(self, at: float) -> None:
        """From standing to moving, and the account of a machine that stood because no move came."""
        self._running = True
        if self._dry_since != -inf:
            self._tally.waited(at - self._dry_since, self._woken_by)
