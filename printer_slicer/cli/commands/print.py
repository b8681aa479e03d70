"""`print`: print over a serial port."""

from __future__ import annotations

import argparse
import json
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
from printer_slicer.cli.connection_options import (
    SIMULATED_PORT,
    add_connection_options,
    occupy_queue_bed,
    reject_simulated_port,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import print_text, show_stages
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import UsageError
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `print`."""
    parser.add_argument(
        "--port",
        required=True,
        metavar="PORT",
        help="serial device, socket:// or rfc2217:// URL, or sim: for the simulated printer",
    )
    parser.add_argument(
        "--baud",
        type=parse_positive_integer,
        metavar="N",
        help="baud rate; default: the baud rate in the printer profile",
    )
    add_allow_option(add_strict_supports_option(add_setting_options(parser, strict_help=STRICT_HELP)))
    add_model_options(parser, gcode=True)
    add_output_options(parser)
    add_connection_options(parser)
    mark_advanced(
        parser.add_argument(
            "--discard-unfinished",
            action="store_true",
            help="delete an interrupted print of this port, which then can no longer be resumed",
        )
    )
    for option in (
        parser.add_argument(
            "--detach",
            action="store_true",
            help="return when the print has begun; it continues in the background",
        ),
        parser.add_argument(
            "--log",
            metavar="FILE",
            type=Path,
            help="with --detach, append the output to FILE; default: MODEL.log",
        ),
    ):
        mark_advanced(option)
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print over a serial port, or on the simulated printer if the port is `sim:`."""
    from printer_slicer.cli.jobs import (
        check_policy,
        choose_profile_arguments,
        format_job_repair_sentences,
        list_job_repair_facts,
        make_job,
    )

    if arguments.detach or arguments.log:
        return _detach(arguments)
    if arguments.port != SIMULATED_PORT:
        reject_simulated_port(arguments.port)
    profile = load_selected_profile(arguments, **choose_profile_arguments(arguments))
    with show_stages(arguments) as report:
        job, known = make_job(arguments, profile, report)
    if arguments.json and known["models"]:
        print(json.dumps({"event": "models", **known}), flush=True)
    if arguments.json:
        print(json.dumps({"event": "profile", **collect_profile_facts(arguments)}), flush=True)
    plan = f"{job.plan.n_layers} layers, " if job.plan else ""
    first = f"{job.name}: {plan}{len(job.commands)} commands, {format_duration(job.seconds)} of motion"
    print_text(arguments, "\n  ".join([first, *format_job_repair_sentences(job)]))
    if arguments.json and job.repairs is not None and job.repairs.count:
        print(json.dumps({"event": "repaired", "repairs": list_job_repair_facts(job)}), flush=True)
    job = check_policy(arguments, job)
    if arguments.port == SIMULATED_PORT:
        from printer_slicer.cli.verdicts import (
            collect_verdict_facts,
            format_verdict,
            require_printable,
            simulate_print,
        )

        verdict = simulate_print(arguments, job, profile, events=True)
        if arguments.json:
            facts = collect_verdict_facts(verdict, job, profile) | {"repairs": list_job_repair_facts(job)}
            print(json.dumps({"event": "verdict", **facts}))
        else:
            print_text(arguments, format_verdict(arguments, verdict, job, profile))
        require_printable(verdict, job)
        return 0
    return _print_on_port(arguments, job, profile)


def _detach(arguments: argparse.Namespace) -> int:
    """Start the same command as a process in the background, and wait until its print can be controlled.

    Raises:
        UsageError: the options contradict each other, or the G-code comes from stdin.
        PrinterSlicerError: the print did not begin; the exit code is that of the other process.
    """
    from tempfile import TemporaryDirectory

    from printer_slicer.printing.detached import start_detached

    if not arguments.detach:
        raise UsageError("--log has no effect without --detach", remedy="Add --detach")
    words = _remove_detach_options(arguments.command_line)
    if arguments.port == SIMULATED_PORT or "-" in words:
        raise UsageError(
            "--detach needs a port and files by name",
            remedy="Start a printer with printer-slicer sim --pty LINK",
        )
    log = arguments.log or Path(f"{arguments.models[0].stem}.log")
    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        ready = Path(folder) / "ready.json"
        started = start_detached(["-m", "printer_slicer", *words, "--ready-file", str(ready)], ready, log)
    facts = {"event": "detached", "pid": started.pid, "folder": str(started.folder), "log": str(log)}
    if arguments.json:
        print(json.dumps(facts))
    else:
        print_text(arguments, f"printing in the background: process {started.pid}, log {log}")
    return 0


def _remove_detach_options(words: list[str]) -> list[str]:
    """Return the words of a command line without --detach and --log."""
    left = [word for word in words if word != "--detach" and not word.startswith("--log=")]
    if "--log" in left:
        at = left.index("--log")
        del left[at : at + 2]
    return left


def _print_on_port(arguments: argparse.Namespace, job: Job, profile: Profile) -> int:
    """Print a job over a serial port; return the exit code."""
    from printer_slicer.cli.progress import print_with_progress
    from printer_slicer.inspection.lint.typed_commands import make_command_check
    from printer_slicer.printing import print_job
    from printer_slicer.printing.job_store import default_job_store

    def start_print(**common: Any) -> PrintResult:
        """Print the job from the beginning."""
        occupy_queue_bed(arguments.port)
        return print_job(
            job,
            profile,
            arguments.port,
            job_store=default_job_store(),
            discard=arguments.discard_unfinished,
            allow=make_command_check(profile, job.allowed),
            **common,
        )

    return print_with_progress(
        arguments, job, Path(f"{arguments.models[0].stem}.checkpoint.json"), start_print
    )
