"""Write a large closed part for measurements: a bumpy torus with a given number of facets, as binary STL.

    python benchmarks/big_mesh.py --facets 5000000 --output benchmarks/made/torus_5m.stl

--load and --slice measure CPU time and peak memory of reading the part, or of the whole slice command, in a separate
process.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np

MADE = Path(__file__).parent / "made"
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def torus_points(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return points (..., 3) of the torus, float32 mm: 90 mm across the middle circle, 25 mm thick, bumps of 1 mm."""
    thick = 25.0 + np.sin(24 * u) * np.cos(12 * v)
    around = 45.0 + thick / 2 * np.cos(v)
    return np.stack([around * np.cos(u), around * np.sin(u), thick / 2 * np.sin(v)], axis=-1).astype(
        np.float32
    )


def write_torus(path: Path, n_facets: int) -> int:
    """Write the torus ring by ring; neighbouring facets share their corners exactly.

    Returns:
        The number of facets: `n_facets`, or up to one ring less.
    """
    n_v = max(int(np.sqrt(n_facets / 2) / 2), 3)
    n_u = n_facets // (2 * n_v)
    v = np.arange(n_v) * (2 * np.pi / n_v)
    first = previous = torus_points(np.full(n_v, 0.0), v)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(b"bumpy torus".ljust(80) + (2 * n_u * n_v).to_bytes(4, "little"))
        for ring in range(1, n_u + 1):
            there = torus_points(np.full(n_v, ring * 2 * np.pi / n_u), v) if ring < n_u else first
            facets = np.zeros(2 * n_v, dtype=FACET)
            a, b, c, d = previous, there, np.roll(there, -1, axis=0), np.roll(previous, -1, axis=0)
            facets["corners"][0::2] = np.stack([a, b, c], axis=1)
            facets["corners"][1::2] = np.stack([a, c, d], axis=1)
            file.write(facets.tobytes())
            previous = there
    return 2 * n_u * n_v


def measure(arguments: list[str]) -> tuple[float, float, int]:
    """Return CPU seconds, peak memory in MiB and exit code of a process."""
    process = os.posix_spawn(sys.executable, [sys.executable, *arguments], os.environ)
    _, status, used = os.wait4(process, 0)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, os.waitstatus_to_exitcode(status)


def main() -> int:
    """Write the part, and measure if an option asks for it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=5_000_000)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--load", action="store_true", help="measure reading it")
    parser.add_argument("--slice", action="store_true", help="measure slicing it to G-code")
    arguments = parser.parse_args()
    path = arguments.output or MADE / f"torus_{arguments.facets}.stl"
    if not path.exists():
        begun = time.perf_counter()
        n_facets = write_torus(path, arguments.facets)
        print(f"{path}: {n_facets} facets, {path.stat().st_size} bytes, {time.perf_counter() - begun:.1f} s")
    read = "import sys; from printer_slicer import load_mesh; mesh = load_mesh(sys.argv[1])"
    wanted = [("load", ["-c", read, str(path)])] if arguments.load else []
    if arguments.slice:
        output = str(path.with_suffix(".gcode"))
        wanted.append(("slice", ["-m", "printer_slicer", "slice", str(path), "-o", output, "--quiet"]))
    for name, words in wanted:
        seconds, peak, code = measure(words)
        print(f"{name}: {seconds:.2f} s CPU, {peak:.0f} MiB at most, exit code {code}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
