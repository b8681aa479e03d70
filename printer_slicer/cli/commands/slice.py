"""`slice`: make G-code from a part."""

from __future__ import annotations

import argparse
import os
from argparse import Namespace
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
    add_strict_supports_option,
    parse_integer,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.opening import add_open_option, open_files
from printer_slicer.cli.output import (
    append_to_stem,
    check_outputs,
    describe_picture,
    print_text,
    reject_overwriting_input,
    show_stages,
    warn,
    write_file,
)
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import PartError, UsageError
from printer_slicer.input_files import MODEL_SUFFIXES

if TYPE_CHECKING:
    from printer_slicer.cli.models import Plate
    from printer_slicer.inspection.deposition.unsupported import UnsupportedExtrusion
    from printer_slicer.model import Mesh, Program
    from printer_slicer.profile import Profile
    from printer_slicer.stages import Stages

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer slice part.stl -o part.gcode --printer corexy_klipper --material petg
  printer-slicer slice part.stl --set infill_density=0.3 --set speeds.travel=200
  printer-slicer slice part.stl --quality adaptive --picture layer.svg --layer 12
  printer-slicer slice part.stl --units inch --rotate -90,0,0 --scale 50%
  printer-slicer slice lid.stl box.3mf -o plate.gcode     all on one plate, positions from the files
  printer-slicer slice box.3mf 'lid.stl*12' -o plate.gcode   arranged, on as many plates as needed
  printer-slicer slice *.stl -o gcode/                    one G-code file per model"""
_LARGEST_KEPT: Final = 2 << 20  # bytes
_SUPPORTING: Final = "print supports with --supports"
_ACCEPTANCE: Final = "accept it with --allow unsupported"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `slice`."""
    group = add_setting_options(
        parser, strict_help="fail if the mesh needs repair, or if extrusion is unsupported and not allowed"
    )
    add_strict_supports_option(group)
    mark_advanced(
        group.add_argument(
            "--allow",
            metavar="NAME",
            action="append",
            choices=("unsupported",),
            default=[],
            help="accept this finding in spite of --strict; the only NAME is unsupported (extrusion with nothing "
            "under it)",
        )
    )
    add_model_options(parser)
    group = parser.add_argument_group("output")
    _add_file_options(group)
    add_output_options(parser, group)
    add_open_option(group)
    mark_advanced(
        group.add_argument(
            "--timestamp",
            action="store_true",
            help="write date and time into the first line of the G-code; default: only if SOURCE_DATE_EPOCH is set",
        )
    )
    add_layer_options(parser)


def _add_file_options(group: argparse._ArgumentGroup) -> None:
    """Add the options for the G-code file and for the picture."""
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "-o",
        "--output",
        metavar="OUT.gcode",
        action=_OutputAction,
        help="G-code file to write; - is stdout; default: MODEL.gcode beside the model",
    )
    where.add_argument(
        "--output-dir",
        metavar="DIR",
        type=Path,
        help="write one G-code file per model into this folder; same as -o FOLDER/",
    )
    group.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw a layer of the print, as .svg or .png"
    )
    mark_advanced(
        group.add_argument(
            "--layer",
            metavar="N",
            type=parse_integer,
            help="layer that --picture draws, counted from 1; default: 1",
        )
    )


class _OutputAction(argparse.Action):
    """Action of -o: an existing folder, or a name ending with /, sets --output-dir instead."""

    def __call__(
        self, _parser: object, namespace: argparse.Namespace, value: object, _flag: object = None
    ) -> None:
        path = Path(str(value))
        is_folder = str(value).endswith(("/", os.sep)) or (value != "" and path.is_dir())
        setattr(namespace, "output_dir" if is_folder else "output", path)


def run(arguments: Namespace) -> int:
    """Slice models and write the G-code: one file for all, or one per model into a folder."""
    profile = load_selected_profile(arguments)
    check_outputs(arguments)
    if arguments.layer is not None and not arguments.picture:
        raise UsageError(
            f"--layer {arguments.layer}: this option has no effect without --picture",
            remedy="Name a picture with --picture FILE",
        )
    arguments.made = _find_timestamp(arguments)
    if arguments.output_dir is None:
        _slice_models(arguments, profile, arguments.output)
        return 0
    for model, output in _pair_outputs(arguments):
        copies = [model] * arguments.models.count(model)
        _slice_models(Namespace(**{**vars(arguments), "models": copies}), profile, output)
    return 0


def _slice_models(arguments: Namespace, profile: Profile, output: Path | None) -> None:
    """Slice all models together, plate by plate.

    Args:
        arguments: the command line.
        profile: printer, material and quality.
        output: G-code file, or None: beside the first model; the files of several plates get numbers.
    """
    from printer_slicer.cli.models import load_plates

    with show_stages(arguments) as report:
        report("loading")
        meshes, plates = load_plates(arguments, profile, report)
    _reject_plates_on_stdout(arguments, output, plates)
    output = output or _choose_default_output(arguments.models[0])
    for plate in plates:
        suffix = f"-{plate.number}" if len(plates) > 1 else ""
        pictured = arguments.picture and append_to_stem(arguments.picture, suffix)
        own = Namespace(**{**vars(arguments), "picture": pictured})
        _slice_plate(own, profile, [meshes.pop(0)], plate, append_to_stem(output, suffix))


def _reject_plates_on_stdout(arguments: Namespace, output: Path | None, plates: Sequence[Plate]) -> None:
    """Reject several plates if the G-code or the picture goes to stdout.

    Raises:
        UsageError: this is so.
    """
    from printer_slicer.cli.arrange_models import describe_other_plates

    for flag, path in (("-o", output), ("--picture", arguments.picture)):
        if len(plates) > 1 and str(path) == "-":
            raise UsageError(
                f"{flag} -: the parts need {len(plates)} plates; {describe_other_plates(plates[0].parts)}",
                remedy="Choose a plate with --plate N, or name a file",
            )


def _slice_plate(
    arguments: Namespace, profile: Profile, meshes: list[Mesh], plate: Plate, output: Path
) -> None:
    """Slice the only mesh of a list, which is removed from it; write the G-code to a file and print a summary."""
    from printer_slicer.cli.models import apply_projects
    from printer_slicer.facts.findings import list_slicing_warnings, list_unsupported_facts
    from printer_slicer.facts.slicing import collect_slicing_facts
    from printer_slicer.freed_memory import release_memory_between_stages
    from printer_slicer.gcode_text import gcode_in_pieces
    from printer_slicer.pipeline import slice_for_output
    from printer_slicer.surface import certify_stacks

    with show_stages(arguments) as show:
        report = release_memory_between_stages(show)
        profile, plate = apply_projects(arguments, profile, meshes[0], plate)
        for path in dict.fromkeys(arguments.models):
            reject_overwriting_input(output, path)
        _reject_model_suffix(output)
        strict = {name: getattr(arguments, name) for name in ("strict", "strict_supports")}
        stage = slice_for_output(meshes, profile, placement=plate.placement, report=report, **strict)
        program = stage.program
        unsupported = _find_unsupported(arguments, stage.part.name, program, profile)
        report("writing")
        seconds, objects = _measure_times(stage, profile)
        if arguments.picture:
            _draw_layer(program, 1 if arguments.layer is None else arguments.layer, arguments.picture)
        certificate = certify_stacks(stage.stacks)
        write_file(
            output,
            gcode_in_pieces(
                program,
                profile,
                part=stage.part,
                certificate=certificate,
                labels=stage.labels,
                made=arguments.made,
                comments=plate.comments,
            ),
        )
    late = list_slicing_warnings(stage, profile, unsupported, supporting=_SUPPORTING, acceptance=_ACCEPTANCE)
    warn(arguments, late)
    more: dict[str, Any] = {"objects": objects}
    more |= {"unsupported": list_unsupported_facts(unsupported), "warnings": [*plate.warnings, *late]}
    facts = collect_slicing_facts(stage, profile, seconds, certificate) | plate.collect_facts() | more
    _print_result(arguments, output, facts)
    open_files(arguments, [output, arguments.picture])


def _measure_times(stage: Stages, profile: Profile) -> tuple[float, list[dict[str, Any]]]:
    """Return the time of all moves, s, and time and filament of each object of a plate with several."""
    from printer_slicer.extrusion import move_seconds

    seconds = move_seconds(stage.program, profile)
    objects: list[dict[str, Any]] = []
    if stage.labels is not None:
        from printer_slicer.facts.objects import collect_object_facts

        objects = collect_object_facts(stage, profile, seconds)
    return float(seconds.sum()), objects


def _print_result(arguments: Namespace, output: Path, facts: dict[str, Any]) -> None:
    """Print the result of slicing, as JSON or as sentences."""
    from printer_slicer.facts.slicing import format_slicing_sentences

    if arguments.json:
        import json

        print(json.dumps({"output": str(output), **facts, **collect_profile_facts(arguments)}))
    elif str(output) != "-":
        first, *more = format_slicing_sentences(facts)
        if facts["objects"]:
            from printer_slicer.facts.objects import format_object_sentences

            more[1:1] = format_object_sentences(facts["objects"])
        layer = f"layer {arguments.layer or 1} of the print"
        lines = [f"{output}: {first}", *more, *describe_picture(arguments.picture, layer)]
        print_text(arguments, "\n  ".join(lines))


def _pair_outputs(arguments: Namespace) -> list[tuple[Path, Path]]:
    """Pair each model with its output file in the folder of --output-dir, and create the folder.

    Raises:
        UsageError: two models have the same output file or picture.
        OutputError: the folder cannot be created.
    """
    from printer_slicer.saving import make_folder

    folder: Path = arguments.output_dir
    outputs: dict[Path, Path] = {}
    for model in dict.fromkeys(arguments.models):
        output = folder / f"{model.stem}.gcode"
        if output in outputs:
            raise UsageError(
                f"{model} and {outputs[output]} have the same output file: {output}",
                remedy="Rename one of the models, or use different output folders",
            )
        outputs[output] = model
    if arguments.picture and len(outputs) > 1:
        raise UsageError(
            f"--picture {arguments.picture}: one picture cannot show {len(outputs)} models that are sliced separately",
            remedy="Slice the models one by one, or leave out --picture",
        )
    make_folder(folder)
    return [(model, output) for output, model in outputs.items()]


def _find_timestamp(arguments: Namespace) -> datetime | None:
    """Return the date for the first line of the G-code: SOURCE_DATE_EPOCH, the current date (--timestamp), or None.

    Raises:
        UsageError: SOURCE_DATE_EPOCH is not a number of seconds.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if epoch:
        try:
            return datetime.fromtimestamp(int(epoch), UTC)
        except (ValueError, OverflowError, OSError):
            raise UsageError(
                f"SOURCE_DATE_EPOCH={epoch}: this is not a date",
                remedy="Set the variable to the seconds since 1970, or unset it",
            ) from None
    return datetime.now(UTC) if arguments.timestamp else None


def _reject_model_suffix(output: Path) -> None:
    """Reject a G-code file with the suffix of a model.

    Raises:
        UsageError: the output has the suffix of a model.
    """
    if output.suffix.lower() in MODEL_SUFFIXES:
        raise UsageError(
            f"-o {output}: the suffix {output.suffix} is for models, but the output is G-code",
            remedy=f"Name it {output.with_suffix('.gcode')}",
        )


def _find_unsupported(
    arguments: Namespace, name: str, program: Program, profile: Profile
) -> tuple[UnsupportedExtrusion, ...]:
    """Return the unsupported extrusion of the part `name`; with --strict, reject it if it is not allowed."""
    from printer_slicer.freed_memory import keep_freed_memory, release_freed_memory
    from printer_slicer.inspection.deposition.unsupported import unsupported_of_program

    release_freed_memory()
    keep_freed_memory(_LARGEST_KEPT)  # larger arrays, as for wide layers, return their memory at once
    found = unsupported_of_program(program, profile)
    keep_freed_memory()
    if arguments.strict and "unsupported" not in arguments.allow:
        _reject_unsupported(name, found, profile)
    return found


def _reject_unsupported(name: str, found: Sequence[UnsupportedExtrusion], profile: Profile) -> None:
    """Reject unsupported extrusion, for --strict without --allow unsupported.

    Raises:
        PartError: there is unsupported extrusion.
    """
    from printer_slicer.facts.findings import choose_unsupported_remedy
    from printer_slicer.inspection.deposition.unsupported import describe_unsupported

    if found:
        remedy = choose_unsupported_remedy(profile, _SUPPORTING)
        raise PartError(
            f"{name}: {describe_unsupported(found)}",
            remedy=f"{remedy[0].upper()}{remedy[1:]}, or use --allow unsupported; without --strict, "
            "unsupported extrusion causes only a warning",
        )


def _choose_default_output(model: Path) -> Path:
    """Return the default output file, which is beside the model.

    Raises:
        UsageError: the model is not a regular file.
    """
    if not model.is_file():
        raise UsageError(
            f"{model}: is not a regular file, so the G-code needs a name",
            remedy="Name the output with -o FILE.gcode",
        )
    return model.with_suffix(".gcode")


def _draw_layer(program: Program, number: int, path: Path) -> None:
    """Draw a layer of the print, counted from 1, to a file."""
    from printer_slicer.drawing import draw_program_layer, encode_picture

    if not 1 <= number <= program.plan.n_layers:
        raise UsageError(
            f"--layer {number}: the print has layers 1 to {program.plan.n_layers}",
            remedy="Choose the number of one of these layers",
        )
    write_file(path, encode_picture(draw_program_layer(program, number - 1), path))
