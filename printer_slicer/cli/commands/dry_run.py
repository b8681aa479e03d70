"""`dry-run`: print on the simulated printer, and report what would happen."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

from printer_slicer.cli.arguments import (
    STRICT,
    add_allow,
    add_firmware,
    add_layer_options,
    add_models,
    add_output,
    add_settings,
    positive,
)
from printer_slicer.cli.output import say, stages, write_file
from printer_slicer.cli.settings import profile_facts, profile_from

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
    add_allow(add_settings(parser, strict=STRICT))
    add_models(parser, gcode=True)
    group = add_firmware(parser)
    group.add_argument(
        "--link", metavar="BAUD", type=positive, help="simulate the serial port; buffer underruns are errors"
    )
    group = parser.add_argument_group("output")
    group.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw the print and its faults, as .svg or .png"
    )
    add_output(parser, group)
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print on the simulated printer, and report what would happen."""
    from printer_slicer.cli.jobs import (
        finding_facts,
        insist_verified,
        job_from,
        profile_options,
        refused,
        repairs_facts,
        repairs_lines,
    )
    from printer_slicer.cli.verdicts import (
        faults_of,
        insist_printable,
        planted_facts,
        planted_lines,
        simulate,
        verdict_facts,
        verdict_text,
    )

    faults = faults_of(arguments)
    if arguments.picture:
        from printer_slicer.drawing.canvas import check_picture

        check_picture(arguments.picture)
    profile = profile_from(arguments, **profile_options(arguments))
    with stages(arguments) as report:
        job, known = job_from(arguments, profile, report)
    job = job.allowing(arguments.allow)
    verdict = simulate(arguments, job, profile, events=False, baud=arguments.link, faults=faults)
    if arguments.picture:
        write_file(arguments.picture, _picture(verdict, job, profile, arguments.picture))
    if arguments.json:
        findings = {"ok": verdict.ok and not refused(job), "findings": finding_facts(job)}
        repairs = {"repairs": repairs_facts(job)}
        facts = verdict_facts(verdict, job, profile) | findings | repairs | known | planted_facts(faults)
        facts |= profile_facts(arguments)
        print(json.dumps(facts))
    else:
        lines = [verdict_text(arguments, verdict, job, profile), *planted_lines(faults), *repairs_lines(job)]
        say(arguments, "\n".join(lines))
    insist_printable(verdict)
    insist_verified(job)
    return 0


def _picture(verdict: Verdict, job: Job, profile: Profile, path: Path) -> bytes:
    from printer_slicer.diagnostics import sentence
    from printer_slicer.drawing.canvas import picture_bytes
    from printer_slicer.drawing.dry_run import FaultMark, dry_run_picture
    from printer_slicer.inspection.dry_run.set_points import find_set_points

    assert verdict.deposition is not None
    found = [FaultMark(sentence(fault), fault.z, fault.place) for fault in verdict.faults if fault.is_error]
    set_points = find_set_points(job.commands, profile.printer.flavour)
    title = f"{verdict.job}: {'no problems' if verdict.ok else 'do not print'}"
    return picture_bytes(
        dry_run_picture(
            verdict.deposition,
            set_points,
            found,
            title=title,
            corners=profile.printer.corners,
            max_flow=profile.max_flow,
        ),
        path,
    )
