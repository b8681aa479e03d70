"""Simulated printers on pseudo-terminals that can stall, disappear and return at a test's request."""

from __future__ import annotations

import os
import pty
import select
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from time import monotonic

from benchmarks import killing
from benchmarks.killing import PRINTER, of_job
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.sim.link import Cable
from printer_slicer.sim.printer import SimulatedPrinter
from tests.waiting import Halting


def after(count: int) -> Halting:
    """What a printer executes, which stands still after so many commands of the job until it is told to go on."""
    return Halting(lambda lines: len(of_job(lines)) > count)


@contextmanager
def served(link: Path, speed: float = 20.0, executed: list[str] | None = None) -> Iterator[list[str]]:
    """A simulated printer; the list holds what it executes. At the end it goes as it is, also where it stands still."""
    ends = executed.go_on if isinstance(executed, Halting) else lambda: None
    with killing.served(link, speed, executed=executed, ends=ends) as lines:
        yield lines


class Pluggable:
    """A printer with a life of its own, twenty times as fast, behind a device that comes and goes.

    Attributes:
        executed: what it executes.
    """

    def __init__(self, link: Path) -> None:
        self.executed = after(100)
        printer = SimulatedPrinter(
            machine_of(PRINTER),
            simulated_firmware_for(PRINTER),
            on_executed=self.executed.append,
            boots=False,
        )
        self._cable, self._link, self._began = Cable(printer), link, monotonic()
        self._end: tuple[int, int] | None = None

    def plug(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))
        self._end = master, slave

    def pull(self) -> None:
        assert self._end is not None
        self._link.unlink()
        (master, slave), self._end = self._end, None
        os.close(master)
        os.close(slave)

    def carry(self, stop: Flag) -> None:
        """Live, until told to stop."""
        while not stop.wait(0.001):
            now = (monotonic() - self._began) * 20
            end = self._end
            # The cable may be pulled at any moment.
            with suppress(OSError, ValueError):
                if end and select.select([end[0]], [], [], 0)[0]:
                    self._cable.write(os.read(end[0], 4096), now)
            said = b""
            while (due := self._cable.next_event_time()) <= now:
                said += self._cable.read(due)
            said += self._cable.read(now)
            with suppress(OSError):
                if said and end:
                    os.write(end[0], said)


@contextmanager
def pluggable(link: Path) -> Iterator[tuple[Halting, Callable[[], None], Callable[[], None]]]:
    """A printer whose cable can be pulled: what it executes, how to pull, how to plug in again.

    It stands still after 100 commands, until it is told to go on.
    """
    printer, stop = Pluggable(link), Flag()
    printer.plug()
    thread = Thread(target=printer.carry, args=(stop,))
    thread.start()
    try:
        yield printer.executed, printer.pull, printer.plug
    finally:
        stop.set()
        thread.join()
        if link.is_symlink():
            printer.pull()
