"""`check`: analyse a G-code file before it is printed, and compare it with its model."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    add_machine_options,
    add_model_options,
    add_output_options,
    parse_factor,
    parse_length,
    parse_positive_integer,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.inputs import reject_non_gcode
from printer_slicer.cli.output import (
    check_outputs,
    describe_picture,
    print_text,
    sanitize,
    show_stages,
    write_file,
)
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.cli.several_files import FilesAction, run_for_each_file
from printer_slicer.cli.unused_options import reject_options_without_model
from printer_slicer.diagnostics import as_former_json, as_json, format_first_error, sentence
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.texts import format_count, format_duration
from printer_slicer.values import Struct, as_dict, replace

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.diagnostics import Diagnostic
    from printer_slicer.inspection.coverage.limits import CoverageLimits
    from printer_slicer.inspection.coverage.measurement import Coverage
    from printer_slicer.inspection.coverage.model_check import Check
    from printer_slicer.inspection.dry_run.underruns import Underrun, UnderrunReport
    from printer_slicer.jobs import Job
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer check part.gcode                    commands, temperatures, moves, speeds
  printer-slicer check *.gcode                       one line per file
  printer-slicer check part.gcode --link 115200      find buffer underruns at this baud rate
  printer-slicer check part.gcode --model part.stl   compare the extrusions with the part
  printer-slicer check part.gcode --model part.stl --picture faults.png --json
  printer-slicer check part.gcode --model part.stl --limit underfilled=0.95 --limit unsupported=5
  printer-slicer check plate.gcode --model lid.stl box.3mf --rotate 90 --filament 2.85"""
_MAX_LISTED = 8  # findings
_MAX_DRAWN = 4  # layers
_FORMER_LIMIT_NAMES: Final = {
    "air": "unsupported",
    "under": "underfilled",
    "over": "overfilled",
}  # names in versions up to 0.2
_ADVISED_SHARE: Final = 0.95  # of the link's throughput


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    parser.add_argument(
        "gcode",
        metavar="FILE.gcode",
        type=Path,
        nargs="+",
        action=FilesAction,
        help="G-code of any slicer; of several files, one line each",
    )
    group = parser.add_argument_group("machine")
    add_machine_options(group)
    _add_link_options(group)
    add_model_options(parser, flag="--model", meaning="compare the G-code with these models")
    _add_comparison_options(parser.add_argument_group("comparison with the model"))
    group = parser.add_argument_group("output")
    group.add_argument(
        "--picture", metavar="FILE", type=Path, help="with --model: draw the worst layers, as .svg or .png"
    )
    add_output_options(parser, group)
    parser.set_defaults(strict=False)


def _add_link_options(group: argparse._ArgumentGroup) -> None:
    """Add the options for the serial link."""
    group.add_argument(
        "--link",
        metavar="BAUD",
        type=parse_positive_integer,
        help="find buffer underruns on a serial link with this baud rate",
    )
    mark_advanced(
        group.add_argument(
            "--latency",
            metavar="MS",
            type=parse_factor,
            default=1.0,
            help="latency of acknowledgements in ms; often 16 with USB serial chips; default: 1",
        )
    )
    mark_advanced(
        group.add_argument(
            "--window",
            metavar="LINES",
            type=parse_positive_integer,
            default=2,
            help="maximum number of lines sent but not yet acknowledged; default: 2",
        )
    )


def _add_comparison_options(group: argparse._ArgumentGroup) -> None:
    """Add the options for the comparison with the model."""
    mark_advanced(
        group.add_argument(
            "--filament",
            metavar="MM",
            type=parse_length,
            help="filament diameter; default: the diameter in the G-code file, or 1.75",
        )
    )
    mark_advanced(
        group.add_argument(
            "--shell",
            metavar="MM",
            type=parse_length,
            help="depth of the shell, from the outline inwards; default: the depth of the perimeters in the file",
        )
    )
    mark_advanced(
        group.add_argument(
            "--skin",
            metavar="MM",
            type=parse_factor,
            default=0.0,
            help="thickness of the shell at the top and bottom; default: one layer",
        )
    )
    mark_advanced(
        group.add_argument(
            "--limit",
            metavar="NAME=VALUE",
            action="append",
            default=[],
            help="with --model: change a limit; may be repeated; NAME is one of uncovered, outside, overlap, "
            "unsupported, underfilled, overfilled, outline, contour",
        )
    )


def _list_given_comparison_options(arguments: argparse.Namespace) -> list[str]:
    """Return the options on the command line that only the comparison with a model uses."""
    names = ("picture", "limit", "shell", "skin", "filament")
    return [f"--{name}" for name in names if getattr(arguments, name)]


def run(arguments: argparse.Namespace) -> int:
    """Analyse G-code files: one in detail, several with one line each."""
    if not arguments.more_files:
        return _run_for_one_file(arguments)
    if arguments.models:
        raise UsageError(
            f"--model: one file is compared with its model, not {len(arguments.more_files) + 1}",
            remedy="Check the files one by one",
        )

    def run_one(path: Path) -> int:
        own = {"gcode": path, "more_files": [], "json": True, "quiet": True}
        return _run_for_one_file(argparse.Namespace(**{**vars(arguments), **own}))

    files = [arguments.gcode, *arguments.more_files]
    return run_for_each_file(
        arguments, files, run_one, lambda facts: format_count(len(facts["diagnostics"]), "finding")
    )


def _run_for_one_file(arguments: argparse.Namespace) -> int:
    """Analyse a G-code file, compare it with its model if there is one, and print the findings."""
    from printer_slicer.cli.models import format_model_names, load_repaired_plate
    from printer_slicer.commands import read_text
    from printer_slicer.inspection.coverage.measurement import CoverageRules
    from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
    from printer_slicer.inspection.deposition.support_gaps import SupportGaps

    reject_options_without_model(arguments, _list_given_comparison_options(arguments))
    check_outputs(arguments)
    reject_non_gcode(arguments.gcode)
    file_check = _check_file(arguments)
    if not arguments.models:
        return _print_file_check(arguments, file_check)
    limits = _parse_limits(arguments.limit)
    with show_stages(arguments) as report:
        text = read_text(arguments.gcode)
        mesh, plate, _ = load_repaired_plate(arguments, file_check.profile, report)
        placement = plate.placement if arguments.center or arguments.as_placed or not arguments.drop else None
        rules = CoverageRules(
            shell=arguments.shell, surface_depth=arguments.skin, gaps=SupportGaps.of(file_check.profile)
        )
        asked = CheckOptions(rules, limits, arguments.filament, placement)
        check = check_gcode(text, mesh, asked, name=arguments.gcode.name, report=report)
        drawn: list[str] = []
        if arguments.picture:
            report("drawing")
            shows = _draw_worst_layers(check, limits, format_model_names(arguments.models), arguments.picture)
            drawn = describe_picture(arguments.picture, shows)
    if arguments.json:
        facts = _collect_comparison_facts(check, limits) | plate.collect_facts() | file_check.facts
        facts["diagnostics"] = [*map(_round_diagnostic, check.findings), *facts["diagnostics"]]
        print(json.dumps(facts | {"ok": check.ok and not file_check.wrong}))
    else:
        print_text(
            arguments,
            "\n".join(
                [*_format_check(check, format_model_names(arguments.models)), *file_check.lines, *drawn]
            ),
        )
    _raise_if_check_failed(check, file_check.wrong)
    return 0


# The commands of the file, and the serial link


class _FileCheck(Struct, frozen=True):
    """The result of checking the commands of a file: facts for JSON, lines of text, errors, and the profile used."""

    facts: dict[str, Any]
    lines: list[str]
    wrong: list[str]
    profile: Profile


def _check_file(arguments: argparse.Namespace) -> _FileCheck:
    """Check the commands of a G-code file, and their timing on the serial link.

    Raises:
        UsageError: the file cannot be printed, or an option is invalid.
    """
    from printer_slicer.cli.jobs import (
        format_disallowed_errors,
        format_notes,
        list_diagnostic_facts,
        list_finding_facts,
    )
    from printer_slicer.firmware import FLAVOURS
    from printer_slicer.gcode import read_moves
    from printer_slicer.inspection.dry_run.underruns import find_underruns
    from printer_slicer.inspection.lint.scan import lint_file
    from printer_slicer.link_model import SerialLink
    from printer_slicer.motion.rules import limits_of

    profile = load_selected_profile(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile).allowing(arguments.allow)
    wrong = format_disallowed_errors(job)
    facts: dict[str, Any] = {
        "allowed": sorted(arguments.allow),
        "diagnostics": list_diagnostic_facts(job, job.findings),
        "lint": list_finding_facts(job),
    }
    lines = [
        f"{job.name}: {len(job.commands)} commands, {format_duration(job.seconds)} of motion on {profile.printer.name}"
    ]
    lines += [f"error       {one}" for one in wrong] or ["commands    no errors"]
    lines += format_notes(arguments, job)
    if arguments.link:
        link = SerialLink(
            arguments.link,
            latency_back=arguments.latency / 1000,
            window_lines=arguments.window,
            window_bytes=profile.printer.receive_buffer - 1,
        )
        printer = profile.printer
        moves = read_moves(job.commands, printer.corners[0], FLAVOURS[printer.flavour])
        report = _add_line_numbers(
            job, find_underruns(job.commands, moves, limits_of(printer), link, job.marks)
        )
        facts["link"] = _collect_link_facts(report)
        lines += _format_link(arguments, report)
        wrong += _find_link_errors(report)
    return _FileCheck(facts | collect_profile_facts(arguments), lines, wrong, profile)


def _add_line_numbers(job: Job, report: UnderrunReport) -> UnderrunReport:
    """Add the line numbers of the file to the underruns of a report."""
    from printer_slicer.commands import find_lines

    firsts = find_lines(job.text, [one.first for one in report.underruns])
    lasts = find_lines(job.text, [one.last for one in report.underruns])
    underruns = zip(report.underruns, firsts, lasts, strict=True)
    return replace(
        report, underruns=tuple(replace(one, line=first, last_line=last) for one, first, last in underruns)
    )


def _collect_link_facts(report: UnderrunReport) -> dict[str, Any]:
    """Return the timing of the serial link for JSON."""
    return as_dict(report) | {"ok": report.ok, "advice": _suggest_link_rate(report)}


def _format_link(arguments: argparse.Namespace, report: UnderrunReport) -> list[str]:
    """Format the timing of the serial link as lines of text."""
    link = report.link
    rate = "unlimited" if report.lines_per_second == inf else f"{report.lines_per_second:.0f} lines/s"
    setup = f"{link.baud} baud, latency {link.latency_back * 1000:g} ms, {link.window_lines} lines in flight: {rate}"
    if report.ok:
        return [f"serial      {setup}, which is enough (no buffer underruns)"]
    lines = [f"serial      {setup}", f"            {_summarize_underruns(report)}"]
    most = len(report.underruns) if arguments.verbose else _MAX_LISTED
    worst = sorted(report.underruns, key=lambda one: -one.seconds)[:most]
    lines += [f"            {_format_underrun(one)}" for one in sorted(worst, key=lambda one: one.first)]
    if len(report.underruns) > most:
        lines.append(f"            ... and {len(report.underruns) - most} shorter ones (-v lists all)")
    return [*lines, f"            {_suggest_link_rate(report)}"]


def _summarize_underruns(report: UnderrunReport) -> str:
    """Summarize the buffer underruns: their number, the time lost, and how often the printer stops."""
    n = len(report.underruns)
    lost = sum(one.seconds for one in report.underruns)
    many = "1 buffer underrun" if n == 1 else f"{n} buffer underruns"
    stands = f"the printer stops {report.stalls} times" if report.stalls else "the printer only slows down"
    return (
        f"{many}: {lost:.1f} s lost, {stands}"
        f" ({format_duration(report.seconds)} instead of {format_duration(report.ideal_seconds)})"
    )


def _format_underrun(one: Underrun) -> str:
    layer = f"layer {one.layer}, " if one.layer else ""
    return (
        f"{layer}lines {one.line} to {one.last_line}: {one.lines_per_second_needed:.0f} lines/s needed, "
        f"{one.lines_per_second_available:.0f} available, {one.seconds:.1f} s lost"
    )


def _suggest_link_rate(report: UnderrunReport) -> str:
    """Suggest a setting that avoids the underruns; return an empty text if there are none."""
    if report.ok:
        return ""
    rate = int(report.lines_per_second * _ADVISED_SHARE)
    return f"Slice with --set printer.link_lines_per_second={rate}, or use a higher baud rate"


def _find_link_errors(report: UnderrunReport) -> list[str]:
    """Return an error if there are buffer underruns; otherwise an empty list."""
    return [] if report.ok else [f"the serial link is too slow: {_summarize_underruns(report)}"]


def _print_file_check(arguments: argparse.Namespace, file_check: _FileCheck) -> int:
    """Print the result of checking a file without a model."""
    if arguments.json:
        print(json.dumps({"file": arguments.gcode.name, "ok": not file_check.wrong, **file_check.facts}))
    else:
        print_text(arguments, "\n".join(file_check.lines))
    _raise_if_errors(arguments.gcode.name, file_check.wrong)
    return 0


# The material against the model


def _parse_limits(changes: list[str]) -> CoverageLimits:
    """Return the default limits with the changes of --limit.

    Raises:
        UsageError: a name is unknown, or a value is invalid.
    """
    from printer_slicer.inspection.coverage.limits import CoverageLimits

    known = set(CoverageLimits.__struct_fields__)
    limits = CoverageLimits()
    for change in changes:
        name, _, text = change.partition("=")
        name = _FORMER_LIMIT_NAMES.get(name.strip(), name.strip())
        try:
            value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
        except ValueError:
            value = nan
        if name not in known or not (isfinite(value) and value >= 0):
            raise UsageError(
                f"--limit {change}: expected NAME=VALUE, with a value of 0 or more",
                remedy=f"Known names: {', '.join(sorted(known))}. Example: --limit underfilled=0.95",
            )
        limits = replace(limits, **{name: value})
    return limits


def _raise_if_check_failed(check: Check, more: Sequence[str] = ()) -> None:
    """Raise an error if the comparison with the model has problems, or if `more` contains errors."""
    _raise_if_errors(check.name, [*check.problems, *map(sentence, check.findings), *more])


def _raise_if_errors(name: str, wrong: Sequence[str]) -> None:
    """Raise a verification error with the first of the errors, if there are any."""
    if wrong:
        raise VerificationError(f"{name}: {format_first_error(wrong)}")


def _format_check(check: Check, model: str) -> Iterator[str]:
    """Yield the result of the comparison with a model: summary, findings, notes, table."""
    wrong = [*check.problems, *map(sentence, check.findings)]
    count = format_count(len(wrong), "problem") if wrong else "within all limits"
    yield f"{check.name} against {model}: {count}"
    yield from (f"  {one}" for one in wrong[:_MAX_LISTED])
    if len(wrong) > _MAX_LISTED:
        yield f"  ... and {len(wrong) - _MAX_LISTED} more (--json lists all)"
    x, y = check.match.shift
    found = "found" if check.matched else "given"
    yield (
        f"  model position ({found}): shifted by x {x:+.3f} y {y:+.3f} z {check.z:+.3f} mm; "
        f"{check.match.share:.1%} of the external perimeters match, median distance {check.match.spread:.4f} mm"
    )
    yield from (f"  {note}" for note in check.notes)
    yield from _format_table(check.coverage)


def _format_table(coverage: Coverage) -> Iterator[str]:
    """Yield the rows of the table of measurements, for the worst layer and for the whole file."""
    import numpy as np

    from printer_slicer.inspection.deposition.marks import Purpose

    fill, outline = coverage.fill, coverage.outline
    shell, covered = coverage.shell.area(), coverage.covered.area()
    rows = [
        ("", "worst layer", "", "whole file"),
        _format_area_row("uncovered shell", coverage, coverage.uncovered.area(), shell),
        _format_area_row("outside the outline", coverage, coverage.outside.area(), covered),
        _format_area_row("overlap", coverage, fill.overlap, covered),
        (
            "unsupported",
            f"{coverage.unsupported_length.max():.1f} mm",
            _format_worst_layer(coverage, coverage.unsupported_length),
            f"{coverage.unsupported_length.sum():.1f} mm",
        ),
        (
            "material in shell",
            _format_statistic(np.nanmin, fill.shell, ".1%"),
            _format_worst_layer(coverage, -fill.shell),
            f"{_format_statistic(np.nanmedian, fill.shell, '.1%')} median",
        ),
        (
            "outline error, 95%",
            _format_statistic(np.nanmax, outline.p95, ".3f", " mm"),
            _format_worst_layer(coverage, outline.p95),
            f"{_format_statistic(np.nanmedian, outline.p95, '.3f', ' mm')} median",
        ),
        (
            "outline error, maximum",
            _format_statistic(np.nanmax, outline.largest, ".3f", " mm"),
            _format_worst_layer(coverage, outline.largest),
            f"{_format_statistic(np.nanmedian, outline.largest, '.3f', ' mm')} median",
        ),
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for row in rows:
        cells = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        yield f"  {'  '.join(cells)}".rstrip()
    volume, solid = float(coverage.volume.sum()), float(coverage.section_volume.sum())
    share = f", {volume / solid:.1%} of its volume" if solid else ""
    yield f"  part: {volume:.1f} mm³ in {format_count(coverage.stack.n_layers, 'layer')}{share}"
    kinds = [
        (volume, Purpose(i).label) for i, volume in enumerate(coverage.by_purpose.tolist()) if volume > 0.05
    ]
    yield f"  volume by role, mm³: {', '.join(f'{name} {volume:.1f}' for volume, name in sorted(kinds, reverse=True))}"


def _format_area_row(name: str, coverage: Coverage, areas: Float, whole: Float) -> tuple[str, str, str, str]:
    """Format a row of the table: an area, mm², in the worst layer and in total, with its share of `whole`."""
    total, of = float(areas.sum()), float(whole.sum())
    share = f" ({total / of:.2%})" if of else ""
    return name, f"{areas.max():.2f} mm²", _format_worst_layer(coverage, areas), f"{total:.1f} mm²{share}"


def _format_worst_layer(coverage: Coverage, values: Float) -> str:
    """Format number and height of the layer with the largest value; return an empty text if all values are 0."""
    import numpy as np

    if np.isnan(values).all() or not np.nanmax(np.abs(values)) > 0:
        return ""
    layer = int(np.nanargmax(values))
    return f"layer {coverage.stack.number[layer]} z {coverage.stack.top[layer]:.4g}"


def _format_statistic(
    statistic: Callable[[Float], float], values: Float, number_format: str, unit: str = ""
) -> str:
    """Format a statistic of the values, such as their median; return a dash if there are none."""
    import numpy as np

    return "-" if np.isnan(values).all() else f"{statistic(values):{number_format}}{unit}"


def _round_for_json(value: float) -> float | None:
    """Round a number for JSON; return None for nan and infinity, which JSON lacks."""
    return round(float(value), 6) if isfinite(value) else None


def _round_column(values: Float | Sequence[float]) -> list[float | None]:
    """Round the values of a column for JSON."""
    import numpy as np

    return [_round_for_json(value) for value in np.asarray(values, np.float64).tolist()]


def _round_diagnostic(finding: Diagnostic) -> dict[str, Any]:
    """Return a finding of the comparison for JSON, with rounded numbers; no such finding can be allowed."""
    facts = as_json(finding) | {"allowed": False}
    return {
        key: _round_for_json(value) if isinstance(value, float) else value for key, value in facts.items()
    }


def _collect_comparison_facts(check: Check, limits: CoverageLimits) -> dict[str, Any]:
    """Return the result of the comparison with a model for JSON; layers are counted from 1."""
    from printer_slicer.inspection.deposition.marks import Purpose

    coverage, stack = check.coverage, check.coverage.stack
    found = [as_former_json(one) | _round_diagnostic(one) for one in check.findings]
    return {
        "file": check.name,
        "ok": check.ok,
        "problems": list(check.problems),
        "findings": found,
        "notes": list(check.notes),
        "limits": as_dict(limits),
        "rules": as_dict(coverage.rules),
        "shift": [*_round_column(check.match.shift), _round_for_json(check.z)],
        "matched": check.matched,
        "fit": {"share": _round_for_json(check.match.share), "spread": _round_for_json(check.match.spread)},
        "filament_diameter": _round_column(check.deposit.diameter),
        "shell_depth": _round_for_json(coverage.shell_depth),
        "cell": coverage.fill.cell,
        "volume_by_role": {
            Purpose(i).label: _round_for_json(volume)
            for i, volume in enumerate(coverage.by_purpose.tolist())
            if volume
        },
        "layers": {
            "top": _round_column(stack.top),
            "height": _round_column(stack.height),
            "section_area": _round_column(coverage.sections.area()),
            "shell_area": _round_column(coverage.shell.area()),
            "covered_area": _round_column(coverage.covered.area()),
            "uncovered_area": _round_column(coverage.uncovered.area()),
            "outside_area": _round_column(coverage.outside.area()),
            "overlap_area": _round_column(coverage.fill.overlap),
            "max_fill": _round_column(coverage.fill.most),
            "shell_fill": _round_column(coverage.fill.shell),
            "unsupported_length": _round_column(coverage.unsupported_length),
            "outline_p95": _round_column(coverage.outline.p95),
            "outline_largest": _round_column(coverage.outline.largest),
            "volume": _round_column(coverage.volume),
            "section_volume": _round_column(coverage.section_volume),
        },
    }


def _draw_worst_layers(check: Check, limits: CoverageLimits, model: str, path: Path) -> str:
    """Draw the worst layer of each kind of finding, then further layers with findings, up to four in all.

    Without findings, draw the layer nearest to a limit. Return what the picture shows.
    """
    from printer_slicer.drawing import draw_coverage, encode_picture
    from printer_slicer.inspection.coverage.limits import describe_usage, find_nearest_to_limit

    kinds: dict[str, Diagnostic] = {}
    for finding in check.findings:
        kinds.setdefault(finding.code, finding)
    chosen: dict[int, Diagnostic] = {}
    for finding in (*kinds.values(), *check.findings):
        chosen.setdefault(finding.layer, finding)
    title = sanitize(f"{check.name} against {model}")
    shown = list(chosen.values())[:_MAX_DRAWN]
    picture = draw_coverage(check.coverage, shown, title, limits)
    write_file(path, encode_picture(picture, path))
    if not shown:
        return f"nearest to a limit: {describe_usage(*find_nearest_to_limit(check.coverage, limits))}"
    return f"the worst layers: {', '.join(f'{one.layer} ({one.code})' for one in shown)}"
