"""What can be typed about a job before it is printed, about other people's printers, and about what is plugged in."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from printer_slicer.cli.model_flags import add_models
from printer_slicer.cli.parsing import command, later, output
from printer_slicer.cli.values import address, factor, positive, whole

__all__ = [
    "FIRMWARES",
    "add_allow",
    "add_allow_unsupported",
    "add_beforehand",
    "add_doctor",
    "add_firmware",
    "add_machine",
    "add_send",
    "add_sim_flags",
]

_Commands = argparse._SubParsersAction  # noqa: SLF001 - the type of what add_subparsers gives has no other name
_Flags = argparse._ActionsContainer  # noqa: SLF001 - a parser or a group of one

# The keys of diagnostics.NAMES, which is not imported: --help answers at once.
_ALLOWED: Final = (
    "temperature, box, feed, flow, ratio, unsupported, cold, homing, eeprom, limits, calibration, autotune, "
    "protection, endstops, offsets, halt, wait, firmware, files, pins, macros, link, debug, shell, unreadable"
)


def add_allow(parser: _Flags) -> None:
    """What may be in a job although it is usually refused."""
    parser.add_argument(
        "--allow",
        metavar="NAME",
        action="append",
        default=[],
        help=f"take G-code although this is in it; may be repeated: {_ALLOWED}",
    )


def add_allow_unsupported(parser: _Flags) -> None:
    """Add the --allow of a command that slices only: what --strict refuses by name."""
    parser.add_argument(
        "--allow",
        metavar="NAME",
        action="append",
        choices=("unsupported",),
        default=[],
        help="accept this despite --strict: unsupported (extrusion with nothing under it)",
    )


def add_beforehand(parser: argparse.ArgumentParser) -> None:
    """What `check` needs to know of the printer and the way to it."""
    group = parser.add_argument_group("printing")
    group.add_argument(
        "--link", metavar="BAUD", type=positive, help="say where a port of this speed would be too slow"
    )
    group.add_argument(
        "--latency",
        metavar="MS",
        type=factor,
        default=1.0,
        help="until an answer is there; 16 is usual for USB to serial chips without low latency; default: 1",
    )
    group.add_argument(
        "--window", metavar="LINES", type=positive, default=2, help="most lines in flight; default: 2"
    )
    add_machine(group)


def add_machine(parser: _Flags) -> None:
    """The machine by which G-code is judged, and what it may hold all the same."""
    add_allow(parser)
    parser.add_argument("--printer", metavar="NAME", help="printer profile, or path of a .toml file")
    parser.add_argument("--material", metavar="NAME", help="material profile, likewise")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )


def add_send(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`send`."""
    parser = command(
        commands,
        "send",
        "upload G-code to a printer on the network",
        "  printer-slicer send part.gcode --to octoprint http://octopi.local --print\n"
        "  printer-slicer send part.gcode --to moonraker http://voron.local:7125\n"
        "  printer-slicer send part.gcode --to prusalink http://mk4.local --key-file ~/.mk4.key\n"
        "  printer-slicer send part.gcode --to duet http://duet.local --folder /gcodes/parts\n"
        "keys: --key-file, else the variable PRINTER_SLICER_KEY; what --key has others on this computer may see",
    )
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="what to send")
    parser.add_argument(
        "--to",
        nargs=2,
        required=True,
        metavar=("KIND", "URL"),
        help="octoprint, moonraker, prusalink or duet, and the address of its page",
    )
    parser.add_argument("--print", dest="start", action="store_true", help="and print it")
    parser.add_argument("--name", metavar="NAME", help="what to call it there; default: its own name")
    parser.add_argument(
        "--folder", metavar="PATH", default="", help="in which folder there; default: the usual one"
    )
    parser.add_argument("--key-file", metavar="FILE", type=Path, help="file that holds the key or password")
    parser.add_argument("--key", metavar="KEY", help="API key or password")
    parser.add_argument(
        "--user", metavar="NAME", default="", help="whose password it is; default for prusalink: maker"
    )
    parser.add_argument(
        "--timeout", metavar="S", type=positive, default=30, help="s without an answer; default: 30"
    )
    checked = "checks before sending: unsupported extrusion; with --print everything that `print` checks"
    add_machine(parser.add_argument_group(checked))
    output(parser)
    parser.set_defaults(run=later("sending", "send_command"))


def add_doctor(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`doctor`."""
    parser = command(
        commands,
        "doctor",
        "look for what keeps a printer from being printed to",
        "  printer-slicer doctor                   the ports of this computer\n"
        "  printer-slicer doctor /dev/ttyUSB0      one of them, and the printer behind it\n"
        "  printer-slicer doctor /dev/ttyACM0 --baud 250000 --json",
    )
    parser.add_argument(
        "port", nargs="?", metavar="PORT", help="device or URL; default: look at all ports, ask none"
    )
    parser.add_argument("--baud", type=positive, metavar="N", default=115_200, help="default: 115200")
    output(parser)
    parser.set_defaults(run=later("doctoring", "doctor_command"))


FIRMWARES: Final = (
    *("marlin 1.1", "marlin 2.0", "marlin 2.1", "marlin 2.1 advanced", "marlin 2.1.3", "prusa mk3"),
    *("reprapfirmware", "klipper", "repetier", "smoothie", "octoprint virtual"),
)
"""As `sim.front_end` has them, which is not imported before it is needed; a test holds the two equal."""


def _firmware(text: str) -> str:
    """A name of the list, however its words are joined."""
    name = " ".join(text.lower().replace("_", " ").replace("-", " ").split())
    if name not in FIRMWARES:
        raise argparse.ArgumentTypeError(f"{text!r} is not known; known are {', '.join(FIRMWARES)}")
    return name


def add_firmware(parser: argparse.ArgumentParser) -> None:
    """Flags that decide which firmware is simulated and what goes wrong with it."""
    group = parser.add_argument_group("simulated printer")
    group.add_argument(
        "--firmware",
        metavar="NAME",
        type=_firmware,
        help=f"simulated firmware: {', '.join(FIRMWARES)}; parts are sliced for it; default: marlin 2.1 with the "
        "commands of the printer's flavour",
    )
    group.add_argument(
        "--extruders",
        metavar="N",
        type=positive,
        help="how many it has; default: 1, or up to the tool that the printer's profile prints with",
    )
    group.add_argument(
        "--one-hotend", action="store_true", help="the extruders share one, as with a changer of filaments"
    )
    group.add_argument(
        "--faults", metavar="FILE.toml", type=Path, help="what shall go wrong, see docs/simulator.md"
    )
    group.add_argument(
        "--seed", metavar="N", type=whole, help="of all chance; default: as the file says, else 0"
    )


def add_sim_flags(parser: argparse.ArgumentParser) -> None:
    """Flags of `sim` alone: the door, the clock, the card."""
    door = parser.add_mutually_exclusive_group()
    door.add_argument(
        "--pty",
        metavar="LINK",
        type=Path,
        help="where to link a pseudo-terminal; default: printer-slicer-sim",
    )
    door.add_argument(
        "--tcp",
        metavar="HOST:PORT",
        type=address,
        help="listen there instead, on any system; port 0: a free one",
    )
    parser.add_argument(
        "--rfc2217", action="store_true", help="speak RFC 2217 at --tcp instead of plain bytes"
    )
    parser.add_argument(
        "--speed", type=factor, default=1.0, metavar="X", help="times real time; 0: do not wait at all"
    )
    parser.add_argument(
        "--baud", type=positive, metavar="N", help="pace of the bytes; default: none, or the firmware's need"
    )
    parser.add_argument(
        "--latency-timer",
        type=factor,
        metavar="MS",
        default=0.0,
        help="of a USB chip, such as 16; default: none",
    )
    parser.add_argument(
        "--card",
        metavar="FILE",
        nargs="*",
        type=Path,
        help="a memory card with these files; default: no reader",
    )
    parser.add_argument(
        "--report", metavar="FILE", type=Path, help="write what was executed as JSON at the end"
    )
    add_models(parser, gcode=True, flag="--expect", meaning="judge at the end whether this was printed")
    add_firmware(parser)
