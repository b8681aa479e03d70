"""Start a print as a process that outlives the one that started it, and wait until the print can be controlled.

The process has a session of its own and writes to a log file, so that neither a closed terminal nor the death of the
process that started it ends the print. It reports that it is ready by a file: `write_ready_file`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from typing import Any, Final

from printer_slicer.errors import PrintError, PrinterSlicerError
from printer_slicer.saving import check_writable, save

__all__ = ["DetachedPrint", "spawn_detached", "start_detached", "write_ready_file"]

_POLL_INTERVAL: Final = 0.02  # s
_TAIL_BYTES: Final = 4096  # bytes of the log in an error message


class DetachedPrint:
    """A print process that was started.

    Attributes:
        pid: its process id.
        folder: folder of the print in the job store.
    """

    def __init__(self, process: subprocess.Popen[bytes], ready: dict[str, Any]) -> None:
        self.pid = process.pid
        self.folder = Path(ready["folder"])
        # Collects the exit code, if this process still lives when the print ends.
        Thread(target=process.wait, name="print", daemon=True).start()


def write_ready_file(path: Path, folder: Path) -> None:
    """Report that the print in this folder can be controlled now.

    Args:
        path: file to write; it appears complete or not at all.
        folder: folder of the print in the job store.
    """
    save(path, json.dumps({"pid": os.getpid(), "folder": str(folder)}).encode())


def start_detached(command: Sequence[str], ready_file: Path, log: Path) -> DetachedPrint:
    """Start a print process, and wait until it is ready or has ended.

    Args:
        command: arguments of Python; the process calls `write_ready_file` for `ready_file`.
        ready_file: file that does not exist yet.
        log: file to which the output of the process is appended.

    Raises:
        OutputError: the log is a folder, or its folder is missing.
        PrintError: the process ended before it was ready; the message is the end of its log.
    """
    check_writable(log)
    process = spawn_detached(command, log)
    wait = Flag()
    while process.poll() is None and not ready_file.exists():
        wait.wait(_POLL_INTERVAL)
    if not ready_file.exists():
        raise _make_start_error(log, process.returncode)
    return DetachedPrint(process, json.loads(ready_file.read_text(encoding="utf-8")))


def spawn_detached(command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    """Start Python with these arguments in a session of its own, with nothing on its stdin, and return at once.

    The output of the process is appended to the file `log`.

    Raises:
        OSError: the process cannot be started, or the log cannot be opened.
    """
    session: dict[str, Any] = (
        {"start_new_session": True}
        if os.name == "posix"
        else {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
    )
    with log.open("ab") as output:
        return subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, *command], stdin=subprocess.DEVNULL, stdout=output, stderr=output, **session
        )


def _make_start_error(log: Path, code: int | None) -> PrinterSlicerError:
    """Return the error of a print process that ended before it was ready."""
    with log.open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - _TAIL_BYTES, 0))
        lines = file.read().decode("utf-8", "replace").splitlines()
    said = [line.removeprefix("printer-slicer: ") for line in lines if line.strip()][-2:]
    message, *remedy = said or [f"the print process ended with exit code {code}"]
    error = PrintError(message, remedy=" ".join(remedy).strip() or f"Read the log {log}")
    error.exit_code = code or error.exit_code
    return error
