"""Print a file on a printer behind a print server: upload it, start it, and wait for its end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event as Flag
from time import monotonic
from typing import Final

from printer_slicer.errors import OutputError, PortError, PrintError, UsageError
from printer_slicer.print_queue.printers import PrinterEntry
from printer_slicer.print_queue.run_folder import RunResult
from printer_slicer.sending import RemoteStatus, Upload, cancel_remote_print, read_remote_status, send

__all__ = ["RemotePrinter", "print_remotely"]

_INTERVAL: Final = 2.0  # s between two requests
_ANSWER_TIMEOUT: Final = 60.0  # s for a print to begin, and for a server to report how it ended


class RemotePrinter:
    """A printer behind a print server.

    Args:
        entry: the printer in printers.toml.

    Raises:
        UsageError: the file with its key cannot be read.
    """

    def __init__(self, entry: PrinterEntry) -> None:
        assert entry.server is not None
        self._kind, self._url = entry.server
        self._key, self._user = _read_key(entry.key_file), entry.user

    def read_status(self) -> RemoteStatus:
        """Read what the printer does.

        Raises:
            PortError: the server does not answer, or rejects the key.
        """
        return read_remote_status(self._kind, self._url, key=self._key, user=self._user)

    def send(self, path: Path, name: str) -> None:
        """Upload a file, and start its print.

        Raises:
            PortError: the upload or the start failed.
        """
        upload = Upload(path, name, start=True)
        send(upload, self._kind, self._url, key=self._key, user=self._user)

    def cancel(self) -> None:
        """Cancel the print.

        Raises:
            PortError: the server does not answer, rejects the key, or prints nothing.
        """
        cancel_remote_print(self._kind, self._url, key=self._key, user=self._user)


def _read_key(file: str) -> str:
    """Read the API key or password in a file; empty without a file.

    Raises:
        UsageError: the file cannot be read.
    """
    if not file:
        return ""
    try:
        return Path(file).expanduser().read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{file}: the key cannot be read: {error}", remedy="Check key_file in printers.toml"
        ) from None


def print_remotely(  # noqa: PLR0913 - two are for tests
    printer: RemotePrinter,
    path: Path,
    name: str,
    *,
    is_cancelled: Callable[[], bool],
    on_start: Callable[[], None],
    interval: float = _INTERVAL,
    timeout: float = _ANSWER_TIMEOUT,
) -> RunResult:
    """Print a file on a server, and wait for the end of the print.

    Args:
        printer: the printer.
        path: the G-code.
        name: its name on the server, which no other file there has.
        is_cancelled: whether a person has asked for the end of the print.
        on_start: called when the server has accepted the print.
        interval: time between two requests to the server, s.
        timeout: time for the print to begin, and for the server to report how it ended, s.

    Raises:
        PortError: the printer is not ready; nothing was uploaded.
        PrintError: the upload or the start failed, so the print may have begun or not.
    """
    status = printer.read_status()
    if status.state != "idle":
        raise PortError(
            f"the printer is not ready: {status.message or status.state}",
            remedy="Check the web page of the server",
        )
    try:
        printer.send(path, name)
    except (PortError, UsageError, OutputError) as error:
        raise PrintError(str(error.args[0]), remedy=error.remedy) from None
    on_start()
    return _wait_for_end(printer, name, is_cancelled, _measure_time(interval), timeout)


def _measure_time(interval: float) -> Iterator[float]:
    """Yield the time at once and then after each interval, s."""
    pause = Flag()
    while True:
        yield monotonic()
        pause.wait(interval)


def _wait_for_end(
    printer: RemotePrinter,
    name: str,
    is_cancelled: Callable[[], bool],
    times: Iterator[float],
    timeout: float,
) -> RunResult:
    """Poll the server until the print has ended; an unanswered request is repeated, because the print goes on."""
    has_begun, unclear_since = False, next(times)
    for now in times:
        if is_cancelled():
            with suppress(PortError):  # it has ended already, or the server does not answer
                printer.cancel()
        try:
            status = printer.read_status()
        except PortError:
            continue
        is_ours = Path(status.file).name == name if status.file else has_begun
        if status.state in {"printing", "paused"} and (is_ours or not status.file):
            has_begun, unclear_since = True, now
        elif is_ours and (result := _judge_end(status, is_cancelled=is_cancelled())) is not None:
            return result
        elif now - unclear_since > timeout:
            return RunResult("failed", f"the server does not report how the print ended: {status.message}")
    raise AssertionError("time never ends")


def _judge_end(status: RemoteStatus, *, is_cancelled: bool) -> RunResult | None:
    """Return how a print has ended, according to the server; None if that is unknown."""
    if status.is_complete:
        return RunResult("done")
    if is_cancelled and status.state == "idle":
        return RunResult("cancelled", "cancelled on the server")
    if status.state == "error" or status.is_complete is False:
        return RunResult("failed", f"the server says: {status.message or status.state}")
    return None
