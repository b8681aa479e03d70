"""Measure the CPU time of each stage of slicing one part, also relative to fixed work of the same kinds.

    python benchmarks/stages.py [MODEL] [--quality NAME] [--printer NAME] [--rounds N]

The stages and their names are those of `printer_slicer.pipeline`, plus reading the file and writing the text. The last
column divides by the time of `calibration.py`, so it can be compared between machines and between days.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from time import process_time

from calibration import calibration_seconds
from processes import SAMPLES, machine_note

from printer_slicer import Profile, gcode_of, load_mesh, load_profile, slice_part


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per stage."""
    options = _options(argv)
    profile = load_profile(options.printer, None, options.quality)
    calibration_seconds()
    _measure_stages(options.model, profile)
    calibrations: list[float] = []
    rounds: list[dict[str, float]] = []
    for _ in range(options.rounds):
        calibrations.append(calibration_seconds())
        rounds.append(_measure_stages(options.model, profile))
    print(machine_note())
    print(f"{options.model.name}, {options.printer or 'default printer'}, quality {options.quality}")
    print(_table(rounds, median(calibrations)))
    return 0


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure the CPU time of each stage of slicing one part.")
    parser.add_argument(
        "model", nargs="?", type=Path, default=SAMPLES / "vase.stl", help="default: the sample vase"
    )
    parser.add_argument("--quality", default="standard", help="our quality profile (default standard)")
    parser.add_argument("--printer", help="our printer profile")
    parser.add_argument("--rounds", type=int, default=7, help="measured runs (default 7)")
    return parser.parse_args(argv)


def _measure_stages(model: Path, profile: Profile) -> dict[str, float]:
    """Return CPU seconds of each stage, all threads, of one run."""
    times: dict[str, float] = {}
    switch = _stopwatch(times)
    switch("loading")
    mesh = load_mesh(model)
    program = slice_part(mesh, profile, report=switch)
    switch("writing")
    gcode_of(program, profile)
    switch("")
    return times


def _stopwatch(times: dict[str, float]) -> Callable[[str], None]:
    """Return a function that is called when a stage starts, and adds the time since then to the previous stage."""
    current, since = "", process_time()

    def switch(stage: str) -> None:
        nonlocal current, since
        now = process_time()
        if current:
            times[current] = times.get(current, 0.0) + now - since
        current, since = stage, process_time()

    return switch


def _table(rounds: Sequence[dict[str, float]], unit: float) -> str:
    """Return one row per stage, and their sum."""
    total = median(sum(times.values()) for times in rounds)
    rows = [(stage, [times[stage] for times in rounds]) for stage in rounds[0]]
    rows.append(("all", [sum(times.values()) for times in rounds]))
    lines = [
        "| stage | CPU ms, median [min..max] | share | in units of calibration |",
        "|---|---:|---:|---:|",
    ]
    for stage, seconds in rows:
        low, middle, high = min(seconds) * 1000, median(seconds) * 1000, max(seconds) * 1000
        share, loops = middle / 1000 / total, middle / 1000 / unit
        lines.append(f"| {stage} | {middle:.1f} [{low:.1f}..{high:.1f}] | {share:.0%} | {loops:.2f} |")
    return "\n".join([*lines, f"calibration work: {unit * 1000:.1f} ms"])


if __name__ == "__main__":
    sys.exit(main())
