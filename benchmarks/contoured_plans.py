"""Compare adaptive plans with and without contoured tops: print time at equal error, and error in equal print time.

    python -m benchmarks.contoured_plans [MODEL ...] [--prices N ...] [--contoured N ...] [--pressed MM]

Each model is sliced with the quality `adaptive` and several prices of volume error, with level and with contoured tops.
Time is that of the moves; the error is the mean distance of points on the surface from the print, from its G-code
(`benchmarks.contouring`). The results of level tops between two prices are interpolated linearly; outside the prices
there is no figure. The default model is the sample part `sphere`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.contouring import sample
from benchmarks.processes import SAMPLES
from printer_slicer.arrays import Float
from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode_text import gcode_of
from printer_slicer.healing import repair
from printer_slicer.mesh_io import load_mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.surface.certificate import certify_stacks

_PRICES = (25.0, 45.0, 65.0, 90.0, 130.0)
_HEADER = (
    "| tops | price | minutes | mean µm | pressed | certified | minutes at equal error | error in equal minutes "
    "| the same two, pressed | |"
)
_CONTOURED = (25.0, 45.0, 65.0)
"""Error prices, with contoured tops; level tops need a higher price for the same error."""


def measure(path: Path, price: float, pressed: float, *, contoured: bool) -> Float:
    """Return minutes, mean distance, distance if the nozzle presses tops down, and certified deviation, mm."""
    mesh = load_mesh(path)
    profile = load_profile(
        quality="adaptive", changes={"z_contouring": contoured, "error_price_ratio": price}
    )
    stages = slice_stages(mesh, profile)
    text, part = gcode_of(stages.program, profile), repair(mesh)[0]
    means = [
        sample(text, part, pressed=size).deviation.mean for size in ((0.0, pressed) if contoured else (0.0,))
    ]
    minutes = float(move_seconds(stages.program, profile).sum()) / 60
    return np.array([minutes, means[0], means[-1], certify_stacks(stages.stacks).max_error])


def compare(level: Float, minutes: float, error: float) -> str:
    """Format the changes of minutes at equal error and of error in equal minutes against level tops (n, 4)."""
    time, mean = level[np.argsort(level[:, 0]), :2].T
    at_error = float(np.interp(-error, -mean, time, np.nan, np.nan))
    at_time = float(np.interp(minutes, time, mean, np.nan, np.nan))
    return f"{minutes / at_error - 1:+.1%} | {error / at_time - 1:+.1%}".replace("+nan%", "-")


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table for each model."""
    parser = argparse.ArgumentParser(prog="benchmarks.contoured_plans", description=__doc__.split("\n")[0])
    parser.add_argument("models", nargs="*", type=Path, default=[SAMPLES / "sphere.stl"])
    parser.add_argument("--prices", type=float, nargs="+", default=_PRICES, help="of error, with level tops")
    parser.add_argument("--contoured", type=float, nargs="+", default=_CONTOURED, help="with contoured tops")
    parser.add_argument("--pressed", type=float, default=1.0, metavar="MM", help="underside of the nozzle")
    options = parser.parse_args(argv)
    for path in options.models:
        print(f"\n{path.name}\n\n{_HEADER}\n{'|---' * 10}|")
        rows = []
        for price in options.prices:
            rows.append(measure(path, price, options.pressed, contoured=False))
            minutes, mean, _, most = rows[-1]
            print(
                f"| level | {price:g} | {minutes:.2f} | {1000 * mean:.2f} | | {most:.4f} | | | | |",
                flush=True,
            )
        for price in options.contoured:
            minutes, mean, low, most = measure(path, price, options.pressed, contoured=True)
            figures = f"{minutes:.2f} | {1000 * mean:.2f} | {1000 * low:.2f} | {most:.4f}"
            changes = [compare(np.array(rows), minutes, error) for error in (mean, low)]
            print(f"| contoured | {price:g} | {figures} | {' | '.join(changes)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
