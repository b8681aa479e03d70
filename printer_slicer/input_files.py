"""The files that a user names: what their names tell, and how to read them.

Files are opened with a size limit, and with a timeout for named pipes that no program writes to.
"""

from __future__ import annotations

import errno
import os
import stat
import threading
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path, PurePath
from typing import Final

__all__ = [
    "GCODE_SUFFIXES",
    "MODEL_SUFFIXES",
    "WRITER_SECONDS",
    "check_is_file",
    "is_gcode",
    "open_input",
    "read_input",
    "read_pieces",
]

MODEL_SUFFIXES: Final = (".stl", ".3mf", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp")
"""Endings of the names of models, in lower case."""

GCODE_SUFFIXES: Final = (".gcode", ".gco", ".gc", ".g", ".nc", ".ngc")
"""Endings of the names of plain G-code, in lower case."""

_PIECE: Final = 1 << 20  # bytes
WRITER_SECONDS: Final = 10.0
"""Time, s, to wait for a program to open a named pipe for writing."""


def is_gcode(path: PurePath) -> bool:
    """Return whether the name of a file has the ending of plain G-code."""
    return path.suffix.lower() in GCODE_SUFFIXES


def open_input(path: Path, writer_seconds: float = WRITER_SECONDS) -> BufferedReader:
    """Open a file for reading in binary mode.

    The timeout ends when a program opens the pipe for writing; later pauses of that program do not count.

    Args:
        path: a file, a device or a pipe.
        writer_seconds: timeout for a named pipe without a writer.

    Raises:
        OSError: the file cannot be opened; TimeoutError for a pipe without a writer.
        ValueError: the name contains a zero byte.
    """
    is_named_pipe = stat.S_ISFIFO(path.stat().st_mode) and path.resolve().exists()  # false for /dev/stdin
    if not is_named_pipe:
        return path.open("rb")
    opened: list[BufferedReader] = []
    opening = threading.Thread(target=lambda: opened.append(path.open("rb")), daemon=True)
    opening.start()
    opening.join(writer_seconds)
    if opening.is_alive():
        os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))  # a writer ends the wait of the thread
        opening.join()
        opened[0].close()
        raise TimeoutError(errno.ETIMEDOUT, "no program writes to this named pipe", str(path))
    return opened[0]


def read_input(path: Path, max_bytes: int, writer_seconds: float = WRITER_SECONDS) -> bytes:
    """Read a whole file, up to a size limit.

    Args:
        path: a file, a device or a pipe.
        max_bytes: size limit, bytes.
        writer_seconds: as for `open_input`.

    Raises:
        OSError: the file cannot be read, or is larger than the limit (EFBIG).
        ValueError: the name contains a zero byte.
    """
    with open_input(path, writer_seconds) as file:
        is_long = os.fstat(file.fileno()).st_size > max_bytes
        data = b"" if is_long else file.read(max_bytes + 1)
    if is_long or len(data) > max_bytes:
        raise OSError(errno.EFBIG, f"longer than {max_bytes} bytes", str(path))
    return data


def read_pieces(path: Path) -> Iterator[bytes]:
    """Yield a file in pieces of 1 MiB.

    Raises:
        OSError: it cannot be opened or read, see `open_input`.
    """
    with open_input(path) as file:
        while piece := file.read(_PIECE):
            yield piece


def check_is_file(path: Path) -> None:
    """Check that a path is a regular file and not, for example, a pipe that would block when it is opened.

    Raises:
        OSError: the file is missing, or is a pipe, a folder or a device.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "not a regular file but a pipe, a folder or a device", str(path))
