"""Second process that switches the heaters off if the printing process dies.

`run_failsafe_process` starts this process, and reports the end of the print through a pipe. If the pipe closes
without that report, the host was killed or crashed. The process then waits for a new host to resume the print. If no
host does so, the process opens the port and sends the commands of `HeaterWatchdog.build_shutdown_lines`. It cannot
help when the computer loses its power or the cable is unplugged. Then only the thermal protection of the firmware
remains.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event as Flag
from time import monotonic
from typing import Final

from printer_slicer.commands import split_gcode
from printer_slicer.errors import PortError
from printer_slicer.printing.job_store import Print, load_print
from printer_slicer.printing.journal import HEATERS_OFF, HOST, Journal, read_journal
from printer_slicer.stream.heater_watchdog import HeaterWatchdog
from printer_slicer.stream.serial_port import open_port

__all__ = ["main", "run_failsafe_process", "switch_heaters_off_unless_resumed"]

_PRINT_ENDED: Final = b"."
_POLL_INTERVAL: Final = 0.5
_MAX_UNACKED: Final = 64
"""Number of commands that may have been sent after the last accepted command."""

_TRANSMIT_SECONDS: Final = 1.0
"""Time allowed to transmit the last bytes before the port is closed, s."""


@contextmanager
def run_failsafe_process(folder: Path, seconds: float) -> Iterator[None]:
    """Within a `with` block, run a process that switches the heaters off if the host dies.

    Args:
        folder: folder of the print in the job store.
        seconds: time for a new host to resume the print.
    """
    command = [sys.executable, "-m", "printer_slicer.printing.heater_failsafe", str(folder), f"{seconds:g}"]
    quiet = subprocess.DEVNULL
    # In its own session, so that Ctrl-C and a closed terminal affect only the host.
    process = subprocess.Popen(  # noqa: S603 - our own program
        command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        yield
    finally:
        with suppress(OSError):
            process.communicate(_PRINT_ENDED)


def main(folder: Path, seconds: float) -> int:
    """Wait for the end of the host, then call `switch_heaters_off_unless_resumed`; return the exit code."""
    while data := os.read(0, 1):
        if data == _PRINT_ENDED:
            return 0
    return switch_heaters_off_unless_resumed(folder, seconds)


def switch_heaters_off_unless_resumed(
    folder: Path, seconds: float, clock: Callable[[], float] = monotonic
) -> int:
    """Switch the heaters off unless the print is resumed in time; return the exit code: 1 if that failed.

    Args:
        folder: folder of the print, whose host has ended.
        seconds: time for a new host to resume it.
        clock: monotonic time, s.
    """
    print_ = _wait_for_new_host(folder, seconds, clock)
    if print_ is None:
        return 0
    try:
        _switch_heaters_off(print_)
    except PortError:
        return 1
    finally:
        print_.release()
    return 0


def _wait_for_new_host(folder: Path, seconds: float, clock: Callable[[], float]) -> Print | None:
    """Wait for a new host; return the print, locked, if no host resumes it in time, else None.

    A deleted print also gives None. A lock alone does not count as a resume: the new host may still ask the
    user, or find that the state is lost.
    """
    host = _read_last_host(folder)
    end, timer = clock() + seconds, Flag()
    while True:
        timer.wait(min(_POLL_INTERVAL, max(end - clock(), 0.01)))
        print_ = load_print(folder)
        if print_ is None or _read_last_host(folder) != host:
            return None
        if clock() >= end and print_.lock():
            return print_


def _read_last_host(folder: Path) -> str:
    """Read the id of the last host of the print from the journal; empty if unknown."""
    try:
        return str(read_journal(folder).states.get(HOST, ""))
    except OSError:
        return ""


def _switch_heaters_off(print_: Print) -> None:
    """Send the shutdown commands to the printer, and record in the journal that the heaters are off.

    Raises:
        PortError: the port cannot be opened, or the connection is lost.
    """
    journal_data = read_journal(print_.folder)
    sent = split_gcode(print_.text).commands[: journal_data.entries + _MAX_UNACKED]
    words = HeaterWatchdog().build_shutdown_lines(
        [*sent, *(record.command for record in journal_data.lines)], assume_heated=True
    )
    port = open_port(print_.port, print_.baud)
    try:
        port.write(words)
        end = monotonic() + _TRANSMIT_SECONDS
        while monotonic() < end:
            port.read(_POLL_INTERVAL)
    finally:
        port.close()
    journal = Journal(print_.folder)
    journal.record_state({HEATERS_OFF: "nobody resumed the print"})
    journal.close()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), float(sys.argv[2])))
