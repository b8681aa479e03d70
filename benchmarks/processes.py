"""One whole process, and what the operating system says it cost; shared by the benchmarks.

The benchmarks themselves import nothing heavy: on Linux the peak memory of a child begins with that of the process that
started it, so a parent with numpy loaded would raise the figure of a small child.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from statistics import median
from time import perf_counter

__all__ = ["HERE", "SAMPLES", "WORK", "Cost", "RunError", "machine_note", "ours", "run", "spread"]

HERE = Path(__file__).resolve().parent
SAMPLES = HERE.parent / "sample_parts"
WORK = HERE / "made"
"""Folder for files that the benchmarks make; not under version control."""

_PER_MIB = 2**20 if sys.platform == "darwin" else 2**10  # ru_maxrss is in bytes there and in KiB elsewhere


class RunError(Exception):
    """A process ended with an exit code other than 0; the message has the end of what it said."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What one process cost.

    Attributes:
        cpu: s, user and system, all threads.
        wall: s from start to end.
        peak: MiB, most memory resident at once.
    """

    cpu: float
    wall: float
    peak: float


def run(command: Sequence[str], *, folder: Path | None = None) -> Cost:
    """The cost of one command, waited for.

    Args:
        command: program and arguments.
        folder: where it runs; None is the current one.

    Raises:
        RunError: it does not exist or its exit code is not 0.
    """
    with tempfile.TemporaryFile() as said:
        begun = perf_counter()
        try:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd=folder, env=_surroundings()
            )
        except OSError as error:
            raise RunError(f"{command[0]}: {error.strerror}") from error
        _, status, usage = os.wait4(process.pid, 0)
        wall = perf_counter() - begun
        # Popen must know that the process is gone, or it warns that nobody waited for it.
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            tail = said.read()[-500:].decode("utf-8", "replace").strip()
            raise RunError(f"{Path(command[0]).name} ended with code {process.returncode}: {tail}")
    return Cost(usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / _PER_MIB)


def _surroundings() -> dict[str, str]:
    """The variables of this process, but for the one that keeps Python from storing compiled modules.

    What is installed has them compiled; with it, a checkout is compiled anew by every process that is measured.
    """
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def ours(*arguments: str) -> list[str]:
    """The command line of printer-slicer in this interpreter."""
    return [sys.executable, "-m", "printer_slicer", *arguments]


def spread(values: Sequence[float], form: str = ".3f") -> str:
    """`median [min..max]`."""
    return f"{median(values):{form}} [{min(values):{form}}..{max(values):{form}}]"


def machine_note() -> str:
    """Date, processors, load and versions, for the top of every result; nothing that names the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    names = ("printer-slicer", "numpy", "shapely", "clipper2-py", "msgspec")
    versions = ", ".join(f"{name} {_version(name)}" for name in names)
    return (
        f"{datetime.now(tz=UTC):%Y-%m-%d}, {sys.platform}, {cores} processors{load},"
        f" Python {python_version()}, {versions}"
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "(not installed)"
