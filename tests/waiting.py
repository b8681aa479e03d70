"""Wait for a state of another thread or process, never for a fixed time."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from shutil import rmtree
from threading import Event as Flag
from time import monotonic
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path
    from types import FrameType

LAST_RESORT: Final = 600.0
"""s after which a test gives up what hangs for ever. No machine is so busy that a test which works needs as long."""

_LOOK: Final = 0.005


def until(what: Callable[[], object], told: Callable[[], object] = lambda: "") -> None:
    """Wait until something is so.

    Args:
        what: whether it is so.
        told: what to show where it never is.

    Raises:
        AssertionError: it never is.
    """
    never, give_up = Flag(), monotonic() + LAST_RESORT
    while not what():
        assert monotonic() < give_up, f"it never happened {told()}"
        never.wait(_LOOK)


class NeverEndsError(AssertionError):
    """A call that should have been back long ago."""


@contextmanager
def comes_back() -> Iterator[None]:
    """Fails what never comes back, instead of waiting for it for ever; on systems with alarms, in the main thread."""

    def give_up(_number: int, _frame: FrameType | None) -> None:
        raise NeverEndsError(f"not back after {LAST_RESORT:g} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, LAST_RESORT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class Halting(list[str]):
    """Lines that a simulated printer executes; it stands still in the first one that a test waits for.

    So the test finds the state that it waits for however late it looks. Give `append` to the printer as `on_executed`.

    Args:
        where: whether to stand still, asked with each line until it once says so; None: never.
    """

    def __init__(self, where: Callable[[list[str]], object] | None = None) -> None:
        super().__init__()
        self._where = where
        self._reached, self._free = Flag(), Flag()

    def append(self, line: str) -> None:
        """One more line is executed."""
        super().append(line)
        if self._where is not None and not self._reached.is_set() and self._where(self):
            self._reached.set()
            self._free.wait(LAST_RESORT)

    def reached(self) -> None:
        """Wait until it stands still."""
        until(self._reached.is_set, lambda: self[-5:])

    def go_on(self) -> None:
        """Let it go on, now and for ever."""
        self._where = None
        self._free.set()


@contextmanager
def hosts(state: Path) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes that the block puts into the list are ended and waited for, however it ends.

    Args:
        state: the folder of their prints. It is removed, so that those who watch over these prints end, too.
    """
    started: list[subprocess.Popen[bytes]] = []
    try:
        yield started
    finally:
        for process in started:
            if process.poll() is None:
                process.kill()
            process.wait(LAST_RESORT)
        rmtree(state, ignore_errors=True)
