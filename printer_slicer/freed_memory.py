"""Keep freed memory for the next array, or return it to the system: settings of the C library glibc."""

from __future__ import annotations

import contextlib
import sys
from functools import cache
from typing import Any

from printer_slicer.progress import Report

__all__ = [
    "keep_freed_memory",
    "load_c_library",
    "release_freed_memory",
    "release_memory_between_stages",
]

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # parameters of mallopt(3)
_MAX_THRESHOLD, _OLD_MAX_THRESHOLD = (
    1 << 30,
    32 << 20,
)  # bytes; the maxima of glibc since 2.35 and before
_MAX_KEPT = 1 << 30  # bytes
_MAX_FREED = 24 << 20  # bytes of freed memory that are kept between two stages


def keep_freed_memory(largest: int = _MAX_THRESHOLD) -> None:
    """Make the C library keep freed memory for the next array instead of returning it to the system at once.

    Slicing allocates and frees arrays of megabytes all the time. By default the C library requests each of them from
    the system, which clears every page first; this takes a sixth of the CPU time of a large part. Only the command line
    and the processes of a batch change the setting, because it applies to the whole process. Only glibc has it.

    Args:
        largest: size of the largest array whose memory is kept, bytes.
    """
    if not sys.platform.startswith("linux"):
        return
    import ctypes  # noqa: PLC0415 - slow, and only on Linux

    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        if not mallopt(_MMAP_THRESHOLD, largest):
            mallopt(_MMAP_THRESHOLD, _OLD_MAX_THRESHOLD)
        mallopt(_TRIM_THRESHOLD, _MAX_KEPT)


def release_freed_memory() -> None:
    """Return freed memory to the system if it is much, as between two stages of slicing a large part.

    `keep_freed_memory` keeps it, in holes that the arrays of the next stage may not fit. Only glibc has the functions.
    """
    if not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(OSError, AttributeError):
        library = load_c_library()
        if library.mallinfo2().freed > _MAX_FREED:
            library.malloc_trim(0)


@cache
def load_c_library() -> Any:
    """Return the C library, in which `mallinfo2` has the type of its result.

    Raises:
        OSError, AttributeError: there is no library, or it has no such function.
    """
    import ctypes  # noqa: PLC0415 - slow, and only on Linux

    class MemoryUse(ctypes.Structure):
        """The result of mallinfo2(3), whose ninth number is the size of the freed blocks, in bytes."""

        _fields_ = (("before", ctypes.c_size_t * 8), ("freed", ctypes.c_size_t), ("top", ctypes.c_size_t))

    library = ctypes.CDLL(None)
    library.mallinfo2.restype = MemoryUse
    return library


def release_memory_between_stages(report: Report) -> Report:
    """Return a progress report that also returns freed memory to the system when a stage starts."""

    def release_and_report(stage: str) -> None:
        """Start a stage."""
        release_freed_memory()
        report(stage)

    return release_and_report
