"""What can be typed about a print that runs or was broken off: `resume`, `control`, `console`."""

from __future__ import annotations

import argparse
from pathlib import Path

from printer_slicer.cli.door_parsers import add_machine
from printer_slicer.cli.parsing import command, later, output
from printer_slicer.cli.values import number, patience, positive

__all__ = ["add_console", "add_print_flags", "add_resume"]

_Commands = argparse._SubParsersAction  # noqa: SLF001 - the type of what add_subparsers gives has no other name


def add_print_flags(parser: argparse.ArgumentParser) -> None:
    """Flags of `print` that are about the port and about what was there before."""
    parser.add_argument(
        "--discard-unfinished", action="store_true", help="forget a print that was broken off on this port"
    )
    parser.add_argument(
        "--dtr",
        choices=("auto", "on", "off"),
        default="auto",
        help="level of the line that resets many boards when the port is opened; default: auto, as the system does",
    )
    _reconnect(parser)
    _guard(parser)


def _reconnect(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--reconnect",
        metavar="S",
        type=patience,
        default=30.0,
        help="wait so long for a printer whose cable was pulled; default: 30",
    )


def _guard(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--guard",
        metavar="S",
        type=patience,
        default=120.0,
        help="if this program dies and nobody resumes the print for so long, a second process switches the heaters "
        "off; 0: never, nor when the printer is given up; default: 120",
    )


def add_resume(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`resume`."""
    parser = command(
        commands,
        "resume",
        "go on with a print that was broken off",
        "  printer-slicer resume                     where the printer kept its state: at the next line\n"
        "  printer-slicer resume --recover           else: home x and y, heat, go back to the place, go on\n"
        "  printer-slicer resume --list              which prints are unfinished\n"
        "  printer-slicer resume part.gcode --discard",
    )
    parser.add_argument("name", nargs="?", default="", metavar="JOB", help="which one, if there are more")
    parser.add_argument("--port", metavar="PORT", help="where the printer is now; default: where it was")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="only say which prints are unfinished")
    what.add_argument("--discard", action="store_true", help="forget it instead")
    what.add_argument(
        "--recover",
        action="store_true",
        help="if the printer has lost its state, do what is told without asking: z is taken from the journal",
    )
    _reconnect(parser)
    _guard(parser)
    output(parser)
    parser.set_defaults(run=later("resuming", "resume_command"))


def add_console(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`console`."""
    parser = command(
        commands,
        "console",
        "talk to a printer: type G-code, read its answers",
        "  printer-slicer console /dev/ttyUSB0\n"
        "  echo M115 | printer-slicer console /dev/ttyUSB0\n"
        "  printer-slicer console socket://192.168.1.7:8888 --command M503\n"
        "  printer-slicer console /dev/ttyUSB0 --command M500 --allow eeprom",
    )
    parser.add_argument("port", metavar="PORT", help="device, or socket:// or rfc2217:// URL")
    parser.add_argument("--baud", type=positive, default=115200, metavar="N", help="default: 115200")
    parser.add_argument(
        "--command", metavar="GCODE", action="append", default=[], help="send this and stop; may be repeated"
    )
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=number,
        default=30.0,
        help="silence after which an answer is not waited for",
    )
    parser.add_argument("--log", metavar="FILE", type=Path, help="also write everything into this file")
    add_machine(parser.add_argument_group("what would harm this machine is refused, or asked about"))
    output(parser)
    parser.set_defaults(run=later("console", "console_command"))
