"""Measure dry runs of long jobs: CPU time, memory, and the difference between simulated and estimated time.

    python -m benchmarks.dry_run [--lines 100000 500000 1000000] [FILE.gcode ...]

Without files, it makes its own jobs: a vase with a wavy wall is sliced here, and its layers are stacked repeatedly
until there are enough lines. Every job runs as the complete command in a separate process. On Linux it runs once more
in a process that measures memory: the peak while the file is read, the memory of the job, and the increase during the
dry run.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from printer_slicer.model import Mesh
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_of

__all__ = ["main", "wavy_vase"]

LINES = (100_000, 500_000, 1_000_000)
SETTINGS = {
    "planner.kind": "uniform",
    "layer_height": 0.2,
    "first_layer_height": 0.2,
    "infill_density": 0.15,
    "printer.bed_z": 2000,
    "material.min_layer_time": 0,
}
_MEMORY = """
import gc, json, re, sys
from pathlib import Path
from printer_slicer.slice_jobs import job_from
from printer_slicer.profile import load_profile
from printer_slicer.inspection.dry_run.runner import dry_run

def memory(name):
    status = Path("/proc/self/status").read_text()
    return int(re.search(name + r":\\s+(\\d+)", status)[1]) / 1024

profile = load_profile(changes=json.loads(sys.argv[2]))
job = job_from(Path(sys.argv[1]), profile)
peak = memory("VmHWM")
gc.collect()
Path("/proc/self/clear_refs").write_text("5")  # reset the peak
held = memory("VmRSS")
dry_run(job, profile)
print(peak, held, memory("VmHWM"))
"""


def wavy_vase(radius: float = 50.0, height: float = 4.0, waves: int = 12, sides: int = 500) -> Mesh:
    """Return a solid vase with a wavy wall; its outline has as many corners as curves of real parts."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    reach = radius + 3.0 * np.sin(waves * turn)
    ring = np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])
    low, high = (np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height))
    after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    bottom, top = np.zeros((sides, 3)), np.tile([0.0, 0.0, height], (sides, 1))
    facets = [
        np.stack([low, after_low, after_high], axis=1),
        np.stack([low, after_high, high], axis=1),
        np.stack([after_low, low, bottom], axis=1),
        np.stack([high, after_high, top], axis=1),
    ]
    return Mesh(np.concatenate(facets), "wavy vase")


def long_job(lines: int) -> bytes:
    """Return G-code with at least this many lines: the middle layers of the vase, stacked repeatedly."""
    text = job_of(wavy_vase(), load_profile(changes=SETTINGS)).text.decode()
    head, *layers = re.split(r"(?m)^(?=;LAYER_CHANGE$)", text)
    middle = layers[8:12]
    height = 0.2 * len(middle)
    parts, count, turn = [head, *layers[:8]], 0, 0
    while count < lines:
        for layer in middle:
            parts.append(_raise_layer(layer, turn * height))
            count += len(re.findall(r"(?m)^[GM]", layer))
        turn += 1
    return "".join([*parts, "M104 S0\nM140 S0\nM107\nM84\n"]).encode()


def _raise_layer(layer: str, by: float) -> str:
    """Return the same layer at a greater height."""

    def raise_z(found: re.Match[str]) -> str:
        return f"{found[1]}{float(found[2]) + by:.5g}"

    return re.sub(r"(?m)^((?:G[01] .*?Z|;Z:))([\d.]+)", raise_z, layer)


def measure_job(path: Path, changes: dict[str, object]) -> dict[str, float]:
    """Measure the command for a file, and return the figures with its result."""
    flags = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "printer_slicer", "dry-run", str(path), "--json", *flags]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if not done.stdout:
        raise SystemExit(done.stderr.decode())
    said = json.loads(done.stdout)
    memory = subprocess.run(
        [sys.executable, "-c", _MEMORY, str(path), json.dumps(changes)], capture_output=True, check=True
    )
    peak, held, peak_of_dry_run = map(float, memory.stdout.split())
    return {
        "lines": said["commands"],
        "hours": said["modelled_seconds"] / 3600,
        "differs": said["simulated_seconds"] / said["modelled_seconds"] - 1,
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "read_mb": peak,
        "held_mb": held,
        "grown_mb": peak_of_dry_run - held,
        "ok": float(said["ok"]),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return 1 if a simulated time differs from the estimate by more than 0.1 %."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.dry_run", description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.gcode")
    parser.add_argument(
        "--lines", nargs="+", type=int, default=LINES, help="number of lines of the generated jobs"
    )
    options = parser.parse_args(arguments)
    memory = f"{'read MB':>9}{'job MB':>9}{'dry run +MB':>12}"
    print(f"{'job':<24}{'lines':>10}{'hours':>7}{'CPU s':>7}{'differs':>10}{memory}  ok")
    far = False
    with tempfile.TemporaryDirectory() as folder:
        jobs: list[Any] = [(path, {}) for path in options.files]
        for lines in () if options.files else options.lines:
            path = Path(folder, f"vase_{lines}.gcode")
            path.write_bytes(long_job(lines))
            jobs.append((path, SETTINGS))
        for path, changes in jobs:
            row = measure_job(path, changes)
            far |= abs(row["differs"]) > 0.001
            figures = f"{row['lines']:>10.0f}{row['hours']:>7.1f}{row['cpu']:>7.1f}{row['differs']:>+10.4%}"
            memory = f"{row['read_mb']:>9.0f}{row['held_mb']:>9.0f}{row['grown_mb']:>12.0f}"
            print(f"{path.name:<24}{figures}{memory}  {'yes' if row['ok'] else 'no'}", flush=True)
    return int(far)


if __name__ == "__main__":
    raise SystemExit(main())
