"""`view`: write a web page that shows the layers and moves of any slicer's G-code."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output_options, parse_length
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.inputs import load_file_profile, reject_non_gcode
from printer_slicer.cli.opening import add_open_option, open_files
from printer_slicer.cli.output import (
    choose_output_beside,
    print_text,
    reject_overwriting_input,
    sanitize,
    show_stages,
    write_file,
)
from printer_slicer.errors import UsageError
from printer_slicer.saving import check_writable
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.preview import Preview

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer view part.gcode                       write part.html
  printer-slicer view part.gcode --open                and show it in the browser
  printer-slicer view part.gcode -o pages/part.html"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `view`."""
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="G-code of any slicer")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE.html",
        type=Path,
        help="page to write; - is stdout; default: FILE.html beside the G-code",
    )
    mark_advanced(
        parser.add_argument(
            "--filament",
            metavar="MM",
            type=parse_length,
            help="filament diameter; default: the diameter in the G-code file, or 1.75",
        )
    )
    add_open_option(add_output_options(parser))
    parser.set_defaults(strict=False, set=[])


def run(arguments: argparse.Namespace) -> int:
    """Write the page, and print its size and what it shows."""
    from printer_slicer.commands import read_text
    from printer_slicer.motion.rules import limits_of
    from printer_slicer.preview import make_view_page, read_preview

    reject_non_gcode(arguments.gcode)
    arguments.output = arguments.output or choose_output_beside(
        arguments.gcode, ".html", "page", "-o FILE.html"
    )
    _check_output(arguments)
    with show_stages(arguments) as report:
        report("reading")
        limits = limits_of(load_file_profile(arguments).printer)
        text, name = read_text(arguments.gcode), sanitize(arguments.gcode.name)
        preview = read_preview(text, name, limits, filament_diameter=arguments.filament)
        report("writing")
        page = make_view_page(preview)
        write_file(arguments.output, page)
    facts = _collect_facts(arguments, preview, len(page))
    if arguments.json:
        print(json.dumps(facts))
    elif str(arguments.output) != "-":
        print_text(arguments, _format_facts(facts))
    open_files(arguments, [arguments.output])
    return 0


def _check_output(arguments: argparse.Namespace) -> None:
    """Check, before work starts, that the page can be written.

    Raises:
        UsageError: the file is no .html file, two outputs go to stdout, or the G-code would be overwritten.
        OutputError: the page cannot be written.
    """
    output: Path = arguments.output
    if str(output) == "-":
        if arguments.json:
            raise UsageError("-o - and --json cannot both go to stdout", remedy="Write the page to a file")
        return
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{output}: the page is HTML", remedy="Use a name that ends in .html")
    check_writable(output)
    reject_overwriting_input(output, arguments.gcode)


def _collect_facts(arguments: argparse.Namespace, preview: Preview, size: int) -> dict[str, Any]:
    """Return what `--json` prints."""
    from printer_slicer.preview.columns import NO_EXTRUSION_ROLES

    return {
        "output": str(arguments.output),
        "bytes": size,
        "layers": preview.n_layers,
        "moves": preview.n_moves,
        "seconds": round(float(preview.layer_seconds.sum()), 1),
        "roles": [role.name for role in preview.roles[len(NO_EXTRUSION_ROLES) :]],
    }


def _format_facts(facts: dict[str, Any]) -> str:
    """Return one line about the page."""
    size = f"{facts['bytes'] / 1e6:.2g} MB" if facts["bytes"] >= 1e6 else f"{facts['bytes'] / 1e3:.0f} kB"
    shows = f"{facts['layers']} layers, {facts['moves']} moves"
    return sanitize(f"{facts['output']}: {shows}, {format_duration(facts['seconds'])} of motion, {size}")
