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
  printer-slicer check part.gcode --model part.stl --limit under=0.95 --limit air=5
  printer-slicer check plate.gcode --model lid.stl box.3mf --rotate 90 --filament 2.85"""
_TOLD = 8  # findings told in full
_DRAWN = 4  # layers in a picture
_SPARE: Final = 0.95  # of the lines that a link carries are asked of it


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
            help="change a limit: uncovered, outside, overlap, air, under, over, outline; may be repeated",
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
    looked = _look(arguments)
    if not arguments.models:
        return _tell_looked(arguments, looked)
    limits = _limits(arguments.limit)
    with stages(arguments) as report:
        text = read_text(arguments.gcode)
        mesh, plate, _ = repaired_plate(arguments, load_profile().printer, report)
        placement = plate.placement if arguments.center or arguments.as_placed or not arguments.drop else None
        rules = CoverageRules(shell=arguments.shell, skin=arguments.skin)
        asked = CheckOptions(rules, limits, arguments.filament, placement)
        check = check_gcode(text, mesh, asked, name=arguments.gcode.name, report=report)
        if arguments.picture:
            report("drawing")
            _draw(check, plate_name(arguments.models), arguments.picture)
    if arguments.json:
        facts = _facts(check, limits) | plate.facts() | looked.facts
        print(json.dumps(facts | {"ok": check.ok and not looked.wrong}))
    else:
        say(arguments, "\n".join([*_lines(check, plate_name(arguments.models)), *looked.lines]))
    _insist(check, looked.wrong)
    return 0


# The commands of the file, and the serial link


@dataclass(frozen=True, slots=True)
class _Looked:
    """What was seen: for programs, for people, and what is wrong."""

    facts: dict[str, Any]
    lines: list[str]
    wrong: list[str]


def _look(arguments: argparse.Namespace) -> _Looked:
    """Look at the job that a G-code file makes.

    Raises:
        UsageError: it is no job, or the profile or a name makes no sense.
    """
    from printer_slicer.cli.jobs import finding_facts, finding_lines, refused
    from printer_slicer.firmware import FLAVOURS
    from printer_slicer.gcode import read_moves
    from printer_slicer.inspection.dry_run.underruns import find_underruns
    from printer_slicer.inspection.lint.scan import lint_file
    from printer_slicer.link_model import SerialLink
    from printer_slicer.motion.rules import limits_of

    profile = profile_from(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile).allowing(arguments.allow)
    wrong = refused(job)
    facts: dict[str, Any] = {"allowed": sorted(arguments.allow), "policy": finding_facts(job)}
    lines = [
        f"{job.name}: {len(job.commands)} commands, {format_duration(job.seconds)} of motion on {profile.printer.name}"
    ]
    lines += [f"refused     {one}" for one in wrong] or ["policy      nothing is refused"]
    lines += finding_lines(arguments, job)
    if arguments.link:
        link = SerialLink(
            arguments.link,
            latency_back=arguments.latency / 1000,
            window_lines=arguments.window,
            window_bytes=profile.printer.receive_buffer - 1,
        )
        printer = profile.printer
        moves = read_moves(job.commands, printer.corners[0], FLAVOURS[printer.flavour])
        told = _located(job, find_underruns(job.commands, moves, limits_of(printer), link, job.marks))
        facts["link"] = _link_facts(told)
        lines += _link_lines(arguments, told)
        wrong += _link_wrong(told)
    return _Looked(facts | profile_facts(arguments), lines, wrong)


def _located(job: Job, told: UnderrunReport) -> UnderrunReport:
    """The same with lines of the text."""
    from printer_slicer.commands import find_lines

    firsts = find_lines(job.text, [one.first for one in told.stretches])
    lasts = find_lines(job.text, [one.last for one in told.stretches])
    stretches = zip(told.stretches, firsts, lasts, strict=True)
    return replace(
        told, stretches=tuple(replace(one, line=first, last_line=last) for one, first, last in stretches)
    )


def _link_facts(told: UnderrunReport) -> dict[str, Any]:
    return asdict(told) | {"ok": told.ok, "advice": _advice(told)}


def _link_lines(arguments: argparse.Namespace, told: UnderrunReport) -> list[str]:
    """For people."""
    link = told.link
    rate = "any number of" if told.lines_per_second == inf else f"{told.lines_per_second:.0f}"
    yes = f"{link.baud} Bd, {link.latency_back * 1000:g} ms, {link.window_lines} lines in flight: {rate} lines/s"
    if told.ok:
        return [f"link        {yes}; the machine never waits for lines"]
    lines = [f"link        {yes}", f"            {_summary(told)}"]
    most = len(told.stretches) if arguments.verbose else _TOLD
    worst = sorted(told.stretches, key=lambda one: -one.seconds)[:most]
    lines += [f"            {_stretch_sentence(one)}" for one in sorted(worst, key=lambda one: one.first)]
    if len(told.stretches) > most:
        lines.append(f"            ... and {len(told.stretches) - most} more that lose less (-v tells all)")
    return [*lines, f"            {_advice(told)}"]


def _summary(told: UnderrunReport) -> str:
    n = len(told.stretches)
    lost = sum(one.seconds for one in told.stretches)
    many = "1 stretch" if n == 1 else f"{n} stretches"
    stands = f"it stands still {told.stalls} times" if told.stalls else "it never stands still"
    return (
        f"the machine waits for lines in {many}: {lost:.1f} s lost, {stands}"
        f" ({format_duration(told.seconds)} instead of {format_duration(told.unhindered)})"
    )


def _stretch_sentence(one: Underrun) -> str:
    layer = f"layer {one.layer}, " if one.layer else ""
    return (
        f"{layer}lines {one.line} to {one.last_line}: {one.wanted:.0f} lines/s wanted, {one.possible:.0f} come, "
        f"{one.seconds:.1f} s lost"
    )


def _advice(told: UnderrunReport) -> str:
    if told.ok:
        return ""
    rate = int(told.lines_per_second * _SPARE)
    return f"slice for this link: --set printer.link_lines_per_second={rate}; or raise the speed of the port"


def _link_wrong(told: UnderrunReport) -> list[str]:
    return [] if told.ok else [f"the link is too slow: {_summary(told)}"]


def _tell_looked(arguments: argparse.Namespace, looked: _Looked) -> int:
    """The answer where there is no model."""
    if arguments.picture or arguments.limit:
        raise UsageError("--picture and --limit are about the part", remedy="name it with --model part.stl")
    if arguments.json:
        print(json.dumps({"file": arguments.gcode.name, "ok": not looked.wrong, **looked.facts}))
    else:
        say(arguments, "\n".join(looked.lines))
    _refuse(arguments.gcode.name, looked.wrong)
    return 0


# The material against the model


def _limits(changes: list[str]) -> CoverageLimits:
    """The usual limits with changes.

    Raises:
        UsageError: a name that does not exist, or a value that is no limit.
    """
    from printer_slicer.inspection.coverage.limits import CoverageLimits

    known = {field.name for field in fields(CoverageLimits)}
    limits = CoverageLimits()
    for change in changes:
        name, _, text = change.partition("=")
        try:
            value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
        except ValueError:
            value = nan
        if name.strip() not in known or not (isfinite(value) and value >= 0):
            raise UsageError(
                f"--limit {change}: expected NAME=VALUE, with a value of 0 or more",
                remedy=f"names are {', '.join(sorted(known))}; for example --limit under=0.95",
            )
        limits = replace(limits, **{name.strip(): value})
    return limits


def _insist(check: Check, more: Sequence[str] = ()) -> None:
    _refuse(check.name, [*check.problems, *map(sentence, check.findings), *more])


def _refuse(name: str, wrong: Sequence[str]) -> None:
    if wrong:
        more = f"\n  and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise VerificationError(f"{name}: {wrong[0]}{more}")


def _lines(check: Check, model: str) -> Iterator[str]:
    """The verdict, then the table."""
    wrong = [*check.problems, *map(sentence, check.findings)]
    count = (
        f"{len(wrong)} {'problem' if len(wrong) == 1 else 'problems'}"
        if wrong
        else "nothing is beyond its limit"
    )
    yield f"{check.name} against {model}: {count}"
    yield from (f"  {one}" for one in wrong[:_TOLD])
    if len(wrong) > _TOLD:
        yield f"  ... and {len(wrong) - _TOLD} more (--json tells all)"
    x, y = check.match.shift
    found = "found" if check.matched else "told"
    yield (
        f"  the model lies x {x:+.3f} y {y:+.3f} z {check.z:+.3f} mm from where its file has it ({found}); "
        f"{check.match.share:.1%} of the outer perimeters fit it, half within {check.match.spread:.4f} mm"
    )
    yield from (f"  {note}" for note in check.notes)
    yield from _table(check.coverage)


def _table(coverage: Coverage) -> Iterator[str]:
    """Measurements: the worst layer, and the whole file."""
    import numpy as np

    from printer_slicer.inspection.deposition.marks import Purpose

    fill, outline = coverage.fill, coverage.outline
    shell, covered = coverage.shell.area(), coverage.covered.area()
    rows = [
        ("", "worst layer", "", "whole file"),
        _of_areas("shell uncovered", coverage, coverage.uncovered.area(), shell),
        _of_areas("outside the section", coverage, coverage.outside.area(), covered),
        _of_areas("overlap", coverage, fill.overlap, covered),
        (
            "unsupported",
            f"{coverage.hanging.max():.1f} mm",
            _at(coverage, coverage.hanging),
            f"{coverage.hanging.sum():.1f} mm",
        ),
        (
            "shell holds",
            _said(np.nanmin, fill.shell, ".1%"),
            _at(coverage, -fill.shell),
            f"{_said(np.nanmedian, fill.shell, '.1%')} in the median",
        ),
        (
            "outline off, 95 %",
            _said(np.nanmax, outline.p95, ".3f", " mm"),
            _at(coverage, outline.p95),
            f"{_said(np.nanmedian, outline.p95, '.3f', ' mm')} in the median",
        ),
        (
            "outline off, at most",
            _said(np.nanmax, outline.largest, ".3f", " mm"),
            _at(coverage, outline.largest),
            f"{_said(np.nanmedian, outline.largest, '.3f', ' mm')} in the median",
        ),
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for row in rows:
        cells = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        yield f"  {'  '.join(cells)}".rstrip()
    laid, wanted = float(coverage.volume.sum()), float(coverage.section_volume.sum())
    share = f", {laid / wanted:.1%} of its volume" if wanted else ""
    yield f"  {laid:.1f} mm3 laid for the part in {coverage.stack.n_layers} layers{share}; in all"
    kinds = [
        (volume, Purpose(i).label) for i, volume in enumerate(coverage.by_purpose.tolist()) if volume > 0.05
    ]
    yield f"  {', '.join(f'{name} {volume:.1f}' for volume, name in sorted(kinds, reverse=True))}"


def _of_areas(name: str, coverage: Coverage, areas: Float, whole: Float) -> tuple[str, str, str, str]:
    """A row of the table: mm² in the worst layer and in all, and what share of the whole that is."""
    total, of = float(areas.sum()), float(whole.sum())
    share = f" ({total / of:.2%})" if of else ""
    return name, f"{areas.max():.2f} mm2", _at(coverage, areas), f"{total:.1f} mm2{share}"


def _at(coverage: Coverage, values: Float) -> str:
    """Where the largest value is, if there is any that is not 0."""
    import numpy as np

    if np.isnan(values).all() or not np.nanmax(np.abs(values)) > 0:
        return ""
    layer = int(np.nanargmax(values))
    return f"layer {layer + 1} z {coverage.stack.top[layer]:.4g}"


def _said(pick: Callable[[Float], float], values: Float, how: str, unit: str = "") -> str:
    """One value of a column, or a dash where it has none."""
    import numpy as np

    return "-" if np.isnan(values).all() else f"{pick(values):{how}}{unit}"


def _number(value: float) -> float | None:
    """For JSON, which knows no nan and no infinity."""
    return round(float(value), 6) if isfinite(value) else None


def _column(values: Float | Sequence[float]) -> list[float | None]:
    import numpy as np

    return [_number(value) for value in np.asarray(values, np.float64).tolist()]


def _facts(check: Check, limits: CoverageLimits) -> dict[str, Any]:
    """All that is known, ready for JSON; layers count from 1."""
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
            "most_times": _column(coverage.fill.most),
            "shell_fill": _column(coverage.fill.shell),
            "in_air": _column(coverage.hanging),
            "outline_p95": _column(coverage.outline.p95),
            "outline_largest": _column(coverage.outline.largest),
            "volume": _column(coverage.volume),
            "section_volume": _column(coverage.section_volume),
        },
    }


def _draw(check: Check, model: str, path: Path) -> None:
    """The worst layer of each kind, then other layers, as long as there is room."""
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
