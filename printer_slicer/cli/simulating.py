"""The simulated printer as the command line wants it: which firmware, what shall go wrong, and by which door."""

from __future__ import annotations

import argparse
import signal
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.common import say
from printer_slicer.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.profile import Printer, Profile
    from printer_slicer.sim.faults import Faults
    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.switches import FrontEnd
    from printer_slicer.sim.tally import Report

__all__ = ["faults_of", "firmware_of", "planted_facts", "planted_lines", "serve_printer", "violation_lines"]

_VIOLATIONS = 20  # listed in the text output
_MOST = 64 * 1024 * 1024  # bytes of a file on the card


def firmware_of(arguments: argparse.Namespace, printer: Printer) -> FrontEnd:
    """The firmware that was asked for, else the one that understands what the printer's profile writes."""
    from printer_slicer.inspection.dry_run.machines import front_end_of
    from printer_slicer.sim.front_end import FRONT_ENDS

    return FRONT_ENDS[arguments.firmware] if arguments.firmware else front_end_of(printer)


def faults_of(arguments: argparse.Namespace) -> Faults | None:
    """What shall go wrong; None for nothing.

    Raises:
        UsageError: the script cannot be read or makes no sense.
    """
    from random import Random  # noqa: TID251 - seeded, so that a run can be had again

    from printer_slicer.input_files import read_input
    from printer_slicer.sim.fault_script import read_script
    from printer_slicer.sim.faults import Faults
    from printer_slicer.toml_text import MOST_BYTES

    if arguments.faults is None:
        if arguments.seed is not None:
            raise UsageError("--seed without --faults", remedy="say with --faults what shall go wrong")
        return None
    try:
        text = read_input(arguments.faults, MOST_BYTES).decode("utf-8")
    except OSError as error:
        raise UsageError(
            f"{arguments.faults}: {error.strerror}", remedy="--faults wants a TOML file"
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{arguments.faults}: no text in UTF-8", remedy="--faults wants a TOML file"
        ) from error
    faults, seed = read_script(text, str(arguments.faults))
    chosen = next((one for one in (arguments.seed, seed) if one is not None), 0)
    return Faults(faults, Random(chosen))  # noqa: S311 - nothing secret


def planted_lines(faults: Faults | None) -> list[str]:
    """The faults that struck, for people."""
    struck = faults.happened if faults else []
    return [f"{'planted':<12}{one.time:.1f} s, line {one.line}: {one.text}" for one in struck]


def planted_facts(faults: Faults | None) -> dict[str, Any]:
    """The same for programs."""
    return {"planted": [one._asdict() for one in faults.happened]} if faults else {}


def violation_lines(report: Report) -> list[str]:
    """List what a real machine would have rejected, clipped or suffered, with the command; at most 20 lines."""
    shown = [f"  command {one.line}: {one.text}" for one in report.violations[:_VIOLATIONS]]
    more = report.n_violations - len(shown)
    return [*shown, f"  and {more} more: --report and --json list up to 1000"] if more else shown


def serve_printer(
    arguments: argparse.Namespace,
    profile: Profile,
    on_executed: Callable[[str], None],
    faults: Faults | None,
) -> Report:
    """Be a printer until Ctrl-C or SIGTERM; its account."""
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
        """The printer, switched on."""
        return SimulatedPrinter(machine, firmware, on_executed=on_executed, faults=faults, card=files)

    # Bytes that come all at once would overflow a small receive buffer.
    paced = arguments.baud or (None if firmware.receive_buffer is None else profile.printer.baud)
    timer = arguments.latency_timer / 1000.0
    connect = partial(Cable, baud=paced, timer=timer, damage=faults)
    return _served(arguments, profile, make, connect, faults)


def _served(
    arguments: argparse.Namespace,
    profile: Profile,
    make: Callable[[], SimulatedPrinter],
    connect: Callable[[SimulatedPrinter], Cable],
    faults: Faults | None,
) -> Report:
    """Let hosts in by the door that was asked for."""
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopped.append(number))

    def ready(name: str) -> None:
        """Say where the printer is; who waits for it reads this through a pipe."""
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
    from printer_slicer.sim.rfc2217 import Negotiator

    return serve_tcp(
        make, arguments.tcp, telnet=Negotiator, ready=lambda name: ready(f"rfc2217://{name}"), **common
    )


def _card(arguments: argparse.Namespace) -> dict[str, bytes] | None:
    """The files for the memory card; None without a card reader."""
    if arguments.card is None:
        return None
    files: dict[str, bytes] = {}
    for path in arguments.card:
        try:
            with path.open("rb") as file:
                data = file.read(_MOST + 1)
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}", remedy="--card wants G-code files") from error
        if len(data) > _MOST:
            raise UsageError(
                f"{path}: over {_MOST >> 20} MiB",
                remedy="the card of a simulated printer takes smaller files",
            )
        files[path.name] = data
    return files
