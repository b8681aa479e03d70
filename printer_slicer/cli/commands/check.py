"""`check`: analyse a G-code file before it is printed, alone and against its model."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_machine, add_models, add_output, factor, length, positive
from printer_slicer.cli.help import advanced
from printer_slicer.cli.inputs import refuse_other_text
from printer_slicer.cli.output import refuse_mixing, sanitize, say, stages, write_file
from printer_slicer.cli.settings import profile_facts, profile_from
from printer_slicer.diagnostics import as_json, sentence
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.diagnostics import Diagnostic
    from printer_slicer.inspection.coverage.limits import CoverageLimits
    from printer_slicer.inspection.coverage.measurement import Coverage
    from printer_slicer.inspection.coverage.model_check import Check
    from printer_slicer.inspection.dry_run.underruns import Underrun, UnderrunReport
    from printer_slicer.jobs import Job

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer check part.gcode                    commands, temperatures, moves, speeds
  printer-slicer check part.gcode --link 115200      find buffer underruns at this baud rate
  printer-slicer check part.gcode --model part.stl   compare the extrusions with the part
  printer-slicer check part.gcode --model part.stl --picture faults.png --json
  printer-slicer check part.gcode --model part.stl --limit underfilled=0.95 --limit unsupported=5
  printer-slicer check plate.gcode --model lid.stl box.3mf --rotate 90 --filament 2.85"""
_MOST_LISTED = 8  # findings listed
_DRAWN = 4  # layers in a picture
_OLD_LIMITS: Final = {"air": "unsupported", "under": "underfilled", "over": "overfilled"}  # names until 0.2
_SPARE: Final = 0.95  # share of the throughput of a link that the advice uses


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="G-code of any slicer")
    group = parser.add_argument_group("machine")
    add_machine(group)
    _add_link(group)
    add_models(parser, flag="--model", meaning="compare the G-code with these models")
    _add_measuring(parser.add_argument_group("comparison with the model"))
    group = parser.add_argument_group("output")
    group.add_argument("--picture", metavar="FILE", type=Path, help="draw the worst layers, as .svg or .png")
    add_output(parser, group)
    parser.set_defaults(strict=False)


def _add_link(group: argparse._ArgumentGroup) -> None:
    """Add the options for the serial link."""
    group.add_argument(
        "--link", metavar="BAUD", type=positive, help="find buffer underruns at this baud rate"
    )
    advanced(
        group.add_argument(
            "--latency",
            metavar="MS",
            type=factor,
            default=1.0,
            help="time until an acknowledgement arrives; USB serial chips often have 16; default: 1",
        )
    )
    advanced(
        group.add_argument(
            "--window",
            metavar="LINES",
            type=positive,
            default=2,
            help="most lines sent but not yet acknowledged; default: 2",
        )
    )


def _add_measuring(group: argparse._ArgumentGroup) -> None:
    """Add the options for the comparison with the model."""
    advanced(
        group.add_argument(
            "--filament",
            metavar="MM",
            type=length,
            help="filament diameter; default: from the file, else 1.75",
        )
    )
    advanced(
        group.add_argument(
            "--shell",
            metavar="MM",
            type=length,
            help="depth of the shell; default: from the perimeters of the file",
        )
    )
    advanced(
        group.add_argument(
            "--skin",
            metavar="MM",
            type=factor,
            default=0.0,
            help="thickness of the shell at the top and bottom; default: one layer",
        )
    )
    advanced(
        group.add_argument(
            "--limit",
            metavar="NAME=VALUE",
            action="append",
            default=[],
            help="change a limit: uncovered, outside, overlap, unsupported, underfilled, overfilled, outline",
        )
    )


def run(arguments: argparse.Namespace) -> int:
    """Analyse G-code, compare it with its model, and print the findings."""
    from printer_slicer.cli.models import plate_name, repaired_plate
    from printer_slicer.commands import read_text
    from printer_slicer.inspection.coverage.measurement import CoverageRules
    from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
    from printer_slicer.profile import load_profile

    refuse_mixing(arguments)
    refuse_other_text(arguments.gcode)
    file_check = _check_file(arguments)
    if not arguments.models:
        return _print_file_check(arguments, file_check)
    limits = _limits(arguments.limit)
    with stages(arguments) as report:
        text = read_text(arguments.gcode)
        mesh, plate, _ = repaired_plate(arguments, load_profile().printer, report)
        placement = plate.placement if arguments.center or arguments.as_placed or not arguments.drop else None
        rules = CoverageRules(shell=arguments.shell, surface_depth=arguments.skin)
        asked = CheckOptions(rules, limits, arguments.filament, placement)
        check = check_gcode(text, mesh, asked, name=arguments.gcode.name, report=report)
        if arguments.picture:
            report("drawing")
            _draw(check, plate_name(arguments.models), arguments.picture)
    if arguments.json:
        facts = _facts(check, limits) | plate.facts() | file_check.facts
        print(json.dumps(facts | {"ok": check.ok and not file_check.wrong}))
    else:
        say(arguments, "\n".join([*_lines(check, plate_name(arguments.models)), *file_check.lines]))
    _insist(check, file_check.wrong)
    return 0


# The commands of the file, and the serial link


@dataclass(frozen=True, slots=True)
class _FileCheck:
    """The result of checking the commands: facts for JSON, lines of text, and errors."""

    facts: dict[str, Any]
    lines: list[str]
    wrong: list[str]


def _check_file(arguments: argparse.Namespace) -> _FileCheck:
    """Check the commands of a G-code file and its timing on the serial link.

    Raises:
        UsageError: the file cannot be printed, or an option is invalid.
    """
    from printer_slicer.cli.jobs import finding_facts, format_findings, refused
    from printer_slicer.firmware import FLAVOURS
    from printer_slicer.gcode import read_moves
    from printer_slicer.inspection.dry_run.underruns import find_underruns
    from printer_slicer.inspection.lint.scan import lint_file
    from printer_slicer.link_model import SerialLink
    from printer_slicer.motion.rules import limits_of

    profile = profile_from(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile).allowing(arguments.allow)
    wrong = refused(job)
    facts: dict[str, Any] = {"allowed": sorted(arguments.allow), "lint": finding_facts(job)}
    lines = [
        f"{job.name}: {len(job.commands)} commands, {format_duration(job.seconds)} of motion on {profile.printer.name}"
    ]
    lines += [f"error       {one}" for one in wrong] or ["commands    no errors"]
    lines += format_findings(arguments, job)
    if arguments.link:
        link = SerialLink(
            arguments.link,
            latency_back=arguments.latency / 1000,
            window_lines=arguments.window,
            window_bytes=profile.printer.receive_buffer - 1,
        )
        printer = profile.printer
        moves = read_moves(job.commands, printer.corners[0], FLAVOURS[printer.flavour])
        report = _located(job, find_underruns(job.commands, moves, limits_of(printer), link, job.marks))
        facts["link"] = _link_facts(report)
        lines += _link_lines(arguments, report)
        wrong += _link_wrong(report)
    return _FileCheck(facts | profile_facts(arguments), lines, wrong)


def _located(job: Job, report: UnderrunReport) -> UnderrunReport:
    """Add line numbers of the text."""
    from printer_slicer.commands import find_lines

    firsts = find_lines(job.text, [one.first for one in report.underruns])
    lasts = find_lines(job.text, [one.last for one in report.underruns])
    underruns = zip(report.underruns, firsts, lasts, strict=True)
    return replace(
        report, underruns=tuple(replace(one, line=first, last_line=last) for one, first, last in underruns)
    )


def _link_facts(report: UnderrunReport) -> dict[str, Any]:
    return asdict(report) | {"ok": report.ok, "advice": _advice(report)}


def _link_lines(arguments: argparse.Namespace, report: UnderrunReport) -> list[str]:
    """Return the timing of the link as text."""
    link = report.link
    rate = "unlimited" if report.lines_per_second == inf else f"{report.lines_per_second:.0f} lines/s"
    setup = f"{link.baud} baud, latency {link.latency_back * 1000:g} ms, {link.window_lines} lines in flight: {rate}"
    if report.ok:
        return [f"serial      {setup}, which is enough (no buffer underruns)"]
    lines = [f"serial      {setup}", f"            {_summary(report)}"]
    most = len(report.underruns) if arguments.verbose else _MOST_LISTED
    worst = sorted(report.underruns, key=lambda one: -one.seconds)[:most]
    lines += [f"            {_underrun_text(one)}" for one in sorted(worst, key=lambda one: one.first)]
    if len(report.underruns) > most:
        lines.append(f"            ... and {len(report.underruns) - most} shorter ones (-v lists all)")
    return [*lines, f"            {_advice(report)}"]


def _summary(report: UnderrunReport) -> str:
    n = len(report.underruns)
    lost = sum(one.seconds for one in report.underruns)
    many = "1 buffer underrun" if n == 1 else f"{n} buffer underruns"
    stands = (
        f"the printer stands still {report.stalls} times" if report.stalls else "the printer only slows down"
    )
    return (
        f"{many}: {lost:.1f} s lost, {stands}"
        f" ({format_duration(report.seconds)} instead of {format_duration(report.ideal_seconds)})"
    )


def _underrun_text(one: Underrun) -> str:
    layer = f"layer {one.layer}, " if one.layer else ""
    return (
        f"{layer}lines {one.line} to {one.last_line}: {one.lines_per_second_needed:.0f} lines/s needed, "
        f"{one.lines_per_second_available:.0f} available, {one.seconds:.1f} s lost"
    )


def _advice(report: UnderrunReport) -> str:
    if report.ok:
        return ""
    rate = int(report.lines_per_second * _SPARE)
    return f"Slice with --set printer.link_lines_per_second={rate}, or use a higher baud rate"


def _link_wrong(report: UnderrunReport) -> list[str]:
    return [] if report.ok else [f"the serial link is too slow: {_summary(report)}"]


def _print_file_check(arguments: argparse.Namespace, file_check: _FileCheck) -> int:
    """Print the result of a check without a model."""
    if arguments.picture or arguments.limit:
        raise UsageError("--picture and --limit need a model", remedy="Name it with --model part.stl")
    if arguments.json:
        print(json.dumps({"file": arguments.gcode.name, "ok": not file_check.wrong, **file_check.facts}))
    else:
        say(arguments, "\n".join(file_check.lines))
    _refuse(arguments.gcode.name, file_check.wrong)
    return 0


# The material against the model


def _limits(changes: list[str]) -> CoverageLimits:
    """Return the default limits with the changes of --limit.

    Raises:
        UsageError: unknown name, or invalid value.
    """
    from printer_slicer.inspection.coverage.limits import CoverageLimits

    known = {field.name for field in fields(CoverageLimits)}
    limits = CoverageLimits()
    for change in changes:
        name, _, text = change.partition("=")
        name = _OLD_LIMITS.get(name.strip(), name.strip())
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


def _insist(check: Check, more: Sequence[str] = ()) -> None:
    _refuse(check.name, [*check.problems, *map(sentence, check.findings), *more])


def _refuse(name: str, wrong: Sequence[str]) -> None:
    if wrong:
        more = f"\n  and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise VerificationError(f"{name}: {wrong[0]}{more}")


def _lines(check: Check, model: str) -> Iterator[str]:
    """Yield the result of a check against a model: summary, findings, notes, table."""
    wrong = [*check.problems, *map(sentence, check.findings)]
    count = f"{len(wrong)} {'problem' if len(wrong) == 1 else 'problems'}" if wrong else "within all limits"
    yield f"{check.name} against {model}: {count}"
    yield from (f"  {one}" for one in wrong[:_MOST_LISTED])
    if len(wrong) > _MOST_LISTED:
        yield f"  ... and {len(wrong) - _MOST_LISTED} more (--json lists all)"
    x, y = check.match.shift
    found = "found" if check.matched else "given"
    yield (
        f"  model position {found}: shifted by x {x:+.3f} y {y:+.3f} z {check.z:+.3f} mm; "
        f"{check.match.share:.1%} of the external perimeters match, median distance {check.match.spread:.4f} mm"
    )
    yield from (f"  {note}" for note in check.notes)
    yield from _table(check.coverage)


def _table(coverage: Coverage) -> Iterator[str]:
    """Yield the table of measurements: worst layer and whole file."""
    import numpy as np

    from printer_slicer.inspection.deposition.marks import Purpose

    fill, outline = coverage.fill, coverage.outline
    shell, covered = coverage.shell.area(), coverage.covered.area()
    rows = [
        ("", "worst layer", "", "whole file"),
        _area_row("uncovered shell", coverage, coverage.uncovered.area(), shell),
        _area_row("outside the outline", coverage, coverage.outside.area(), covered),
        _area_row("overlap", coverage, fill.overlap, covered),
        (
            "unsupported",
            f"{coverage.unsupported_length.max():.1f} mm",
            _at(coverage, coverage.unsupported_length),
            f"{coverage.unsupported_length.sum():.1f} mm",
        ),
        (
            "material in shell",
            _value_text(np.nanmin, fill.shell, ".1%"),
            _at(coverage, -fill.shell),
            f"{_value_text(np.nanmedian, fill.shell, '.1%')} median",
        ),
        (
            "outline error, 95%",
            _value_text(np.nanmax, outline.p95, ".3f", " mm"),
            _at(coverage, outline.p95),
            f"{_value_text(np.nanmedian, outline.p95, '.3f', ' mm')} median",
        ),
        (
            "outline error, maximum",
            _value_text(np.nanmax, outline.largest, ".3f", " mm"),
            _at(coverage, outline.largest),
            f"{_value_text(np.nanmedian, outline.largest, '.3f', ' mm')} median",
        ),
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for row in rows:
        cells = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        yield f"  {'  '.join(cells)}".rstrip()
    volume, solid = float(coverage.volume.sum()), float(coverage.section_volume.sum())
    share = f", {volume / solid:.1%} of its volume" if solid else ""
    yield f"  part: {volume:.1f} mm³ in {coverage.stack.n_layers} layers{share}"
    kinds = [
        (volume, Purpose(i).label) for i, volume in enumerate(coverage.by_purpose.tolist()) if volume > 0.05
    ]
    yield f"  volume by role, mm³: {', '.join(f'{name} {volume:.1f}' for volume, name in sorted(kinds, reverse=True))}"


def _area_row(name: str, coverage: Coverage, areas: Float, whole: Float) -> tuple[str, str, str, str]:
    """Return a row of the table: mm² in the worst layer and in total, and the share of the whole."""
    total, of = float(areas.sum()), float(whole.sum())
    share = f" ({total / of:.2%})" if of else ""
    return name, f"{areas.max():.2f} mm²", _at(coverage, areas), f"{total:.1f} mm²{share}"


def _at(coverage: Coverage, values: Float) -> str:
    """Return the layer of the largest value; empty if all are 0."""
    import numpy as np

    if np.isnan(values).all() or not np.nanmax(np.abs(values)) > 0:
        return ""
    layer = int(np.nanargmax(values))
    return f"layer {layer + 1} z {coverage.stack.top[layer]:.4g}"


def _value_text(pick: Callable[[Float], float], values: Float, how: str, unit: str = "") -> str:
    """Format one value of a column; a dash if it has none."""
    import numpy as np

    return "-" if np.isnan(values).all() else f"{pick(values):{how}}{unit}"


def _number(value: float) -> float | None:
    """Round for JSON, which has no nan and no infinity."""
    return round(float(value), 6) if isfinite(value) else None


def _column(values: Float | Sequence[float]) -> list[float | None]:
    import numpy as np

    return [_number(value) for value in np.asarray(values, np.float64).tolist()]


def _facts(check: Check, limits: CoverageLimits) -> dict[str, Any]:
    """Return the result of a check against a model for JSON; layers count from 1."""
    from printer_slicer.inspection.deposition.marks import Purpose

    coverage, stack = check.coverage, check.coverage.stack
    found = [
        {key: _number(value) if isinstance(value, float) else value for key, value in as_json(one).items()}
        for one in check.findings
    ]
    return {
        "file": check.name,
        "ok": check.ok,
        "problems": list(check.problems),
        "findings": found,
        "notes": list(check.notes),
        "limits": asdict(limits),
        "rules": asdict(coverage.rules),
        "shift": [*_column(check.match.shift), _number(check.z)],
        "matched": check.matched,
        "fit": {"share": _number(check.match.share), "spread": _number(check.match.spread)},
        "filament_diameter": _column(check.deposit.diameter),
        "shell_depth": _number(coverage.shell_depth),
        "cell": coverage.fill.cell,
        "volume_by_purpose": {
            Purpose(i).label: _number(volume)
            for i, volume in enumerate(coverage.by_purpose.tolist())
            if volume
        },
        "layers": {
            "top": _column(stack.top),
            "height": _column(stack.height),
            "section_area": _column(coverage.sections.area()),
            "shell_area": _column(coverage.shell.area()),
            "covered_area": _column(coverage.covered.area()),
            "uncovered_area": _column(coverage.uncovered.area()),
            "outside_area": _column(coverage.outside.area()),
            "overlap_area": _column(coverage.fill.overlap),
            "max_fill": _column(coverage.fill.most),
            "shell_fill": _column(coverage.fill.shell),
            "unsupported_length": _column(coverage.unsupported_length),
            "outline_p95": _column(coverage.outline.p95),
            "outline_largest": _column(coverage.outline.largest),
            "volume": _column(coverage.volume),
            "section_volume": _column(coverage.section_volume),
        },
    }


def _draw(check: Check, model: str, path: Path) -> None:
    """Draw the worst layer of each kind of finding, then other layers while there is room."""
    from printer_slicer.drawing import coverage_picture, picture_bytes

    kinds: dict[str, Diagnostic] = {}
    for finding in check.findings:
        kinds.setdefault(finding.code, finding)
    chosen: dict[int, Diagnostic] = {}
    for finding in (*kinds.values(), *check.findings):
        chosen.setdefault(finding.layer, finding)
    title = sanitize(f"{check.name} against {model}")
    write_file(
        path, picture_bytes(coverage_picture(check.coverage, list(chosen.values())[:_DRAWN], title), path)
    )
