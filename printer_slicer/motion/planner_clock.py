"""When the planner of a firmware runs short: moves go in when they arrive, and without them the machine waits.

The host's own account of a planner, for what it expects of a link and for what it saw of one. How long a move takes is
decided by `rules.Lookahead` when the move before it ends, as in a firmware. Plain Python, no clock: moments are given.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.motion.rules import Lookahead

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.motion.rules import Block, MotionLimits

__all__ = ["PlannerClock", "PlannerState"]

_FIRST_MOVE_DELAY: Final = 0.1
"""s that a standing machine waits for more moves; Marlin's BLOCK_DELAY_FOR_1ST_MOVE."""

_ENOUGH: Final = 3
"""Moves that make it start at once."""

_LONGEST: Final = 2.0
"""s; a machine that stood still for longer was not waiting for the link."""


class PlannerState(NamedTuple):
    """A planner whose machine moves.

    Attributes:
        queue: blocks that wait, each with the squared speed of the corner before it.
        last: the block pushed last.
        square: squared speed at the end of the running block, (mm/s)².
        ends: s, when that ends.
    """

    queue: tuple[tuple[Block, float], ...]
    last: Block | None
    square: float
    ends: float


class PlannerClock:
    """A ring of blocks, one place of which stays empty, and the machine that takes them out.

    Args:
        limits: of the machine, with the number of blocks.
        on_begin: called with the label of each move and when it begins, s.

    Attributes:
        stalls, stalled_seconds: how often and how long it stood still only because no move had come.
        moving_seconds: of all moves. Where the planner runs short it brakes, for it must be able to stop behind the
            last move it knows: then moves take longer, long before the machine stands still.
        ends: when the running move ends, or the standing machine will start, s; infinite when it stands.
    """

    def __init__(
        self, limits: MotionLimits, on_begin: Callable[[int, float], None] = lambda _label, _at: None
    ) -> None:
        self.stalls = 0
        self.stalled_seconds = self.moving_seconds = 0.0
        self.ends = inf
        self._lookahead = Lookahead(limits)
        self._places = max(limits.planner_blocks - 1, 1)
        self._on_begin = on_begin
        self._labels: deque[int] = deque()
        self._running = False
        self._meant = True  # the machine stands because it was told to
        self._dry_since = -inf

    def full(self, now: float) -> bool:
        """Whether a move that comes at `now`, s, has to wait for its place."""
        self._advance(now)
        return len(self._labels) >= self._places

    def set_limits(self, limits: MotionLimits) -> None:
        """Use other corner rules for the moves pushed from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, now: float, label: int = 0) -> float:
        """Bring a move at `now`, s; the moment at which it has a place, which is when its ok is sent."""
        self._advance(now)
        while len(self._labels) >= self._places:
            now = self.ends
            self._advance(now)
        self._lookahead.push(block)
        self._labels.append(label)
        if self._running:
            return now
        if self.ends == inf:
            self.ends = now + _FIRST_MOVE_DELAY
            if self._meant or now - self._dry_since > _LONGEST:
                self._dry_since = -inf
            self._meant = False
        elif len(self._labels) >= _ENOUGH:
            self.ends = min(self.ends, now)
        return now

    def stand_still(self, now: float) -> float:
        """Something waits until all moves are made: the moment at which they are, not before `now`, s."""
        self._advance(now)
        while self.ends != inf:
            now = max(now, self.ends)
            self._advance(now)
        self._meant = True
        return now

    @property
    def labels(self) -> tuple[int, ...]:
        """The labels of the running move and of those that wait."""
        return tuple(self._labels)

    def state(self, now: float) -> PlannerState | None:
        """What is being made and what waits at `now`, s; None while the machine stands."""
        self._advance(now)
        if not self._running:
            return None
        queue, last, square = self._lookahead.planned()
        return PlannerState(tuple(queue), last, square, self.ends)

    def skip_to(self, state: PlannerState, labels: Sequence[int], seconds: float) -> None:
        """Go on from a later state.

        Args:
            state: then; the machine did not stand in between.
            labels: of the running move and of those that wait then.
            seconds: of all moves that have begun in between.
        """
        self._lookahead.skip_to(state.queue, state.last, state.square)
        self._labels = deque(labels)
        self.ends = state.ends
        self.moving_seconds += seconds

    def _advance(self, now: float) -> None:
        """Everything that begins until `now`."""
        while self.ends <= now:
            at = self.ends
            if self._running:
                self._labels.popleft()
            if self._labels:
                if not self._running:
                    self._start(at)
                self._on_begin(self._labels[0], at)
                seconds = self._lookahead.pop()
                self.moving_seconds += seconds
                self.ends = at + seconds
            else:
                self._running = False
                self.ends = inf
                self._dry_since = at

    def _start(self, at: float) -> None:
        self._running = True
        if self._dry_since == -inf:
            return
        self.stalls += 1
        self.stalled_seconds += at - self._dry_since
