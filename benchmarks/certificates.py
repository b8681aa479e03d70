"""Compare certified bounds with sampled points: planning time, bound and largest error of each part.

    python -m benchmarks.certificates [--models DIR] [--points N] [--tolerance MM] [part ...]

For each part, the shipped quality `adaptive` plans layers from a new mesh, and the plan is certified. Then points are
sampled where the stack may be wrong. Their exact distance to the mesh is compared with the bound of their layer. Points
on the mesh are compared with the boundary of the stack. The exit code is 1 if a wrong point exceeds its bound, or if a
flat of more than 1 mm² or the top of the part is off by more than 0.005 mm.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.processes import SAMPLES, machine_note
from benchmarks.sizes import printable
from printer_slicer.deviation import measure_deviation
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, load_profile
from printer_slicer.slicing import cut
from printer_slicer.surface import certify, find_flats, read_surface, thin_areas
from tests.surface.distances import distance_to_mesh, wrong_points

_ALLOWED = 0.005  # mm, for flats and the top
_ROUNDING = 2e-6  # mm, of the exact distances
_HEAD = (
    "| part | facets | layers | planning CPU s | bound µm | worst wrong point µm | worst share of its bound "
    "| worst flat µm | top µm | surface to stack, mean and max µm | thin mm² |"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row for each part; return 1 if a part is not as certified."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.certificates", description=__doc__.split("\n")[0]
    )
    parser.add_argument("parts", nargs="*", type=Path, help="files; default: sample parts and models")
    parser.add_argument(
        "--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)"
    )
    parser.add_argument(
        "--points", type=int, default=20_000, help="points sampled on each part (default 20000)"
    )
    parser.add_argument("--tolerance", type=float, help="mm; default: the quality's")
    options = parser.parse_args(argv)
    models = options.models or os.environ.get("PRINTER_SLICER_MODELS")
    folders = [Path(models)] if models else []
    found = [path for folder in [*folders, SAMPLES] for path in sorted(folder.iterdir())]
    parts = options.parts or [path for path in found if path.suffix.lower().removeprefix(".") in FORMATS]
    changes = {"quality.tolerance": options.tolerance} if options.tolerance else {}
    profile = load_profile(quality="adaptive", changes=changes)
    print(f"{machine_note()}\n\n{_HEAD}\n|---|{'---:|' * 10}", flush=True)
    kept = [_row(path, profile, options.points) for path in parts]
    print(f"\n{sum(kept)} of {len(kept)} parts are as certified")
    return int(not all(kept))


def _row(path: Path, profile: Profile, n_points: int) -> bool:
    """Measure a part, print its row, and return whether it is as certified."""
    sized, note = printable(load_mesh(path))
    part = place(sized, profile.printer)
    if note:
        print(note, file=sys.stderr)
    seconds = []
    for _ in range(3):
        fresh = Mesh(part.triangles, part.name)  # a mesh remembers its surface
        begin = process_time()
        plan = plan_layers(fresh, profile)
        seconds.append(process_time() - begin)
    certificate = certify(read_surface(part), plan)
    wrong, layer = wrong_points(part, plan, n_points, np.random.default_rng(0))
    bounds = np.append(certificate.bound, certificate.missing)
    distance = distance_to_mesh(wrong, part, 2 * float(plan.height.max()))
    share = distance / np.maximum(bounds[layer], 1e-9)
    heights = find_flats(part)[0]
    off = np.abs(np.append(plan.top, 0.0)[:, None] - heights).min(axis=0).max(initial=0.0)
    top = certificate.overshoot - certificate.missing
    sections = cut(part, plan, 0.0)
    back = measure_deviation(part, sections, n_points)
    above = int((distance > bounds[layer] + _ROUNDING).sum())
    errors = (certificate.max_error, distance.max(initial=0.0))
    columns = [path.stem, f"{part.n_facets}", f"{plan.n_layers}", f"{min(seconds):.2f}"]
    columns += [f"{1000 * error:.1f}" for error in errors]
    columns += [f"{share.max(initial=0.0):.3f}", f"{1000 * off:.2f}", f"{1000 * top:+.2f}"]
    columns += [f"{1000 * back.mean:.2f}, {1000 * back.max:.1f}"]
    columns += [f"{thin_areas(read_surface(part), sections).sum():.2f}"]
    columns += [f"{above} POINTS ABOVE"] if above else []
    print(f"| {' | '.join(columns)} |", flush=True)
    return not above and off <= _ALLOWED and abs(top) <= _ALLOWED


if __name__ == "__main__":
    sys.exit(main())
