"""Print results, warnings and progress, survive closed pipes and terminals, and write files."""

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
    "colour",
    "hide_stdin_folder",
    "lost_output_error",
    "refuse_mixing",
    "refuse_same",
    "sanitize",
    "say",
    "stages",
    "survive_closed_streams",
    "warn",
    "write_file",
]

PATIENCE = 1.0  # s before a progress bar appears
_STAGES = 11  # from loading to writing
_SHARES: Final = 20  # lines of progress
_A_MINUTE: Final = 60.0  # s
_CODES: Final = {"error": "1;31", "warning": "1;33"}


# Text


def say(arguments: argparse.Namespace, text: str, *, is_message: bool = True) -> None:
    """Print a line, unless --quiet or --json is given; messages name options in place of arguments."""
    if not (arguments.quiet or arguments.json):
        print(sanitize(hide_stdin_folder(arguments, _with_flags(text) if is_message else text)))


def _with_flags(text: str) -> str:
    """Return a text with options in place of the arguments that it names."""
    if "`" not in text:
        return text
    from printer_slicer.cli.argument_flags import name_flags  # few messages name arguments

    return name_flags(text)


def hide_stdin_folder(arguments: argparse.Namespace, text: str) -> str:
    """Remove the temporary folder with the file from stdin from a text."""
    hidden = getattr(arguments, "hidden", "")
    return text.replace(hidden, "") if hidden else text


def sanitize(text: str) -> str:
    """Replace control characters in a text that may come from a file or a printer."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def colour(text: str, kind: str, stream: TextIO) -> str:
    """Return the text in the colour of an error or warning, if the stream is a terminal; `kind` is error or warning."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return text
    return f"\x1b[{_CODES[kind]}m{text}\x1b[0m"


def warn(arguments: argparse.Namespace, warnings: Sequence[str]) -> None:
    """Print warnings to stderr, unless --quiet is given."""
    for text in () if arguments.quiet else warnings:
        prefix = colour("printer-slicer: warning:", "warning", sys.stderr)
        print(f"{prefix} {sanitize(_with_flags(text))}", file=sys.stderr)


# Progress


Stages = Callable[[str], None]


@contextmanager
def stages(arguments: argparse.Namespace) -> Iterator[Stages]:
    """Show the current stage on a progress bar, if work takes longer than a second on a terminal without --json.

    With --verbose, print a line per stage to stderr, with the seconds since the start.
    """
    begun = monotonic()

    def tell(stage: str) -> None:
        """Print a line with the time."""
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
    """A progress bar over the stages that appears only if the work takes long."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._stage, self._done, self._over = "", -1, False
        self._show: Callable[[], object] | None = None
        self._stop: Callable[[], object] | None = None
        self._timer = Timer(PATIENCE, self._open)
        self._timer.daemon = True
        self._timer.start()

    def report(self, stage: str) -> None:
        """Show a stage; with the same first word as before it is the same stage."""
        with self._lock:
            goes_on = self._done >= 0 and stage.split(maxsplit=1)[0] == self._stage.split()[0]
            self._stage, self._done = stage, self._done + (not goes_on)
            if self._show:
                self._show()

    def close(self) -> None:
        """Remove the bar."""
        self._timer.cancel()
        with self._lock:
            self._over = True  # a timer that has already fired must not open the bar any more
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
        print(sanitize(line), file=sys.stderr, flush=True)


# Files


def refuse_mixing(arguments: argparse.Namespace) -> None:
    """Check that at most one output goes to stdout, and that the picture format is supported.

    Raises:
        UsageError: several outputs go to stdout or to one file, or the format is unknown.
    """
    if arguments.picture:
        from printer_slicer.drawing import check_picture

        check_picture(arguments.picture)
    wants = {"-o": getattr(arguments, "output", None), "--picture": arguments.picture}
    there = [f"{flag} -" for flag, path in wants.items() if str(path) == "-"]
    there += ["--json"] if arguments.json else []
    if len(there) > 1:
        raise UsageError(
            f"{' and '.join(there)} cannot both go to stdout", remedy="Write one of them to a file"
        )
    output, picture = wants.values()
    if output and picture and str(output) != "-" and output.absolute() == picture.absolute():
        raise UsageError(
            f"-o and --picture have the same name: {output}", remedy="Choose another name for the picture"
        )


def refuse_same(output: Path, model: Path, flag: str = "-o") -> None:
    """Refuse to overwrite an input file.

    Raises:
        UsageError: the output is the input.
    """
    # Impossible names are reported when the file is written.
    with contextlib.suppress(OSError, ValueError):
        if not output.samefile(model):
            return
        raise UsageError(f"{output}: is an input file", remedy=f"Choose another output with {flag}")


def write_file(path: Path, data: bytes) -> None:
    """Write a file completely or not at all; `-` is stdout, and symbolic links are kept.

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
    """A raw stream that discards output after its reader has gone or the disk is full.

    Attributes:
        failure: the error because of which output was lost; None if only the reader has gone.
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
        """Return whether it is a terminal that is still open."""
        return self._terminal and not self._gone

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, data: Buffer, /) -> int | None:
        """Write data and return the number of bytes, pretending success after a failure; None if it would block."""
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


def lost_output_error() -> OSError | None:
    """Return the error because of which output to stdout was lost, such as a full disk; None if none was."""
    buffer = getattr(sys.stdout, "buffer", None)
    raw = getattr(buffer, "raw", buffer)
    return raw.failure if isinstance(raw, _Output) else None


def survive_closed_streams() -> None:
    """Replace sys.stdout and sys.stderr by streams that survive a closed pipe or terminal.

    Streams that were replaced before are kept; closed ones (`>&-`) become /dev/null.
    """
    for name, errors in (("stdout", "replace"), ("stderr", "backslashreplace")):
        stream = getattr(sys, name)
        if stream is None:
            stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for the rest of the process
        elif stream is getattr(sys, f"__{name}__"):
            stream = _wrap_stream(stream)
        # A terminal may not support all characters of our texts and file names.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
        setattr(sys, name, stream)


def _wrap_stream(stream: io.TextIOWrapper) -> io.TextIOWrapper:
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
