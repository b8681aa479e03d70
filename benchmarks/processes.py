"""Run whole processes and measure their costs as the operating system reports them; shared by the benchmarks.

The benchmarks import no large packages. On Linux, the peak memory of a child starts with that of its parent, so a
parent with numpy would increase the figure of a small child.
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
"""Folder for files of the benchmarks; not under version control."""

_PER_MIB = 2**20 if sys.platform == "darwin" else 2**10  # ru_maxrss is in bytes there and in KiB elsewhere


class RunError(Exception):
    """A process ended with an exit code other than 0; the message contains the end of its output."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Costs of one process.

    Attributes:
        cpu: s, user and system, all threads.
        wall: s from start to end.
        peak: MiB, largest resident memory.
    """

    cpu: float
    wall: float
    peak: float


def run(command: Sequence[str], *, folder: Path | None = None) -> Cost:
    """Run a command and return its costs.

    Args:
        command: program and arguments.
        folder: working directory; None is the current one.

    Raises:
        RunError: the program does not exist, or its exit code is not 0.
    """
    with tempfile.TemporaryFile() as said:
        begun = perf_counter()
        try:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd=folder, env=_environment()
            )
        except OSError as error:
            raise RunError(f"{command[0]}: {error.strerror}") from error
        _, status, usage = os.wait4(process.pid, 0)
        wall = perf_counter() - begun
        # Popen must know the exit code, or it warns that nobody waited for the process.
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            tail = said.read()[-500:].decode("utf-8", "replace").strip()
            raise RunError(f"{Path(command[0]).name} ended with code {process.returncode}: {tail}")
    return Cost(usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / _PER_MIB)


def _environment() -> dict[str, str]:
    """Return the environment without the variable that keeps Python from storing compiled modules.

    Installed packages are already compiled. With this variable, every measured process would compile a checkout again.
    """
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def ours(*arguments: str) -> list[str]:
    """Return the command line of printer-slicer in this interpreter."""
    return [sys.executable, "-m", "printer_slicer", *arguments]


def spread(values: Sequence[float], form: str = ".3f") -> str:
    """Return `median [min..max]`."""
    return f"{median(values):{form}} [{min(values):{form}}..{max(values):{form}}]"


def machine_note() -> str:
    """Return date, processors, load and versions, without the name of the machine."""
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
