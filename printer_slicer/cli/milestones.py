"""Report progress without a progress bar: a line per 5 %, and at least one a minute."""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import monotonic
from typing import Final

from printer_slicer.cli.common import visible
from printer_slicer.durations import spoken

__all__ = ["Milestones"]

_SHARES: Final = 20
_A_MINUTE: Final = 60.0


class Milestones:
    """Writes a line of progress to stderr whenever one is due.

    Args:
        what: the activity, at the start of each line.
        wanted: whether to write lines at all.
        every_share: whether to write one per 5 %; if not, only one a minute.
        clock: returns seconds.
    """

    def __init__(
        self, what: str, *, wanted: bool, every_share: bool = True, clock: Callable[[], float] = monotonic
    ) -> None:
        self._what, self._wanted, self._every_share, self._clock = what, wanted, every_share, clock
        self._begun = self._last = clock()
        self._shares = 0

    def reached(self, done: int, total: int, more: Callable[[], str]) -> None:
        """Report progress if a line is due.

        Args:
            done: finished steps of `total`.
            total: at least 1.
            more: returns further text for the line; called only when a line is due.
        """
        if not self._wanted:
            return
        shares, now = done * _SHARES // total, self._clock()
        if not (self._every_share and shares > self._shares) and now - self._last < _A_MINUTE:
            return
        self._shares, self._last = shares, now
        line = f"{self._what}: {done * 100 // total} %, {more()}, {spoken(now - self._begun)} so far"
        print(visible(line), file=sys.stderr, flush=True)
