"""How far long work has come, for those who see no progress bar: a line per 5 %, and one after each minute without."""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import monotonic
from typing import Final

from printer_slicer.cli.common import visible
from printer_slicer.gcode import spoken

__all__ = ["Milestones"]

_SHARES: Final = 20
_A_MINUTE: Final = 60.0


class Milestones:
    """Writes a line on stderr whenever one is due.

    Args:
        what: is going on, the first word of each line.
        wanted: whether anybody wants lines.
        every_share: whether each 5 % is worth one; where whole jobs take seconds, only minutes are.
        clock: s.
    """

    def __init__(
        self, what: str, *, wanted: bool, every_share: bool = True, clock: Callable[[], float] = monotonic
    ) -> None:
        self._what, self._wanted, self._every_share, self._clock = what, wanted, every_share, clock
        self._begun = self._last = clock()
        self._shares = 0

    def reached(self, done: int, total: int, more: Callable[[], str]) -> None:
        """So much is done.

        Args:
            done: of `total`.
            total: at least 1.
            more: what else to say, asked only when a line is due.
        """
        if not self._wanted:
            return
        shares, now = done * _SHARES // total, self._clock()
        if not (self._every_share and shares > self._shares) and now - self._last < _A_MINUTE:
            return
        self._shares, self._last = shares, now
        line = f"{self._what}: {done * 100 // total} %, {more()}, {spoken(now - self._begun)} so far"
        print(visible(line), file=sys.stderr, flush=True)
