"""Options of the simulated printer, for the commands that use it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from printer_slicer.cli.arguments import parse_integer, parse_positive_integer
from printer_slicer.cli.help import mark_advanced

__all__ = ["FIRMWARES", "add_simulator_options"]

FIRMWARES: Final = (
    *("marlin 1.1", "marlin 2.0", "marlin 2.1", "marlin 2.1 advanced", "marlin 2.1.3", "prusa mk3"),
    *("reprapfirmware", "klipper", "repetier", "smoothie", "octoprint virtual"),
)
"""The names in `sim.firmwares`, repeated here so that --help need not import it; a test compares the two."""


def _parse_firmware(text: str) -> str:
    """Parse the name of a firmware; words may be joined by spaces, hyphens or underscores."""
    name = " ".join(text.lower().replace("_", " ").replace("-", " ").split())
    if name not in FIRMWARES:
        raise argparse.ArgumentTypeError(f"unknown firmware {text!r}; choose one of: {', '.join(FIRMWARES)}")
    return name


def add_simulator_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options for the simulated printer; return their group."""
    group = parser.add_argument_group("simulated printer")
    mark_advanced(
        group.add_argument(
            "--firmware",
            metavar="NAME",
            type=_parse_firmware,
            help="firmware to simulate; models are sliced for it, too; default: marlin 2.1 with the commands of the "
            f"printer's flavour; NAME is one of {', '.join(FIRMWARES)}",
        )
    )
    mark_advanced(
        group.add_argument(
            "--extruders",
            metavar="N",
            type=parse_positive_integer,
            help="number of extruders; default: as many as the printer profile uses, at least 1",
        )
    )
    mark_advanced(
        group.add_argument(
            "--one-hotend", action="store_true", help="simulate extruders that share one hotend"
        )
    )
    group.add_argument(
        "--faults",
        metavar="FILE.toml",
        type=Path,
        help="inject the faults in FILE; see docs/simulator.md",
    )
    mark_advanced(
        group.add_argument(
            "--seed",
            metavar="N",
            type=parse_integer,
            help="random seed of the faults; default: the seed in the fault script, or 0",
        )
    )
    return group
