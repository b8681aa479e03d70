"""Compare our supports with those of PrusaSlicer and CuraEngine, measured on G-code with the same code.

    python -m benchmarks.supports [--models DIR] [--plans uniform,adaptive] [--programs NAME,...] [--rounds N]
                                  [--json FILE] [--places] [part ...]

A part is one of `support_parts`, or a model of the folder with a rotation, such as `benchy@x60z30`. Every part is
sliced by us (columns, tree, auto), by PrusaSlicer (grid and snug, each with and without `dont_support_bridges`) and by
CuraEngine (normal and tree), with the settings of one profile. `support_settings` lists what cannot be made equal.
Figures come from the extrusions in the files and from the facets of the part, never from areas that a program declares.
Peers' G-code is kept in `benchmarks/made/` and used again.

With `--rounds N`, the CPU time that supports add is measured: whole programs with supports minus without, in turn, the
least of N rounds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from benchmarks.parts import options_of, parser_of
from benchmarks.peers import CuraEngine, Part, PrusaSlicer, find_peers
from benchmarks.processes import WORK, RunError, machine_note, ours, run
from benchmarks.support_beads import SupportFile, read_supports
from benchmarks.support_figures import Figures, Flat, Place, measure_supports
from benchmarks.support_parts import support_parts
from benchmarks.support_settings import NOT_EQUAL, cura_supports, prusa_supports
from benchmarks.support_solid import Island, Overhang, Solid, find_islands, find_overhang
from printer_slicer.model import Mesh
from printer_slicer.profile import Profile, load_profile

_OURS: Final = ("columns", "tree", "auto")
_FARTHEST_SHIFT: Final = 0.3  # mm between the part in a file and the mesh
_EQUAL_BARE: Final = 0.01  # of the overhang
_QUALITIES: Final = {"uniform": "standard", "adaptive": "adaptive"}
_PLANNERS: Final = {"uniform": "uniform", "adaptive": "optimal"}
_NO_EXTRAS: Final[Mapping[str, str | float]] = {"skirt_loops": 0, "thickest_layer": 0.3}
_HEAD: Final = (
    "program",
    "g",
    "min (travel)",
    "bare mm²",
    "farthest mm",
    "islands bare",
    "in the air: places, mm",
    "sags: places, mm",
    "longest span mm",
    "inside mm²",
    "stands on part mm²",
    "touches mm²",
    "gap at flats mm",
    "slimness",
    "CPU s",
)

Slice = Callable[[Part], bytes]


@dataclass(frozen=True)
class Result:
    """One file.

    Attributes:
        part, plan, program: what was sliced, in which layers, by whom.
        figures: what was measured.
        cpu: s that supports add; nan if not measured.
    """

    part: str
    plan: str
    program: str
    figures: Figures
    cpu: float = float("nan")

    @property
    def is_ours(self) -> bool:
        """Whether our program wrote it."""
        return self.program in _OURS

    def line(self) -> str:
        """Return the row in Markdown."""
        one = self.figures
        gaps = [flat.gap for flat in one.flats]
        cells = [
            self.program,
            f"{one.grams:.2f}",
            f"{one.minutes:.1f} ({one.travel_minutes:.1f})",
            f"{one.bare:.1f} of {one.overhang:.0f}",
            f"{one.farthest:.1f}",
            f"{len(one.unsupported)} of {one.islands}",
            f"{len(one.floats)}, {one.floating:.0f}",
            f"{len(one.sags)}, {one.sagging:.0f}",
            f"{one.span:.1f}",
            f"{one.inside:.1f}",
            f"{one.standing:.0f}",
            f"{one.touching:.0f}",
            f"{min(gaps):.3f} / {median(gaps):.3f} / {max(gaps):.3f}" if gaps else "-",
            f"{one.slimness:.1f}",
            "-" if np.isnan(self.cpu) else f"{self.cpu:.2f}",
        ]
        return f"| {' | '.join(cells)} |"


@dataclass(frozen=True, eq=False)
class _Job:
    """A part to slice in one kind of layers."""

    part: Part
    plan: str
    solid: Solid
    truth: tuple[Overhang, list[Island]]


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table for each part, and the ratios to the best peers."""
    options = options_of(_parser(), argv)
    WORK.mkdir(exist_ok=True)
    prusa, cura, absent = find_peers()
    print(machine_note(), *absent, "Not equal:", *(f"- {one}" for one in NOT_EQUAL), sep="\n", flush=True)
    results: list[Result] = []
    for plan in options.plans.split(","):
        profile = _profile(options, plan)
        programs = _programs(plan, prusa, cura, options.set)
        wanted = options.programs.split(",") if options.programs else list(programs)
        if unknown := [name for name in wanted if name not in programs]:
            sys.exit(f"no program {', '.join(unknown)}; known programs: {', '.join(programs)}")
        chosen = [name for name in programs if name in wanted and not name.endswith("off")]
        for mesh in support_parts(options.models, options.parts, profile):
            job = _prepare(mesh, plan, profile)
            print(f"\n### {mesh.name}, {plan} layers\n\n| {' | '.join(_HEAD)} |\n|---{'|---:' * 14}|")
            cpu = _added_cpu(job, programs, chosen, options.rounds) if options.rounds else {}
            for name in chosen:
                results += _measure(job, name, programs[name], cpu, options)
            if options.json:  # after each part, because all take hours
                options.json.write_text(
                    json.dumps([asdict(one) for one in results], indent=1) + "\n", "utf-8"
                )
    print(*_summary(results), sep="\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("supports", __doc__)
    parser.add_argument("--plans", default="uniform", help="uniform, adaptive, or both (default: uniform)")
    parser.add_argument(
        "--programs", default="", help="only these programs, with commas between (default: all)"
    )
    parser.add_argument("--rounds", type=int, default=0, help="rounds for CPU times (default: 0, none)")
    parser.add_argument("--places", action="store_true", help="list places of faults below each table")
    return parser


def _profile(options: argparse.Namespace, plan: str) -> Profile:
    """Return the common profile for uniform or adaptive layers."""
    typed = dict(change.split("=", 1) for change in options.set)
    return load_profile(
        quality=_QUALITIES[plan], changes=layer_changes(plan, options.height, options.height) | typed
    )


def layer_changes(plan: str, height: float, first: float) -> dict[str, str | float]:
    """Return the settings of layers in common: uniform or adaptive ones.

    The planner is named because a layer height alone chooses uniform layers.
    """
    layers: dict[str, str | float] = {"planner.kind": _PLANNERS[plan], "layer_height": height}
    return layers | {"first_layer_height": first} | dict(_NO_EXTRAS)


def _prepare(mesh: Mesh, plan: str, profile: Profile) -> _Job:
    solid = Solid.of(mesh)
    quality = profile.quality
    overhang = find_overhang(
        solid,
        quality.support_threshold_deg,
        quality.support_max_bridge,
        quality.support_min_area,
        quality.support_min_reach,
    )
    highest = quality.layer_height if plan == "uniform" else profile.thickest
    return _Job(Part(mesh, profile, WORK), plan, solid, (overhang, find_islands(solid, highest)))


# Programs


def _programs(
    plan: str, prusa: PrusaSlicer | None, cura: CuraEngine | None, typed: Sequence[str] = ()
) -> dict[str, Slice]:
    """Return the programs that slice a part with supports, and "off" or "name, off" without.

    `typed` are changes of settings, KEY=VALUE, for our program; peers get theirs from the profile of the part.
    """
    found: dict[str, Slice] = {style: _our_slice(style, plan, typed) for style in (*_OURS, "off")}
    if prusa:
        found["Prusa, off"] = _prusa_slice(plan, "", False)
        for style in ("grid", "snug"):
            for skips in (False, True):
                found[f"Prusa {style}{' no bridges' if skips else ''}"] = _prusa_slice(plan, style, skips)
    if cura:
        found["Cura, off"] = _cura_slice(cura, plan, "")
        for structure in ("normal", "tree"):
            found[f"Cura {structure}"] = _cura_slice(cura, plan, structure)
    return found


def _our_slice(style: str, plan: str, typed: Sequence[str]) -> Slice:
    def slice_it(part: Part) -> bytes:
        target = part.folder / f"{part.mesh.name}.{plan}.{style}.gcode"
        quality = part.profile.quality
        changes = layer_changes(plan, quality.layer_height, quality.first_layer_height)
        if plan == "adaptive":
            del changes["layer_height"]  # our program accepts it for uniform layers only
        all_changes = [*(f"{key}={value}" for key, value in changes.items()), *typed, f"support={style}"]
        words = [word for change in all_changes for word in ("--set", change)]
        run(ours("slice", str(part.stl), "-o", str(target), "--quality", _QUALITIES[plan], *words))
        return target.read_bytes()

    return slice_it


def _prusa_slice(plan: str, style: str, skips: bool) -> Slice:
    def slice_it(part: Part) -> bytes:
        more = prusa_supports(part.profile, style, skip_bridges=skips) if style else {}
        peer = PrusaSlicer("classic", **more)
        height = part.profile.quality.layer_height
        printed = peer.uniform(part, height) if plan == "uniform" else peer.adaptive(part, 0.5)
        return printed.gcode.read_bytes()

    return slice_it


def _cura_slice(cura: CuraEngine, plan: str, structure: str) -> Slice:
    def slice_it(part: Part) -> bytes:
        more = cura_supports(part.profile, structure) if structure else {}
        height = part.profile.quality.layer_height
        printed = (
            cura.uniform(part, height, **more) if plan == "uniform" else cura.adaptive(part, 0.2, **more)
        )
        return printed.gcode.read_bytes()

    return slice_it


# Measuring


def _measure(
    job: _Job, name: str, slice_it: Slice, cpu: Mapping[str, float], options: argparse.Namespace
) -> list[Result]:
    """Measure the file of one program, print its row, and return the result; empty if it failed."""
    try:
        figures = _figures(job, slice_it(job.part))
    except RunError as error:
        print(f"| {name} | {str(error).splitlines()[0]} |", flush=True)
        return []
    result = Result(job.part.mesh.name, job.plan, name, figures, cpu.get(name, float("nan")))
    print(result.line(), flush=True)
    if options.places:
        for what in ("bare_places", "unsupported", "floats", "sags", "inside_places"):
            for one in getattr(figures, what)[:6]:
                print(
                    f"<!-- {name} {what}: z {one.z:.2f}, x {one.x:.1f}, y {one.y:.1f}, {one.amount:.2f} -->"
                )
    return [result]


def _figures(job: _Job, text: bytes) -> Figures:
    """Return the figures of a file; those of the same file, part and rules are kept."""
    sources = sorted(Path(__file__).parent.glob("support_*.py"))
    digest = sha256(text + repr(job.part.digest).encode())
    for path in sources:
        digest.update(path.read_bytes())
    kept = WORK / f"{job.part.mesh.name}.supports.{digest.hexdigest()[:16]}.json"
    if kept.exists():
        return _from_json(json.loads(kept.read_text("utf-8")))
    profile = job.part.profile
    file = read_supports(text, profile.material.filament_diameter)
    _require_position(file, job.part.mesh)
    figures = measure_supports(file, job.solid, job.truth, profile.material.density)
    kept.write_text(json.dumps(asdict(figures)), "utf-8")
    return figures


def _from_json(values: dict[str, object]) -> Figures:
    places = {
        name: [Place(**one) for one in values[name]]  # type: ignore[attr-defined]
        for name in ("bare_places", "unsupported", "floats", "sags", "inside_places")
    }
    flats = [Flat(**one) for one in values["flats"]]  # type: ignore[attr-defined]
    return Figures(**(values | places | {"flats": flats}))  # type: ignore[arg-type]


def _require_position(file: SupportFile, mesh: Mesh) -> None:
    """Raise RunError if the part is not at the place of the mesh."""
    ends = np.concatenate([file.part.begin, file.part.end])
    shift = (ends.min(axis=0) + ends.max(axis=0) - mesh.bounds[:, :2].sum(axis=0)) / 2
    if np.abs(shift).max() > _FARTHEST_SHIFT:
        raise RunError(f"the part is {shift.round(2).tolist()} mm from its place")


def _added_cpu(
    job: _Job, programs: Mapping[str, Slice], chosen: Sequence[str], rounds: int
) -> dict[str, float]:
    """Return the CPU time, s, of slicing with supports minus without, the least of each over the rounds.

    A round runs every program once, one after the other, so that other load affects all of them.
    """
    plain = {name: f"{name.split()[0]}, off" if name not in _OURS else "off" for name in chosen}
    runs = {name: programs[name] for name in (*dict.fromkeys(plain.values()), *chosen)}
    costs: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, slice_it in runs.items():
            with TemporaryDirectory() as folder:
                part = Part(job.part.mesh, job.part.profile, Path(folder))
                assert part.stl.exists()
                begun = getrusage(RUSAGE_CHILDREN)
                try:
                    slice_it(part)
                except RunError:
                    costs[name].append(float("inf"))  # its row says so
                ended = getrusage(RUSAGE_CHILDREN)
            costs[name].append(ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime)
    return {name: min(costs[name]) - min(costs[plain[name]]) for name in chosen}


# Ratios


def _summary(results: Sequence[Result]) -> list[str]:
    """Return the ratios of our files to the best peers with as little bare area, and their medians."""
    lines = [
        "",
        "### Ratios to the best peer that leaves no more bare (plus 1 % of the overhang) and no more islands",
        "",
        "| part, layers | style | grams | minutes | bare mm² - best peer's | standing | touching |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    all_ratios: dict[str, list[tuple[float, float]]] = {}
    for one in (one for one in results if one.is_ours):
        peers = [
            other
            for other in results
            if not other.is_ours and (other.part, other.plan) == (one.part, one.plan)
        ]
        if not peers:
            continue
        mine = one.figures
        equal = [other.figures for other in peers if _leaves_no_more(other.figures, mine)]
        least_bare = min(other.figures.bare for other in peers)
        grams, minutes, standing, touching = (
            min((getattr(other, what) for other in equal), default=float("nan"))
            for what in ("grams", "minutes", "standing", "touching")
        )
        ratios = mine.grams / max(grams, 1e-9), mine.minutes / max(minutes, 1e-9)
        if grams > 0:
            all_ratios.setdefault(one.program, []).append(ratios)
        lines.append(
            f"| {one.part}, {one.plan} | {one.program} | {ratios[0]:.2f} | {ratios[1]:.2f} "
            f"| {mine.bare - least_bare:+.1f} | {mine.standing:.0f} / {standing:.0f} "
            f"| {mine.touching:.0f} / {touching:.0f} |"
        )
    for style, ratios_of in all_ratios.items():
        grams_of, minutes_of = (sorted(one[k] for one in ratios_of) for k in (0, 1))
        lines.append(
            f"\n{style}: median of {len(ratios_of)}: grams {median(grams_of):.2f} (most {grams_of[-1]:.2f}), "
            f"minutes {median(minutes_of):.2f} (most {minutes_of[-1]:.2f})"
        )
    sums = {one.program: 0.0 for one in results if not np.isnan(one.cpu)}
    for one in results:
        if one.program in sums:
            sums[one.program] += one.cpu
    if sums:
        said = ", ".join(f"{name} {seconds:.2f}" for name, seconds in sums.items())
        lines.append(f"\nCPU time that supports add, sum over the files, s: {said}")
    return lines


def _leaves_no_more(theirs: Figures, mine: Figures) -> bool:
    """Return whether a peer's file holds as much as ours."""
    return theirs.bare <= mine.bare + _EQUAL_BARE * mine.overhang and len(theirs.unsupported) <= len(
        mine.unsupported
    )


if __name__ == "__main__":
    sys.exit(main())
