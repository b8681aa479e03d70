"""Stdout and stderr that outlive their reader: what a command finds out must not depend on who still listens.

`dry-run part.gcode | head -1` closes the pipe while the command works, and a terminal may be closed while it prints.
What is written from then on is dropped, so the command goes on to its end, and its exit code is its own. A full disk
does not end a print either, but what could not be written is missed: `unwritten` tells, and it is an error at the end.
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
    """A file descriptor that is written to for as long as it takes what is written.

    Attributes:
        failure: why something that somebody may miss was not written.
    """

    failure: OSError | None = None

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._terminal = os.isatty(descriptor)
        self._gone = False

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether a person reads it."""
        return self._terminal and not self._gone

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, data: Buffer, /) -> int | None:
        """How many bytes were taken; all of them once no more can be written. None: just now, none can be."""
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
    """Put streams that outlive their reader in the place of the process's own stdout and stderr.

    Streams that somebody else has put there stay; those that were closed by the caller (`>&-`) become /dev/null.
    """
    for name, errors in (("stdout", "replace"), ("stderr", "backslashreplace")):
        stream = getattr(sys, name)
        if stream is None:
            stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for the rest of the process
        elif stream is getattr(sys, f"__{name}__"):
            stream = _outliving(stream)
        # A terminal may know fewer letters than our texts and file names have.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
        setattr(sys, name, stream)


def _outliving(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The same stream, over a descriptor that somebody need not read; a Windows console stays as it is."""
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
