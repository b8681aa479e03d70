"""What can be typed: commands, flags, help by example. Imports nothing heavy, so that --help answers at once."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from printer_slicer.cli.control import add_control
from printer_slicer.cli.dials import add_dials
from printer_slicer.cli.door_parsers import (
    add_allow,
    add_allow_unsupported,
    add_beforehand,
    add_doctor,
    add_firmware,
    add_send,
    add_sim_flags,
)
from printer_slicer.cli.later_parsers import add_console, add_print_flags, add_resume
from printer_slicer.cli.model_flags import add_models, attached, box_of
from printer_slicer.cli.parsing import Command, Parser
from printer_slicer.cli.parsing import command as _command
from printer_slicer.cli.parsing import later as _later
from printer_slicer.cli.parsing import output as _output
from printer_slicer.cli.profile_parsers import add_profiles, add_settings
from printer_slicer.cli.shell_parsers import add_completion, add_man
from printer_slicer.cli.values import factor, height, length, number, pixels, positive, whole
from printer_slicer.version import VERSION

__all__ = ["build_parser"]

_EXAMPLES = """\
examples:
  printer-slicer slice part.stl                      write part.gcode
  printer-slicer slice part.stl --quality adaptive   thick layers where the shape allows, thin ones elsewhere
  printer-slicer plan part.stl --picture plan.svg    compare layer plans, draw the chosen one
  printer-slicer check part.gcode --model part.stl   hold any slicer's G-code against the part
  printer-slicer draw part.gcode --layer 12 -o layer.svg   draw a layer of any slicer's G-code
  printer-slicer dry-run part.stl                    print it on a simulated printer and say what would happen
  printer-slicer print part.stl --port sim:          the same over the serial protocol, line by line
  printer-slicer ports                               which serial ports there are
  printer-slicer print part.stl --port /dev/ttyUSB0  print it
  printer-slicer control pause                       have a wish for a running print
  printer-slicer resume                              go on with a print that was broken off

exit codes: 0 done, 2 usage, 3 the part cannot be sliced, 4 the port, 5 print failed, 6 cancelled, 7 verification failed
"""


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line; `run` in its result is the function to call."""
    parser = _Parser(
        prog="printer-slicer",
        description="Slice a part with adaptive layer heights, check any G-code, print it over USB, or dry-run it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and stop")
    usual: type[argparse.ArgumentParser] = Command
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=usual, title="commands")
    _slice(commands)
    _plan(commands)
    _contours(commands)
    _check(commands)
    _draw(commands)
    _dry_run(commands)
    _print(commands)
    add_resume(commands)
    add_control(commands)
    add_console(commands)
    _sim(commands)
    add_send(commands)
    _ports(commands)
    add_doctor(commands)
    add_profiles(commands)
    add_completion(commands)
    add_man(commands)
    return parser


class _Parser(Parser):
    """Takes `--rotate -90,0,0` as it is meant."""

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """As the class it comes from, which takes every word with a minus sign for a flag."""
        return super().parse_known_args(attached(sys.argv[1:] if args is None else args), namespace)


class _Output(argparse.Action):
    """Action of -o: an existing folder, or a name ending with /, sets --output-dir instead."""

    def __call__(
        self, _parser: object, namespace: argparse.Namespace, value: object, _flag: object = None
    ) -> None:
        path = Path(str(value))
        is_folder = str(value).endswith(("/", os.sep)) or (value != "" and path.is_dir())
        setattr(namespace, "output_dir" if is_folder else "output", path)


class _Version(argparse.Action):
    """Says the version."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"printer-slicer {VERSION}")
        parser.exit()


def _common(parser: argparse.ArgumentParser, *, strict: str = "fail if the mesh needs repair") -> None:
    """Flags that decide how a part becomes G-code, and how results are said; `strict` is the help of --strict."""
    group = add_settings(parser)
    group.add_argument("--strict", action="store_true", help=strict)
    add_dials(parser)
    _output(parser)


def _slice(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "slice",
        "make G-code from a part",
        "  printer-slicer slice part.stl -o part.gcode --printer corexy_klipper --material petg\n"
        "  printer-slicer slice part.stl --set infill_density=0.3 --set speeds.travel=200\n"
        "  printer-slicer slice part.stl --quality adaptive --picture layer.svg --layer 12\n"
        "  printer-slicer slice part.stl --units inch --rotate -90,0,0 --scale 50%\n"
        "  printer-slicer slice lid.stl box.3mf -o plate.gcode     all on one plate, positions from the files\n"
        "  printer-slicer slice *.stl -o gcode/                    one G-code file per model",
    )
    add_models(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-o",
        "--output",
        metavar="OUT.gcode",
        action=_Output,
        help="default: beside the first model; - for stdout; a folder, or a name ending with /: as --output-dir",
    )
    where.add_argument(
        "--output-dir",
        metavar="DIR",
        type=Path,
        help="write one G-code file per model into this folder; created if missing",
    )
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw one layer's beads, SVG or PNG by the name"
    )
    parser.add_argument(
        "--layer", metavar="N", type=whole, help="which layer of the print to draw, from 1; default: 1"
    )
    parser.add_argument(
        "--timestamp",
        action="store_true",
        help="write date and time into the first line; default: only if SOURCE_DATE_EPOCH is set",
    )
    add_allow_unsupported(parser)
    _common(
        parser,
        strict="fail if the mesh needs repair, or if extrusion is unsupported and not allowed",
    )
    parser.set_defaults(run=_later("slicing", "slice_command"))


def _plan(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "plan",
        "compare layer plans for a part",
        "  printer-slicer plan sample_parts/case_study.stl --printer marlin_220_06 --quality case_study\n"
        "  printer-slicer plan part.stl --picture plan.png --tolerance 0.05\n"
        "  printer-slicer plan part.stl --compare --heights 0.1:0.3:0.02\n"
        "  printer-slicer plan part.stl --time-budget 45m --range 10:12:tolerance=0.03",
    )
    add_models(parser)
    parser.add_argument(
        "--compare", action="store_true", help="all planners, at the same tolerance and heights"
    )
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw the chosen plan, SVG or PNG by the name"
    )
    _common(parser)
    parser.set_defaults(run=_later("planning", "plan_command"))


def _contours(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "contours",
        "write the contours of a part for other machines: SVG, CLI, SLC",
        "  printer-slicer contours part.stl -o part.svg           one group per layer\n"
        "  printer-slicer contours part.stl -o slices/            one SVG per layer\n"
        "  printer-slicer contours part.stl -o part_%04d.svg      the same, with names of your own\n"
        "  printer-slicer contours part.stl -o part.cli --binary  Common Layer Interface 2.0\n"
        "  printer-slicer contours part.stl -o part.slc --smooth 0.02 --resample 0.5",
    )
    add_models(parser)
    # Not a Path: that would lose the / at the end of a folder.
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        required=True,
        help="name ending in .svg, .cli or .slc; a folder/ or a name with %%d: one SVG per layer",
    )
    parser.add_argument("--binary", action="store_true", help="binary instead of ASCII, for .cli")
    parser.add_argument(
        "--smooth",
        metavar="MM",
        type=number,
        help="smooth contours, nowhere farther off than this; default: not",
    )
    parser.add_argument(
        "--resample",
        metavar="MM",
        type=number,
        help="points at most this far apart, but for the rounding of the file, which is told; off by at most the"
        " setting resolution; default: as they are",
    )
    _common(parser)
    parser.set_defaults(run=_later("contours", "contours_command"))


def _check(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "check",
        "look at G-code of any slicer before it is printed: what it holds, its material, the link",
        "  printer-slicer check part.gcode                    commands, temperatures, ways, speeds\n"
        "  printer-slicer check part.gcode --link 115200      where the machine would wait for lines\n"
        "  printer-slicer check part.gcode --model part.stl   the material it lays against the part\n"
        "  printer-slicer check part.gcode --model part.stl --picture faults.png --json\n"
        "  printer-slicer check part.gcode --model part.stl --limit under=0.95 --limit air=5\n"
        "  printer-slicer check plate.gcode --model lid.stl box.3mf --rotate 90 --filament 2.85",
    )
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="G-code of any slicer")
    meaning = "what it shall print; several lie to each other as their files place them"
    add_models(parser, flag="--model", meaning=meaning)
    add_beforehand(parser)
    group = parser.add_argument_group("measuring")
    group.add_argument(
        "--filament", metavar="MM", type=length, help="diameter; default: as the file says, else 1.75"
    )
    group.add_argument(
        "--shell",
        metavar="MM",
        type=length,
        help="depth of the shell; default: of the file's own perimeters",
    )
    group.add_argument(
        "--skin",
        metavar="MM",
        type=factor,
        default=0.0,
        help="height under and over air that belongs to the shell; default: the layer next to it",
    )
    group.add_argument(
        "--limit",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="change one limit: uncovered, outside, overlap, air, under, over, outline; may be repeated",
    )
    _output(parser)
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw the worst layers, SVG or PNG by the name"
    )
    parser.set_defaults(run=_later("checking", "check_command"), strict=False)


def _draw(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "draw",
        "draw one layer of any slicer's G-code from above, every bead as wide as it is laid",
        "  printer-slicer draw part.gcode --layer 12 -o layer.svg\n"
        "  printer-slicer draw part.gcode --z 2.4 --travel -o layer.png --pixels 2000\n"
        "  printer-slicer draw part.gcode --layer 12 --box 100,100,110,108 -o corner.svg\n"
        "  printer-slicer draw part.gcode --layer 12 --model part.stl -o layer.svg    with the section's outline",
    )
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="G-code of any slicer")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        required=True,
        help="SVG or PNG by the name; - for stdout",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--layer", metavar="N", type=whole, help="which layer of the file, from 1; default: 1")
    which.add_argument("--z", metavar="MM", type=height, help="the layer that holds this height over the bed")
    parser.add_argument(
        "--box",
        metavar="X0,Y0,X1,Y1",
        type=box_of,
        help="only this part of the bed, in mm; default: all beads",
    )
    parser.add_argument("--travel", action="store_true", help="show where the nozzle goes and lays nothing")
    parser.add_argument(
        "--pixels", metavar="N", type=pixels, default=1000, help="longer side of the drawing; default: 1000"
    )
    parser.add_argument(
        "--filament", metavar="MM", type=length, help="diameter; default: as the file says, else 1.75"
    )
    add_models(parser, flag="--model", meaning="draw the outline of its section too; it is found in the file")
    _output(parser)
    parser.set_defaults(run=_later("drawing", "draw_command"), strict=False)


def _dry_run(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "dry-run",
        "print on a simulated printer, in seconds, and say what would happen",
        "  printer-slicer dry-run part.stl\n"
        "  printer-slicer dry-run part.gcode --printer marlin_220 --json\n"
        "  printer-slicer dry-run part.gcode --link 57600 --picture print.png",
    )
    add_models(parser, gcode=True)
    parser.add_argument(
        "--link",
        metavar="BAUD",
        type=positive,
        help="speed of the serial port; running out of moves counts as a fault then",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE",
        type=Path,
        help="draw what was printed, time and flow over the height, and the faults (.svg or .png)",
    )
    add_allow(parser)
    add_firmware(parser)
    _common(parser)
    parser.set_defaults(run=_later("printing", "dry_run_command"))


def _print(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "print",
        "print over a serial port",
        "  printer-slicer print part.stl --port /dev/ttyUSB0\n"
        "  printer-slicer print part.gcode --port socket://192.168.1.7:8888 --json\n"
        "  printer-slicer print part.stl --port sim:          simulated printer, virtual clock",
    )
    add_models(parser, gcode=True)
    parser.add_argument(
        "--port", required=True, metavar="PORT", help="device, socket:// or rfc2217:// URL, or sim:"
    )
    parser.add_argument("--baud", type=positive, metavar="N", help="default: as the printer's profile says")
    add_allow(parser)
    add_print_flags(parser)
    _common(parser)
    parser.set_defaults(run=_later("printing", "print_command"))


def _sim(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(
        commands,
        "sim",
        "serve the simulated printer on a pseudo-terminal or over TCP until interrupted",
        "  printer-slicer sim --pty /tmp/printer &\n"
        "  printer-slicer print part.stl --port /tmp/printer\n"
        "  printer-slicer sim --tcp 127.0.0.1:8888             print --port socket://127.0.0.1:8888\n"
        "  printer-slicer sim --tcp 127.0.0.1:8888 --rfc2217   print --port rfc2217://127.0.0.1:8888\n"
        "  printer-slicer sim --firmware klipper --faults bad_day.toml --seed 3\n"
        "  printer-slicer sim --pty /tmp/printer --speed 0     as fast as the host can send\n"
        "  printer-slicer sim --pty /tmp/printer --expect part.stl   and say whether all of it was printed",
    )
    add_sim_flags(parser)
    _common(parser)
    parser.set_defaults(run=_later("printing", "sim_command"))


def _ports(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _command(commands, "ports", "list the serial ports", "  printer-slicer ports --json")
    _output(parser)
    parser.set_defaults(run=_later("profiles", "ports_command"))
