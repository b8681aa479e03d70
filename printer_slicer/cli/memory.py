"""How this process handles the memory of large arrays."""

from __future__ import annotations

import contextlib
import sys

__all__ = ["keep_memory"]

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # parameters of mallopt(3)
_LARGEST, _LARGEST_BEFORE = 1 << 30, 32 << 20  # bytes; glibc before 2.35 accepts no more than the second
_MOST_KEPT = 1 << 30  # bytes


def keep_memory() -> None:
    """Keep freed memory for the next array instead of handing it back to the system at once.

    Slicing makes and drops arrays of megabytes all the time. The C library asks the system for each anew, and the
    system clears every page first: a sixth of the CPU time of a large part. Only the command line does this, because
    the setting holds for the whole process; where the C library is not glibc nothing changes.
    """
    if not sys.platform.startswith("linux"):
        return
    import ctypes

    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        if not mallopt(_MMAP_THRESHOLD, _LARGEST):
            mallopt(_MMAP_THRESHOLD, _LARGEST_BEFORE)
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)
