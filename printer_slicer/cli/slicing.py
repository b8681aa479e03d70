"""`slice` and `plan`."""

from __future__ import annotations

import argparse
import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.cli.common import profile_from, say, stages, write_file
from printer_slicer.errors import UsageError
from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode import spoken
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh, Program
from printer_slicer.pipeline import gcode_of, slice_part, slice_stages
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, profile_with
from printer_slicer.slicing import cut

if TYPE_CHECKING:
    from printer_slicer.cli.common import Stages

__all__ = ["plan_command", "slice_command"]

_WORTH_SAYING = 0.002  # share of the part
_MOST_RUNS = 6  # stretches of equal height shown per plan


def slice_command(arguments: argparse.Namespace) -> int:
    """Slice a model and write the G-code."""
    profile = profile_from(arguments)
    _refuse_mixing(arguments)
    with stages(arguments) as report:
        report("loading")
        mesh = load_mesh(arguments.model)
        output = arguments.output or arguments.model.with_suffix(".gcode")
        _refuse_same(output, arguments.model)
        stage = slice_stages(mesh, profile, report=report)
        program = stage.program
        report("writing")
        seconds = float(move_seconds(program, profile).sum())
        if arguments.picture:
            _draw_layer(program, arguments.layer, arguments.picture)
        write_file(output, gcode_of(program, profile, seconds=seconds))
    facts = _facts(program, profile, seconds, mesh.volume)
    facts["lost_mm3"] = round(float((stage.walls.lost * program.plan.height).sum()), 3)
    facts["empty_layers"] = program.plan.n_layers - len(program.printed)
    facts["open_edges"], facts["gaps"] = (
        stage.sections.open_edges,
        [asdict(gap) for gap in stage.sections.gaps[:10]],
    )
    if arguments.json:
        print(json.dumps({"output": str(output), **facts}))
    elif str(output) != "-":
        _tell(arguments, output, facts)
    return 0


def _refuse_mixing(arguments: argparse.Namespace) -> None:
    """Only one thing can go to stdout."""
    wants = {"-o": getattr(arguments, "output", None), "--picture": arguments.picture}
    there = [f"{flag} -" for flag, path in wants.items() if str(path) == "-"]
    there += ["--json"] if arguments.json else []
    if len(there) > 1:
        raise UsageError(f"{' and '.join(there)} both want stdout", remedy="write one of them to a file")


def _refuse_same(output: Path, model: Path) -> None:
    """Never write over the model."""
    # Names that cannot be are refused when they are written to.
    with contextlib.suppress(OSError, ValueError):
        if not output.samefile(model):
            return
        raise UsageError(f"{output}: is the model itself", remedy="name another output with -o")


def _facts(program: Program, profile: Profile, seconds: float, volume: float) -> dict[str, object]:
    """What people want to know about a sliced part."""
    area = np.pi * profile.material.filament_diameter**2 / 4
    return {
        "layers": program.plan.n_layers,
        "planner": program.plan.planner,
        "heights": [[count, height] for count, height in program.plan.runs()],
        "seconds": round(seconds, 3),
        "filament_mm": round(program.filament_used, 3),
        "filament_g": round(program.filament_used * area / 1000 * profile.material.density, 3),
        "moves": program.n_moves,
        "volume_mm3": round(volume, 3),
    }


def _tell(arguments: argparse.Namespace, output: Path, facts: dict[str, object]) -> None:
    heights = facts["heights"]
    assert isinstance(heights, list)
    say(arguments, f"{output}: {facts['layers']} layers ({_runs([(n, h) for n, h in heights])})")
    say(
        arguments,
        f"  {spoken(float(str(facts['seconds'])))} of printing, {float(str(facts['filament_mm'])) / 1000:.2f} m"
        f" of filament, {facts['filament_g']} g",
    )
    if facts["planner"] != "uniform" and any(
        change.removeprefix("quality.").startswith("layer_height") for change in arguments.set
    ):
        say(
            arguments,
            f"  layer_height has no effect: planner {facts['planner']} chooses heights; see --planner uniform",
        )
    if facts["empty_layers"]:
        say(arguments, f"  {facts['empty_layers']} layers stay empty: the part is narrower than a bead there")
    if float(str(facts["lost_mm3"])) > _WORTH_SAYING * float(str(facts["volume_mm3"])):
        say(arguments, f"  {facts['lost_mm3']} mm3 of the part are too narrow for a bead and stay empty")
    if facts["open_edges"]:
        gaps = facts["gaps"]
        assert isinstance(gaps, list)
        widest = f"; the widest gap closed is {gaps[0]['width']:g} mm at z {gaps[0]['z']:g}" if gaps else ""
        say(arguments, f"  the mesh is not closed: {facts['open_edges']} edges without a neighbour{widest}")


def _draw_layer(program: Program, number: int, path: Path) -> None:
    from printer_slicer.drawing import draw_layer

    if not 1 <= number <= program.plan.n_layers:
        raise UsageError(f"--layer {number}: the part has layers 1 to {program.plan.n_layers}")
    write_file(path, draw_layer(program, number - 1).encode())


def plan_command(arguments: argparse.Namespace) -> int:
    """Compare the chosen layer plan with uniform ones: the tables of the paper for any part."""
    _refuse_mixing(arguments)
    profile = profile_from(arguments)
    with stages(arguments) as report:
        report("loading")
        mesh = load_mesh(arguments.model)
        part = place(mesh, profile.printer)
        rows = _compare(part, profile, report)
        if arguments.picture:
            from printer_slicer.drawing import draw_plan

            chosen = plan_layers(part, profile)
            sections = cut(part, chosen, profile.quality.resolution)
            write_file(arguments.picture, draw_plan(sections, arguments.model.name).encode())
    table = _table_1(mesh)
    if arguments.json:
        chosen = plan_layers(part, profile)
        layers = {name: getattr(chosen, name).tolist() for name in ("bottom", "top", "cut")}
        print(json.dumps({"part": table, "plans": rows, "layers": layers}))
    elif not arguments.quiet:
        print(_as_text(arguments.model.name, table, rows))
    return 0


def _table_1(mesh: Mesh) -> dict[str, object]:
    """The paper's Table 1: what the file holds."""
    levels = np.unique(np.round(mesh.triangles[:, :, 2], 6))
    return {
        "vertices": 3 * mesh.n_facets,
        "facets": mesh.n_facets,
        "levels": len(levels),
        "level_steps": [round(float(step), 6) for step in np.diff(levels[:50], prepend=levels[0])],
        "size": [round(float(length), 6) for length in mesh.size],
        "volume": round(mesh.volume, 6),
    }


def _compare(part: Mesh, profile: Profile, report: Stages) -> list[dict[str, object]]:
    """The paper's Table 2: uniform thin, uniform thick, and the plan of the profile, with modelled time."""
    thin, thick = profile.thinnest, profile.thickest
    chosen = profile.quality.planner.__struct_config__.tag
    jobs: dict[str, Profile] = {
        f"uniform {height:g} mm": profile_with(
            profile, {"quality.planner.kind": "uniform", "quality.layer_height": height}
        )
        for height in sorted(
            {thin, thick} if chosen != "uniform" else {thin, thick, profile.quality.layer_height}
        )
    }
    if chosen != "uniform":
        jobs[f"{chosen} {thin:g} to {thick:g} mm"] = profile
    rows: list[dict[str, object]] = []
    slowest = 0.0
    for name, variant in jobs.items():
        report(f"planning {name}")
        program = slice_part(part, variant)
        seconds = float(move_seconds(program, variant).sum())
        slowest = slowest or seconds
        most = int(str(rows[0]["layers"])) if rows else program.plan.n_layers
        rows.append(
            {
                "plan": name,
                "layers": program.plan.n_layers,
                "heights": [[n, h] for n, h in program.plan.runs()],
                "seconds": round(seconds, 3),
                "layers_saved": round(1 - program.plan.n_layers / most, 4),
                "time_saved": round(1 - seconds / slowest, 4),
                "filament_mm": round(program.filament_used, 3),
            }
        )
    return rows


def _as_text(name: str, table: dict[str, object], rows: list[dict[str, object]]) -> str:
    size, steps = table["size"], table["level_steps"]
    assert isinstance(size, list)
    assert isinstance(steps, list)
    shown = ", ".join(f"{step:g}" for step in steps[:8]) + (", ..." if len(steps) > 8 else "")
    lines = [
        f"Table 1. {name}",
        f"  STL vertices      {table['vertices']}",
        f"  facets            {table['facets']}",
        f"  levels in z       {table['levels']} ({shown} mm, each from the one before)",
        f"  envelope          {' x '.join(f'{length:g}' for length in size)} mm",
        f"  volume            {table['volume']} mm3",
        "",
        "Table 2. Layer plans; time is modelled for the chosen printer, material and quality",
        f"  {'plan':<24}{'layers':>8}{'saved':>9}{'time':>14}{'saved':>9}   heights from the bed up",
    ]
    for row in rows:
        heights = row["heights"]
        assert isinstance(heights, list)
        layers = f"{row['layers']:>8}{_percent(row['layers_saved']):>9}"
        time = f"{spoken(float(str(row['seconds']))):>14}{_percent(row['time_saved']):>9}"
        lines.append(f"  {row['plan']:<24}{layers}{time}   {_runs([(n, h) for n, h in heights])}")
    return "\n".join(lines)


def _percent(share: object) -> str:
    return f"{float(str(share)) * 100:.1f} %"


def _runs(runs: list[tuple[int, float]]) -> str:
    """`75 x 0.4, 225 x 0.1 mm`, shortened when there are many."""
    if len(runs) > _MOST_RUNS:
        heights = [height for _, height in runs]
        return f"{len(set(heights))} heights from {min(heights):g} to {max(heights):g} mm"
    return ", ".join(f"{count} x {height:g}" for count, height in runs) + " mm"
