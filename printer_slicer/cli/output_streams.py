"""Make stdout and stderr survive a closed pipe or terminal, so that exit codes do not depend on the reader.

`dry-run part.gcode | head -1` closes the pipe while the command runs, and a terminal may be closed during a print.
Later output is discarded, the command runs to its end, and its exit code is unchanged. A full disk does not end a print
either, but `unwritten` reports it, and it is an error at the end.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["outlive_readers", "unwritten"]

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
