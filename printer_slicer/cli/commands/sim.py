"""`sim`: serve the simulated printer to other programs."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
    add_strict_supports_option,
    parse_address,
    parse_factor,
    parse_positive_integer,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import print_text, reject_overwriting_input, write_file
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.cli.simulator_options import add_simulator_options
from printer_slicer.errors import UsageError
from printer_slicer.progress import quiet
from printer_slicer.saving import check_writable
from printer_slicer.texts import format_duration
from printer_slicer.values import as_dict, replace

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
_MAX_LISTED = 20  # listed in the text output
_MAX_CARD_BYTES = 64 * 1024 * 1024  # bytes of a file on the card


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `sim`."""
    _add_server_options(parser)
    mark_advanced(
        parser.add_argument(
            "--latency-timer",
            type=parse_factor,
            metavar="MS",
            default=0.0,
            help="simulate a USB serial chip with this latency timer in ms, such as 16; default: none",
        )
    )
    mark_advanced(
        parser.add_argument(
            "--card",
            metavar="FILE",
            nargs="*",
            type=Path,
            help="simulate an SD card reader, and a card with these files; default: no card reader",
        )
    )
    mark_advanced(
        parser.add_argument(
            "--report",
            metavar="FILE",
            type=Path,
            help="write a report of the print as JSON when the simulation ends",
        )
    )
    add_simulator_options(parser)
    add_strict_supports_option(add_setting_options(parser, strict_help=STRICT_HELP))
    add_model_options(
        parser,
        gcode=True,
        flag="--expect",
        meaning="verify at the end that these files were printed",
    )
    add_output_options(parser)
    add_layer_options(parser)


def _add_server_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the address, the baud rate and the clock of the simulated printer."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--pty",
        metavar="LINK",
        type=Path,
        help="link to the port; default: printer-slicer-sim",
    )
    where.add_argument(
        "--tcp",
        metavar="HOST:PORT",
        type=parse_address,
        help="listen on TCP instead; port 0: any free port",
    )
    mark_advanced(
        parser.add_argument(
            "--rfc2217",
            action="store_true",
            help="with --tcp, use the RFC 2217 protocol instead of plain bytes",
        )
    )
    parser.add_argument(
        "--speed",
        type=parse_factor,
        default=1.0,
        metavar="X",
        help="multiple of real time; 0: as fast as possible",
    )
    parser.add_argument(
        "--baud",
        type=parse_positive_integer,
        metavar="N",
        help="baud rate; default: unlimited or the profile's",
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve the simulated printer on a pseudo-terminal or over TCP until interrupted."""
    from printer_slicer.cli.jobs import choose_profile_arguments, list_job_repair_facts, make_job
    from printer_slicer.cli.verdicts import (
        collect_verdict_facts,
        format_injected_faults,
        format_verdict,
        list_injected_fault_facts,
        read_faults,
        require_printable,
    )
    from printer_slicer.inspection.dry_run.comparison import Comparison
    from printer_slicer.inspection.dry_run.judging import judge
    from printer_slicer.inspection.dry_run.runner import make_layer_counter

    _check_options(arguments)
    faults = read_faults(arguments)
    profile = load_selected_profile(arguments, **choose_profile_arguments(arguments), tell=False)
    job, known = make_job(arguments, profile, quiet) if arguments.models else (None, {})
    comparison = Comparison(job.commands if job else ())
    if faults and job:
        faults.current_layer = make_layer_counter(job, comparison)
    report = _build_and_serve(arguments, profile, comparison, faults)
    result = {
        **as_dict(report),
        "violations": [list(violation) for violation in report.violations],
        "print_seconds": report.print_seconds,
        "job_commands": comparison.executed,
        "job_digest": comparison.digest,
        **known,
        **list_injected_fault_facts(faults),
        **collect_profile_facts(arguments),
    }
    verdict = judge(job, profile, report, comparison) if job else None
    if verdict and job:
        repairs = {"repairs": list_job_repair_facts(job)}
        result["verdict"] = collect_verdict_facts(verdict, job, profile) | repairs
    if arguments.report:
        write_file(arguments.report, (json.dumps(result) + "\n").encode())
    if arguments.json:
        print(json.dumps(result))
    elif verdict and job:
        text = format_verdict(arguments, verdict, job, profile)
        print_text(arguments, "\n".join([text, *format_injected_faults(faults)]))
    else:
        text = _format_summary(report, comparison.executed)
        print_text(arguments, "\n".join([text, *_format_violations(report), *format_injected_faults(faults)]))
    if verdict and job:
        require_printable(verdict, job)
    return 0


def _format_summary(report: Report, n_executed: int) -> str:
    """Format the numbers of executed commands, extruded heights and violations, and the time of motion."""
    motion = f"{format_duration(report.print_seconds)} of motion, {report.n_violations} violations"
    return f"executed {n_executed} commands, extruded at {len(report.layers)} heights, {motion}"


def _check_options(arguments: argparse.Namespace) -> None:
    """Check that the options do not contradict each other, and that the report can be written."""
    if arguments.report and arguments.json and str(arguments.report) == "-":
        raise UsageError("--report - and --json cannot both go to stdout", remedy="Leave out one of them")
    if arguments.rfc2217 and arguments.tcp is None:
        raise UsageError("--rfc2217 has no effect without --tcp", remedy="Add --tcp HOST:PORT")
    if arguments.report:
        check_writable(arguments.report)
        for path in arguments.models:
            reject_overwriting_input(arguments.report, path, "--report")


def _format_violations(report: Report) -> list[str]:
    """Format the first 20 commands that a real machine would reject or clip, or that would harm it."""
    shown = [f"  command {one.line}: {one.text}" for one in report.violations[:_MAX_LISTED]]
    more = report.n_violations - len(shown)
    return [*shown, f"  and {more} more: --report and --json list up to 1000"] if more else shown


def _build_and_serve(
    arguments: argparse.Namespace,
    profile: Profile,
    on_executed: Callable[[str], None],
    faults: Faults | None,
) -> Report:
    """Run the simulated printer until Ctrl-C or SIGTERM; return its report."""
    from printer_slicer.cli.verdicts import select_firmware
    from printer_slicer.inspection.dry_run.machines import machine_of
    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter

    firmware = select_firmware(arguments, profile.printer)
    files = _read_card_files(arguments)
    machine = replace(
        machine_of(profile.printer, arguments.extruders, one_hotend=arguments.one_hotend),
        card=files is not None,
    )

    def create_printer() -> SimulatedPrinter:
        """Create the simulated printer."""
        return SimulatedPrinter(machine, firmware, on_executed=on_executed, faults=faults, card=files)

    # Without a baud rate all bytes arrive at once, which would overflow a small receive buffer.
    effective_baud = arguments.baud or (None if firmware.receive_buffer is None else profile.printer.baud)
    timer = arguments.latency_timer / 1000.0
    connect = partial(Cable, baud=effective_baud, timer=timer, noise=faults)
    return _serve_until_stopped(arguments, profile, create_printer, connect, faults)


def _serve_until_stopped(
    arguments: argparse.Namespace,
    profile: Profile,
    create_printer: Callable[[], SimulatedPrinter],
    connect: Callable[[SimulatedPrinter], Cable],
    faults: Faults | None,
) -> Report:
    """Serve the simulated printer on the pseudo-terminal or the TCP port until it is stopped; return its report."""
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopped.append(number))

    def print_address(name: str) -> None:
        """Print the address of the printer at once, for programs that wait for it."""
        print_text(arguments, f"simulated {profile.printer.name} at {name}; Ctrl-C ends it")
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
        return serve(create_printer, link, ready=lambda name: print_address(f"{link} ({name})"), **common)
    from printer_slicer.sim.tcp_server import serve_tcp

    if not arguments.rfc2217:
        return serve_tcp(
            create_printer, arguments.tcp, ready=lambda name: print_address(f"socket://{name}"), **common
        )
    from printer_slicer.sim.rfc2217 import Rfc2217Server

    return serve_tcp(
        create_printer,
        arguments.tcp,
        telnet=Rfc2217Server,
        ready=lambda name: print_address(f"rfc2217://{name}"),
        **common,
    )


def _read_card_files(arguments: argparse.Namespace) -> dict[str, bytes] | None:
    """Read the files for the SD card; return None without a card reader."""
    if arguments.card is None:
        return None
    files: dict[str, bytes] = {}
    for path in arguments.card:
        try:
            with path.open("rb") as file:
                data = file.read(_MAX_CARD_BYTES + 1)
        except OSError as error:
            raise UsageError(
                f"{path}: the file for the SD card cannot be read: {error.strerror}",
                remedy="Name G-code files after --card",
            ) from error
        if len(data) > _MAX_CARD_BYTES:
            raise UsageError(
                f"{path}: the file is larger than the {_MAX_CARD_BYTES >> 20} MiB that the simulated SD card accepts",
                remedy="Name smaller files after --card",
            )
        files[path.name] = data
    return files
