"""Read uploaded files in processes of their own, with limits of time and memory, so that no file can stop the server.

The process is `python -m printer_slicer.server.workers facts|page|preview PATH NAME OUTPUT`; it writes the facts as
JSON, the page, or the compressed preview to a file.
"""

from __future__ import annotations

import gzip
import json
import signal
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import BoundedSemaphore
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.print_queue import FileFacts, PrintQueue
from printer_slicer.print_queue.file_facts import format_facts, parse_facts, read_file_facts
from printer_slicer.process_limits import ProcessLimits, limit_process
from printer_slicer.saving import save

if TYPE_CHECKING:
    from printer_slicer.preview import Preview

__all__ = ["LIMITS", "FileReader"]

LIMITS: Final = ProcessLimits(max_seconds=900, max_bytes=6 << 30, niceness=10)
"""Limits of the processes that read and slice uploaded files."""

_INTERRUPTIONS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
_PREVIEW_ENDING: Final = "preview1.gz"  # with the number of the format


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
            UsageError: there is no such file, or reading was interrupted.
        """
        facts = self._queue.read_facts(file_id)
        if facts is None:
            file = self._queue.find_file(file_id)
            with self._free:
                facts = self._queue.read_facts(file_id) or _read_facts(
                    self._queue.files.find_path(file_id), file.name
                )
            self._queue.store_facts(file_id, facts)
        return facts

    def make_page(self, file_id: str) -> bytes:
        """Return the page that shows the layers and moves of a file; it is kept for the next time.

        Raises:
            UsageError: there is no such file, or it cannot be shown.
        """
        return self._make("page", file_id, "html").read_bytes()

    def make_preview(self, file_id: str) -> bytes:
        """Return the preview of a file, see `printer_slicer.preview.encoding`, compressed with gzip.

        Raises:
            UsageError: there is no such file, or it cannot be shown.
        """
        return self._make("preview", file_id, _PREVIEW_ENDING).read_bytes()

    def read_layers(self, file_id: str) -> dict[str, Any]:
        """Return the columns `first`, `z`, `height`, `seconds` and `command` of the layers of a file.

        Raises:
            UsageError: there is no such file, or it cannot be shown.
        """
        with gzip.open(self._make("preview", file_id, _PREVIEW_ENDING)) as preview:
            length = int.from_bytes(preview.read(12)[8:], "little")
            layers: dict[str, Any] = json.loads(preview.read(length))["layers"]
        return layers

    def delete_pages(self, file_id: str) -> None:
        """Delete what was made of a file."""
        for path in (self._queue.folder / "pages").glob(f"{file_id}-*"):
            path.unlink(missing_ok=True)

    def _make(self, what: str, file_id: str, ending: str) -> Path:
        """Return the path of what was made of a file; it is kept for the next time.

        Raises:
            UsageError: there is no such file, or it cannot be shown.
        """
        file = self._queue.find_file(file_id)
        kept = self._queue.folder / "pages" / f"{file_id}-{_hash_text(file.name)}.{ending}"
        with self._free:
            if not kept.exists():
                made, problem = _run_process(what, self._queue.files.find_path(file_id), file.name)
                if problem:
                    raise UsageError(f"{file.name}: {problem}", remedy="Open it with printer-slicer view")
                kept.parent.mkdir(exist_ok=True, mode=0o700)
                save(kept, made)
        return kept


def _hash_text(text: str) -> str:
    """Return the first digits of the SHA-256 of a text."""
    return sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:12]


def _read_facts(path: Path, name: str) -> FileFacts:
    """Read the facts of a file in another process."""
    facts, problem = _run_process("facts", path, name)
    return FileFacts(problem=problem) if problem else parse_facts(facts.decode())


def _run_process(what: str, path: Path, name: str) -> tuple[bytes, str]:
    """Read a file in another process; return what it wrote, and why it failed."""
    with TemporaryDirectory() as folder:
        output = Path(folder) / "result"
        command = [sys.executable, "-m", __name__, what, str(path), name, str(output)]
        problem = _wait_for(command)
        return (b"", problem) if problem else (output.read_bytes(), "")


def _wait_for(command: list[str]) -> str:
    """Run a command without input and output; return why it failed.

    Raises:
        UsageError: it was interrupted from outside, such as by Ctrl-C, which says nothing about the file.
    """
    nothing = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    try:
        subprocess.run(command, timeout=2 * LIMITS.max_seconds, check=True, **nothing)  # type: ignore[call-overload]  # noqa: S603 - no shell
    except subprocess.TimeoutExpired:
        return f"reading the file took over {2 * LIMITS.max_seconds:g} s"
    except subprocess.CalledProcessError as error:
        if -error.returncode in _INTERRUPTIONS:
            raise UsageError("reading the file was interrupted", remedy="Try again") from None
        return "the file cannot be read within the limits of time and memory"
    return ""


def _read_preview(path: Path, name: str) -> Preview:
    """Return the preview of a file."""
    from printer_slicer.importing.gcode_files import read_gcode_settings  # noqa: PLC0415 - slow
    from printer_slicer.motion.rules import limits_of  # noqa: PLC0415 - slow
    from printer_slicer.preview import read_preview  # noqa: PLC0415 - slow
    from printer_slicer.profile import complete_profile  # noqa: PLC0415 - slow

    profile = complete_profile(dict(read_gcode_settings(path).values), {})
    return read_preview(path.read_bytes(), name, limits_of(profile.printer))


def _make_content(what: str, path: Path, name: str) -> bytes:
    """Return the facts, the page or the preview of a file."""
    from printer_slicer.preview import encode_preview, make_view_page  # noqa: PLC0415 - slow

    if what == "facts":
        return format_facts(read_file_facts(path, name)).encode()
    preview = _read_preview(path, name)
    if what == "page":
        return make_view_page(preview)
    return gzip.compress(encode_preview(preview), 9, mtime=0)


if __name__ == "__main__":
    limit_process(LIMITS, limits_cpu=True)
    _, wanted, source, shown_name, target = sys.argv
    Path(target).write_bytes(_make_content(wanted, Path(source), shown_name))
