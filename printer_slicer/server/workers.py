"""Read uploaded files in processes of their own, with limits of time and memory, so that no file can stop the server.

The process is `python -m printer_slicer.server.workers PATH NAME`; it writes the facts as JSON.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import BoundedSemaphore
from typing import Final

from printer_slicer.print_queue import FileFacts, PrintQueue
from printer_slicer.print_queue.file_facts import format_facts, parse_facts, read_file_facts

__all__ = ["FileReader", "limit_process"]

_MAX_SECONDS: Final = 900
_MAX_BYTES: Final = 6 << 30
_NICENESS: Final = 10


class FileReader:
    """Reads what G-code files say about themselves, and stores it in the queue.

    Args:
        queue: the queue.
        n_processes: how many files are read at the same time.
    """

    def __init__(self, queue: PrintQueue, n_processes: int = 1) -> None:
        self._queue, self._free = queue, BoundedSemaphore(n_processes)

    def read(self, file_id: str) -> FileFacts:
        """Return the facts of a file, which is read if that has not happened yet; a problem is a fact, too.

        Raises:
            UsageError: there is no such file.
        """
        facts = self._queue.read_facts(file_id)
        if facts is None:
            file = self._queue.find_file(file_id)
            with self._free:
                facts = self._queue.read_facts(file_id) or _run_process(
                    self._queue.files.find_path(file_id), file.name
                )
            self._queue.store_facts(file_id, facts)
        return facts


def _run_process(path: Path, name: str) -> FileFacts:
    """Read a file in another process."""
    command = [sys.executable, "-m", __name__, str(path), name]
    try:
        done = subprocess.run(  # noqa: S603 - no shell, and the process reads its arguments as they are
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=2 * _MAX_SECONDS,
            check=True,
        )
        return parse_facts(done.stdout.decode())
    except subprocess.TimeoutExpired:
        return FileFacts(problem=f"reading the file took over {2 * _MAX_SECONDS} s")
    except subprocess.CalledProcessError:
        return FileFacts(problem="the file cannot be read within the limits of time and memory")


def limit_process() -> None:
    """Limit time and memory of this process, and let all others go first."""
    if os.name != "posix":
        return
    import resource  # noqa: PLC0415 - only on POSIX

    with suppress(OSError, ValueError):
        os.nice(_NICENESS)
        resource.setrlimit(resource.RLIMIT_CPU, (_MAX_SECONDS, _MAX_SECONDS))
        resource.setrlimit(resource.RLIMIT_AS, (_MAX_BYTES, _MAX_BYTES))


if __name__ == "__main__":
    limit_process()
    sys.stdout.write(format_facts(read_file_facts(Path(sys.argv[1]), sys.argv[2])))
