"""The planner in simulated time: moves go in at one end, and leave it when the motors have made them.

How long a move takes is decided by `motion.rules.Lookahead` at the moment the move before it ends, as in a
firmware: what arrives later can no longer change it. Nothing happens between calls; `advance` catches up with
the clock.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.motion.rules import Axes, Block, Limits, Lookahead

if TYPE_CHECKING:
    from printer_slicer.sim.tally import Tally

__all__ = ["Mover"]

LONGEST_STARVATION: Final = 2.0
"""s; a machine that stands still for longer was not waiting for the cable but for a person or a program."""

ENOUGH_TO_START: Final = 3
"""Moves that make a standing machine start at once instead of waiting for more, as Marlin does."""


class Mover:
    """Executes blocks one after the other.

    A planner of n blocks has n - 1 places, one of them held by the block that is being executed: a ring needs
    one empty place to be told from an empty ring.

    Attributes:
        ends: when the running move ends, or the standing machine will start; infinite when it stands for
            good.
        targets: where the running move and each waiting move end, x, y, z, e, mm.
        expects_stop: a command asked for standing still, so running dry is no starvation.
    """

    __slots__ = (
        "_began",
        "_delay",
        "_dry_since",
        "_lookahead",
        "_places",
        "_running",
        "_standing",
        "_tally",
        "ends",
        "expects_stop",
        "targets",
    )

    def __init__(self, limits: Limits, first_move_delay: float, tally: Tally) -> None:
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
        self._standing: Axes = (0.0, 0.0, 0.0, 0.0)

    @property
    def busy(self) -> bool:
        """Whether something moves or is about to."""
        return self.ends != inf

    @property
    def room(self) -> int:
        """Moves that can be taken without waiting."""
        return self._places - len(self.targets)

    def set_limits(self, limits: Limits) -> None:
        """Use other corner rules for the moves pushed from now on."""
        self._lookahead.limits = limits

    def push(self, block: Block, target: Axes, now: float) -> None:
        """Take a move that ends at `target`. The caller has looked at `room`, after `advance(now)`."""
        self._lookahead.push(block)
        self.targets.append(target)
        if self._running:
            return
        if self.ends == inf:
            self.ends = now + self._delay
            if self.expects_stop or now - self._dry_since > LONGEST_STARVATION:
                self._dry_since = -inf
            self.expects_stop = False
        elif len(self.targets) >= ENOUGH_TO_START:
            self.ends = min(self.ends, now)

    def advance(self, now: float) -> None:
        """Execute everything that begins until `now`."""
        while self.ends <= now:
            at = self.ends
            if self._running:
                self._standing = self.targets.popleft()
            if self.targets:
                if not self._running:
                    self._start(at)
                seconds = self._lookahead.pop()
                self._tally.motion_seconds += seconds
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

    def stop(self, now: float) -> tuple[Axes, float]:
        """Stop at once and forget all moves: where that is, and the E (mm) that will not be fed."""
        position = self.position(now)
        unfed = self.targets[-1][3] - position[3] if self.targets else 0.0
        if self._running:
            self._tally.motion_seconds -= self.ends - now
        self.targets.clear()
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
            self._tally.starvations += 1
            self._tally.starved_seconds += at - self._dry_since
