"""`contours`: export the contours of a part as SVG, CLI or SLC files for other machines."""

from __future__ import annotations

import argparse
import json
import os
import re
from math import ceil, inf, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
    parse_number,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import print_text, reject_overwriting_input, show_stages, write_file
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import OutputError, UsageError
from printer_slicer.saving import check_writable, make_folder
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    from printer_slicer.cli.output import StageReport
    from printer_slicer.exports import RoundedRings
    from printer_slicer.model import Sections
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer contours part.stl -o part.svg           one group per layer
  printer-slicer contours part.stl -o slices/            one SVG per layer
  printer-slicer contours part.stl -o part_%04d.svg      the same, with your own file names
  printer-slicer contours part.stl -o part.cli --binary  Common Layer Interface 2.0
  printer-slicer contours part.stl -o part.slc --smooth 0.02 --resample 0.5"""
_FORMATS: Final = {".svg": "svg", ".cli": "cli", ".slc": "slc"}
_LAYER_NUMBER: Final = re.compile(r"%0?\d*d")
_LAYER_FILE: Final = re.compile(r"layer\d{4,}\.svg")
_DECIMALS: Final = 9  # of lengths in the result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `contours`."""
    # Not a Path, which would lose the / at the end of the name of a folder.
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        required=True,
        help="output file: .svg, .cli or .slc; for one SVG per layer, a folder/ or a name with %%d for the number",
    )
    mark_advanced(
        parser.add_argument(
            "--binary", action="store_true", help="write a binary .cli file instead of an ASCII one"
        )
    )
    parser.add_argument(
        "--smooth",
        metavar="MM",
        type=parse_number,
        help="smooth the contours, moving them by at most MM",
    )
    parser.add_argument(
        "--resample",
        metavar="MM",
        type=parse_number,
        help="resample the contours to points at most MM apart",
    )
    add_setting_options(parser, strict_help=STRICT_HELP)
    add_model_options(parser)
    add_output_options(parser)
    add_layer_options(parser)


class _Target(Struct, frozen=True):
    """Format and location of the output files.

    Attributes:
        kind: svg, cli or slc; svgs: one SVG per layer.
        path: the file; for svgs, the folder.
        pattern: for svgs, the name of each file, with one %d; empty: layer0000.svg and so on.
    """

    kind: str
    path: Path
    pattern: str = ""


def run(arguments: argparse.Namespace) -> int:
    """Slice a model, write its contours, and print how much they deviate from the sections."""
    from printer_slicer.cli.models import load_repaired_plate
    from printer_slicer.facts.slicing import format_repair_sentences, list_repair_facts
    from printer_slicer.healing import require_no_repair
    from printer_slicer.model import Repairs
    from printer_slicer.pipeline import plan_part
    from printer_slicer.placing import place
    from printer_slicer.slicing import cut, list_section_repairs

    target = _parse_target(arguments.output, binary=arguments.binary)
    profile = load_selected_profile(arguments)
    _check_containment_options(arguments, profile)
    with show_stages(arguments) as report:
        mesh, plate, repairs = load_repaired_plate(arguments, profile, report)
        for path in arguments.models:
            reject_overwriting_input(target.path, path)
        report("placing")
        part = place(mesh, profile.printer, plate.placement)
        shift = mesh.bounds[0] - part.bounds[0]
        del mesh
        report("planning")
        plan = plan_part(part, profile)
        report("slicing")
        raw = cut(part, plan, profile.quality.resolution)
        repairs = Repairs((*repairs.done, *list_section_repairs(raw, shift)))
        if arguments.strict:
            require_no_repair(part.name, repairs)
        sections = _smooth_and_resample(raw, arguments, profile, report)
        report("writing")
        sizes = _write_contours(sections, target, binary=arguments.binary)
    facts = _collect_contour_facts(sections, sizes, target, arguments, profile) | {
        "repairs": list_repair_facts(repairs)
    }
    if arguments.json:
        print(json.dumps(facts | plate.collect_facts() | collect_profile_facts(arguments)))
    else:
        print_text(
            arguments, "\n  ".join([*_format_facts(facts), *format_repair_sentences(facts["repairs"])])
        )
    return 0


# Output files


def _parse_target(output: str, *, binary: bool) -> _Target:
    """Return the format and the location of the output named by -o.

    Raises:
        UsageError: the name has no known suffix, or --binary does not apply to its format.
        OutputError: the file cannot be written.
    """
    if output == "-":
        raise UsageError(
            "-o -: contours cannot be written to stdout", remedy="Name a .svg, .cli or .slc file"
        )
    path = Path(output)
    kind = _FORMATS.get(path.suffix.lower(), "")
    if output.endswith(("/", os.sep)) or _is_folder(path):
        target = _Target("svgs", path)
        _check_folder(path)
    elif kind == "svg" and "%" in path.name:
        target = _Target("svgs", path.parent, _check_pattern(path.name))
        check_writable(path)
    elif kind:
        target = _Target(kind, path)
        check_writable(path)
    else:
        raise UsageError(
            f"-o {output}: unknown format; contours are written as .svg, .cli or .slc",
            remedy="Use one of these suffixes, or end the name with / for a folder with one SVG per layer",
        )
    if binary and target.kind != "cli":
        raise UsageError(
            f"--binary with -o {output}: only .cli files can be binary", remedy="Leave out --binary"
        )
    return target


def _is_folder(path: Path) -> bool:
    """Return whether the path is a folder.

    Raises:
        OutputError: the name is not valid.
    """
    try:
        return path.is_dir()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(f"{path}: cannot be written: {reason}", remedy="Choose another name") from None


def _check_pattern(name: str) -> str:
    """Check that a file name pattern has exactly one layer number and no other %; return it.

    Raises:
        UsageError: the pattern is invalid.
    """
    if len(_LAYER_NUMBER.findall(name)) != 1 or name.count("%") != 1:
        raise UsageError(
            f"-o {name}: a pattern must contain the layer number exactly once",
            remedy="Write for example part_%04d.svg",
        )
    return name


def _check_folder(path: Path) -> None:
    """Check that a folder exists or can be created.

    Raises:
        OutputError: the parent folder is missing, or a file has the name of the folder.
    """
    if path.exists() and not path.is_dir():
        raise OutputError(
            f"{path}: exists and is not a folder", remedy="Name a folder, or a file without / at the end"
        )
    if not path.exists():
        check_writable(path)


def _write_contours(sections: Sections, target: _Target, *, binary: bool) -> list[int]:
    """Write the contours to the output files; return the size of each file in bytes."""
    from printer_slicer.exports import write_cli, write_slc, write_svg

    if target.kind == "svgs":
        return _write_layers(sections, target)
    if target.kind == "cli":
        data = write_cli(sections, binary=binary)
    else:
        data = write_slc(sections) if target.kind == "slc" else write_svg(sections)
    write_file(target.path, data)
    return [len(data)]


def _write_layers(sections: Sections, target: _Target) -> list[int]:
    """Write one SVG per layer; return the size of each file in bytes."""
    from printer_slicer.exports import write_svgs

    make_folder(target.path)
    sizes = []
    for layer, (name, data) in enumerate(write_svgs(sections)):
        write_file(target.path / (target.pattern % layer if target.pattern else name), data)
        sizes.append(len(data))
    return sizes


# Changes of the contours


def _check_containment_options(arguments: argparse.Namespace, profile: Profile) -> None:
    """Check that --smooth and --resample are not given if contours must stay on one side of the surface.

    Raises:
        UsageError: --smooth or --resample would move contours to the other side.
    """
    flags = [f"--{flag}" for flag in ("smooth", "resample") if getattr(arguments, flag) is not None]
    if flags and profile.quality.containment != "mid":
        raise UsageError(
            f"{' and '.join(flags)} can move contours outwards and inwards, which {profile.quality.containment} "
            "containment forbids",
            remedy=f"Leave out {' and '.join(flags)}, or use --containment mid",
        )


def _smooth_and_resample(
    sections: Sections, arguments: argparse.Namespace, profile: Profile, report: StageReport
) -> Sections:
    """Apply --smooth and --resample to the contours; return the changed sections."""
    from printer_slicer.exports import resample, smooth

    solid = sections.solid
    if arguments.smooth is not None:
        report("smoothing")
        solid = smooth(solid, arguments.smooth)
    if arguments.resample is not None:
        report("resampling")
        solid = resample(solid, arguments.resample, profile.quality.resolution)
    return replace(sections, solid=solid)


# Results


def _collect_contour_facts(
    sections: Sections, sizes: list[int], target: _Target, arguments: argparse.Namespace, profile: Profile
) -> dict[str, Any]:
    """Return the facts about the written contours for JSON; lengths in mm."""
    import numpy as np

    plan, solid = sections.plan, sections.solid
    rounded = _round_contours(sections, target)
    low, high = (solid.xy.min(axis=0).tolist(), solid.xy.max(axis=0).tolist())
    off = {
        "simplified": profile.quality.resolution if plan.containment == "mid" else 0.0,
        "smoothed": arguments.smooth or 0.0,
        "resampled": profile.quality.resolution if arguments.resample is not None else 0.0,
        "rounded": round(sqrt(2) * rounded.error, _DECIMALS),
    }
    return {
        "output": arguments.output,
        "format": target.kind,
        "binary": arguments.binary or target.kind == "slc",
        "files": len(sizes),
        "bytes": sum(sizes),
        "layers": plan.n_layers,
        "empty_layers": int(np.count_nonzero(~solid.used)),
        "heights": [[count, height] for count, height in plan.runs()],
        "rings": len(rounded.ring_layer),
        "points": len(rounded.xy),
        "bounds": [[*low, 0.0], [*high, float(plan.top[-1])]],
        "rounding": round(rounded.error, _DECIMALS),
        # JSON has no number for an infinite spacing.
        "spacing": arguments.resample if arguments.resample != inf else None,
        "farthest_apart": round(rounded.find_longest_edge() * _get_coordinate_unit(target), _DECIMALS),
        "at_most_off": off | {"together": round(sum(off.values()), _DECIMALS)},
        "rings_left_out": rounded.lost,
        "notes": _find_notes(sections, rounded, target),
    }


def _round_contours(sections: Sections, target: _Target) -> RoundedRings:
    """Return the contours rounded to the numbers of the file format."""
    from printer_slicer.exports import round_to_float32, round_to_grid

    return (
        round_to_float32(sections.solid)
        if target.kind == "slc"
        else round_to_grid(sections.solid, _get_coordinate_unit(target))
    )


def _get_coordinate_unit(target: _Target) -> float:
    """Return the unit of the coordinates in the file, mm."""
    from printer_slicer.exports import CLI_UNITS, SVG_DIGITS

    return {"slc": 1.0, "cli": CLI_UNITS}.get(target.kind, 10.0**-SVG_DIGITS)


def _find_notes(sections: Sections, rounded: RoundedRings, target: _Target) -> list[str]:
    """Return warnings about the written files: contours left out, rounding, layer heights, files left over."""
    from printer_slicer.exports import has_uneven_heights

    notes = []
    if rounded.lost:
        notes.append(
            f"{rounded.lost} contours are left out, because they are smaller than the rounding of the file"
        )
    if sections.plan.containment != "mid":
        notes.append(
            f"rounding can violate the {sections.plan.containment} containment by up to {rounded.error:.2g} mm"
        )
    if target.kind == "slc" and has_uneven_heights(sections.plan):
        notes.append("layer heights are not multiples of the thinnest one, which some SLC readers require")
    if target.kind == "svgs" and not target.pattern:
        older = sum(bool(_LAYER_FILE.fullmatch(file.name)) for file in target.path.iterdir())
        older -= sections.plan.n_layers
        if older > 0:
            notes.append(
                f"{older} layer files in the folder are left over from an earlier export; remove them"
            )
    return notes


def _format_facts(facts: dict[str, Any]) -> list[str]:
    """Format the facts about the written contours as sentences."""
    from printer_slicer.facts.slicing import format_runs

    files = f"{facts['files']} files, " if facts["format"] == "svgs" else ""
    off = facts["at_most_off"]
    parts = [f"{name} {value:.3g}" for name, value in off.items() if value and name != "together"]
    size = f"{facts['rings']} contours, {facts['points']} points, {facts['bytes']} bytes"
    lines = [
        f"{facts['output']}: {files}{facts['layers']} layers ({format_runs(facts['heights'])}), {size}",
        f"contours deviate from the section by at most {off['together']:.3g} mm: {', '.join(parts)}",
    ]
    if facts["spacing"] is not None:
        apart = ceil(facts["farthest_apart"] * 1e4 - 1e-5) / 1e4  # never less than it is
        lines.append(f"points in the file are at most {f'{apart:.4f}'.rstrip('0').rstrip('.')} mm apart")
    if facts["empty_layers"]:
        many = "1 layer is" if facts["empty_layers"] == 1 else f"{facts['empty_layers']} layers are"
        lines.append(f"{many} empty")
    return [*lines, *facts["notes"]]
