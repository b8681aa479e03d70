"""Compare the number of plates that parts need with PrusaSlicer's, and check the distances of random plates.

    python -m benchmarks.arranging --models DIR [--copies N]
    python -m benchmarks.arranging --random N

The first command arranges N copies, by default three, of 20 parts on beds of 250 x 250 mm, 6 mm apart, and prints
plates and CPU time. The parts are those of the models folder, functional parts and sample parts. PrusaSlicer arranges
the parts of one command line on one bed, and fails if they do not fit. So its beds are filled one after the other:
with as many of the largest parts that are left as it accepts, then with as many of the smallest ones; both numbers are
found by bisection. It compares convex outlines, so it is given each part flattened to 0.4 mm, which slices at once.

The second command arranges random parts, and measures exact distances with shapely. It fails if two parts are nearer
than the gap, or a part leaves the bed or enters an excluded area.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Final

import numpy as np
import shapely
from shapely import affinity

import printer_slicer as ps
from benchmarks.functional_parts import PARTS, make_part
from benchmarks.processes import SAMPLES, RunError, machine_note, run
from printer_slicer.arranging import FreeArea, arrange_outlines
from printer_slicer.geometry import Areas
from printer_slicer.plates import find_places

__all__ = ["check_random_plate"]

BED: Final = 250.0  # mm
GAP: Final = 6.0  # mm
MODELS: Final = ("benchy.3mf", "bp_case.stl", "crazyradio.stl", "ringing_tower.stl")
INCH_MODELS: Final = ("fandisk.obj", "idler_riser.STL", "torus.STL")
SAMPLE_NAMES: Final = ("case_study", "tee", "vase", "thin_wall", "bridge", "cone", "box", "sheared_prism")
PEER: Final = "prusa-slicer"
FLAT: Final = 0.4  # mm


def main(argv: Sequence[str] | None = None) -> int:
    """Run one of the two measurements; return 1 if a plate is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", type=Path, help="folder with the models")
    parser.add_argument("--copies", type=int, default=3, help="copies of each part (default: %(default)s)")
    parser.add_argument("--random", type=int, metavar="N", help="check N random plates instead")
    arguments = parser.parse_args(argv)
    print(machine_note())
    if arguments.random is not None:
        return check_random_plates(arguments.random)
    compare(arguments.models, arguments.copies)
    return 0


# Beds


def load_parts(models: Path | None) -> list[ps.Mesh]:
    """Return the parts; without a models folder, those that are made."""
    read = [ps.load_mesh(models / name) for name in MODELS] if models else []
    read += [ps.transform(ps.load_mesh(models / name), scale=25.4) for name in INCH_MODELS] if models else []
    return [*read, *map(make_part, PARTS), *(ps.load_mesh(SAMPLES / f"{name}.stl") for name in SAMPLE_NAMES)]


def compare(models: Path | None, copies: int) -> None:
    """Print plates and CPU time for the parts, and the beds of PrusaSlicer if it is installed."""
    distinct = load_parts(models)
    parts = [mesh for mesh in distinct for _ in range(copies)]
    changes = {"printer.bed_x": BED, "printer.bed_y": BED}
    profile = ps.load_profile("marlin_220", quality="standard", changes=changes)
    begun = process_time()
    places = find_places(parts, profile, GAP)
    seconds = process_time() - begun
    print(
        f"{len(parts)} parts: {places.n_plates} plates {np.bincount(places.plate).tolist()}, {seconds:.2f} s CPU"
    )
    if not shutil.which(PEER):
        print(f"{PEER} is not installed")
        return
    with TemporaryDirectory() as folder:
        counts = fill_beds(distinct, copies, Path(folder))
    print(f"{PEER}: {len(counts)} plates {counts}")


def fill_beds(distinct: Sequence[ps.Mesh], copies: int, folder: Path) -> list[int]:
    """Return the number of parts on each of PrusaSlicer's beds, which are filled one after the other."""
    paths: list[Path] = []
    for number, mesh in enumerate(sorted(distinct, key=lambda one: -float(one.size[:2].prod()))):
        paths.append(folder / f"{number}.stl")
        ps.export_stl(ps.transform(mesh, scale=(1, 1, FLAT / float(mesh.size[2]))), paths[-1])
    left, counts = [path for path in paths for _ in range(copies)], []
    while left:
        n_large = count_fitting([], left, folder)
        bed, rest = left[:n_large], left[n_large:]
        n_small = count_fitting(bed, rest[::-1], folder)
        left = rest[: len(rest) - n_small]
        counts.append(n_large + n_small)
        print(f"{PEER}: bed {len(counts)} holds {n_large} large and {n_small} small parts", flush=True)
    return counts


def count_fitting(bed: Sequence[Path], more: Sequence[Path], folder: Path) -> int:
    """Return how many of further parts, from the first one, PrusaSlicer arranges beside those of a bed."""
    low, high = 0, len(more)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits_on_bed([*bed, *more[:middle]], folder) else (low, middle - 1)
    return low


def fits_on_bed(paths: Sequence[Path], folder: Path) -> bool:
    """Return whether PrusaSlicer arranges parts on one bed."""
    bed = f"0x0,{BED:g}x0,{BED:g}x{BED:g},0x{BED:g}"
    thin = ("--layer-height", "0.3", "--first-layer-height", "0.35", "--skirts", "0", "--perimeters", "1")
    empty = ("--fill-density", "0", "--top-solid-layers", "0", "--bottom-solid-layers", "0")
    asked = ("--merge", "--duplicate-distance", f"{GAP:g}", "--bed-shape", bed, "--export-gcode")
    try:
        run([PEER, *asked, *thin, *empty, "-o", str(folder / "bed.gcode"), *map(str, paths)])
    except RunError:
        return False
    return True


# Distances


def check_random_plates(count: int) -> int:
    """Check plates with seeds from 0; print the smallest distance beyond the gap, mm."""
    begun, least = process_time(), np.inf
    for seed in range(count):
        least = min(least, check_random_plate(seed))
        if least < 0:
            print(f"plate {seed}: parts are {-least:g} mm too near, or outside of their area")
            return 1
    seconds = process_time() - begun
    print(f"{count} random plates: smallest distance is {least:.6f} mm above the gap; {seconds:.0f} s CPU")
    return 0


def check_random_plate(seed: int) -> float:
    """Arrange random parts; return by how much their smallest distance exceeds the gap, mm.

    It is negative if parts are too near, leave the bed or enter an excluded area.
    """
    random = np.random.default_rng(seed)
    gap, size = float(random.uniform(0.2, 10)), random.uniform(80, 300, 2)
    clip = shapely.box(0, 0, *(size * random.uniform(0.02, 0.2, 2)))
    polygons = list(make_polygons(random, size))
    room = FreeArea(np.zeros(2), size, to_areas(clip))
    found = arrange_outlines(
        [to_areas(one) for one in polygons], list(map(str, range(len(polygons)))), room, gap
    )
    least = np.inf
    for plate in range(found.n_plates):
        here = [
            affinity.translate(
                affinity.rotate(polygons[at], found.angle[at], origin=(0, 0)), *found.shift[at].tolist()
            )
            for at in np.flatnonzero(found.plate == plate).tolist()
        ]
        bed = shapely.box(0, 0, *size).buffer(1e-6)
        if not all(bed.covers(one) and one.intersection(clip).area < 1e-6 for one in here):
            return -1.0
        least = min([least, *(one.distance(other) - gap for one, other in combinations(here, 2))])
    return float(least)


def make_polygons(random: np.random.Generator, size: np.ndarray) -> Iterator[shapely.Polygon]:
    """Yield two to nine parts as seen from above: random polygons, some with a hole."""
    for _ in range(int(random.integers(2, 10))):
        extent = float(size.min()) * random.uniform(0.05, 0.32)
        angle = np.sort(random.uniform(0, 2 * np.pi, int(random.integers(5, 30))))
        radius = extent * random.uniform(0.3, 1, len(angle))
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        polygon = shapely.make_valid(shapely.Polygon(points))
        largest = max(shapely.get_parts(polygon), key=lambda one: one.area)
        inner = largest.buffer(-extent / 5)
        has_hole = random.random() < 0.5 and isinstance(inner, shapely.Polygon) and not inner.is_empty
        yield (
            shapely.Polygon(largest.exterior, [inner.exterior])
            if has_hole
            else shapely.Polygon(largest.exterior)
        )


def to_areas(polygon: shapely.Polygon) -> Areas:
    """Return a polygon as areas of one layer."""
    turned = shapely.orient_polygons(polygon)
    rings = [turned.exterior, *turned.interiors]
    return Areas.from_rings([[shapely.get_coordinates(ring)[:-1] for ring in rings]])


if __name__ == "__main__":
    sys.exit(main())
