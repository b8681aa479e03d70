"""Compare one layer plan for all objects of a plate with a plan for each object.

    python -m benchmarks.object_plans [--models FOLDER] [--plates N] [--processes N]

For each plate, the print time of the moves and the certified volume error are measured with plans for each object, and
with one plan at several error prices. Interpolation between these gives the print time of one plan with the same volume
error, and its volume error in the same print time.
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

PRICE_RATIOS: Final = (0.3, 0.6, 1.0, 1.8, 3.5, 6.0, 12.0)
"""Error prices of the single plan, as multiples of that for the separate plans."""
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


class Comparison(NamedTuple):
    """One plate: minutes, volume errors in mm³, and the ratios of separate plans to one plan.

    Attributes:
        names: the parts.
        one: (minutes, volume error) of one plan at the same error price.
        own: those of separate plans.
        minutes: ratio of print times at equal volume error.
        error: ratio of volume errors in equal time.
    """

    names: tuple[str, ...]
    one: tuple[float, float]
    own: tuple[float, float]
    minutes: float
    error: float


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all plates and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--models", type=Path, help="folder with models; without it, plates of made parts only"
    )
    parser.add_argument("--plates", type=int, nargs="+", metavar="N", help="numbers of the plates, from 1")
    parser.add_argument("--processes", type=int, default=1, help="plates at once (default: %(default)s)")
    arguments = parser.parse_args(argv)
    print(machine_note())
    wanted = [PLATES[number - 1] for number in arguments.plates or range(1, len(PLATES) + 1)]
    plates = [names for names in wanted if arguments.models or not {*names} & {*STL, *INCH}]
    print(f"{'one plan':>16} {'own plans':>16}   {'equal error':>11} {'equal time':>10}  parts")
    found = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for row in pool.map(partial(compare, models=arguments.models), plates):
            found.append(row)
            print(_format_row(row), flush=True)
    for name in ("minutes", "error"):
        changes = [getattr(row, name) - 1 for row in found]
        print(f"{name}: median {np.median(changes):+.1%}, from {min(changes):+.1%} to {max(changes):+.1%}")
    return 0


def _format_row(row: Comparison) -> str:
    """Format the comparison of a plate as a line of the table."""
    times = [f"{minutes:.1f} min {error:.0f} mm³" for minutes, error in (row.one, row.own)]
    return f"{times[0]:>16} {times[1]:>16}   {row.minutes - 1:>+11.1%} {row.error - 1:>+10.1%}  {', '.join(row.names)}"


def compare(names: tuple[str, ...], models: Path | None) -> Comparison:
    """Compare both kinds of plans for one plate.

    Raises:
        ValueError: the parts do not fit on one plate.
    """
    profile = ps.load_profile("marlin_220", quality="adaptive", changes={"quality.planner.kind": "optimal"})
    [plate] = ps.arrange([repair(_load(name, models))[0] for name in names], profile)
    part = place(plate, profile.printer)
    price = compute_error_price(part, profile)

    def measure(stacks: str, ratio: float) -> tuple[float, float]:
        """Return minutes and volume error of the plans with a multiple of the error price."""
        changes = {"quality.planner.stacks": stacks, "quality.planner.error_price": price * ratio}
        own = profile_with(profile, changes)
        return measure_plans(part, plan_objects(part, own), own)

    rows = [measure("one", ratio) for ratio in PRICE_RATIOS]
    own = measure("objects", 1.0)
    curve = np.array(rows)
    minutes = _interpolate(curve[:, 1], curve[:, 0], own[1], np.log)
    error = np.exp(_interpolate(curve[:, 0], np.log(curve[:, 1]), own[0], np.asarray))
    return Comparison(
        names, rows[PRICE_RATIOS.index(1.0)], own, float(own[0] / minutes), float(own[1] / error)
    )


def _interpolate(x: np.ndarray, y: np.ndarray, at: float, scale: Callable[[np.ndarray], np.ndarray]) -> float:
    """Interpolate values (n,) over `scale` of x (n,), which may be in any order."""
    order = np.argsort(x)
    return float(np.interp(scale(np.array(at)), scale(x[order]), y[order]))


def measure_plans(part: ps.Mesh, stacks: Sequence[ObjectStack], profile: ps.Profile) -> tuple[float, float]:
    """Return the minutes of the moves and the certified volume error, mm³, of a plate with given layers."""
    program = slice_planned(part, list_stack_plans(stacks), profile, keep=False, trial=True).program
    return float(move_seconds(program, profile).sum()) / 60, certify_stacks(stacks).volume_error


def _load(name: str, models: Path | None) -> ps.Mesh:
    """Load or make a part."""
    if name in PARTS:
        return make_part(name)
    if models and name in STL:
        return ps.load_mesh(models / name)
    if models and name in INCH:
        return ps.transform(ps.load_mesh(models / name), scale=25.4)
    return ps.load_mesh(SAMPLES / f"{name}.stl")


if __name__ == "__main__":
    sys.exit(main())
