"""Measure the speed and memory of slicing for benchmarks/README.md: all tables as Markdown.

    python -m benchmarks.speed_table --models DIR [--rounds N] [--parts NAME ...]

The first tables are those of `compare.py` for parts of all sizes. The last one has our own program only, each
time beside a process to which it is compared in the same round.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from benchmarks import compare
from benchmarks.processes import SAMPLES, WORK, ours, run, spread

PARTS: Final = (
    *compare.MODELS,
    *("angle_bracket", "belt_pulley", "threaded_adapter", "electronics_box", "knurled_knob"),
    *("plate", "torus_5m", "box"),
)

_BARE: Final = "import numpy, shapely"
_IN_PROCESS: Final = """
import sys
from time import process_time
from printer_slicer import gcode_of, load_mesh, load_profile, slice_part
from printer_slicer.healing import repair
from printer_slicer.pipeline import plan_part
from printer_slicer.placing import place
task, path = sys.argv[1:]
def run():
    if task == "plan":
        profile = load_profile()
        plan_part(place(repair(mesh)[0], profile.printer), profile)
    else:
        profile = load_profile(None, None, "standard")
        gcode_of(slice_part(load_mesh(path), profile), profile)
mesh = load_mesh(path)
if task == "slice":
    run()
began = process_time()
run()
print(process_time() - began)
"""
"""Code that prints the CPU seconds of planning a part, or of slicing it for the second time."""


class Comparison(NamedTuple):
    """A command beside one to which it is compared.

    Attributes:
        name: what is measured.
        measure: returns its CPU time, s.
        other_name: to what it is compared.
        other: the command of that.
    """

    name: str
    measure: Callable[[], float]
    other_name: str
    other: list[str]


def main(argv: Sequence[str] | None = None) -> int:
    """Print all tables; return 1 if a part could not be measured."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.speed_table", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)"
    )
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default: 5)")
    parser.add_argument("--parts", nargs="+", default=list(PARTS), help="parts to compare (default: all)")
    options = parser.parse_args(argv)
    models = options.models or Path(os.environ.get("PRINTER_SLICER_MODELS") or ".")
    folder = ["--models", str(options.models)] if options.models else []
    code = compare.main([*options.parts, "--rounds", str(options.rounds), *folder])
    print(f"\n{_table(list(_comparisons(models)), options.rounds)}")
    return code


def _comparisons(models: Path) -> Iterator[Comparison]:
    """Yield our own measurements; those of benchy only if the folder of models has it."""
    output = str(WORK / "speed_table.gcode")
    box = ours("slice", str(SAMPLES / "box.stl"), "-o", output)
    bare = [sys.executable, "-c", _BARE]
    yield Comparison("slice box.stl", lambda: run(box).cpu, _BARE, bare)
    for path in sorted(models.glob("benchy.*"))[:1]:
        yield Comparison("plan the layers of benchy", partial(_run_in_process, "plan", path), _BARE, bare)
        sliced = ours("slice", str(path), "-o", output, "--quality", "standard")
        again = partial(_run_in_process, "slice", path)
        yield Comparison("slice benchy again in the same process", again, "slice benchy", sliced)


def _run_in_process(task: str, path: Path) -> float:
    """Return the CPU time of one task, s, without that of the process around it."""
    command = [sys.executable, "-c", _IN_PROCESS, task, str(path)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def _table(comparisons: Sequence[Comparison], rounds: int) -> str:
    """Measure all comparisons in turn after a warm-up, and return one row for each."""
    lines = ["| ours | compared with | CPU s | CPU ratio |", "|---|---|---:|---:|"]
    for one in comparisons:
        one.measure()
        run(one.other)
        costs = [(one.measure(), run(one.other).cpu) for _ in range(rounds)]
        ratios = spread([cost / other for cost, other in costs], ".2f")
        seconds = " / ".join(f"{median(column):.2f}" for column in zip(*costs, strict=True))
        lines.append(f"| {one.name} | {one.other_name} | {seconds} | {ratios} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
