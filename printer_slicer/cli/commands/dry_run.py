"""`dry-run`: print on the simulated printer, and report errors, times and material."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_allow_option,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
    parse_positive_integer,
)
from printer_slicer.cli.output import print_text, show_stages, write_file
from printer_slicer.cli.settings import profile_facts, profile_from
from printer_slicer.cli.simulator_options import add_simulator_options

if TYPE_CHECKING:
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.jobs import Job
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer dry-run part.stl
  printer-slicer dry-run part.gcode --printer marlin_220 --json
  printer-slicer dry-run part.gcode --link 57600 --picture print.png"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `dry-run`."""
    add_allow_option(add_setting_options(parser, strict_help=STRICT_HELP))
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
    """Print on the simulated printer, and report errors, times and material."""
    from printer_slicer.cli.jobs import (
        disallowed_error_sentences,
        finding_facts,
        job_from,
        job_repair_facts,
        job_repair_sentences,
        profile_options,
        require_no_errors,
    )
    from printer_slicer.cli.verdicts import (
        format_verdict,
        injected_fault_facts,
        injected_fault_lines,
        read_faults,
        require_printable,
        simulate_print,
        verdict_facts,
    )

    faults = read_faults(arguments)
    if arguments.picture:
        from printer_slicer.drawing.canvas import check_picture_path

        check_picture_path(arguments.picture)
    profile = profile_from(arguments, **profile_options(arguments))
    with show_stages(arguments) as report:
        job, known = job_from(arguments, profile, report)
    job = job.allowing(arguments.allow)
    verdict = simulate_print(arguments, job, profile, events=False, baud=arguments.link, faults=faults)
    if arguments.picture:
        write_file(arguments.picture, _draw_verdict(verdict, job, profile, arguments.picture))
    if arguments.json:
        findings = {"ok": verdict.ok and not disallowed_error_sentences(job), "findings": finding_facts(job)}
        repairs = {"repairs": job_repair_facts(job)}
        facts = verdict_facts(verdict, job, profile) | findings | repairs | known
        facts |= injected_fault_facts(faults) | profile_facts(arguments)
        print(json.dumps(facts))
    else:
        lines = [
            format_verdict(arguments, verdict, job, profile),
            *injected_fault_lines(faults),
            *job_repair_sentences(job),
        ]
        print_text(arguments, "\n".join(lines))
    require_printable(verdict, job)
    require_no_errors(job)
    return 0


def _draw_verdict(verdict: Verdict, job: Job, profile: Profile, path: Path) -> bytes:
    """Draw the print with its faults; return the picture in the format of the path's suffix."""
    from printer_slicer.diagnostics import sentence
    from printer_slicer.drawing.canvas import encode_picture
    from printer_slicer.drawing.dry_run import FaultMark, draw_dry_run
    from printer_slicer.inspection.dry_run.set_points import find_set_points

    assert verdict.deposition is not None
    found = [FaultMark(sentence(fault), fault.z, fault.place) for fault in verdict.faults if fault.is_error]
    set_points = find_set_points(job.commands, profile.printer.flavour)
    title = f"{verdict.job}: {'no problems' if verdict.ok else 'do not print'}"
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
