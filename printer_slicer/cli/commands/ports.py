"""`ports`: list the serial ports of this computer."""

from __future__ import annotations

import argparse
import json
from typing import Final

from printer_slicer.cli.arguments import add_output_options

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = "  printer-slicer ports --json"
add_arguments = add_output_options


def run(arguments: argparse.Namespace) -> int:
    """List the serial ports of this computer."""
    from printer_slicer.stream.serial_port import list_ports
    from printer_slicer.values import as_dict

    ports = [] if arguments.quiet else list_ports()
    if arguments.json:
        print(json.dumps([as_dict(port) for port in ports]))
    elif not ports and not arguments.quiet:
        print("no serial ports found: check that the printer is switched on and its USB cable is plugged in")
    for port in [] if arguments.json else ports:
        print(f"{port.device:<24}{port.description}")
    return 0
