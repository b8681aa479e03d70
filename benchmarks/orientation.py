"""Compare how we turn parts with Tweaker-3, with the makers of the parts, and with parts that are not turned.

    python -m benchmarks.orientation [--models DIR] [--tweaker DIR] [--careful] [--unturned] [--turns N] [--json FILE]
                                     [part ...]

Every part is first turned at random, always in the same ways. Then each program turns it, and we slice the result with
supports. The score is minutes of print time plus grams of support. Parts are made, or models of the folder; their files
hold them as their makers orient them.

Tweaker-3 is not on the package index: `--tweaker` names a folder with its `MeshTweaker.py`. It is asked for
its extended mode, for least support volume.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, Final, NamedTuple

import numpy as np

import printer_slicer as ps
from benchmarks.sizes import printable
from benchmarks.support_parts import MADE
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError
from printer_slicer.healing import repair
from printer_slicer.model import Mesh
from printer_slicer.pipeline import plan_part, slice_planned
from printer_slicer.placing import place
from printer_slicer.profile import Profile, profile_with
from printer_slicer.roles import roles_with

MODELS: Final = ("benchy", "bp_case", "crazyradio", "idler_riser", "fandisk", "ringing_tower")
MADE_NAMES: Final = ("tee", "hook", "bracket", "table", "mushroom", "figure")
SEED: Final = 20_261
_SAME: Final = 0.002  # of the size
Turn = Callable[[Mesh], Mesh]


class Run(NamedTuple):
    """One part, turned at random and then by a program, and sliced.

    Attributes:
        part, program: names.
        turn: number of the random turn.
        minutes: print time, min.
        grams: filament of supports, g.
        seconds: CPU time of turning, s.
        down: direction of the part that points down, in coordinates of its file.
        looks: size and centre of the turned surface, mm; the same for sides of a part that are alike.
    """

    part: str
    program: str
    turn: int
    minutes: float
    grams: float
    seconds: float
    down: tuple[float, float, float]
    looks: tuple[float, ...]

    @property
    def score(self) -> float:
        """Minutes plus grams."""
        return self.minutes + self.grams


def random_rotation(rng: np.random.Generator) -> Float:
    """Return a rotation matrix (3, 3), evenly distributed."""
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotated(mesh: Mesh, matrix: Float) -> Mesh:
    """Return the mesh turned by a matrix, with coordinates as an STL file keeps them."""
    return Mesh((mesh.triangles @ matrix.T).astype(np.float32).astype(np.float64), mesh.name)


def find_down(before: Mesh, after: Mesh) -> Float:
    """Return the direction (3,) of the mesh `before` that points down in the turned mesh `after`."""
    edges = [(mesh.triangles[:, 1:] - mesh.triangles[:, :1]).reshape(-1, 3) for mesh in (before, after)]
    down, *_ = np.linalg.lstsq(edges[0], -edges[1][:, 2], rcond=None)
    return np.asarray(down / np.linalg.norm(down))


def find_looks(mesh: Mesh) -> tuple[float, ...]:
    """Return the size of a part, and the centre of its surface from the lowest corner, mm."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    center = (area @ (a + b + c)) / (3 * area.sum()) - mesh.bounds[0]
    return (*mesh.size.tolist(), *center.tolist())


def tweaker(folder: Path) -> Turn:
    """Return a function that turns a mesh as Tweaker-3 does."""
    sys.path.insert(0, str(folder))
    module = importlib.import_module("MeshTweaker")

    def turn(mesh: Mesh) -> Mesh:
        np.random.seed(0)  # noqa: NPY002 - it draws from the global generator
        result = module.Tweak(
            mesh.triangles.reshape(-1, 3), extended_mode=True, min_volume=True, verbose=False
        )
        return Mesh(mesh.triangles @ result.matrix, mesh.name)  # it multiplies rows

    return turn


def sliced(mesh: Mesh, profile: Profile) -> tuple[float, float]:
    """Return minutes of print time, and grams of support."""
    part = place(repair(mesh)[0], profile.printer)
    program = slice_planned(part, plan_part(part, profile), profile, keep=False, trial=True).program
    filament = float(program.filament[roles_with(is_support=True)[program.role]].sum())
    area = np.pi / 4 * profile.material.filament_diameter**2
    return float(
        ps.move_seconds(program, profile).sum()
    ) / 60, filament * area / 1000 * profile.material.density


def parts(models: Path | None, names: Sequence[str]) -> Mapping[str, Mesh]:
    """Return the named parts, or all of them."""
    found = {name: MADE[name]() for name in MADE_NAMES if not names or name in names}
    files = {path.stem: path for path in sorted(models.iterdir())} if models else {}
    for name in names or MODELS:
        if name in files:
            found[name] = printable(ps.load_mesh(files[name]))[0]
    return found


def measure(name: str, mesh: Mesh, turns: int, programs: Mapping[str, Turn], profile: Profile) -> list[Run]:
    """Return the runs of one part: as its maker oriented it, and turned at random and then by each program."""
    minutes, grams = sliced(mesh, profile)
    runs = [Run(name, "maker", 0, minutes, grams, 0.0, (0.0, 0.0, -1.0), ())]
    rng = np.random.default_rng(SEED)
    for number in range(1, turns + 1):
        given = rotated(mesh, random_rotation(rng))
        for program, turn in programs.items():
            begin = process_time()
            result = turn(given)
            seconds = process_time() - begin
            x, y, z = find_down(mesh, result).tolist()
            try:
                minutes, grams = sliced(result, profile)
            except PartError as error:
                print(f"{name}, turn {number}, {program}: {error}", file=sys.stderr)
                continue
            runs.append(Run(name, program, number, minutes, grams, seconds, (x, y, z), find_looks(result)))
            print(
                f"  {name:<16}{number:>3}  {program:<10}{minutes:>8.1f} min{grams:>8.2f} g{seconds:>8.2f} s CPU",
                flush=True,
            )
    return runs


def summarize(runs: Sequence[Run]) -> str:
    """Return the table of all parts: worst score of each program, and how far our answers differ."""
    names, programs = (
        list(dict.fromkeys(run.part for run in runs)),
        list(dict.fromkeys(run.program for run in runs)),
    )
    lines = [
        f"{'part':<16}"
        + "".join(f"{program:>10}" for program in programs)
        + f"{'ours/maker':>12}{'spread':>9}"
    ]
    ratios: dict[str, list[float]] = {program: [] for program in programs}
    for name in names:
        own = {
            program: [run for run in runs if (run.part, run.program) == (name, program)]
            for program in programs
        }
        worst = {program: max((run.score for run in some), default=np.nan) for program, some in own.items()}
        for program in programs:
            others = {run.turn: run.score for run in own[program]}
            ratios[program] += [
                run.score / others.get(run.turn, others.get(0, np.nan)) for run in own["ours"]
            ]
        spread = max((find_difference(a, b) for a in own["ours"] for b in own["ours"]), default=0.0)
        scores = "".join(f"{worst[program]:>10.1f}" for program in programs)
        lines.append(f"{name:<16}{scores}{worst['ours'] / worst['maker']:>12.3f}{spread:>8.1f}°")
    for program in programs:
        known = [ratio for ratio in ratios[program] if np.isfinite(ratio)]
        if program != "ours" and known:
            lines.append(
                f"ours / {program}: median {median(known):.3f}, largest {max(known):.3f}, of {len(known)} runs"
            )
    return "\n".join(lines)


def find_difference(one: Run, other: Run) -> float:
    """Return the angle between two answers for a part, degrees; 0 if the turned parts look the same."""
    if np.allclose(one.looks, other.looks, atol=_SAME * max(one.looks)):
        return 0.0
    return angle_between(one.down, other.down)


def angle_between(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the angle between two unit vectors, degrees."""
    return float(np.degrees(np.arccos(np.clip(np.dot(a, b), -1.0, 1.0))))


def main() -> None:
    """Measure all parts, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help="names of parts; default: all")
    parser.add_argument("--models", type=Path, help="folder with models")
    parser.add_argument("--tweaker", type=Path, help="folder with MeshTweaker.py of Tweaker-3")
    parser.add_argument("--careful", action="store_true", help="also measure the careful search")
    parser.add_argument("--unturned", action="store_true", help="also measure parts that are not turned")
    parser.add_argument("--turns", type=int, default=3, help="random turns of each part; default: 3")
    parser.add_argument("--quality", default="standard", help="quality profile; default: standard")
    parser.add_argument("--json", type=Path, help="write every run to this file")
    options = parser.parse_args()
    profile = profile_with(
        ps.load_profile("marlin_220", quality=options.quality), {"quality.support": "auto"}
    )
    programs: dict[str, Turn] = {"ours": lambda mesh: ps.orient(mesh, profile)}
    if options.unturned:
        programs["unturned"] = lambda mesh: mesh
    if options.careful:
        programs["careful"] = lambda mesh: ps.orient(mesh, profile, search="careful")
    if options.tweaker:
        programs["tweaker"] = tweaker(options.tweaker)
    runs = [
        run
        for name, mesh in parts(options.models, options.parts).items()
        for run in measure(name, mesh, options.turns, programs, profile)
    ]
    print(summarize(runs))
    if options.json:
        rows: list[dict[str, Any]] = [run._asdict() for run in runs]
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
