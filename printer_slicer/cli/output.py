"""Print results, warnings and progress, tolerate closed pipes and terminals, and write files."""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock, Timer
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, TextIO

from printer_slicer.errors import UsageError
from printer_slicer.saving import save
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = [
    "BAR_DELAY",
    "Milestones",
    "StageReport",
    "append_to_stem",
    "check_outputs",
    "choose_output_beside",
    "colourize",
    "describe_picture",
    "get_lost_output_error",
    "hide_stdin_folder",
    "print_result",
    "print_text",
    "reject_overwriting_input",
    "sanitize",
    "show_stages",
    "survive_closed_streams",
    "warn",
    "write_file",
]

BAR_DELAY = 1.0  # s before a progress bar appears
_STAGE_COUNT = 11  # stages from loading to writing
_MILESTONE_COUNT: Final = 20  # lines of progress, one per 5 %
_LINE_INTERVAL: Final = 60.0  # s, longest time without a line of progress
_COLOUR_CODES: Final = {"error": "1;31", "warning": "1;33"}


# Text


def print_text(arguments: argparse.Namespace, text: str, *, is_message: bool = True) -> None:
    """Print a text, unless --quiet or --json is given; in messages, options replace arguments of Python functions."""
    if not (arguments.quiet or arguments.json):
        print(sanitize(hide_stdin_folder(arguments, _name_options(text) if is_message else text)))


def print_result(arguments: argparse.Namespace, facts: Mapping[str, Any], text: str) -> int:
    """Print the result of an action, as JSON or as text; return the exit code 0."""
    if arguments.json:
        print(json.dumps(facts))
    else:
        print_text(arguments, text, is_message=False)
    return 0


def choose_output_beside(gcode: Path, suffix: str, what: str, option: str) -> Path:
    """Return the default name of an output: that of the G-code file with another suffix.

    Args:
        gcode: the G-code.
        suffix: of the output, such as `.svg`.
        what: the output, for the message, such as `picture`.
        option: the option that names the output, for the message.

    Raises:
        UsageError: the G-code is read from a pipe or a device.
    """
    if gcode.exists() and not gcode.is_file():
        raise UsageError(
            f"{gcode}: is not a regular file, so the {what} needs a name",
            remedy=f"Name the {what} with {option}",
        )
    return gcode.with_suffix(suffix)


def _name_options(text: str) -> str:
    """Replace the arguments of Python functions that a text names in backticks by options."""
    if "`" not in text:
        return text
    from printer_slicer.cli.argument_flags import replace_arguments_by_options  # few messages name arguments

    return replace_arguments_by_options(text)


def hide_stdin_folder(arguments: argparse.Namespace, text: str) -> str:
    """Remove the name of the temporary folder for stdin from a text."""
    hidden = getattr(arguments, "hidden", "")
    return text.replace(hidden, "") if hidden else text


def sanitize(text: str) -> str:
    """Replace control characters in a text that may come from a file or a printer."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def colourize(text: str, kind: str, stream: TextIO) -> str:
    """Add the colour of an error or a warning (`kind`) to a text, if the stream is a terminal that may use colours."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return text
    return f"\x1b[{_COLOUR_CODES[kind]}m{text}\x1b[0m"


def warn(arguments: argparse.Namespace, warnings: Sequence[str]) -> None:
    """Print warnings to stderr, unless --quiet is given."""
    for text in () if arguments.quiet else warnings:
        prefix = colourize("printer-slicer: warning:", "warning", sys.stderr)
        print(f"{prefix} {sanitize(_name_options(text))}", file=sys.stderr)


# Progress


StageReport = Callable[[str], None]
"""Function that is called with the name of each stage when it starts."""


@contextmanager
def show_stages(arguments: argparse.Namespace) -> Iterator[StageReport]:
    """Show the current stage on a progress bar, if the work takes longer than a second.

    The bar appears only on a terminal, and not with --json or --quiet. With --verbose, a line per stage is printed to
    stderr instead, with the seconds since the start.
    """
    begun = monotonic()

    def print_stage(stage: str) -> None:
        """Print the name of a stage with the time since the start."""
        print(f"{monotonic() - begun:8.3f} s  {stage}", file=sys.stderr)

    if arguments.verbose and not arguments.quiet:
        yield print_stage
    elif arguments.quiet or getattr(arguments, "json", False) or not sys.stderr.isatty():
        yield lambda _stage: None
    else:
        bar = _DelayedBar()
        try:
            yield bar.report
        finally:
            bar.close()


class _DelayedBar:
    """A progress bar of the stages, which appears only if the work takes longer than a second."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._stage, self._done, self._is_closed = "", -1, False
        self._show: Callable[[], object] | None = None
        self._stop: Callable[[], object] | None = None
        self._timer = Timer(BAR_DELAY, self._open)
        self._timer.daemon = True
        self._timer.start()

    def report(self, stage: str) -> None:
        """Show a stage; if its name begins with the same word as the previous name, the stage continues."""
        with self._lock:
            is_same_stage = self._done >= 0 and stage.split(maxsplit=1)[0] == self._stage.split()[0]
            self._stage, self._done = stage, self._done + (not is_same_stage)
            if self._show:
                self._show()

    def close(self) -> None:
        """Remove the bar."""
        self._timer.cancel()
        with self._lock:
            self._is_closed = True  # a timer that has already fired must not open the bar any more
            if self._stop:
                self._stop()

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn())
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        with self._lock:
            if self._is_closed:
                return
            task = bar.add_task(self._stage, total=_STAGE_COUNT, completed=max(self._done, 0))
            bar.start()
            self._stop = bar.stop
            self._show = lambda: bar.update(task, description=self._stage, completed=self._done)


class Milestones:
    """Writes lines of progress to stderr: one per 5 % of the work, and at least one a minute.

    Args:
        what: the activity, at the start of each line.
        wanted: whether to write lines at all.
        every_share: whether to write a line per 5 %; if not, only one a minute.
        clock: function that returns the time, s.
    """

    def __init__(
        self, what: str, *, wanted: bool, every_share: bool = True, clock: Callable[[], float] = monotonic
    ) -> None:
        self._what, self._wanted, self._every_share, self._clock = what, wanted, every_share, clock
        self._begun = self._last = clock()
        self._shares = 0

    def report_if_due(self, done: int, total: int, more: Callable[[], str]) -> None:
        """Write a line of progress if one is due.

        Args:
            done: number of finished steps.
            total: number of steps, at least 1.
            more: function that returns further text for the line; called only if a line is due.
        """
        if not self._wanted:
            return
        shares, now = done * _MILESTONE_COUNT // total, self._clock()
        if not (self._every_share and shares > self._shares) and now - self._last < _LINE_INTERVAL:
            return
        self._shares, self._last = shares, now
        line = f"{self._what}: {done * 100 // total} %, {more()}, {format_duration(now - self._begun)} so far"
        print(sanitize(line), file=sys.stderr, flush=True)


# Files


def check_outputs(arguments: argparse.Namespace) -> None:
    """Check that at most one output goes to stdout, and that the picture format is supported.

    Raises:
        UsageError: several outputs go to stdout or to one file, or the picture format is unknown.
    """
    if arguments.picture:
        from printer_slicer.drawing import check_picture_path

        check_picture_path(arguments.picture)
    outputs = {"-o": getattr(arguments, "output", None), "--picture": arguments.picture}
    on_stdout = [f"{flag} -" for flag, path in outputs.items() if str(path) == "-"]
    on_stdout += ["--json"] if arguments.json else []
    if len(on_stdout) > 1:
        raise UsageError(
            f"{' and '.join(on_stdout)} cannot both go to stdout", remedy="Write one of them to a file"
        )
    output, picture = outputs.values()
    if output and picture and str(output) != "-" and output.absolute() == picture.absolute():
        raise UsageError(
            f"-o and --picture have the same name: {output}", remedy="Choose another name for the picture"
        )


def reject_overwriting_input(output: Path, model: Path, flag: str = "-o") -> None:
    """Reject an output file that is also an input file.

    Raises:
        UsageError: the output would overwrite the input.
    """
    # Invalid names are reported when the file is written.
    with contextlib.suppress(OSError, ValueError):
        if not output.samefile(model):
            return
        raise UsageError(
            f"{output}: is an input file and cannot be the output, too",
            remedy=f"Choose another output file with {flag}",
        )


def write_file(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a file completely or not at all; `-` is stdout, and symbolic links are kept.

    Args:
        path: the file.
        data: its content, or pieces of it. Stdout gets each piece as soon as it is made.

    Raises:
        OutputError: the folder is missing, the disk is full, or permission is denied.
    """
    if str(path) != "-":
        save(path, data)
        return
    for piece in [data] if isinstance(data, bytes) else data:
        sys.stdout.buffer.write(piece)
        sys.stdout.buffer.flush()


def append_to_stem(path: Path, suffix: str) -> Path:
    """Return a path with text between its name and its extension, such as the number of a plate."""
    return path.with_name(f"{path.stem}{suffix}{path.suffix}") if suffix else path


def describe_picture(path: Path | None, shows: str) -> list[str]:
    """Return a line that names the file of a picture and what it shows; no line without a file."""
    return [] if path is None or str(path) == "-" else [f"{'picture':<12}{path}: {shows}"]


_CLOSED_ERRORS = {errno.EPIPE, errno.ECONNRESET} | ({errno.EINVAL} if sys.platform == "win32" else set())
_CLOSED_TERMINAL_ERRORS = {errno.EIO, errno.ENXIO}


class _ResilientStream(io.RawIOBase):
    """A raw output stream that discards data after its reader has closed the pipe, or after the disk is full.

    Attributes:
        failure: the error that caused a loss of data; None if there was none, or if only the reader closed the pipe.
    """

    failure: OSError | None = None

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._is_terminal = os.isatty(descriptor)
        self._is_broken = False

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Return whether the stream is a terminal that is still open."""
        return self._is_terminal and not self._is_broken

    def writable(self) -> bool:
        """Return True, because data can be written to the stream."""
        return True

    def write(self, data: Buffer, /) -> int | None:
        """Write data; return the number of bytes, also of discarded ones, or None if writing would block."""
        size = memoryview(data).nbytes
        if self._is_broken:
            return size
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return None
        except OSError as error:
            self._is_broken = True
            if error.errno not in _CLOSED_ERRORS | (_CLOSED_TERMINAL_ERRORS if self._is_terminal else set()):
                self.failure = error
            return size


def get_lost_output_error() -> OSError | None:
    """Return the error that caused a loss of output to stdout, such as a full disk; None if nothing was lost."""
    buffer = getattr(sys.stdout, "buffer", None)
    raw = getattr(buffer, "raw", buffer)
    return raw.failure if isinstance(raw, _ResilientStream) else None


def survive_closed_streams() -> None:
    """Replace sys.stdout and sys.stderr by streams that tolerate a closed pipe or terminal.

    Streams that were replaced before are kept; a closed stream (`>&-`) is replaced by the null device.
    """
    for name, errors in (("stdout", "replace"), ("stderr", "backslashreplace")):
        stream = getattr(sys, name)
        if stream is None:
            stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for the rest of the process
        elif stream is getattr(sys, f"__{name}__"):
            stream = _wrap_stream(stream)
        # A terminal may not support all characters of messages and file names.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
        setattr(sys, name, stream)


def _wrap_stream(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """Wrap a stream so that it tolerates a reader that closes the pipe; a Windows console is not wrapped."""
    inner = getattr(stream, "buffer", None)
    if not isinstance(getattr(inner, "raw", inner), io.FileIO):
        return stream
    raw = _ResilientStream(stream.fileno())
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(raw) if isinstance(inner, io.BufferedWriter) else raw,  # type: ignore[arg-type]
        encoding=stream.encoding,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
