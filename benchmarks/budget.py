"""The budget of slicing: fails if slicing a sample part costs more CPU, calls or memory than recorded.

    python -m benchmarks.budget [--all-rounds]

Calls of functions, imported modules and peak memory do not depend on the machine, so their rows notice small changes.
Other versions of Python and numpy, and slicing without the kernel, call other functions, so the limits are wide there.

Rows of CPU are divided by the CPU of a fixed unit of work measured in the same rounds: the work of `calibration.py` for
warm calls, and a process that imports numpy and shapely and does that work for whole processes. Each row is the minimum
of all rounds, because other programs on the machine only ever add time; rounds end early when all are within their
limits. These ratios differ by up to a fifth between machines, so these rows only notice large changes, for example in
compiled code. All of it takes about 20 s of CPU time.

A change that costs more changes `BUDGET` in the same commit and says why. One that costs less lowers it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from benchmarks.processes import SAMPLES, ours, run
from printer_slicer.kernel import load_kernel

BUDGET: Final[Mapping[str, float]] = {
    "slice box.stl, CPU of the process": 1.67,
    "dry-run box.gcode, CPU of the process": 1.45,
    "slice vase.stl, CPU when warm": 8.60,
    "slice case_study.stl, CPU when warm": 5.60,
    "slice box.stl, thousands of calls": 466.2,
    "slice box.stl, modules": 491,
    "slice vase.stl, thousands of calls": 204.21,
    "slice case_study.stl, thousands of calls": 222.28,
    "slice vase.stl, peak MiB of values": 28.00,
    "slice case_study.stl, peak MiB of values": 9.91,
}
"""CPU in units, thousands of calls, modules, and MiB."""

_TOLERANCE_OF_TIME: Final = 1.5
_RECORDED_WITH: Final = "Python 3.11, numpy 2.4, compiled kernel"
_TOLERANCE_OF_COUNTS: Final = 1.02
_TOLERANCE_OF_OTHER_COUNTS: Final = 1.5  # with other versions, or without the kernel
_ROUNDS: Final = 8
_COUNT_IN_PROCESS: Final = """
import sys
n_calls = 0
def count(_frame, event, _argument):
    global n_calls
    n_calls += event in {"call", "c_call"}
sys.setprofile(count)
from printer_slicer.cli import main
code = main(["slice", sys.argv[1], "-o", sys.argv[2], "--quiet"])
sys.setprofile(None)
print(n_calls, len(sys.modules))
sys.exit(code)
"""
_UNIT_PROCESS: Final = "import numpy, shapely; from benchmarks.calibration import *; calibration_seconds()"


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all rows; return 1 if one is over its budget."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.budget", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--rounds", type=int, default=_ROUNDS, help="maximum number of rounds (default: %(default)s)"
    )
    parser.add_argument(
        "--all-rounds", action="store_true", help="do not end early; use it to set new budgets"
    )
    options = parser.parse_args(argv)
    if load_kernel() is None:
        print("nothing measured: the budget applies to slicing with the compiled kernel, and there is none")
        return 0
    with TemporaryDirectory() as folder:
        rows = [*_process_rows(folder), *_warm_rows()]
        seconds = _measure(rows, options.rounds, early=not options.all_rounds)
        counts = _count_in_process(folder) | _count()
    measured = seconds | counts
    limits = {name: BUDGET[name] * _TOLERANCE_OF_TIME for name in seconds}
    is_recorded = _describe_setup() == _RECORDED_WITH
    tolerance = _TOLERANCE_OF_COUNTS if is_recorded else _TOLERANCE_OF_OTHER_COUNTS
    limits |= {name: BUDGET[name] * tolerance for name in counts}
    if not is_recorded:
        print(
            f"recorded with {_RECORDED_WITH}, measured with {_describe_setup()}: counts up to {tolerance:g} x pass"
        )
    print("| row | now | budget |\n|---|---:|---:|")
    for name, cost in measured.items():
        print(f"| {name} | {cost:.2f} | {BUDGET[name]:.2f} |")
    over = [name for name, cost in measured.items() if cost > limits[name]]
    for name in over:
        print(
            f"{name}: {measured[name] / BUDGET[name] - 1:.1%} over the budget; see {__file__}",
            file=sys.stderr,
        )
    return bool(over)


Row = tuple[str, Callable[[], float], Callable[[], float]]
"""Name, CPU seconds of the row, and CPU seconds of its unit."""


def _measure(rows: Sequence[Row], rounds: int, *, early: bool) -> dict[str, float]:
    """Return the least cost of each row over the rounds, in units."""
    cost, unit = ({name: float("inf") for name, *_ in rows} for _ in range(2))
    for _ in range(rounds):
        for name, measure, measure_unit in rows:
            unit[name], cost[name] = min(unit[name], measure_unit()), min(cost[name], measure())
        if early and all(cost[name] / unit[name] <= BUDGET[name] * _TOLERANCE_OF_TIME for name in cost):
            break
    return {name: cost[name] / unit[name] for name in cost}


def _process_rows(folder: str) -> list[Row]:
    """Return the rows of whole processes."""
    box, gcode = str(SAMPLES / "box.stl"), f"{folder}/box.gcode"
    run(ours("slice", box, "-o", gcode))

    def process_seconds() -> float:
        return run([sys.executable, "-c", _UNIT_PROCESS]).cpu

    return [
        (
            "slice box.stl, CPU of the process",
            lambda: run(ours("slice", box, "-o", gcode)).cpu,
            process_seconds,
        ),
        ("dry-run box.gcode, CPU of the process", lambda: run(ours("dry-run", gcode)).cpu, process_seconds),
    ]


_WARM: Final = ("vase.stl", "case_study.stl")


def _slice_sample(name: str) -> None:
    """Slice a sample part to G-code text in this process."""
    from printer_slicer import gcode_of, load_mesh, load_profile, slice_part

    profile = load_profile(None, None, "standard")
    gcode_of(slice_part(load_mesh(SAMPLES / name), profile), profile)


def _warm_rows() -> list[Row]:
    """Return the rows of CPU in this process, in which each part was sliced once before."""
    from time import process_time

    from benchmarks.calibration import calibration_seconds

    def slice_seconds(name: str) -> float:
        began = process_time()
        _slice_sample(name)
        return process_time() - began

    for name in _WARM:
        _slice_sample(name)
    return [
        (f"slice {name}, CPU when warm", partial(slice_seconds, name), calibration_seconds) for name in _WARM
    ]


def _describe_setup() -> str:
    """Describe what the counts depend on."""
    python, numpy = ".".join(map(str, sys.version_info[:2])), ".".join(np.__version__.split(".")[:2])
    return f"Python {python}, numpy {numpy}, {'compiled kernel' if load_kernel() else 'no kernel'}"


def _count() -> dict[str, float]:
    """Count the calls of functions, and measure the peak of memory that Python and numpy allocate."""
    found = {f"slice {name}, thousands of calls": _thousands_of_calls(name) for name in _WARM}
    return found | {f"slice {name}, peak MiB of values": _peak_mebibytes(name) for name in _WARM}


def _count_in_process(folder: str) -> dict[str, float]:
    """Count the calls of functions and the modules of a process that slices a box, with all imports."""
    arguments = [sys.executable, "-c", _COUNT_IN_PROCESS, str(SAMPLES / "box.stl"), f"{folder}/box.gcode"]
    said = subprocess.run(arguments, capture_output=True, text=True, check=True).stdout
    calls, modules = map(float, said.split())
    return {"slice box.stl, thousands of calls": calls / 1e3, "slice box.stl, modules": modules}


def _thousands_of_calls(name: str) -> float:
    """Count the calls of functions in Python and C while a sample part is sliced."""
    _slice_sample(name)  # imports and cached tables do not count
    n_calls = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal n_calls
        n_calls += event in {"call", "c_call"}

    sys.setprofile(count)
    try:
        _slice_sample(name)
    finally:
        sys.setprofile(None)
    return n_calls / 1e3


def _peak_mebibytes(name: str) -> float:
    """Measure the peak of memory that Python and numpy allocate while a sample part is sliced, MiB."""
    tracemalloc.start()
    try:
        _slice_sample(name)
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


if __name__ == "__main__":
    sys.exit(main())
