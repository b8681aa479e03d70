"""`sim`: serve the simulated printer to other programs."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT,
    add_firmware,
    add_layer_options,
    add_models,
    add_output,
    add_settings,
    address,
    factor,
    positive,
)
from printer_slicer.cli.help import advanced
from printer_slicer.cli.output import refuse_same, say, write_file
from printer_slicer.cli.settings import profile_facts, profile_from
from printer_slicer.errors import UsageError
from printer_slicer.progress import quiet
from printer_slicer.saving import check_writable
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.profile import Profile
    from printer_slicer.sim.faults import Faults
    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.statistics import Report

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer sim --pty /tmp/printer &
  printer-slicer print part.stl --port /tmp/printer
  printer-slicer sim --tcp 127.0.0.1:8888             print --port socket://127.0.0.1:8888
  printer-slicer sim --tcp 127.0.0.1:8888 --rfc2217   print --port rfc2217://127.0.0.1:8888
  printer-slicer sim --firmware klipper --faults bad_day.toml --seed 3
  printer-slicer sim --pty /tmp/printer --speed 0     as fast as possible
  printer-slicer sim --pty /tmp/printer --expect part.stl   verify that it was printed"""
_VIOLATIONS = 20  # listed in the text output
_MOST = 64 * 1024 * 1024  # bytes of a file on the card


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `sim`."""
    _add_server(parser)
    advanced(
        parser.add_argument(
            "--latency-timer",
            type=factor,
            metavar="MS",
            default=0.0,
            help="latency timer of a USB serial chip, such as 16; default: none",
        )
    )
    advanced(
        parser.add_argument(
            "--card",
            metavar="FILE",
            nargs="*",
            type=Path,
            help="insert an SD card with these files; default: no reader",
        )
    )
    advanced(
        parser.add_argument(
            "--report", metavar="FILE", type=Path, help="write the executed commands as JSON when it ends"
        )
    )
    add_firmware(parser)
    add_settings(parser, strict=STRICT)
    add_models(parser, gcode=True, flag="--expect", meaning="verify at the end that this was printed")
    add_output(parser)
    add_layer_options(parser)


def _add_server(parser: argparse.ArgumentParser) -> None:
    """Add the options for the address, the baud rate and the clock of the simulated printer."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--pty",
        metavar="LINK",
        type=Path,
        help="link to the pseudo-terminal; default: printer-slicer-sim",
    )
    where.add_argument(
        "--tcp", metavar="HOST:PORT", type=address, help="listen on TCP instead; port 0: any free port"
    )
    advanced(
        parser.add_argument(
            "--rfc2217", action="store_true", help="use RFC 2217 on --tcp instead of plain bytes"
        )
    )
    parser.add_argument(
        "--speed", type=factor, default=1.0, metavar="X", help="factor on real time; 0: as fast as possible"
    )
    parser.add_argument(
        "--baud", type=positive, metavar="N", help="baud rate; default: unlimited, or as the firmware needs"
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve the simulated printer on a pseudo-terminal or over TCP until interrupted."""
    from printer_slicer.cli.jobs import job_from, profile_options, repairs_facts
    from printer_slicer.cli.verdicts import (
        faults_of,
        insist_printable,
        planted_facts,
        planted_lines,
        verdict_facts,
        verdict_text,
    )
    from printer_slicer.inspection.dry_run.comparison import Comparison
    from printer_slicer.inspection.dry_run.judging import judge
    from printer_slicer.inspection.dry_run.runner import layer_counter

    _check_options(arguments)
    faults = faults_of(arguments)
    profile = profile_from(arguments, **profile_options(arguments), tell=False)
    job, known = job_from(arguments, profile, quiet) if arguments.models else (None, {})
    comparison = Comparison(job.commands if job else ())
    if faults and job:
        faults.current_layer = layer_counter(job, comparison)
    report = _serve_printer(arguments, profile, comparison, faults)
    result = {
        **asdict(report),
        "violations": [list(violation) for violation in report.violations],
        "print_seconds": report.print_seconds,
        "job_commands": comparison.executed,
        "job_digest": comparison.digest,
        **known,
        **planted_facts(faults),
        **profile_facts(arguments),
    }
    verdict = judge(job, profile, report, comparison) if job else None
    if verdict and job:
        result["verdict"] = verdict_facts(verdict, job, profile) | {"repairs": repairs_facts(job)}
    if arguments.report:
        write_file(arguments.report, (json.dumps(result) + "\n").encode())
    if arguments.json:
        print(json.dumps(result))
    elif verdict and job:
        text = verdict_text(arguments, verdict, job, profile)
        say(arguments, "\n".join([text, *planted_lines(faults)]))
    else:
        motion = f"{format_duration(report.print_seconds)} of motion, {report.n_violations} violations"
        first = f"executed {comparison.executed} commands, extruded at {len(report.layers)} heights, {motion}"
        say(arguments, "\n".join([first, *_violation_lines(report), *planted_lines(faults)]))
    if verdict:
        insist_printable(verdict)
    return 0


def _check_options(arguments: argparse.Namespace) -> None:
    """Refuse options that contradict each other."""
    if arguments.report and arguments.json and str(arguments.report) == "-":
        raise UsageError("--report - and --json cannot both go to stdout", remedy="Leave out one of them")
    if arguments.rfc2217 and arguments.tcp is None:
        raise UsageError("--rfc2217 without --tcp", remedy="Add --tcp HOST:PORT")
    if arguments.report:
        check_writable(arguments.report)
        for path in arguments.models:
            refuse_same(arguments.report, path, "--report")


def _violation_lines(report: Report) -> list[str]:
    """Format commands that a real machine would have rejected, clipped or been harmed by; at most 20 lines."""
    shown = [f"  command {one.line}: {one.text}" for one in report.violations[:_VIOLATIONS]]
    more = report.n_violations - len(shown)
    return [*shown, f"  and {more} more: --report and --json list up to 1000"] if more else shown


def _serve_printer(
    arguments: argparse.Namespace,
    profile: Profile,
    on_executed: Callable[[str], None],
    faults: Faults | None,
) -> Report:
    """Run the simulated printer until Ctrl-C or SIGTERM; return its report."""
    from printer_slicer.cli.verdicts import firmware_of
    from printer_slicer.inspection.dry_run.machines import machine_of
    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter

    firmware = firmware_of(arguments, profile.printer)
    files = _card(arguments)
    machine = replace(
        machine_of(profile.printer, arguments.extruders, one_hotend=arguments.one_hotend),
        card=files is not None,
    )

    def make() -> SimulatedPrinter:
        """Create the printer."""
        return SimulatedPrinter(machine, firmware, on_executed=on_executed, faults=faults, card=files)

    # Bytes that arrive all at once would overflow a small receive buffer.
    paced = arguments.baud or (None if firmware.receive_buffer is None else profile.printer.baud)
    timer = arguments.latency_timer / 1000.0
    connect = partial(Cable, baud=paced, timer=timer, noise=faults)
    return _served(arguments, profile, make, connect, faults)


def _served(
    arguments: argparse.Namespace,
    profile: Profile,
    make: Callable[[], SimulatedPrinter],
    connect: Callable[[SimulatedPrinter], Cable],
    faults: Faults | None,
) -> Report:
    """Serve on the pseudo-terminal or TCP port."""
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopped.append(number))

    def ready(name: str) -> None:
        """Print the address at once, for programs that wait for it."""
        say(arguments, f"simulated {profile.printer.name} at {name}; Ctrl-C ends it")
        sys.stdout.flush()

    common: dict[str, Any] = {
        "speed": arguments.speed,
        "connect": connect,
        "unplugged": (lambda: faults.unplugged) if faults else (lambda: False),
        "stop": lambda: bool(stopped),
    }
    if arguments.tcp is None:
        from printer_slicer.sim.pty_server import serve

        link = arguments.pty or Path("printer-slicer-sim")
        return serve(make, link, ready=lambda name: ready(f"{link} ({name})"), **common)
    from printer_slicer.sim.tcp_server import serve_tcp

    if not arguments.rfc2217:
        return serve_tcp(make, arguments.tcp, ready=lambda name: ready(f"socket://{name}"), **common)
    from printer_slicer.sim.rfc2217 import Rfc2217Server

    return serve_tcp(
        make, arguments.tcp, telnet=Rfc2217Server, ready=lambda name: ready(f"rfc2217://{name}"), **common
    )


def _card(arguments: argparse.Namespace) -> dict[str, bytes] | None:
    """Read the files of the SD card; None without a card reader."""
    if arguments.card is None:
        return None
    files: dict[str, bytes] = {}
    for path in arguments.card:
        try:
            with path.open("rb") as file:
                data = file.read(_MOST + 1)
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}", remedy="Name G-code files after --card") from error
        if len(data) > _MOST:
            raise UsageError(
                f"{path}: over {_MOST >> 20} MiB",
                remedy="Use smaller files",
            )
        files[path.name] = data
    return files
