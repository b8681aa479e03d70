"""`doctor`: diagnose connection problems."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output, positive
from printer_slicer.cli.output import sanitize, say
from printer_slicer.errors import PortError

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
    parser.add_argument(
        "port", nargs="?", metavar="PORT", help="device or URL; default: all ports, without opening them"
    )
    parser.add_argument("--baud", type=positive, metavar="N", default=115_200, help="default: 115200")
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check one port and its printer, or all ports without opening them."""
    return _check_one(arguments) if arguments.port else _check_all(arguments)


def _check_all(arguments: argparse.Namespace) -> int:
    """Check what the system knows about every port."""
    from printer_slicer.doctor import read_port_state
    from printer_slicer.stream.serial_port import list_ports

    checked: list[tuple[str, list[PortCheck]]] = []
    for port in list_ports():
        name = f"{port.address} ({port.description})" if port.description else port.address
        checked.append((name, list(read_port_state(port.device).checks())))
    if arguments.json:
        print(json.dumps({"ports": [{"port": name, "checks": _facts(checks)} for name, checks in checked]}))
    elif not checked:
        say(arguments, "no serial ports found; is the printer switched on and its USB cable plugged in?")
    for name, checks in checked:
        say(arguments, "\n".join([name, *_lines(checks)]))
    if checked and not arguments.json:
        say(arguments, "To check a printer, name its port: printer-slicer doctor PORT")
    return 0


def _check_one(arguments: argparse.Namespace) -> int:
    """Check a port and its printer."""
    checks, found = _examine(arguments)
    bad = [check for check in checks if check.state == "bad"]
    if arguments.json:
        facts: dict[str, Any] = {"port": arguments.port, "ok": not bad, "checks": _facts(checks)}
        print(json.dumps(facts | {"printer": asdict(found) if found else None}))
    else:
        say(arguments, "\n".join(_lines(checks)))
    if bad:
        raise PortError(f"{arguments.port}: {bad[0].what}", remedy=bad[0].remedy)
    return 0


def _examine(arguments: argparse.Namespace) -> tuple[list[PortCheck], PrinterDiagnosis | None]:
    """Return the checks of a port, and of its printer if the port can be opened."""
    from printer_slicer.doctor import PortCheck, diagnose_printer, read_port_state
    from printer_slicer.stream.serial_port import open_port

    checks = [] if "://" in arguments.port else list(read_port_state(arguments.port).checks())
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
    return [*checks, *found.checks()], found


def _facts(checks: Iterable[PortCheck]) -> list[dict[str, Any]]:
    return [asdict(check) for check in checks]


def _lines(checks: Sequence[PortCheck]) -> list[str]:
    lines = []
    for check in checks:
        lines.append(f"  {_MARKS[check.state]}  {check.name:<20}{check.what}")
        lines += [f"        {'':<20}{check.remedy}"] if check.remedy else []
    return [sanitize(line) for line in lines]
