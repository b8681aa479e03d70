"""Measure how CPU time and memory of `slice` grow with the number of facets, for several kinds of meshes.

    python -m benchmarks.growth [--kinds torus relief ...] [--facets 300000 1000000 2500000 5000000] [--rounds N]

Every part is written once, as binary STL, and sliced in a separate process. The operating system reports CPU time and
peak memory. The last columns are CPU time and memory per facet, without those of a box of twelve facets, divided by the
values for the smallest size: 1 means growth in proportion, and less is better. The exit code shows parts that are
rejected, such as loose facets.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.big_mesh import FACET, MADE, measure, write_torus

SIZES = (300_000, 1_000_000, 2_500_000, 5_000_000)
BOX = Path(__file__).parent.parent / "sample_parts" / "box.stl"
AT_ONCE = 1 << 13
Corners = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


def write_facets(path: Path, n_facets: int, facets_of: Callable[[np.ndarray], Corners]) -> int:
    """Write facets (n, 3, 3) that are computed from their numbers (n,), in chunks."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(path.stem.encode().ljust(80) + n_facets.to_bytes(4, "little"))
        for begin in range(0, n_facets, AT_ONCE):
            number = np.arange(begin, min(begin + AT_ONCE, n_facets))
            facets = np.zeros(len(number), dtype=FACET)
            facets["corners"] = facets_of(number)
            file.write(facets.tobytes())
    return n_facets


def write_disc(path: Path, n_facets: int, radius: float, top: Callable[[np.ndarray], np.ndarray]) -> int:
    """Write a disc of sectors that stands on z = 0; `top` gives its height at each angle, (n,) -> (n,) mm."""
    n_sectors = n_facets // 4

    def facets_of(number: np.ndarray) -> Corners:
        sheet, sector = np.divmod(number, n_sectors)
        zero = np.zeros(len(number))
        middles = [np.column_stack([zero, zero, zero + z]) for z in (0.0, float(top(zero[:1])[0]))]
        low, high = [], []
        for step in (0, 1):
            turn = (sector + step) % n_sectors * (2 * np.pi / n_sectors)
            x, y = radius * np.cos(turn), radius * np.sin(turn)
            low.append(np.column_stack([x, y, zero]))
            high.append(np.column_stack([x, y, top(turn)]))
        sheets = (
            (middles[0], low[1], low[0]),
            (middles[1], high[0], high[1]),
            (low[0], low[1], high[1]),
            (low[0], high[1], high[0]),
        )
        corners = np.zeros((len(number), 3, 3))
        for kind, abc in enumerate(sheets):
            corners[sheet == kind] = np.stack(abc, axis=1)[sheet == kind]
        return corners.astype(np.float32)

    return write_facets(path, 4 * n_sectors, facets_of)


def write_relief(path: Path, n_facets: int) -> int:
    """Write a disc 0.2 mm high, 160 mm across, with waves of 0.05 mm on top; the only plane cuts half of its facets."""
    return write_disc(path, n_facets, 80.0, lambda turn: 0.175 + 0.025 * np.cos(24 * turn))


def write_needles(path: Path, n_facets: int) -> int:
    """Write a disc 2 mm high and 100 mm across with needles around it, and slivers below and on top."""
    return write_disc(path, n_facets, 50.0, lambda turn: np.full(len(turn), 2.0))


def write_loose(path: Path, n_facets: int) -> int:
    """Write facets of 1 mm at random places in a cube of 100 mm; no two share an edge."""

    def facets_of(number: np.ndarray) -> Corners:
        rng = np.random.default_rng(int(number[0]))
        middle = rng.uniform(1, 99, (len(number), 1, 3))
        return (middle + rng.uniform(-1, 1, (len(number), 3, 3))).astype(np.float32)

    return write_facets(path, n_facets, facets_of)


KINDS: Mapping[str, Callable[[Path, int], int]] = {
    "torus": write_torus,
    "relief": write_relief,
    "needles": write_needles,
    "loose": write_loose,
}


def read_facet_count(path: Path) -> int:
    """Return the facet count of a binary STL. This process must stay small: children start with its peak memory."""
    with path.open("rb") as file:
        return int.from_bytes(file.read(84)[80:], "little")


def measure_slicing(path: Path, rounds: int) -> tuple[float, float, int]:
    """Return the medians of CPU seconds and peak MiB for slicing a part, and the exit code."""
    words = ["-m", "printer_slicer", "slice", str(path), "-o", str(MADE / "growth.gcode"), "--quiet"]
    MADE.mkdir(parents=True, exist_ok=True)
    runs = [measure(words) for _ in range(rounds)]
    seconds, peaks, codes = zip(*runs, strict=True)
    return median(seconds), median(peaks), max(codes)


def main() -> int:
    """Print a table for each kind of mesh."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--facets", nargs="+", type=int, default=SIZES)
    parser.add_argument("--rounds", type=int, default=1)
    arguments = parser.parse_args()
    base_seconds, base_peak, _ = measure_slicing(BOX, max(arguments.rounds, 3))
    print(f"a box of 12 facets: {base_seconds:.2f} s, {base_peak:.0f} MiB\n")
    print("| kind | facets | CPU s | peak MiB | exit code | CPU per facet | memory per facet |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for kind in arguments.kinds:
        first: tuple[float, float] | None = None
        for wanted in sorted(arguments.facets):
            path = MADE / f"{kind}_{wanted}.stl"
            count = read_facet_count(path) if path.exists() else KINDS[kind](path, wanted)
            seconds, peak, code = measure_slicing(path, arguments.rounds)
            each = (seconds - base_seconds) / count, max(peak - base_peak, 1.0) / count
            first = first or each
            ratios = f"{each[0] / first[0]:.2f} | {each[1] / first[1]:.2f}"
            print(f"| {kind} | {count} | {seconds:.2f} | {peak:.0f} | {code} | {ratios} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
