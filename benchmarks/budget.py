"""The CPU budget of slicing: fails if slicing a sample part costs over 10 % more than recorded.

    python -m benchmarks.budget [--rounds N]

Each row divides CPU time by that of a fixed unit of work measured in the same rounds: the work of `calibration.py` for
warm calls, and a process that imports numpy and shapely and does that work for whole processes. A row takes the least
of all rounds, because other programs on the
machine only ever add time; rounds end early when all rows are within the budget. A change that costs more changes
`BUDGET` in the same commit and says why. One that costs less lowers it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from tempfile import TemporaryDirectory
from typing import Final

from benchmarks.processes import SAMPLES, ours, run

BUDGET: Final[Mapping[str, float]] = {
    "slice box.stl, process": 1.70,
    "dry-run box.gcode, process": 1.40,
    "slice vase.stl, warm": 12.66,
    "slice case_study.stl, warm": 7.90,
}
"""CPU of each row, in units."""

_TOLERANCE: Final = 1.10
_ROUNDS: Final = 12
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
    with TemporaryDirectory() as folder:
        rows = [*_process_rows(folder), *_warm_rows()]
        measured = _measure(rows, options.rounds, early=not options.all_rounds)
    print("| row | CPU, in units | budget |\n|---|---:|---:|")
    for name, cost in measured.items():
        print(f"| {name} | {cost:.2f} | {BUDGET[name]:.2f} |")
    over = [name for name, cost in measured.items() if cost > BUDGET[name] * _TOLERANCE]
    for name in over:
        print(
            f"{name}: over the budget by {measured[name] / BUDGET[name] - 1:.0%}; see {__file__}",
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
        if early and all(cost[name] / unit[name] <= BUDGET[name] * _TOLERANCE for name in cost):
            break
    return {name: cost[name] / unit[name] for name in cost}


def _process_rows(folder: str) -> list[Row]:
    """Return the rows of whole processes."""
    box, gcode = str(SAMPLES / "box.stl"), f"{folder}/box.gcode"
    run(ours("slice", box, "-o", gcode))

    def process_seconds() -> float:
        return run([sys.executable, "-c", _UNIT_PROCESS]).cpu

    return [
        ("slice box.stl, process", lambda: run(ours("slice", box, "-o", gcode)).cpu, process_seconds),
        ("dry-run box.gcode, process", lambda: run(ours("dry-run", gcode)).cpu, process_seconds),
    ]


def _warm_rows() -> list[Row]:
    """Return the rows of calls in this process, each called once before."""
    from time import process_time

    from benchmarks.calibration import calibration_seconds
    from printer_slicer import gcode_of, load_mesh, load_profile, slice_part

    profile = load_profile(None, None, "standard")

    def slice_seconds(name: str) -> float:
        began = process_time()
        gcode_of(slice_part(load_mesh(SAMPLES / name), profile), profile)
        return process_time() - began

    rows: list[Row] = []
    for name in ("vase.stl", "case_study.stl"):
        slice_seconds(name)
        rows.append((f"slice {name}, warm", partial(slice_seconds, name), calibration_seconds))
    return rows


if __name__ == "__main__":
    sys.exit(main())
