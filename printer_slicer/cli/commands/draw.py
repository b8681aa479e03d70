"""`draw`: draw a layer of any slicer's G-code, or its layers in 3D."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    add_model_options,
    add_output_options,
    parse_box,
    parse_height,
    parse_integer,
    parse_length,
    parse_pixels,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.inputs import load_file_profile, reject_non_gcode
from printer_slicer.cli.output import (
    choose_output_beside,
    print_text,
    reject_overwriting_input,
    sanitize,
    show_stages,
    write_file,
)
from printer_slicer.cli.unused_options import reject_options_without_model
from printer_slicer.errors import PrinterSlicerError, UsageError
from printer_slicer.saving import check_writable

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.cli.output import StageReport
    from printer_slicer.diagnostics import Diagnostic
    from printer_slicer.drawing import Picture
    from printer_slicer.geometry import Areas
    from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions
    from printer_slicer.inspection.coverage.layer_extrusions import FileLayers, LayerExtrusions
    from printer_slicer.inspection.coverage.matching import Match
    from printer_slicer.inspection.coverage.stack import Stack

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer draw part.gcode                       the layer with most findings, as part.svg
  printer-slicer draw part.gcode --layer 12 -o layer.svg
  printer-slicer draw part.gcode --z 2.4 --travel -o layer.png --pixels 2000
  printer-slicer draw part.gcode --3d -o part.png      all layers, seen from the front right and above
  printer-slicer draw part.gcode --layer 12 --box 100,100,110,108 -o corner.svg
  printer-slicer draw part.gcode --layer 12 --model part.stl -o layer.svg    with the section's outline"""
_MIN_MATCH = 0.5  # share of the external perimeters; a smaller match means that the model is another part
_DECIMALS = 4  # of numbers in the result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `draw`."""
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="G-code of any slicer")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="picture to write, as .svg or .png; - is stdout; default: FILE.svg beside the G-code",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--layer",
        metavar="N",
        type=parse_integer,
        help="layer to draw, counted from 1; default: the layer with the most findings",
    )
    which.add_argument(
        "--z", metavar="MM", type=parse_height, help="draw the layer that contains this height"
    )
    parser.add_argument(
        "--3d",
        dest="in_3d",
        action="store_true",
        help="draw all layers in 3D; with --layer or --z, the layers up to this one",
    )
    parser.add_argument(
        "--box", metavar="X0,Y0,X1,Y1", type=parse_box, help="draw only this rectangle of the bed, in mm"
    )
    parser.add_argument("--travel", action="store_true", help="also draw travel moves")
    parser.add_argument(
        "--pixels",
        metavar="N",
        type=parse_pixels,
        default=1000,
        help="length of the longer side of the picture in pixels; default: 1000",
    )
    mark_advanced(
        parser.add_argument(
            "--filament",
            metavar="MM",
            type=parse_length,
            help="filament diameter; default: the diameter in the G-code file, or 1.75",
        )
    )
    add_model_options(parser, flag="--model", meaning="also draw the outline of these models")
    add_output_options(parser)
    parser.set_defaults(strict=False, set=[])


def run(arguments: argparse.Namespace) -> int:
    """Draw one layer of a G-code file, or its layers in 3D, and print the extrusions."""
    from printer_slicer.commands import read_text
    from printer_slicer.drawing import encode_picture
    from printer_slicer.inspection.coverage.layer_extrusions import extrusions_of_layer, file_layers_of
    from printer_slicer.inspection.coverage.model_check import read_gcode_extrusions

    _reject_options_of_other_view(arguments)
    reject_options_without_model(arguments)
    reject_non_gcode(arguments.gcode)
    arguments.output = arguments.output or choose_output_beside(arguments.gcode, ".svg", "picture", "-o FILE")
    _check_output(arguments)
    with show_stages(arguments) as report:
        report("reading")
        deposit, stack = read_gcode_extrusions(
            read_text(arguments.gcode), arguments.filament, arguments.gcode.name
        )
        stack, sections, match = _match_model(arguments, deposit, stack, report)
        levels = file_layers_of(deposit, stack)
        number, why = _choose_layer(arguments, levels, report)
        sheet = extrusions_of_layer(deposit, levels, number, with_lower=arguments.in_3d)
        own = int(levels.of_stack[sheet.number])
        rings = list(sections.rings(own)) if sections is not None and own >= 0 else []
        report("drawing")
        picture = _draw(arguments, sheet, rings)
        write_file(arguments.output, encode_picture(picture, arguments.output))
    facts = _collect_layer_facts(arguments, sheet, match)
    if arguments.json:
        print(json.dumps(facts))
    elif str(arguments.output) != "-":
        print_text(arguments, "\n  ".join([*_format_facts(facts), *([why] if why else [])]))
    return 0


def _reject_options_of_other_view(arguments: argparse.Namespace) -> None:
    """Reject options that have no effect on a drawing in 3D.

    Raises:
        UsageError: such an option is given with --3d.
    """
    given = {"--box": arguments.box, "--travel": arguments.travel, "--model": arguments.models}
    for flag in [flag for flag, value in given.items() if value and arguments.in_3d]:
        raise UsageError(
            f"{flag}: does not apply to a drawing in 3D", remedy=f"Leave out {flag}, or leave out --3d"
        )


def _draw(arguments: argparse.Namespace, sheet: LayerExtrusions, rings: list[Float]) -> Picture:
    """Draw the extrusions; `rings` are those of the model's section.

    Raises:
        UsageError: --box contains no extrusions.
    """
    from printer_slicer.drawing import View, draw_gcode_layer, draw_gcode_layers_3d

    title = sanitize(arguments.gcode.name)
    if arguments.in_3d:
        return draw_gcode_layers_3d(sheet, title, arguments.pixels)
    _check_box(arguments, sheet)
    return draw_gcode_layer(sheet, title, View(arguments.box, arguments.pixels, arguments.travel, rings))


def _check_output(arguments: argparse.Namespace) -> None:
    """Check, before work starts, that the picture can be written.

    Raises:
        UsageError: the picture format is unknown, two outputs go to stdout, or an input file would be overwritten.
        OutputError: the picture cannot be written.
    """
    from printer_slicer.drawing import check_picture_path

    check_picture_path(arguments.output)
    if str(arguments.output) == "-":
        if arguments.json:
            raise UsageError("-o - and --json cannot both go to stdout", remedy="Write the picture to a file")
    else:
        check_writable(arguments.output)
    for path in (arguments.gcode, *arguments.models):
        reject_overwriting_input(arguments.output, path)


def _match_model(
    arguments: argparse.Namespace, deposit: GcodeExtrusions, stack: Stack, report: StageReport
) -> tuple[Stack, Areas | None, Match | None]:
    """Return the layers of the file; with a model, also its sections in these layers and how well they match."""
    from printer_slicer.cli.models import load_repaired_plate
    from printer_slicer.inspection.coverage.model_check import place_sections

    if not arguments.models:
        return stack, None, None
    mesh, plate, _ = load_repaired_plate(arguments, load_file_profile(arguments), report)
    is_placed = arguments.center or arguments.as_placed or not arguments.drop
    report("matching")
    return place_sections(mesh, deposit, stack, plate.placement if is_placed else None)


def _choose_layer(arguments: argparse.Namespace, levels: FileLayers, report: StageReport) -> tuple[int, str]:
    """Return the index of the layer to draw, and why it was chosen; the reason is empty if the user chose the layer.

    Raises:
        UsageError: the file has no such layer.
    """
    if arguments.in_3d and arguments.z is None and arguments.layer is None:
        return levels.n_layers - 1, ""
    if arguments.z is not None or arguments.layer is not None:
        return _find_requested_layer(arguments, levels), ""
    report("checking")
    counts = Counter(
        layer for finding in _collect_findings(arguments) for layer in _find_layers(finding, levels)
    )
    if not counts:
        return 0, "drawn: the first layer, because no layer has findings; --layer N draws another one"
    layer, count = max(counts.items(), key=lambda item: (item[1], -item[0]))
    many = "1 finding" if count == 1 else f"{count} findings"
    return layer, f"drawn: the layer with the most findings ({many}); --layer N draws another one"


def _collect_findings(arguments: argparse.Namespace) -> list[Diagnostic]:
    """Return the findings of `check` for the file, and for its comparison with the model if there is one.

    A file that cannot be checked can still be drawn; it has no findings.
    """
    from printer_slicer.cli.models import load_repaired_plate
    from printer_slicer.cli.settings import load_selected_profile
    from printer_slicer.commands import read_text
    from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
    from printer_slicer.inspection.lint.scan import lint_file

    found: list[Diagnostic] = []
    with suppress(PrinterSlicerError):
        profile = load_selected_profile(arguments, slices=False, gcode=arguments.gcode, tell=False)
        found += lint_file(arguments.gcode, profile).findings
        if arguments.models:
            mesh, plate, _ = load_repaired_plate(arguments, profile, lambda _: None)
            told = arguments.center or arguments.as_placed or not arguments.drop
            placement = plate.placement if told else None
            options = CheckOptions(filament_diameter=arguments.filament, placement=placement)
            text = read_text(arguments.gcode)
            found += check_gcode(text, mesh, options, name=arguments.gcode.name).findings
    return found


def _find_layers(finding: Diagnostic, levels: FileLayers) -> Iterable[int]:
    """Return the indices of the layers in which a finding lies."""
    if finding.first:
        return [layer for layer in finding.affected_layers if 0 <= layer < levels.n_layers]
    layer = levels.layer_at(finding.z) if finding.z is not None else finding.layer - 1
    if layer < 0 and finding.z is None:
        layer = levels.layer_of_line(finding.line)  # the file may have no comments that begin layers
    return [layer] if 0 <= layer < levels.n_layers else []


def _find_requested_layer(arguments: argparse.Namespace, levels: FileLayers) -> int:
    """Return the index of the requested layer.

    Raises:
        UsageError: the file has no such layer.
    """
    top = float(levels.top[-1])
    if arguments.z is not None:
        number = levels.layer_at(arguments.z)
        if number < 0:
            raise UsageError(
                f"--z {arguments.z:g}: {arguments.gcode.name} has layers from the bed to z {top:.4g} mm",
                remedy="Choose a height in this range",
            )
        return number
    number = int(arguments.layer)
    if not 1 <= number <= levels.n_layers:
        raise UsageError(
            f"--layer {number}: {arguments.gcode.name} has layers 1 to {levels.n_layers}",
            remedy="Choose one of these, or a height with --z",
        )
    return number - 1


def _check_box(arguments: argparse.Namespace, sheet: LayerExtrusions) -> None:
    """Check that --box overlaps the extrusions of the layer.

    Raises:
        UsageError: the box contains no extrusions.
    """
    import numpy as np

    if arguments.box is None:
        return
    corners = np.array(arguments.box)
    places = np.concatenate([sheet.beads.begin, sheet.beads.end])
    low, high = places.min(axis=0), places.max(axis=0)
    if (corners.max(axis=0) < low).any() or (corners.min(axis=0) > high).any():
        lies = f"from {low[0]:.1f},{low[1]:.1f} to {high[0]:.1f},{high[1]:.1f}"
        raise UsageError(
            f"--box {','.join(f'{number:g}' for number in corners.ravel())}: "
            f"contains none of the extrusions of layer {sheet.number + 1}, which extend {lies}",
            remedy="Give two corners within this range as X0,Y0,X1,Y1, in mm on the bed",
        )


def _collect_layer_facts(
    arguments: argparse.Namespace, sheet: LayerExtrusions, match: Match | None
) -> dict[str, Any]:
    """Return the facts about the drawn layer, or layers, for JSON.

    Lengths are in mm, volumes in mm³; layers are counted from 1.
    """
    import numpy as np

    return {
        "output": str(arguments.output),
        "file": str(arguments.gcode),
        "layer": sheet.number + 1,
        "layers": sheet.count,
        "in_3d": arguments.in_3d,
        "z": round(sheet.top, _DECIMALS),
        "height": round(sheet.height, _DECIMALS),
        "extrusions": list(_list_extrusion_facts(sheet)),
        "travel": round(float(np.hypot(*(sheet.travel[:, 1] - sheet.travel[:, 0]).T).sum()), _DECIMALS),
        "fit": None if match is None else round(match.share, _DECIMALS),
    }


def _list_extrusion_facts(sheet: LayerExtrusions) -> Iterator[dict[str, Any]]:
    """Group the extrusions by role and by comment in the file; yield length, volume and width of each group."""
    import numpy as np

    from printer_slicer.inspection.deposition.marks import Purpose

    beads = sheet.beads
    pairs = np.stack([sheet.name, beads.purpose], axis=1)
    for name, purpose in np.unique(pairs, axis=0).tolist():
        own = beads.take((sheet.name == name) & (beads.purpose == purpose))
        yield {
            "role": Purpose(purpose).label,
            "comment": sheet.names[name],
            "length": round(float(own.length.sum()), _DECIMALS),
            "volume": round(float(own.volume.sum()), _DECIMALS),
            "width": [round(float(width), _DECIMALS) for width in (own.width.min(), own.width.max())],
        }


def _format_facts(facts: dict[str, Any]) -> Iterator[str]:
    """Format the facts about the layer as sentences."""
    where = f"{facts['layer']} of {facts['layers']}, z {facts['z']:g} mm"
    if facts["in_3d"]:
        yield f"{facts['output']}: layers 1 to {where}"
    else:
        yield f"{facts['output']}: layer {where}, {facts['height']:g} mm high"
    for one in facts["extrusions"]:
        low, high = (f"{width:.2f}" for width in one["width"])
        wide = low if low == high else f"{low} to {high}"
        named = f" ({one['comment']})" if one["comment"] not in ("", one["role"]) else ""
        yield sanitize(
            f"{one['role']}{named}: {one['length']:.1f} mm, {wide} mm wide, {one['volume']:.2f} mm³"
        )
    if facts["fit"] is not None and facts["fit"] < _MIN_MATCH:
        yield (
            f"only {facts['fit']:.0%} of the external perimeters match this model: "
            "check that the file was sliced from this model, with the same scale and rotation"
        )
