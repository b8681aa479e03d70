"""`doctor`: diagnose connection problems."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output_options, parse_positive_integer
from printer_slicer.cli.connection_options import add_port_arguments, reject_simulated_port
from printer_slicer.cli.output import print_text, sanitize
from printer_slicer.errors import PortError
from printer_slicer.values import as_dict

if TYPE_CHECKING:
    from printer_slicer.doctor import PortCheck, PrinterDiagnosis

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer doctor                   check the ports of this computer
  printer-slicer doctor /dev/ttyUSB0      check one of them and its printer
  printer-slicer doctor /dev/ttyACM0 --baud 250000 --json"""
_MARKS: Final = {"good": "ok  ", "warn": "warn", "bad": "BAD "}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `doctor`."""
    meaning = "device or URL of the port to check; default: check all ports without opening them"
    add_port_arguments(parser, meaning, required=False)
    parser.add_argument(
        "--baud", type=parse_positive_integer, metavar="N", default=115_200, help="baud rate; default: 115200"
    )
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check one port and its printer, or all ports without opening them."""
    return _check_port(arguments) if arguments.port else _check_all_ports(arguments)


def _check_all_ports(arguments: argparse.Namespace) -> int:
    """Check every port of this computer without opening it, and print the results."""
    from printer_slicer.doctor import read_port_state
    from printer_slicer.stream.serial_port import list_ports

    checked: list[tuple[str, list[PortCheck]]] = []
    for port in list_ports():
        name = f"{port.address} ({port.description})" if port.description else port.address
        checked.append((name, list(read_port_state(port.device).run_checks())))
    if arguments.json:
        print(
            json.dumps(
                {
                    "ports": [
                        {"port": name, "checks": _collect_check_facts(checks)} for name, checks in checked
                    ]
                }
            )
        )
    elif not checked:
        print_text(
            arguments,
            "no serial ports found: check that the printer is switched on and its USB cable is plugged in",
        )
    for name, checks in checked:
        print_text(arguments, "\n".join([name, *_format_checks(checks)]))
    if checked and not arguments.json:
        print_text(arguments, "To check a printer, name its port: printer-slicer doctor PORT")
    return 0


def _check_port(arguments: argparse.Namespace) -> int:
    """Check a port and its printer, and print the results.

    Raises:
        PortError: a check has failed.
    """
    reject_simulated_port(arguments.port)
    checks, found = _run_checks(arguments)
    bad = [check for check in checks if check.state == "bad"]
    if arguments.json:
        facts: dict[str, Any] = {
            "port": arguments.port,
            "ok": not bad,
            "checks": _collect_check_facts(checks),
        }
        print(json.dumps(facts | {"printer": as_dict(found) if found else None}))
    else:
        print_text(arguments, "\n".join(_format_checks(checks)))
    if bad and (arguments.json or arguments.quiet):
        raise PortError(_name_port(arguments.port, bad[0].what), remedy=bad[0].remedy)
    if bad:  # the lines above name findings and remedies
        names = ", ".join(check.name for check in bad)
        raise PortError(
            f"{arguments.port}: not ready to print; failed: {names}",
            remedy="Follow the remedies listed above",
        )
    return 0


def _name_port(port: str, what: str) -> str:
    """Put the port in front of a finding that does not name it."""
    return what if port in what else f"{port}: {what}"


def _run_checks(arguments: argparse.Namespace) -> tuple[list[PortCheck], PrinterDiagnosis | None]:
    """Run the checks of a port, and of its printer if the port can be opened; return them and the diagnosis."""
    from printer_slicer.doctor import PortCheck, diagnose_printer, read_port_state
    from printer_slicer.stream.serial_port import open_port

    checks = [] if "://" in arguments.port else list(read_port_state(arguments.port).run_checks())
    if any(check.state == "bad" for check in checks):
        return checks, None
    try:
        port = open_port(arguments.port, arguments.baud)
    except PortError as error:
        return [*checks, PortCheck("open", "bad", str(error).splitlines()[0], error.remedy)], None
    try:
        found = diagnose_printer(port, monotonic, baud=arguments.baud)
    except PortError as error:
        return [*checks, PortCheck("open", "bad", str(error).splitlines()[0], error.remedy)], None
    finally:
        port.close()
    return [*checks, *found.run_checks()], found


def _collect_check_facts(checks: Iterable[PortCheck]) -> list[dict[str, Any]]:
    """Return the results of checks for JSON."""
    return [as_dict(check) for check in checks]


def _format_checks(checks: Sequence[PortCheck]) -> list[str]:
    """Format the results of checks as lines of text, with remedies."""
    lines = []
    for check in checks:
        lines.append(f"  {_MARKS[check.state]}  {check.name:<20}{check.what}")
        lines += [f"        {'':<20}{check.remedy}"] if check.remedy else []
    return [sanitize(line) for line in lines]
