"""`print`: print over a serial port."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT,
    add_allow,
    add_connection,
    add_layer_options,
    add_models,
    add_output,
    add_settings,
    positive,
)
from printer_slicer.cli.help import advanced
from printer_slicer.cli.output import say, stages
from printer_slicer.cli.settings import profile_facts, profile_from
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.jobs import Job
    from printer_slicer.printing import PrintResult
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer print part.stl --port /dev/ttyUSB0
  printer-slicer print part.gcode --port socket://192.168.1.7:8888 --json
  printer-slicer print part.stl --port sim:          simulated printer, virtual clock"""
_SIMULATED = "sim:"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `print`."""
    parser.add_argument(
        "--port", required=True, metavar="PORT", help="device, socket:// or rfc2217:// URL, or sim:"
    )
    parser.add_argument("--baud", type=positive, metavar="N", help="default: from the printer profile")
    add_allow(add_settings(parser, strict=STRICT))
    add_models(parser, gcode=True)
    add_output(parser)
    add_connection(parser)
    advanced(
        parser.add_argument(
            "--discard-unfinished",
            action="store_true",
            help="delete an interrupted print on this port; it cannot be resumed afterwards",
        )
    )
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print over a port; `sim:` is the simulated printer in this process."""
    from printer_slicer.cli.jobs import (
        insist_on_policy,
        job_from,
        profile_options,
        repairs_facts,
        repairs_lines,
    )

    profile = profile_from(arguments, **profile_options(arguments))
    with stages(arguments) as report:
        job, known = job_from(arguments, profile, report)
    if arguments.json and known["models"]:
        print(json.dumps({"event": "models", **known}), flush=True)
    if arguments.json:
        print(json.dumps({"event": "profile", **profile_facts(arguments)}), flush=True)
    plan = f"{job.plan.n_layers} layers, " if job.plan else ""
    first = f"{job.name}: {plan}{len(job.commands)} commands, {format_duration(job.seconds)} of motion"
    say(arguments, "\n  ".join([first, *repairs_lines(job)]))
    if arguments.json and job.repairs is not None and job.repairs.count:
        print(json.dumps({"event": "repaired", "repairs": repairs_facts(job)}), flush=True)
    job = insist_on_policy(arguments, job)
    if arguments.port == _SIMULATED:
        from printer_slicer.cli.verdicts import insist_printable, simulate, verdict_facts, verdict_text

        verdict = simulate(arguments, job, profile, events=True)
        if arguments.json:
            facts = verdict_facts(verdict, job, profile) | {"repairs": repairs_facts(job)}
            print(json.dumps({"event": "verdict", **facts}))
        else:
            say(arguments, verdict_text(arguments, verdict, job, profile))
        insist_printable(verdict)
        return 0
    return _print_on_port(arguments, job, profile)


def _print_on_port(arguments: argparse.Namespace, job: Job, profile: Profile) -> int:
    from printer_slicer.cli.jobs import command_check
    from printer_slicer.cli.progress import print_with
    from printer_slicer.printing import print_job
    from printer_slicer.printing.job_store import default_job_store

    def begin(**common: Any) -> PrintResult:
        """Print from the beginning."""
        return print_job(
            job,
            profile,
            arguments.port,
            job_store=default_job_store(),
            discard=arguments.discard_unfinished,
            allow=command_check(profile, job.allowed),
            **common,
        )

    return print_with(arguments, job, Path(f"{arguments.models[0].stem}.checkpoint.json"), begin)
