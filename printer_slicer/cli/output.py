"""Say results and progress on stdout and stderr, which survive a closed pipe or terminal, and write files."""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock, Timer
from time import monotonic
from typing import TYPE_CHECKING, Final, TextIO

from printer_slicer.errors import UsageError
from printer_slicer.saving import save
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = [
    "PATIENCE",
    "Milestones",
    "Stages",
    "coloured",
    "outlive_readers",
    "refuse_mixing",
    "refuse_same",
    "say",
    "stages",
    "unwritten",
    "visible",
    "warn",
    "without_stdin",
    "write_file",
]

PATIENCE = 1.0  # s before a progress bar appears
_STAGES = 11  # from loading to writing
_SHARES: Final = 20
_A_MINUTE: Final = 60.0
_CODES: Final = {"error": "1;31", "warning": "1;33"}


# Text


def say(arguments: argparse.Namespace, text: str) -> None:
    """A line for people; not with --quiet or --json."""
    if not (arguments.quiet or arguments.json):
        print(visible(without_stdin(arguments, text)))


def without_stdin(arguments: argparse.Namespace, text: str) -> str:
    """Text without the folder that stdin was kept in, of which people need not read."""
    hidden = getattr(arguments, "hidden", "")
    return text.replace(hidden, "") if hidden else text


def visible(text: str) -> str:
    """Text that may come from a file or a printer, without what would control the terminal."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def coloured(text: str, kind: str, stream: TextIO) -> str:
    """The text as it is shown on a stream: `kind` is error or warning."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return text
    return f"\x1b[{_CODES[kind]}m{text}\x1b[0m"


def warn(arguments: argparse.Namespace, warnings: Sequence[str]) -> None:
    """Tell people on stderr; not with --quiet."""
    for text in () if arguments.quiet else warnings:
        prefix = coloured("printer-slicer: warning:", "warning", sys.stderr)
        print(f"{prefix} {visible(text)}", file=sys.stderr)


# Progress


Stages = Callable[[str], None]


@contextmanager
def stages(arguments: argparse.Namespace) -> Iterator[Stages]:
    """Show which stage the work is in: a bar once it takes longer than a second, on a terminal, without --json.

    With --verbose every stage is a line on stderr, with the seconds since the beginning.
    """
    begun = monotonic()

    def tell(stage: str) -> None:
        """One line, with the time."""
        print(f"{monotonic() - begun:8.3f} s  {stage}", file=sys.stderr)

    if arguments.verbose and not arguments.quiet:
        yield tell
    elif arguments.quiet or getattr(arguments, "json", False) or not sys.stderr.isatty():
        yield lambda _stage: None
    else:
        bar = _LateBar()
        try:
            yield bar.report
        finally:
            bar.close()


class _LateBar:
    """A progress bar over the stages that appears when the work turns out to be long."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._stage, self._done, self._over = "", -1, False
        self._show: Callable[[], object] | None = None
        self._stop: Callable[[], object] | None = None
        self._timer = Timer(PATIENCE, self._open)
        self._timer.daemon = True
        self._timer.start()

    def report(self, stage: str) -> None:
        """A stage begins, or goes on: then its first word is the same."""
        with self._lock:
            goes_on = self._done >= 0 and stage.split(maxsplit=1)[0] == self._stage.split()[0]
            self._stage, self._done = stage, self._done + (not goes_on)
            if self._show:
                self._show()

    def close(self) -> None:
        """The work is done."""
        self._timer.cancel()
        with self._lock:
            self._over = True  # for a timer that had gone off already: its bar would take stdout and never give it back
            if self._stop:
                self._stop()

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn())
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        with self._lock:
            if self._over:
                return
            task = bar.add_task(self._stage, total=_STAGES, completed=max(self._done, 0))
            bar.start()
            self._stop = bar.stop
            self._show = lambda: bar.update(task, description=self._stage, completed=self._done)


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
        line = f"{self._what}: {done * 100 // total} %, {more()}, {format_duration(now - self._begun)} so far"
        print(visible(line), file=sys.stderr, flush=True)


# Files


def refuse_mixing(arguments: argparse.Namespace) -> None:
    """Only one thing can go to stdout, and a picture must be of a kind that is made.

    Raises:
        UsageError: two would go there, or it is not.
    """
    if arguments.picture:
        from printer_slicer.drawing import check_picture

        check_picture(arguments.picture)
    wants = {"-o": getattr(arguments, "output", None), "--picture": arguments.picture}
    there = [f"{flag} -" for flag, path in wants.items() if str(path) == "-"]
    there += ["--json"] if arguments.json else []
    if len(there) > 1:
        raise UsageError(f"{' and '.join(there)} both want stdout", remedy="write one of them to a file")
    output, picture = wants.values()
    if output and picture and str(output) != "-" and output.absolute() == picture.absolute():
        raise UsageError(f"-o and --picture both want {output}", remedy="name another picture")


def refuse_same(output: Path, model: Path, flag: str = "-o") -> None:
    """Never write over the model.

    Raises:
        UsageError: it would be.
    """
    # Names that cannot be are refused when they are written to.
    with contextlib.suppress(OSError, ValueError):
        if not output.samefile(model):
            return
        raise UsageError(f"{output}: is the model itself", remedy=f"name another output with {flag}")


def write_file(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what was there before untouched; `-` is stdout, and links stay links.

    Raises:
        OutputError: the folder is missing, the disk full, or writing not allowed.
    """
    if str(path) != "-":
        save(path, data)
        return
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


_GONE = {errno.EPIPE, errno.ECONNRESET} | ({errno.EINVAL} if sys.platform == "win32" else set())
_GONE_TERMINAL = {errno.EIO, errno.ENXIO}


class _Output(io.RawIOBase):
    """A raw stream that discards output once its reader is gone or the disk is full.

    Attributes:
        failure: why output that somebody may miss was not written.
    """

    failure: OSError | None = None

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._terminal = os.isatty(descriptor)
        self._gone = False

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether it is a terminal that is still open."""
        return self._terminal and not self._gone

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, data: Buffer, /) -> int | None:
        """Write data and return the number of bytes, all once no more can be written; None if it would block."""
        size = memoryview(data).nbytes
        if self._gone:
            return size
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return None
        except OSError as error:
            self._gone = True
            if error.errno not in _GONE | (_GONE_TERMINAL if self._terminal else set()):
                self.failure = error
            return size


def unwritten() -> OSError | None:
    """Why something that was to go to stdout is not there, as on a full disk; a reader who went away misses nothing."""
    buffer = getattr(sys.stdout, "buffer", None)
    raw = getattr(buffer, "raw", buffer)
    return raw.failure if isinstance(raw, _Output) else None


def outlive_readers() -> None:
    """Replace sys.stdout and sys.stderr by streams that survive a closed pipe or terminal.

    Streams that were replaced before stay; those that the caller closed (`>&-`) become /dev/null.
    """
    for name, errors in (("stdout", "replace"), ("stderr", "backslashreplace")):
        stream = getattr(sys, name)
        if stream is None:
            stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for the rest of the process
        elif stream is getattr(sys, f"__{name}__"):
            stream = _outliving(stream)
        # A terminal may not support all characters of our texts and file names.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
        setattr(sys, name, stream)


def _outliving(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """Wrap a stream so that it survives its reader; a Windows console stays as it is."""
    inner = getattr(stream, "buffer", None)
    if not isinstance(getattr(inner, "raw", inner), io.FileIO):
        return stream
    raw = _Output(stream.fileno())
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(raw) if isinstance(inner, io.BufferedWriter) else raw,  # type: ignore[arg-type]
        encoding=stream.encoding,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
