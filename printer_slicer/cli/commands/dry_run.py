"""`dry-run`: print on the simulated printer, and report errors, times and material."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_allow_option,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
    add_strict_supports_option,
    parse_positive_integer,
)
from printer_slicer.cli.output import describe_picture, print_text, show_stages, write_file
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.cli.simulator_options import add_simulator_options
from printer_slicer.errors import UsageError
from printer_slicer.texts import format_duration, format_significant

if TYPE_CHECKING:
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.jobs import Job
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer dry-run part.stl
  printer-slicer dry-run part.gcode --printer marlin_220 --json
  printer-slicer dry-run *.gcode                     one line per file
  printer-slicer dry-run part.gcode --link 57600 --picture print.png"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `dry-run`."""
    add_allow_option(add_strict_supports_option(add_setting_options(parser, strict_help=STRICT_HELP)))
    add_model_options(parser, gcode=True)
    group = add_simulator_options(parser)
    group.add_argument(
        "--link",
        metavar="BAUD",
        type=parse_positive_integer,
        help="simulate a serial port with this baud rate; buffer underruns are errors",
    )
    group = parser.add_argument_group("output")
    group.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw the print and its faults, as .svg or .png"
    )
    add_output_options(parser, group)
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print on the simulated printer: one job in detail, several G-code files with one line each."""
    from printer_slicer.input_files import is_gcode

    if len(arguments.models) < 2 or not all(map(is_gcode, arguments.models)):
        return _run_for_one_job(arguments)
    from printer_slicer.cli.several_files import run_for_each_file

    if arguments.picture:
        raise UsageError(
            f"--picture {arguments.picture}: one picture cannot show {len(arguments.models)} files",
            remedy="Leave out --picture, or name one file",
        )

    def run_one(path: Path) -> int:
        own = {"models": [path], "json": True, "quiet": True}
        return _run_for_one_job(argparse.Namespace(**{**vars(arguments), **own}))

    return run_for_each_file(arguments, arguments.models, run_one, _describe_facts)


def _describe_facts(facts: Mapping[str, Any]) -> str:
    """Return time and filament of a dry run."""
    return f"{format_duration(facts['total_seconds'])}, {format_significant(facts['filament_g'])} g"


def _run_for_one_job(arguments: argparse.Namespace) -> int:
    """Print on the simulated printer, and report errors, times and material."""
    from printer_slicer.cli.jobs import (
        choose_profile_arguments,
        format_disallowed_errors,
        format_job_repair_sentences,
        list_finding_facts,
        list_job_repair_facts,
        make_job,
        require_no_errors,
    )
    from printer_slicer.cli.verdicts import (
        collect_verdict_facts,
        format_injected_faults,
        format_verdict,
        list_injected_fault_facts,
        read_faults,
        require_printable,
        simulate_print,
    )

    faults = read_faults(arguments)
    if arguments.picture:
        from printer_slicer.drawing.canvas import check_picture_path

        check_picture_path(arguments.picture)
    profile = load_selected_profile(arguments, **choose_profile_arguments(arguments))
    with show_stages(arguments) as report:
        job, known = make_job(arguments, profile, report)
    job = job.allowing(arguments.allow)
    verdict = simulate_print(arguments, job, profile, events=False, baud=arguments.link, faults=faults)
    if arguments.picture:
        write_file(arguments.picture, _draw_verdict(verdict, job, profile, arguments.picture))
    if arguments.json:
        is_ok = verdict.ok and not format_disallowed_errors(job)
        findings = {"ok": is_ok, "findings": list_finding_facts(job)}
        repairs = {"repairs": list_job_repair_facts(job)}
        facts = collect_verdict_facts(verdict, job, profile) | findings | repairs | known
        facts |= list_injected_fault_facts(faults) | collect_profile_facts(arguments)
        print(json.dumps(facts))
    else:
        lines = [format_verdict(arguments, verdict, job, profile), *format_injected_faults(faults)]
        lines += format_job_repair_sentences(job)
        lines += describe_picture(arguments.picture, "the plate, and time and flow of each layer")
        print_text(arguments, "\n".join(lines))
    require_printable(verdict, job)
    require_no_errors(job)
    return 0


def _draw_verdict(verdict: Verdict, job: Job, profile: Profile, path: Path) -> bytes:
    """Draw the print with its faults; return the picture in the format of the path's suffix."""
    from printer_slicer.diagnostics import sentence
    from printer_slicer.drawing.canvas import encode_picture
    from printer_slicer.drawing.dry_run import FaultMark, draw_dry_run
    from printer_slicer.inspection.dry_run.judging import summarize
    from printer_slicer.inspection.dry_run.set_points import find_set_points

    assert verdict.deposition is not None
    found = [FaultMark(sentence(fault), fault.z, fault.place) for fault in verdict.faults if fault.is_error]
    set_points = find_set_points(job.commands, profile.printer.flavour)
    title = f"{verdict.job}: {summarize(len(verdict.problems), has_warnings=bool(verdict.notes))}"
    return encode_picture(
        draw_dry_run(
            verdict.deposition,
            set_points,
            found,
            title=title,
            corners=profile.printer.corners,
            max_flow=profile.max_flow,
        ),
        path,
    )
