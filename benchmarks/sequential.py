"""Print random plates one after the other, and count contacts of the print head on the simulated printer.

    python -m benchmarks.sequential [COUNT] [--from SEED]

Each plate has two to six boxes, cylinders and cones, at random places or scattered around a grid, and one of several
heads. If an order is found,
the plate is sliced, and the simulated printer must report no contact. If none is found, all orders of the objects are
tried: none may be possible by the list of obstacles. For up to three objects, each two of which one is an obstacle are
printed in that order; the last line tells for how many the lint rules, which know only the moves, see the contact, too.
Others are nearer than one or two cells of their map, or within the convex hull of the nozzle positions.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from itertools import permutations
from typing import Final, NamedTuple

import numpy as np

import printer_slicer as ps
from printer_slicer import sequential
from printer_slicer.errors import PartError
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.inspection.lint.scan import lint_text
from printer_slicer.pipeline import slice_planned
from printer_slicer.sequencing import join_programs, list_obstacles, measure_extent

__all__ = ["HEADS", "Outcome", "make_plate", "try_plate"]

HEADS: Final = (
    "0: 18, 20: -999x-999 999x999",
    "0: 4, 8: -25x-18 18x22, 24: -999x-25 999x25",
    "0: 6, 5: 22, 15: -30x-30 30x20, 28: -999x-999 999x999",
    "0: -8x-8 25x12, 30: -999x-12 999x12",
)
"""Shapes of heads: a cylinder under a gantry, a carriage on a bar, a stack, a fan on one side."""

_QUICK: Final = {
    "print_order": "by_object",
    "layer_height": 0.32,
    "first_layer_height": 0.3,
    "infill_density": 0.0,
    "perimeters": 1,
    "top_thickness": 0.32,
    "bottom_thickness": 0.3,
    "printer.z_hop": 0.4,
}
_MAX_PRINTED: Final = 3
_AS_PLACED: Final = ps.Placement(as_placed=True)


class Outcome(NamedTuple):
    """Result of a plate.

    Attributes:
        n_objects: number of objects.
        is_possible: whether an order was found.
        fault: what is wrong; empty if nothing is.
        n_obstacles: pairs that were printed, although the first is an obstacle for the other.
        n_seen: pairs of them whose contact was seen.
    """

    n_objects: int
    is_possible: bool
    fault: str
    n_obstacles: int = 0
    n_seen: int = 0


def make_plate(seed: int) -> tuple[ps.Mesh, ps.Profile]:
    """Return a random plate, and a profile with one of the heads."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    cells = random.permutation(6)[:n]
    grid = np.stack([45 + 65 * (cells % 3), 75 + 70 * (cells // 3)], axis=1) + random.uniform(-12, 12, (n, 2))
    places = grid if seed % 3 else random.uniform(35, 185, (n, 2))
    parts = [_make_part(random, number, places[number]) for number in range(n)]
    changes = {**_QUICK, "printer.head": HEADS[seed % len(HEADS)], "brim_width": float(random.choice([0, 2]))}
    return ps.join(parts), ps.load_profile("marlin_220", quality="standard", changes=changes)


def _make_part(random: np.random.Generator, number: int, place: np.ndarray) -> ps.Mesh:
    """Return a prism or a cone with a random base, at a place (2,), mm."""
    corners, radius, height = int(random.choice([4, 12])), random.uniform(3, 9), random.uniform(2, 30)
    tip = float(random.choice([1.0, 1.0, 0.5]))
    angle = random.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(corners) / corners
    stretch = np.array([1.0, random.uniform(0.5, 2)])
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) * stretch
    low, high = (np.column_stack([ring * size, np.full(corners, z)]) for size, z in ((1, 0.0), (tip, height)))
    middle = np.array([[0, 0, 0.0], [0, 0, height]])
    after = np.roll(np.arange(corners), -1)
    sides = np.concatenate(
        [
            np.stack([low, low[after], high[after]], axis=1),
            np.stack([low, high[after], high], axis=1),
            np.stack([np.repeat(middle[:1], corners, axis=0), low[after], low], axis=1),
            np.stack([np.repeat(middle[1:], corners, axis=0), high, high[after]], axis=1),
        ]
    )
    return ps.Mesh(sides + np.append(place, 0.0), f"part_{number}")


def try_plate(seed: int) -> Outcome:
    """Slice a random plate, and print it on the simulated printer if an order is found."""
    plate, profile = make_plate(seed)
    n = len(plate.objects)
    try:
        job = ps.job_of(plate, profile, placement=_AS_PLACED)
    except PartError as error:
        if "one after the other" not in str(error):
            return Outcome(n, False, str(error))
        return _check_rejection(plate, profile)
    found = [one for one in job.findings if one.code == "head"]
    faults = [one for one in dry_run(job, profile).faults if one.code in {"head", "crash"}]
    return Outcome(n, True, "; ".join(one.message for one in [*found, *faults]))


def _check_rejection(plate: ps.Mesh, profile: ps.Profile) -> Outcome:
    """Try all orders of the objects by the list of obstacles; of few objects, print the pairs with obstacles."""
    plan = ps.plan_part(plate, profile)
    objects = sequential.split_for_sequence(plate, plan, profile)
    stages = [slice_planned(*one) for one in objects]
    extents = [measure_extent(one.part.name, one.program, one.sections) for one in stages]
    blocked = {(one.first, one.later) for one in list_obstacles(extents, profile.printer)}
    n = len(extents)
    for order in permutations(range(n)):
        if not any((a, b) in blocked for at, a in enumerate(order) for b in order[at + 1 :]):
            return Outcome(n, False, f"order {order} is possible")
    pairs = sorted(blocked) if n <= _MAX_PRINTED else []
    seen = [_is_contact_seen(stages[a].program, stages[b].program, profile) for a, b in pairs]
    return Outcome(n, False, "", len(pairs), sum(seen))


def _is_contact_seen(first: ps.Program, later: ps.Program, profile: ps.Profile) -> bool:
    """Return whether the lint rules see a contact of the head if two objects are printed in this order."""
    text = ps.gcode_of(join_programs([first, later], profile)[0], profile)
    return any(one.code == "head" for one in lint_text("pair", text, profile).findings)


def main() -> int:
    """Try the plates of the command line, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", nargs="?", type=int, default=1000)
    parser.add_argument("--from", dest="first", type=int, default=0)
    arguments = parser.parse_args()
    counts: Counter[tuple[int, bool]] = Counter()
    faults, n_obstacles, n_seen = list[int](), 0, 0
    for seed in range(arguments.first, arguments.first + arguments.count):
        outcome = try_plate(seed)
        counts[outcome.n_objects, outcome.is_possible] += 1
        n_obstacles, n_seen = n_obstacles + outcome.n_obstacles, n_seen + outcome.n_seen
        if outcome.fault:
            faults.append(seed)
            print(f"plate {seed}: {outcome.fault}", flush=True)
    print("| objects | order found | none |\n|---:|---:|---:|")
    for n in sorted({n for n, _ in counts}):
        print(f"| {n} | {counts[n, True]} | {counts[n, False]} |")
    print(f"{len(faults)} of {arguments.count} plates with a fault")
    print(f"{n_seen} of {n_obstacles} obstacles seen")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
