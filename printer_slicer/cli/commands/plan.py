"""`plan`: compare layer plans of a part, and certify the chosen one."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.matrix import add_matrix_option, load_combinations
from printer_slicer.cli.opening import add_open_option, open_files
from printer_slicer.cli.output import (
    Milestones,
    check_outputs,
    describe_picture,
    show_stages,
    warn,
    write_file,
)
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import UsageError
from printer_slicer.texts import format_duration, format_significant
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.cli.output import StageReport
    from printer_slicer.model import Mesh, ObjectStack, Sections
    from printer_slicer.profile import Profile
    from printer_slicer.surface import Certificate

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer plan part.stl --picture plan.png
  printer-slicer plan part.stl --compare --printer creality_ender3
  printer-slicer plan part.stl --tolerance 0.05 --heights 0.1:0.3:0.02
  printer-slicer plan part.stl --matrix tolerance=0.02,0.05 --matrix layer_height=0.2,0.3
  printer-slicer plan part.stl --paper-tables
  printer-slicer plan part.stl --time-budget 45m --range 10:12:tolerance=0.03"""

_NAME_WIDTH: Final = 24  # characters, at least
_MAX_STACK_WIDTH: Final = 44  # characters; longer names of objects are cut off

# Variants of the planners: name in the table -> changes to the profile.
_VARIANTS: Mapping[str, dict[str, object]] = {
    "area, literal": {"kind": "area", "aligned": False, "guarded": False},
    "area, guarded": {"kind": "area", "aligned": False, "guarded": True},
    "area, aligned": {"kind": "area", "aligned": True, "guarded": False},
    "cusp": {"kind": "cusp", "metric": "cusp"},
    "cusp, triangle": {"kind": "cusp", "metric": "triangle"},
    "cusp, wasserfall": {"kind": "cusp", "metric": "wasserfall"},
    "cusp, topography": {"kind": "cusp", "metric": "topography"},
    "stepwise": {"kind": "stepwise"},
    "genetic": {"kind": "genetic"},
    "optimal, layers": {"kind": "optimal", "objective": "layers"},
    "optimal, time": {"kind": "optimal", "objective": "time"},
    "optimal, balanced": {"kind": "optimal", "objective": "balanced"},
    "optimal, volume": {"kind": "optimal", "objective": "volume"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    parser.add_argument(
        "--compare",
        action="store_true",
        help="compare all planners, with the same tolerance and layer heights",
    )
    mark_advanced(add_matrix_option(parser, "plan"))
    mark_advanced(
        parser.add_argument(
            "--paper-tables",
            action="store_true",
            help="print tables like tables 1 and 2 of the paper behind this program: the part, and its layer plans",
        )
    )
    add_setting_options(parser, strict_help=STRICT_HELP)
    add_model_options(parser)
    group = parser.add_argument_group("output")
    group.add_argument("--picture", metavar="FILE", type=Path, help="draw the plan, as .svg or .png")
    add_output_options(parser, group)
    add_open_option(group)
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Compare layer plans of a part: of some planners, or with all combinations of settings."""
    check_outputs(arguments)
    return _run_matrix(arguments) if arguments.matrix else _run_planners(arguments)


def _run_planners(arguments: argparse.Namespace) -> int:
    """Compare layer plans of a part, and print the certificate of the chosen plan."""
    import numpy as np

    from printer_slicer.cli.models import apply_projects, load_repaired_plate
    from printer_slicer.facts.slicing import collect_certificate_facts, list_repair_facts
    from printer_slicer.healing import require_no_repair
    from printer_slicer.model import Repairs, stack_sections
    from printer_slicer.pipeline import plan_objects
    from printer_slicer.placing import place
    from printer_slicer.slicing import cut, list_section_repairs
    from printer_slicer.surface import certify_stacks

    profile = load_selected_profile(arguments)
    with show_stages(arguments) as report:
        mesh, plate, repairs = load_repaired_plate(arguments, profile, report)
        profile, plate = apply_projects(arguments, profile, mesh, plate)
        table = _collect_mesh_facts(mesh)
        part = place(mesh, profile.printer, plate.placement)
        shift = np.asarray(mesh.bounds[0] - part.bounds[0])
        del mesh
        unused = _warn_of_unused_settings(arguments, part, profile)
        report("planning")
        chosen = plan_objects(part, profile)
        certificate = certify_stacks(chosen)
        cuts = [cut(one.mesh, one.plan, profile.quality.resolution) for one in chosen]
        repairs = Repairs((*repairs.done, *list_section_repairs(stack_sections(cuts), shift)))
        if arguments.strict:
            require_no_repair(part.name, repairs)
        rows = _compare_plans(
            part, profile, chosen, _make_progress_callback(arguments, report), everything=arguments.compare
        )
        if arguments.picture:
            report("drawing")
            _draw_plan(part, cuts, certificate, profile, arguments)
    facts = collect_certificate_facts(
        certificate, chosen, profile, shift, _find_print_time(rows, _format_plan_name(profile))
    ) | {"thin_features": _measure_thin_features(chosen)}
    repaired = list_repair_facts(repairs)
    if arguments.json:
        plans = {"part": table, "plans": rows, "certificate": facts}
        plans |= {"layers": _list_layer_facts(certificate), "repairs": repaired}
        plans |= plate.collect_facts() | {"warnings": [*plate.warnings, *unused]}
        print(json.dumps(plans | collect_profile_facts(arguments)))
    elif not arguments.quiet:
        print(_format_plans(arguments, table, rows))
        print("\n".join(_format_certificate(arguments, _format_plan_name(profile), facts, repaired)))
    return 0


def _warn_of_unused_settings(arguments: argparse.Namespace, part: Mesh, profile: Profile) -> list[str]:
    """Print and return the warnings about settings of the planner that have no effect."""
    from printer_slicer.facts.findings import list_planning_warnings

    found = list_planning_warnings(part, profile)
    warn(arguments, found)
    return found


def _run_matrix(arguments: argparse.Namespace) -> int:
    """Plan a part with all combinations of settings, and mark the plans that no other beats."""
    from printer_slicer.batching.matrix import find_unbeaten_rows
    from printer_slicer.cli.models import apply_projects, load_repaired_plate
    from printer_slicer.pipeline import plan_objects
    from printer_slicer.placing import place

    for flag, value in (
        ("--compare", arguments.compare),
        ("--paper-tables", arguments.paper_tables),
        ("--picture", arguments.picture),
    ):
        if value:
            raise UsageError(f"--matrix: {flag} shows one set of settings only", remedy=f"Leave out {flag}")
    combinations = load_combinations(arguments)
    rows: list[dict[str, Any]] = []
    with show_stages(arguments) as report:
        mesh, plate, _ = load_repaired_plate(arguments, combinations[0].profile, report)
        show = _make_progress_callback(arguments, report)
        for done, one in enumerate(combinations):
            name = " ".join(f"{key}={value}" for key, value in one.choices.items())
            show(done, len(combinations), name)
            profile, plate = apply_projects(arguments, one.profile, mesh, plate)
            plate = replace(plate, tells=False)
            part = place(mesh, profile.printer, plate.placement)
            row = _measure_plan(part, profile, plan_objects(part, profile))
            rows.append({"plan": name, "choices": dict(one.choices), **row})
    rows = [row | {"best": mark} for row, mark in zip(rows, find_unbeaten_rows(rows), strict=True)]
    if arguments.json:
        print(json.dumps({"plans": rows} | plate.collect_facts() | collect_profile_facts(arguments)))
    elif not arguments.quiet:
        print(_format_matrix(arguments, rows))
    return 0


def _format_matrix(arguments: argparse.Namespace, rows: Sequence[Mapping[str, Any]]) -> str:
    """Format the plans of all combinations of settings as a table."""
    from printer_slicer.cli.models import format_model_names

    shown = [{**row, "plan": f"{'*' if row['best'] else ' '} {row['plan']}"} for row in rows]
    note = "  *: no other plan has less print time, deviation and volume error"
    return "\n".join([_format_comparison(format_model_names(arguments.models), shown), note])


def _find_print_time(rows: list[dict[str, object]], name: str) -> float:
    """Return the print time, s, of the plan with this name."""
    return next(float(str(row["seconds"])) for row in rows if row["plan"] == name)


def _format_certificate(
    arguments: argparse.Namespace, plan: str, facts: dict[str, Any], repairs: list[dict[str, Any]]
) -> list[str]:
    """Format the certificate of the chosen plan, the repairs of the part, and the name of the picture."""
    from printer_slicer.facts.slicing import format_certificate_sentences, format_repair_sentences

    lines = [*format_certificate_sentences(facts), *format_repair_sentences(repairs)]
    shown = describe_picture(arguments.picture, "the chosen plan")
    return ["", f"Certificate of the chosen plan ({plan}):", *(f"  {line}" for line in lines), *shown]


def _list_layer_facts(certificate: Certificate) -> dict[str, list[float]]:
    """List bottom, top and cut height of each layer, mm, with bounds of its deviation and volume error, for JSON."""
    import numpy as np

    layers = {name: getattr(certificate.plan, name).tolist() for name in ("bottom", "top", "cut")}
    return layers | {name: np.round(getattr(certificate, name), 6).tolist() for name in ("bound", "volume")}


def _measure_thin_features(stacks: Sequence[ObjectStack]) -> dict[str, float]:
    """Measure features thinner than a layer: their area, mm² seen from above, and the z near which most of it lies."""
    from printer_slicer.slicing import cut
    from printer_slicer.surface import read_surface, thin_areas

    if stacks[0].plan.containment != "mid":
        return {"area_mm2": 0.0, "z": 0.0}
    areas = [thin_areas(read_surface(one.mesh), cut(one.mesh, one.plan, 0.0)) for one in stacks]
    most, plan = max(zip(areas, (one.plan for one in stacks), strict=True), key=lambda pair: pair[0].sum())
    total = sum(float(area.sum()) for area in areas)
    return {"area_mm2": round(total, 3), "z": round(float(plan.bottom[most[:-1].argmax()]), 4)}


def _draw_plan(
    part: Mesh,
    cuts: Sequence[Sections],
    certificate: Certificate,
    profile: Profile,
    arguments: argparse.Namespace,
) -> None:
    """Draw the chosen plan to the file of --picture."""
    from printer_slicer.cli.models import format_model_names
    from printer_slicer.drawing import draw_plan, encode_picture
    from printer_slicer.model import stack_sections
    from printer_slicer.surface import find_flats

    bounded = certificate.plan.planner not in ("uniform", "area")
    picture = draw_plan(
        stack_sections(cuts),
        certificate,
        format_model_names(arguments.models),
        tolerance=profile.quality.tolerance if bounded else None,
        flats=find_flats(part)[0],
        stacks=cuts,
    )
    write_file(arguments.picture, encode_picture(picture, arguments.picture))
    open_files(arguments, [arguments.picture])


def _collect_mesh_facts(mesh: Mesh) -> dict[str, object]:
    """Return the facts about the mesh in Table 1 of the paper."""
    import numpy as np

    levels = np.unique(np.round(mesh.triangles[:, :, 2], 6))
    return {
        "vertices": 3 * mesh.n_facets,
        "facets": mesh.n_facets,
        "levels": len(levels),
        "level_steps": [round(float(step), 6) for step in np.diff(levels[:50], prepend=levels[0])],
        "size": [round(float(length), 6) for length in mesh.size],
        "volume": round(mesh.volume, 6),
    }


_Progress = Callable[[int, int, str], None]
"""Called before each plan with the number of finished plans, the number of plans, and the name of the next."""


def _make_progress_callback(arguments: argparse.Namespace, report: StageReport) -> _Progress:
    """Return a function that reports the next plan: on the progress bar, or as a line per plan if there is no bar."""
    quiet = arguments.quiet or arguments.json or arguments.verbose or not arguments.compare
    lines = Milestones("comparing plans", wanted=not (quiet or sys.stderr.isatty()))

    def report_plan(done: int, total: int, name: str) -> None:
        """Report the name of the next plan, and how many are done."""
        report(f"planning {name}")
        lines.report_if_due(done, total, lambda: f"{done} of {total} plans done, next: {name}")

    return report_plan


def _compare_plans(
    part: Mesh, profile: Profile, chosen: Sequence[ObjectStack], show: _Progress, *, everything: bool
) -> list[dict[str, Any]]:
    """Return a row for each plan: the uniform plans, those of all planners if `everything`, and the chosen plan."""
    from printer_slicer.pipeline import plan_objects

    rows: list[dict[str, Any]] = []
    jobs = _make_profiles_to_compare(profile, everything=everything)
    for done, (name, variant) in enumerate(jobs.items()):
        show(done, len(jobs), name)
        stacks = chosen if variant is profile else plan_objects(part, variant)
        row = _measure_plan(part, variant, stacks)
        first = rows[0] if rows else row
        saved = {
            "layers_saved": round(1 - row["layers"] / first["layers"], 4),
            "time_saved": round(1 - row["seconds"] / first["seconds"], 4),
        }
        rows.append({"plan": name, **row, **saved})
    return rows


def _measure_plan(part: Mesh, profile: Profile, stacks: Sequence[ObjectStack]) -> dict[str, Any]:
    """Return layers, print time and certified errors of a plan; the print time is that of the sliced part."""
    from printer_slicer.extrusion import move_seconds
    from printer_slicer.facts.slicing import find_largest_flat_error
    from printer_slicer.facts.stacks import collect_stack_facts
    from printer_slicer.object_plans import list_stack_plans
    from printer_slicer.pipeline import slice_part
    from printer_slicer.surface import certify_stacks, find_flats

    program = slice_part(part, profile, plan=list_stack_plans(stacks))
    certificate = certify_stacks(stacks)
    flat_errors = [find_largest_flat_error(find_flats(one.mesh)[0], one.plan) for one in stacks]
    return {
        "layers": certificate.plan.n_layers,
        "heights": [[n, h] for n, h in certificate.plan.runs()],
        "seconds": round(float(move_seconds(program, profile).sum()), 3),
        "filament_mm": round(program.filament_used, 3),
        "max_error_mm": round(certificate.max_error, 6),
        "volume_error_mm3": round(certificate.volume_error, 3),
        "height_error_mm": round(certificate.overshoot - certificate.missing, 6),
        "flat_error_mm": round(max(flat_errors), 6),
        "stacks": collect_stack_facts(certificate),
    }


def _make_profiles_to_compare(profile: Profile, *, everything: bool) -> dict[str, Profile]:
    """Map names in the table to profiles, all of which have the same tolerance and layer heights."""
    from printer_slicer.profile import profile_with

    thin, thick = profile.thinnest, profile.thickest
    kind = profile.quality.planner.__struct_config__.tag
    heights = {thin, thick} if kind != "uniform" else {thin, thick, profile.quality.layer_height}
    jobs = {
        _format_uniform_name(height): profile_with(
            profile, {"quality.planner.kind": "uniform", "quality.layer_height": height}
        )
        for height in sorted(heights)
    }
    if kind == "uniform":
        jobs[_format_plan_name(profile)] = profile
    if everything:
        for name, changes in _VARIANTS.items():
            jobs[name] = profile_with(
                profile, {f"quality.planner.{key}": value for key, value in changes.items()}
            )
    if kind != "uniform":
        jobs[_format_plan_name(profile)] = profile
    return jobs


def _format_plan_name(profile: Profile) -> str:
    """Return the name of the chosen plan in the table."""
    kind = profile.quality.planner.__struct_config__.tag
    if kind == "uniform":
        return _format_uniform_name(profile.quality.layer_height)
    return f"{kind} {profile.thinnest:g} to {profile.thickest:g} mm"


def _format_uniform_name(height: float) -> str:
    """Format the name of a uniform plan in the table."""
    return f"uniform {height:g} mm"


def _format_plans(
    arguments: argparse.Namespace, table: Mapping[str, Any], rows: list[dict[str, object]]
) -> str:
    """Format the comparison of plans: as one table, or with --paper-tables as the tables of the paper."""
    from printer_slicer.cli.models import format_model_names

    name = format_model_names(arguments.models)
    return (
        _format_paper_tables(name, table, rows) if arguments.paper_tables else _format_comparison(name, rows)
    )


def _format_comparison(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Format the comparison of plans as a table."""
    stacks = [min(len(one["objects"]) + 2, _MAX_STACK_WIDTH) for row in rows for one in row["stacks"]]
    width = max(_NAME_WIDTH, *(len(row["plan"]) for row in rows), *stacks)
    columns = f"{'layers':>7}{'print time':>14}{'deviation':>13}{'volume error':>15}   layer heights"
    head = f"  {'plan':<{width}}{columns}"
    return "\n".join([f"{name}: layer plans", head, *(_format_comparison_row(row, width) for row in rows)])


def _format_comparison_row(row: Mapping[str, Any], width: int) -> str:
    """Format a plan as a line of the table, followed by a line for each stack if there are several."""
    stacks = [_format_plan_row({"plan": f"  {one['objects']}", **one}, "", width) for one in row["stacks"]]
    return "\n".join([_format_plan_row(row, format_duration(row["seconds"]), width), *stacks])


def _format_plan_row(row: Mapping[str, Any], duration: str, width: int) -> str:
    """Format the numbers of a plan and its print time as a line."""
    from printer_slicer.facts.slicing import format_runs

    deviation = f"{format_significant(row['max_error_mm'])} mm"
    volume = f"{format_significant(row['volume_error_mm3'])} mm³"
    numbers = f"{row['layers']:>7}{duration:>14}{deviation:>13}{volume:>15}"
    return f"  {row['plan']:<{width}.{width}}{numbers}   {format_runs(row['heights'])}"


def _format_paper_tables(name: str, table: Mapping[str, Any], rows: list[dict[str, object]]) -> str:
    """Format the two tables of the paper."""
    size, steps = table["size"], table["level_steps"]
    shown = ", ".join(f"{step:g}" for step in steps[:8]) + (", ..." if len(steps) > 8 else "")
    columns = f"{'layers':>8}{'saved':>9}{'time':>14}{'saved':>9}"
    columns += f"{'deviation':>11}{'volume':>9}{'top':>9}{'flats':>10}"
    lines = [
        f"Table 1. {name}",
        f"  STL vertices      {table['vertices']}",
        f"  facets            {table['facets']}",
        f"  levels in z       {table['levels']} (steps between them: {shown} mm)",
        f"  envelope          {' x '.join(f'{length:g}' for length in size)} mm",
        f"  volume            {table['volume']} mm³",
        "",
        "Table 2. Layer plans. Times are estimates for the printer, material and quality; deviation (mm) and volume",
        "error (mm³) are upper bounds; top, flats: distance of the part's top and flats from a layer boundary (mm)",
        f"  {'plan':<24}{columns}   layer heights from the bed up",
    ]
    return "\n".join(lines + [_format_paper_row(row) for row in rows])


def _format_paper_row(row: Mapping[str, Any]) -> str:
    from printer_slicer.facts.slicing import format_runs

    layers = f"{row['layers']:>8}{100 * row['layers_saved']:>7.1f} %"
    time = f"{format_duration(row['seconds']):>14}{100 * row['time_saved']:>7.1f} %"
    error = f"{row['max_error_mm']:>11.3f}{row['volume_error_mm3']:>9.1f}"
    ends = f"{row['height_error_mm']:>9.3f}{row['flat_error_mm']:>10.3f}"
    return f"  {row['plan']:<24}{layers}{time}{error}{ends}   {format_runs(row['heights'])}"
