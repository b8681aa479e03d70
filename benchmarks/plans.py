"""Compare default layer plans with uniform layers, on the program's moves.

    python -m benchmarks.plans [--models DIR] [--machine NAME ...] [--limit N] [--json FILE] [--again] [part ...]

For each part and machine, the default plan and uniform layers of `layer_height` are sliced. So are the three thickest
of all uniform plans whose certified volume error is at most that of the default plan: only these could be as accurate
and faster. Minutes are those of the moves, and volume errors are certified. Rows in the file of figures are not
measured again, so a run may be interrupted and continued.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.parts import options_of, parser_of
from benchmarks.processes import SAMPLES, WORK
from benchmarks.sizes import printable
from benchmarks.vendor_speeds import MACHINES
from printer_slicer.extrusion import move_seconds
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile, load_profile
from printer_slicer.surface import certify, read_surface

NEARLY: Final = 0.01
"""Relative difference of time or volume error that the planner's model cannot resolve: closer values count as equal."""

_RIVALS: Final = 3
_SIDES: Final = 96
_HEIGHTS: Final = 14  # of uniform plans, from the thinnest to the thickest layer of the machine's list

Outline = tuple[Sequence[tuple[float, float]], int, float]
"""(z, radius) from the bed up, mm; number of waves around the body, and their depth as a share of the radius."""

GENERATED: Final[Mapping[str, Outline]] = {
    "dome": ([(25 * np.sin(a), 25 * np.cos(a)) for a in np.linspace(0, np.pi / 2 - 0.02, 48)], 0, 0),
    "gentle_cone": ([(0, 40), (9, 4)], 0, 0),
    "stairs": ([(0, 30), (3.1, 30), (3.1, 24), (7.3, 24), (7.3, 15), (12.9, 15)], 0, 0),
    "fine_stairs": ([(1.23 * ((i + 1) // 2), 30 - 2.0 * (i // 2)) for i in range(20)], 0, 0),
    "star": ([(0, 25), (15, 25)], 9, 0.25),
    "tapered_star": ([(0, 25), (20, 12)], 7, 0.2),
    "barrel": ([(z, 14 + 4 * np.sin(np.pi * z / 35)) for z in np.linspace(0, 35, 40)], 0, 0),
    "needle": ([(0, 5), (30, 0.6)], 0, 0),
    "thread": ([(z, 12 + 1.5 * np.sin(2 * np.pi * z / 5)) for z in np.linspace(0, 30, 120)], 0, 0),
    "chamfered": ([(0, 28), (1.5, 30), (12, 30), (13.7, 28.3)], 0, 0),
}
"""Bodies with one outline whose size changes over height."""


@dataclass(frozen=True, slots=True)
class Row:
    """One part on one machine: minutes and volume errors, mm³.

    Attributes:
        rival: layer height, mm, of the fastest uniform plan that is as accurate as the default one; 0 if there is none.
    """

    part: str
    machine: str
    minutes: float
    error: float
    uniform_minutes: float
    uniform_error: float
    rival: float
    rival_minutes: float
    rival_error: float

    @property
    def has_better_uniform_plan(self) -> bool:
        """Whether a uniform plan is as accurate and faster, or as fast and more accurate."""
        if not self.rival or self.rival_minutes > self.minutes:
            return False
        quicker = self.rival_minutes < self.minutes * (1 - NEARLY)
        return quicker or self.rival_error < self.error * (1 - NEARLY) - 1e-6


def main(argv: Sequence[str] | None = None) -> int:
    """Measure missing rows and print the table; return 1 if a uniform plan is better than a default one."""
    parser = parser_of("plans", __doc__ or "")
    parser.add_argument("--machine", action="append", choices=[*MACHINES], help="only these printers")
    parser.add_argument("--limit", type=int, default=10**9, metavar="N", help="maximum number of new rows")
    parser.add_argument(
        "--again", action="store_true", help="also measure rows that the file of figures contains"
    )
    options = options_of(parser, argv)
    target = options.json or WORK / "plans.json"
    known = {} if options.again or not target.exists() else _read(target)
    left = options.limit
    for mesh in _parts(options.models, options.parts):
        for machine in options.machine or MACHINES:
            if (mesh.name, machine) in known or left <= 0:
                continue
            known[mesh.name, machine] = measure(mesh, machine)
            left -= 1
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(json.dumps([asdict(row) for row in known.values()], indent=1) + "\n")
            print(f"measured {mesh.name} on {machine}", file=sys.stderr, flush=True)
    rows = sorted(known.values(), key=lambda row: (row.part, row.machine))
    print("\n".join([*table(rows), "", *summary(rows)]))
    return int(any(row.has_better_uniform_plan for row in rows))


def _read(path: Path) -> dict[tuple[str, str], Row]:
    rows = [Row(**row) for row in json.loads(path.read_text())]
    return {(row.part, row.machine): row for row in rows}


def _parts(models: Path | None, wanted: Sequence[str]) -> Iterator[Mesh]:
    """Return sample parts, generated ones and those of the models folder."""
    for name, outline in GENERATED.items():
        if not wanted or name in wanted:
            yield Mesh(make_body(*outline), name)
    for folder in [SAMPLES, *([models] if models else [])]:
        for path in sorted(folder.iterdir()):
            if path.suffix.lower().removeprefix(".") in FORMATS and (not wanted or path.stem in wanted):
                mesh = printable(load_mesh(path))[0]
                yield Mesh(mesh.triangles, path.stem)


def make_body(points: Sequence[tuple[float, float]], waves: int, depth: float) -> np.ndarray:
    """Return a closed body of revolution (F, 3, 3), see `Outline`."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    shape = (1 + depth * np.cos(waves * angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    rings = np.stack([np.column_stack([r * shape, np.full(_SIDES, z)]) for z, r in points])
    low, high = rings[:-1], rings[1:]
    low_after, high_after = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    sides = [np.stack(corners, axis=2) for corners in ((low, low_after, high_after), (low, high_after, high))]
    caps = []
    for ring in (rings[0][::-1], rings[-1]):
        middle = np.broadcast_to([0.0, 0.0, ring[0, 2]], ring.shape)
        caps.append(np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1))
    return np.concatenate([*(side.reshape(-1, 3, 3) for side in sides), *caps])


def measure(mesh: Mesh, machine: str) -> Row:
    """Measure one part on one machine."""
    usual = load_profile(machine)
    part = place(mesh, usual.printer)

    def error(plan: LayerPlan) -> float:
        return certify(read_surface(part), plan).volume_error

    plan = plan_layers(part, usual)
    mine = _slice_minutes(mesh, usual, plan), error(plan)
    usual_height = usual.quality.layer_height
    steps = ZSteps(part, usual)
    few = np.linspace(0, len(steps.allowed) - 1, min(_HEIGHTS, len(steps.allowed))).astype(np.int64)
    heights = {round(height, 6) for height in (steps.allowed[few] * steps.size).tolist()}
    uniform = {height: _plan_uniform(machine, height) for height in heights | {usual_height}}
    plans = {height: plan_layers(part, one) for height, one in uniform.items()}
    errors = {height: error(one) for height, one in plans.items()}
    exact = sorted(height for height in plans if errors[height] <= mine[1] + 1e-6)[-_RIVALS:]
    wanted = {*exact, usual_height}
    minutes = {height: _slice_minutes(mesh, uniform[height], plans[height]) for height in wanted}
    rival = min(exact, key=lambda height: minutes[height], default=0.0)
    theirs = (minutes[rival], errors[rival]) if rival else (0.0, 0.0)
    return Row(mesh.name, machine, *mine, minutes[usual_height], errors[usual_height], rival, *theirs)


def _plan_uniform(machine: str, height: float) -> Profile:
    return load_profile(machine, changes={"quality.planner.kind": "uniform", "quality.layer_height": height})


def _slice_minutes(mesh: Mesh, profile: Profile, plan: LayerPlan) -> float:
    return float(move_seconds(slice_part(mesh, profile, plan=plan), profile).sum()) / 60


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Return the rows in Markdown, and a summary."""
    yield "| part | machine | minutes, mm³ | uniform | ratio | as accurate | minutes, mm³ | ratio |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in rows:
        mine, uniform = (
            f"{row.minutes:.1f}, {row.error:.1f}",
            f"{row.uniform_minutes:.1f}, {row.uniform_error:.1f}",
        )
        rival = (
            f"{row.rival:g} mm | {row.rival_minutes:.1f}, {row.rival_error:.1f}" if row.rival else "none |"
        )
        share = f"{row.minutes / row.rival_minutes:.2f}" if row.rival else ""
        of_uniform = f"{row.minutes / row.uniform_minutes:.2f}"
        yield f"| {row.part} | `{row.machine}` | {mine} | {uniform} | {of_uniform} | {rival} | {share} |"


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """Return a line for each part: the default plan divided by uniform plans, as a range over all machines."""
    yield (
        "| part | machines | time / uniform | error / uniform | time / equally accurate uniform "
        "| plans worse than a uniform one |"
    )
    yield "|---|---|---|---|---|---|"
    for part in sorted({row.part for row in rows}):
        own = [row for row in rows if row.part == part]
        by_usual = _format_range([row.minutes / row.uniform_minutes for row in own])
        errors = _format_range([row.error / row.uniform_error for row in own if row.uniform_error > NEARLY])
        by_rival = _format_range([row.minutes / row.rival_minutes for row in own if row.rival])
        n_worse = sum(row.has_better_uniform_plan for row in own)
        yield f"| {part} | {len(own)} | {by_usual} | {errors} | {by_rival} | {n_worse} |"
    n_worse = sum(row.has_better_uniform_plan for row in rows)
    yield f"\nno uniform plan is better than {len(rows) - n_worse} of {len(rows)} plans"


def _format_range(ratios: Sequence[float]) -> str:
    return f"{min(ratios):.2f} to {max(ratios):.2f}" if ratios else "-"


if __name__ == "__main__":
    sys.exit(main())
