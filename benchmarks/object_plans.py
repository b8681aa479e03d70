"""Compare one layer plan for all objects of a plate with a plan for each object.

    python -m benchmarks.object_plans [--models FOLDER] [--plates N] [--features] [--tolerance MM] [--processes N]

For each plate, the print time of the moves and the certified volume error are measured with plans for each object, and
with one plan at several error prices. Interpolation between these gives the print time of one plan with the same volume
error, and its volume error in the same print time. Prices are added until both neighbours differ by less than 2 % in
error (for equal error) or 0.5 % in time (for equal time). The columns `between` have what is left of this difference:
`inf` if no single plan is as fast, so that the fastest one is compared.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import trimesh

import printer_slicer as ps
from benchmarks.functional_parts import PARTS, make_part
from benchmarks.processes import SAMPLES, machine_note
from printer_slicer.extrusion import move_seconds
from printer_slicer.healing import repair
from printer_slicer.model import ObjectStack
from printer_slicer.object_plans import list_stack_plans
from printer_slicer.pipeline import plan_objects, slice_planned
from printer_slicer.placing import place
from printer_slicer.planning.shared_layer_times import compute_error_price
from printer_slicer.profile import profile_with
from printer_slicer.surface import certify_stacks

PRICE_RATIOS: Final = (0.5, 1.0, 4.0)
"""First error prices of the single plan, as multiples of that for the separate plans."""
CLOSE: Final = (0.005, 0.02)
"""Differences of minutes and of volume errors, as fractions, within which the single plan is interpolated."""
SAME_PRICE: Final = 1.02
"""Ratio of two prices that are not divided any more."""
MAX_TRIALS: Final = 5
"""Most prices that are added for each of both interpolations."""
STL: Final = ("bp_case.stl", "crazyradio.stl", "ringing_tower.stl", "benchy.3mf")
INCH: Final = ("idler_riser.STL", "fandisk.obj", "torus.STL")
PLATES: Final = (
    ("belt_pulley", "knurled_knob", "angle_bracket", "crazyradio.stl"),
    ("cone", "sphere", "box", "vase"),
    ("case_study", "tee", "knurled_knob", "sphere", "sheared_prism"),
    ("belt_pulley", "electronics_box", "cone", "sheared_prism"),
    ("idler_riser.STL", "knurled_knob", "crazyradio.stl", "tee"),
    ("torus.STL", "fandisk.obj", "belt_pulley", "angle_bracket"),
    ("bp_case.stl", "sphere", "cylinder", "cone", "knurled_knob"),
    ("crazyradio.stl", "idler_riser.STL", "belt_pulley", "knurled_knob", "case_study", "sphere"),
    ("torus.STL", "vase", "crazyradio.stl", "angle_bracket"),
    ("fandisk.obj", "knurled_knob", "tee", "idler_riser.STL", "electronics_box"),
)
"""Names of parts: of `benchmarks.functional_parts`, of the sample parts, or files in the folder of models."""
TOWERS: Final = {"slender_towers": 10.0, "broad_towers": 24.0}
"""Parts with a cone, a box and a ball on a base, which stand apart: size of the box, mm."""
PARTS_WITH_FEATURES: Final = (("slender_towers",), ("broad_towers",), ("benchy.3mf",))


class Comparison(NamedTuple):
    """One plate: minutes, volume errors in mm³, and the ratios of separate plans to one plan.

    Attributes:
        names: the parts.
        one: (minutes, volume error) of one plan at the same error price.
        own: those of separate plans.
        minutes: ratio of print times at equal volume error.
        error: ratio of volume errors in equal time.
        between: differences between the plans on both sides, as fractions: in error for `minutes`, in time for `error`.
    """

    names: tuple[str, ...]
    one: tuple[float, float]
    own: tuple[float, float]
    minutes: float
    error: float
    between: tuple[float, float]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all plates and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--models", type=Path, help="folder with models; without it, plates of made parts only"
    )
    parser.add_argument("--plates", type=int, nargs="+", metavar="N", help="numbers of the plates, from 1")
    parser.add_argument(
        "--features", action="store_true", help="compare plans for features of single parts instead"
    )
    parser.add_argument("--tolerance", type=float, default=0.0, help="mm; default: that of the quality")
    parser.add_argument("--processes", type=int, default=1, help="plates at once (default: %(default)s)")
    arguments = parser.parse_args(argv)
    print(machine_note())
    known = PARTS_WITH_FEATURES if arguments.features else PLATES
    wanted = [known[number - 1] for number in arguments.plates or range(1, len(known) + 1)]
    plates = [names for names in wanted if arguments.models or not {*names} & {*STL, *INCH}]
    columns = ("one plan", "own plans", "equal error", "between", "equal time", "between")
    print("{:>17} {:>17} {:>11} {:>7} {:>10} {:>7}  parts".format(*columns))
    found = []
    stacks = "features" if arguments.features else "objects"
    with ProcessPoolExecutor(arguments.processes) as pool:
        options = {"models": arguments.models, "stacks": stacks, "tolerance": arguments.tolerance}
        for row in pool.map(partial(compare, **options), plates):
            found.append(row)
            print(_format_row(row), flush=True)
    for name in ("minutes", "error"):
        changes = [getattr(row, name) - 1 for row in found]
        print(f"{name}: median {np.median(changes):+.1%}, from {min(changes):+.1%} to {max(changes):+.1%}")
    return 0


def _format_row(row: Comparison) -> str:
    """Format the comparison of a plate as a line of the table."""
    times = [f"{minutes:.1f} min {error:.0f} mm³" for minutes, error in (row.one, row.own)]
    error, time = (f"{value:.1%}" for value in row.between)
    return (
        f"{times[0]:>17} {times[1]:>17} {row.minutes - 1:>+11.1%} {error:>7} {row.error - 1:>+10.1%} {time:>7}"
        f"  {', '.join(row.names)}"
    )


def compare(
    names: tuple[str, ...], models: Path | None, stacks: str = "objects", tolerance: float = 0.0
) -> Comparison:
    """Compare both kinds of plans for one plate.

    Raises:
        ValueError: the parts do not fit on one plate.
    """
    profile = ps.load_profile("marlin_220", quality="adaptive", changes={"quality.planner.kind": "optimal"})
    profile = profile_with(profile, {"quality.tolerance": tolerance or profile.quality.tolerance})
    [plate] = ps.arrange([repair(_load(name, models))[0] for name in names], profile)
    part = place(plate, profile.printer)
    price = compute_error_price(part, profile)

    def measure(stacks: str, ratio: float) -> tuple[float, float]:
        """Return minutes and volume error of the plans with a multiple of the error price."""
        changes = {"quality.planner.stacks": stacks, "quality.planner.error_price": price * ratio}
        own = profile_with(profile, changes)
        return measure_plans(part, plan_objects(part, own), own)

    return compare_with_curve(names, measure(stacks, 1.0), partial(measure, "one"))


def compare_with_curve(
    names: tuple[str, ...], own: tuple[float, float], measure: Callable[[float], tuple[float, float]]
) -> Comparison:
    """Compare separate plans with single plans at several prices.

    Args:
        names: the parts.
        own: minutes and volume error of the separate plans.
        measure: returns minutes and volume error of one plan for a multiple of the error price.
    """
    rows = {ratio: measure(ratio) for ratio in PRICE_RATIOS}
    error_gap, time_gap = (_refine(rows, own[column], column, measure) for column in (1, 0))
    curve = np.log(sorted(rows.values()))
    minutes, error = np.exp([_interpolate(curve, own[1], 1), _interpolate(curve, own[0], 0)])
    return Comparison(
        names, rows[1.0], own, float(own[0] / minutes), float(own[1] / error), (error_gap, time_gap)
    )


def _refine(
    rows: dict[float, tuple[float, float]],
    wanted: float,
    column: int,
    measure: Callable[[float], tuple[float, float]],
) -> float:
    """Add prices until the plans on both sides of a wanted value are close, and return their difference as a fraction.

    Column 0 of `rows` are minutes, which increase with the price, column 1 errors, which decrease.
    """
    for _ in range(MAX_TRIALS):
        below, above = _find_neighbours(rows, wanted, column)
        if below == 0:
            ratio = above / 3
        elif above == np.inf:
            ratio = below * 3
        else:
            low, high = (np.log(rows[ratio][column] / wanted) for ratio in (below, above))
            if abs(high - low) < CLOSE[column] or above / below < SAME_PRICE:
                break
            ratio = below * (above / below) ** np.clip(low / (low - high), 0.2, 0.8)
        rows[float(ratio)] = measure(float(ratio))
    below, above = _find_neighbours(rows, wanted, column)
    if below == 0 or above == np.inf:
        return np.inf
    return float(abs(np.log(rows[above][column] / rows[below][column])))


def _find_neighbours(
    rows: dict[float, tuple[float, float]], wanted: float, column: int
) -> tuple[float, float]:
    """Return the next lower and the next higher price than that of a wanted value; 0 or infinity if there is none."""
    is_below = {ratio: (row[column] < wanted) == (column == 0) for ratio, row in rows.items()}
    below = max((ratio for ratio, low in is_below.items() if low), default=0.0)
    above = min((ratio for ratio, low in is_below.items() if not low and ratio > below), default=np.inf)
    return below, above


def _interpolate(curve: np.ndarray, wanted: float, column: int) -> float:
    """Interpolate the other column of the logarithms of minutes and errors (n, 2) at a value of one column."""
    order = np.argsort(curve[:, column])
    return float(np.interp(np.log(wanted), curve[order, column], curve[order, 1 - column]))


def measure_plans(part: ps.Mesh, stacks: Sequence[ObjectStack], profile: ps.Profile) -> tuple[float, float]:
    """Return the minutes of the moves and the certified volume error, mm³, of a plate with given layers."""
    program = slice_planned(part, list_stack_plans(stacks), profile, keep=False, trial=True).program
    return float(move_seconds(program, profile).sum()) / 60, certify_stacks(stacks).volume_error


def make_towers(name: str) -> ps.Mesh:
    """Make one of `TOWERS`."""
    size = TOWERS[name]
    cone = trimesh.creation.revolve([(0, 0), (8, 0), (1.5, 30), (0, 30)], sections=64)
    solids = [
        trimesh.creation.box(bounds=[(0, 0, 0), (50 + size, 40, 4)]),
        cone.apply_translation((12, 20, 3.5)),
        trimesh.creation.box(bounds=[(25, 20 - size / 2, 3.5), (25 + size, 20 + size / 2, 28)]),
        trimesh.creation.icosphere(4, 8.0).apply_translation((38 + size, 20, 10)),
    ]
    return ps.Mesh(np.asarray(trimesh.boolean.union(solids).triangles, np.float64), name)


def _load(name: str, models: Path | None) -> ps.Mesh:
    """Load or make a part."""
    if name in TOWERS:
        return make_towers(name)
    if name in PARTS:
        return make_part(name)
    if models and name in STL:
        return ps.load_mesh(models / name)
    if models and name in INCH:
        return ps.transform(ps.load_mesh(models / name), scale=25.4)
    return ps.load_mesh(SAMPLES / f"{name}.stl")


if __name__ == "__main__":
    sys.exit(main())
