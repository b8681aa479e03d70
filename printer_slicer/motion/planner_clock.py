"""Simulate the planner queue of a firmware over time, to find buffer underruns.

The host uses it to predict underruns of a serial link and to detect past ones. The time of a move is computed by
`rules.Lookahead` when the move before it ends, as in a firmware. Plain Python without a clock: the caller passes times.
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
"""s; delay before a machine at rest starts, to wait for more moves (Marlin's BLOCK_DELAY_FOR_1ST_MOVE)."""

_MOVES_TO_START: Final = 3
"""Number of queued moves at which a machine at rest starts at once."""

_LONGEST_UNDERRUN: Final = 2.0
"""s; a longer stop is not an underrun of the link."""


class PlannerState(NamedTuple):
    """The state of a planner while the machine moves.

    Attributes:
        queue: waiting blocks, each with the squared speed of the corner before it.
        last: the block pushed last.
        square: squared speed at the end of the running block, (mm/s)².
        ends: time at which the running block ends, s.
    """

    queue: tuple[tuple[Block, float], ...]
    last: Block | None
    square: float
    ends: float


class PlannerClock:
    """A planner queue (a ring buffer with one empty place) and the machine that executes its blocks.

    Args:
        limits: motion limits of the machine, including the number of blocks.
        on_begin: called with the label of each move and its start time, s.

    Attributes:
        stalls, stalled_seconds: number and total time of underruns, when the machine stopped for lack of moves.
        moving_seconds: total time of all moves. A short queue makes moves slower long before the machine stops, because
            it must be able to stop after the last known move.
        ends: time at which the running move ends, s. While the machine rests: the time at which it will start, or
            infinity if no move is queued.
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
        self._rests_on_command = True  # the machine rests on command
        self._idle_since = -inf

    def is_full(self, now: float) -> bool:
        """Return whether the queue is full at time `now`, s."""
        self._advance(now)
        return len(self._labels) >= self._places

    def set_limits(self, limits: MotionLimits) -> None:
        """Set the motion limits for the corners of moves pushed from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, now: float, label: int = 0) -> float:
        """Add a move at time `now`, s; return the time at which it gets a place in the queue and ok is sent for it."""
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
            if self._rests_on_command or now - self._idle_since > _LONGEST_UNDERRUN:
                self._idle_since = -inf
            self._rests_on_command = False
        elif len(self._labels) >= _MOVES_TO_START:
            self.ends = min(self.ends, now)
        return now

    def finish_moves(self, now: float) -> float:
        """Advance from time `now`, s, until all moves are done; return that time, s."""
        self._advance(now)
        while self.ends != inf:
            now = max(now, self.ends)
            self._advance(now)
        self._rests_on_command = True
        return now

    @property
    def labels(self) -> tuple[int, ...]:
        """The labels of the running and the waiting moves."""
        return tuple(self._labels)

    def state(self, now: float) -> PlannerState | None:
        """Return the state of the planner at time `now`, s; None while the machine rests."""
        self._advance(now)
        if not self._running:
            return None
        queue, last, square = self._lookahead.get_queue_state()
        return PlannerState(tuple(queue), last, square, self.ends)

    def skip_to(self, state: PlannerState, labels: Sequence[int], seconds: float) -> None:
        """Skip to a later state of the planner, which was computed elsewhere.

        Args:
            state: the later state; the machine must not have rested in between.
            labels: labels of the running and the waiting moves.
            seconds: total time of all moves that started in between.
        """
        self._lookahead.skip_to(state.queue, state.last, state.square)
        self._labels = deque(labels)
        self.ends = state.ends
        self.moving_seconds += seconds

    def _advance(self, now: float) -> None:
        """Start all moves that begin up to time `now`, s."""
        while self.ends <= now:
            at = self.ends
            if self._running:
                self._labels.popleft()
            if self._labels:
                if not self._running:
                    self._start_moving(at)
                self._on_begin(self._labels[0], at)
                seconds = self._lookahead.pop()
                self.moving_seconds += seconds
                self.ends = at + seconds
            else:
                self._running = False
                self.ends = inf
                self._idle_since = at

    def _start_moving(self, at: float) -> None:
        """Start the machine at time `at`, s; count an underrun if it stopped for lack of moves."""
        self._running = True
        if self._idle_since == -inf:
            return
        self.stalls += 1
        self.stalled_seconds += at - self._idle_since
