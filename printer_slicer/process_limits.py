"""Limits of time, memory and priority for processes that do heavy work."""

from __future__ import annotations

import os
from contextlib import suppress

from printer_slicer.values import Struct

__all__ = ["ProcessLimits", "limit_process"]


class ProcessLimits(Struct, frozen=True):
    """Limits of a process.

    Attributes:
        max_seconds: time after which a task is stopped.
        max_bytes: address space; on Linux only.
        niceness: how much other processes go first; on POSIX only.
    """

    max_seconds: float = 3600.0
    max_bytes: int = 8 << 30
    niceness: int = 0


def limit_process(limits: ProcessLimits, *, limits_cpu: bool = False) -> None:
    """Limit this process and those that it starts.

    Args:
        limits: the limits.
        limits_cpu: also end the process after `max_seconds` of CPU time, because nobody watches its time.
    """
    if os.name != "posix":
        return
    import resource  # noqa: PLC0415 - only on POSIX

    with suppress(OSError, ValueError):
        os.nice(limits.niceness)
        if limits_cpu:
            resource.setrlimit(resource.RLIMIT_CPU, (int(limits.max_seconds),) * 2)
        resource.setrlimit(resource.RLIMIT_AS, (limits.max_bytes,) * 2)
