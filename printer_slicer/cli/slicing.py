"""`slice`."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from printer_slicer.cli.common import (
    profile_facts,
    profile_from,
    refuse_mixing,
    refuse_same,
    say,
    stages,
    write_file,
)
from printer_slicer.cli.completing import MODELS
from printer_slicer.cli.facts import facts_of, sentences
from printer_slicer.cli.models import plate_from, warn
from printer_slicer.cli.projects import with_projects
from printer_slicer.cli.unsupported import refuse_unsupported, unsupported_facts, unsupported_warnings
from printer_slicer.errors import UsageError
from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.deposition.unsupported import unsupported_of_program
from printer_slicer.model import LayerPlan, Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.profile.places import heights_of
from printer_slicer.saving import make_folder
from printer_slicer.surface import certify, read_surface

__all__ = ["slice_command"]


def slice_command(arguments: Namespace) -> int:
    """Slice models and write the G-code: one file for all, or one per model into a folder."""
    profile = profile_from(arguments)
    refuse_mixing(arguments)
    if arguments.layer is not None and not arguments.picture:
        raise UsageError(
            f"--layer {arguments.layer}: there is no picture", remedy="name its file with --picture"
        )
    arguments.made = _made(arguments)
    if arguments.output_dir is None:
        _slice_plate(arguments, profile, arguments.output)
        return 0
    for model, output in _outputs(arguments):
        _slice_plate(Namespace(**{**vars(arguments), "models": [model]}), profile, output)
    return 0


def _slice_plate(arguments: Namespace, profile: Profile, output: Path | None) -> None:
    """Slice all models together and print a summary; without `output` the G-code goes beside the first model."""
    with stages(arguments) as report:
        report("loading")
        mesh, plate = plate_from(arguments, profile.printer, report)
        profile, plate = with_projects(arguments, profile, mesh, plate)
        output = output or _beside(arguments.models[0])
        for path in arguments.models:
            refuse_same(output, path)
        _refuse_model_name(output)
        meshes = [mesh]
        del mesh  # what was read is not needed beyond placing, and may be large
        stage = slice_stages(
            meshes.pop(), profile, placement=plate.placement, report=report, strict=arguments.strict
        )
        program = stage.program
        unsupported = unsupported_of_program(program, profile)
        if arguments.strict and "unsupported" not in arguments.allow:
            refuse_unsupported(stage.part.name, unsupported)
        report("writing")
        seconds = float(move_seconds(program, profile).sum())
        if arguments.picture:
            _draw_layer(program, 1 if arguments.layer is None else arguments.layer, arguments.picture)
        certificate = certify(read_surface(stage.part), stage.sections.plan)
        write_file(
            output,
            gcode_of(
                program,
                profile,
                part=stage.part,
                certificate=certificate,
                labels=stage.labels,
                made=arguments.made,
            ),
        )
    facts = facts_of(stage, profile, seconds, certificate)
    late = [*unsupported_warnings(unsupported), *_unreached(profile, stage.sections.plan)]
    warn(arguments, late)
    if arguments.json:
        told = {"unsupported": unsupported_facts(unsupported), "warnings": [*plate.warnings, *late]}
        print(
            json.dumps({"output": str(output), **facts, **plate.facts(), **told, **profile_facts(arguments)})
        )
    elif str(output) != "-":
        first, *more = sentences(facts)
        say(arguments, "\n  ".join([f"{output}: {first}", *more]))


def _outputs(arguments: Namespace) -> list[tuple[Path, Path]]:
    """Pair each model with its output file in the folder of --output-dir, and create the folder.

    Raises:
        UsageError: two models have the same output file or picture.
        OutputError: the folder cannot be created.
    """
    folder: Path = arguments.output_dir
    outputs: dict[Path, Path] = {}
    for model in arguments.models:
        output = folder / f"{model.stem}.gcode"
        if output in outputs:
            raise UsageError(
                f"{model}: has the same output file as {outputs[output]}: {output}",
                remedy="rename one of them, or use different output folders",
            )
        outputs[output] = model
    if arguments.picture and len(outputs) > 1:
        raise UsageError(
            f"--picture {arguments.picture}: one picture for {len(outputs)} models",
            remedy="slice them one by one",
        )
    make_folder(folder)
    return [(model, output) for output, model in outputs.items()]


def _made(arguments: Namespace) -> datetime | None:
    """Return the date for the first line: SOURCE_DATE_EPOCH, or now with --timestamp; otherwise None.

    Raises:
        UsageError: SOURCE_DATE_EPOCH is not a number of seconds.
    """
    told = os.environ.get("SOURCE_DATE_EPOCH", "")
    if told:
        try:
            return datetime.fromtimestamp(int(told), UTC)
        except (ValueError, OverflowError, OSError):
            raise UsageError(
                f"SOURCE_DATE_EPOCH={told}: not a date", remedy="set it to seconds since 1970, or unset it"
            ) from None
    return datetime.now(UTC) if arguments.timestamp else None


def _refuse_model_name(output: Path) -> None:
    """G-code under the name of a model would be taken for one.

    Raises:
        UsageError: it is asked for.
    """
    if output.suffix.lower() in MODELS:
        raise UsageError(
            f"-o {output}: {output.suffix} is for models, and this is G-code",
            remedy=f"name it {output.with_suffix('.gcode')}",
        )


def _unreached(profile: Profile, plan: LayerPlan) -> Iterator[str]:
    """The settings of heights over the part, which change nothing."""
    top = float(plan.top[-1])
    for low, high, own in heights_of(profile):
        if low >= top:
            shall = f"where {', '.join(own)} shall differ"
            yield f"nothing is between {low:g} and {high:g} mm, {shall}: all is {top:g} mm high"


def _beside(model: Path) -> Path:
    """Where the G-code of a model goes when nobody says where.

    Raises:
        UsageError: the model comes out of a pipe, which has no such place.
    """
    if not model.is_file():
        raise UsageError(f"{model}: is no file, so the G-code has no name", remedy="name it with -o")
    return model.with_suffix(".gcode")


def _draw_layer(program: Program, number: int, path: Path) -> None:
    from printer_slicer.drawing import layer_picture, picture_bytes

    if not 1 <= number <= program.plan.n_layers:
        raise UsageError(
            f"--layer {number}: the print has layers 1 to {program.plan.n_layers}",
            remedy="choose one of these",
        )
    write_file(path, picture_bytes(layer_picture(program, number - 1), path))
