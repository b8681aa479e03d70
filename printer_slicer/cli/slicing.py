"""`slice` and `plan`."""

from __future__ import annotations

import argparse
import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.cli.common import profile_from, say, stages, write_file
from printer_slicer.cli.facts import facts_of, runs_text, sentences
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
    from printer_slicer.cli.facts import facts_of, runs_text, sentences
from printer_slicer.cli.common import Stages

__all__ = ["plan_command", "slice_command"]


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
    facts = facts_of(mesh, stage, profile, seconds)
    if arguments.json:
        print(json.dumps({"output": str(output), **facts}))
    elif str(output) != "-":
        first, *more = sentences(facts, arguments.set)
        say(arguments, "\n  ".join([f"{output}: {first}", *more]))
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
        chosen = plan_layers(part, profile) if arguments.picture or arguments.json else None
        if chosen is not None and arguments.picture:
            from printer_slicer.drawing import draw_plan

            sections = cut(part, chosen, profile.quality.resolution)
            write_file(arguments.picture, draw_plan(sections, arguments.model.name).encode())
    table = _table_1(mesh)
    if chosen is not None and arguments.json:
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
        lines.append(f"  {row['plan']:<24}{layers}{time}   {runs_text(heights)}")
    return "\n".join(lines)


def _percent(share: object) -> str:
    return f"{float(str(share)) * 100:.1f} %"
