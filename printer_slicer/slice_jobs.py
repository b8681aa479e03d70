"""Make print jobs from models: slice, write the G-code, and lint it as if it were read from a file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, Final

from printer_slicer.arguments import PATH, check_argument, check_arguments
from printer_slicer.errors import UsageError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.importing.familiar import translate_changes
from printer_slicer.input_files import is_gcode
from printer_slicer.inspection.lint.scan import lint_file, lint_text
from printer_slicer.jobs import Job
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh, Volumes
from printer_slicer.pipeline import slice_for_output
from printer_slicer.placing import IN_THE_MIDDLE, Placement
from printer_slicer.profile import KINDS, Profile, load_profile
from printer_slicer.progress import Report, quiet
from printer_slicer.stages import Stages
from printer_slicer.strategies import BUILT_IN, Strategies
from printer_slicer.texts import describe_type
from printer_slicer.values import replace

__all__ = ["job_from", "job_of", "load_slice_profile", "slice"]

_PROFILE_REMEDY: Final = (
    "With a Profile, use ps.job_of(mesh, profile), or ps.job_from(path, profile) for a file"
)
_BRIM_WIDTH: Final = 5  # mm, of `brim=True`, as --brim without a width
_OPTION_SETTINGS: Final = {"walls": "perimeters", "brim": "brim_width", "first_layer": "first_layer_height"}
"""Option of the command line -> the setting that it changes."""
_TRANSFORM_REMEDY: Final = "Change the mesh first: ps.slice(ps.transform(mesh, scale=2, rotate=(90, 0, 0)))"
_IMPORT_REMEDY: Final = "Import the file first (printer-slicer profiles import FILE), then pass printer=NAME"
_OPTION_REMEDIES: Final[Mapping[str, str]] = {
    "scale": _TRANSFORM_REMEDY,
    "rotate": _TRANSFORM_REMEDY,
    "orient": "Turn the mesh first: ps.job_of(ps.orient(mesh, profile), profile)",
    "copies": "Copy the mesh first: ps.slice(ps.join([mesh, mesh.moved((30, 0, 0))]))",
    "center": "Use ps.job_of(mesh, profile, placement=ps.Placement(center=(100, 100)))",
    "units": 'Load the mesh with its unit first: ps.slice(ps.load_mesh("part.stl", units="inch"))',
    "load": _IMPORT_REMEDY,
    "profile": "Name the printer, the material or the quality: ps.slice(mesh, printer=NAME)",
    "output": 'Save the job: ps.slice("part.stl").save("part.gcode")',
    "strict": "Use ps.job_of(mesh, profile, strict=True)",
}
"""Option of the command line that `slice` does not have -> what to do instead."""
_ALWAYS_ALLOWED: Final = frozenset({"wait"})  # a pause in our own G-code is one that the settings ask for


@check_arguments(path=PATH, profile=Profile)
def job_from(
    path: str | os.PathLike[str], profile: Profile, *, report: Report = quiet, strict: bool = False
) -> Job:
    """Make a job from a file: slice a model, or read a G-code file unchanged.

    Args:
        path: model or G-code file.
        profile: printer, material and quality.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.

    Raises:
        PrinterSlicerError: the file cannot be read, sliced or sent.
    """
    path = Path(path)
    if is_gcode(path):
        report("reading")
        return replace(lint_file(path, profile), profile=profile)
    report("loading")
    return job_of(load_mesh(path), profile, name=path.name, report=report, strict=strict)


def job_of(  # noqa: PLR0913 - all options have defaults
    part: Mesh | Stages,
    profile: Profile,
    *,
    name: str = "",
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strict_supports: bool = False,
    strategies: Strategies = BUILT_IN,
    volumes: Volumes | None = None,
    comments: Sequence[str] = (),
) -> Job:
    """Make a job from a part.

    Args:
        part: a mesh to slice, or the result of `slice_stages`; then `placement`, `strict`, `strict_supports` and
            `volumes` have no effect.
        profile: the profile to slice with.
        name: name of the job; empty: that of the part.
        placement: position of the part.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.
        strict_supports: raise an error if a piece of the part begins in the air without a support.
        strategies: user functions that replace built-in ones.
        volumes: support enforcers and blockers and negative volumes, in the coordinates of the mesh.
        comments: further comments at the top of the G-code.

    Raises:
        PrinterSlicerError: the part cannot be sliced.
    """
    if isinstance(part, Stages):
        stages = part
    else:
        check_argument("mesh", part, Mesh)
        meshes = [part.with_volumes(volumes)]
        options = {"strict": strict, "strict_supports": strict_supports}
        stages = slice_for_output(
            meshes, profile, placement=placement, report=report, strategies=strategies, **options
        )
    report("writing")
    program, labels = stages.program, stages.labels
    text = gcode_of(
        program, profile, part=stages.part, labels=labels, strategies=strategies, comments=comments
    )
    job = lint_text(name or stages.part.name, text, profile, dialect=strategies.flavour)
    return replace(job, program=program, allowed=_ALWAYS_ALLOWED, repairs=stages.repairs, profile=profile)


def slice(  # noqa: A001 - called as ps.slice
    path_or_mesh: str | os.PathLike[str] | Mesh,
    *,
    printer: str | os.PathLike[str] | None = None,
    material: str | os.PathLike[str] | None = None,
    quality: str | os.PathLike[str] | None = None,
    profiles: Sequence[str | os.PathLike[str]] = (),
    volumes: Volumes | None = None,
    **settings: object,
) -> Job:
    """Slice a model file or a mesh, and return the print job.

        job = ps.slice("part.stl", printer="Ender 3", material="petg", layer_height=0.2, infill_density="20%")
        job.save("part.gcode")

    Args:
        path_or_mesh: a model file, such as STL, 3MF, OBJ or STEP, or a mesh.
        printer: name of a printer profile, its display name such as "Ender 3", or a TOML file; None: the default.
        material: material profile, named like the printer.
        quality: quality profile, named like the printer.
        profiles: folders of profiles that are searched before the user's and the shipped ones.
        volumes: support enforcers and blockers and negative volumes, in the coordinates of the model; they are added to
            those of a 3MF file.
        **settings: settings to change, by the names used here or by those of PrusaSlicer, OrcaSlicer and Cura. A key
            in a table is written with two underscores, or with a dict: `speeds__travel=120`, `speeds={"travel": 120}`.
            A percentage is text, such as "20%". A `layer_height` without a planner means uniform layers. Options of
            the command line work too: `walls=3`, `infill="20%"`, `brim=5`, `first_layer=0.3`. `notes` of the job tell
            what settings of other slicers became; `find_settings` lists all settings.

    Raises:
        UsageError: a file cannot be read, or a profile or a setting does not exist or is out of bounds.
        PartError: the part does not fit the printer, or cannot be sliced.
    """
    check_argument("volumes", volumes, (Volumes, NoneType))
    name = ""
    if not isinstance(path_or_mesh, Mesh):
        name = _check_model_path(path_or_mesh).name
    names: dict[str, Any] = {"printer": printer, "material": material, "quality": quality}
    profile, notes = load_slice_profile(settings, folders=profiles, **names)
    part = path_or_mesh if isinstance(path_or_mesh, Mesh) else load_mesh(path_or_mesh)
    return replace(job_of(part, profile, name=name, volumes=volumes), notes=notes)


def load_slice_profile(
    settings: Mapping[str, object], folders: Sequence[str | os.PathLike[str]] = (), **names: Any
) -> tuple[Profile, tuple[str, ...]]:
    """Load the profile with settings as `slice` has them; return it, and what settings of other slicers became.

    Args:
        settings: the keywords of `slice`.
        folders: folders of profiles that are searched first.
        **names: names of `printer`, `material` and `quality`.

    Raises:
        UsageError: a profile or a setting does not exist or is out of bounds.
    """
    _check_options({**names, **settings})

    def load(changes: Mapping[str, object] | None) -> Profile:
        return load_profile(**names, changes=changes, slices=False, folders=folders)

    changes, notes = translate_changes(dict(_flatten_settings(_rename_options(settings))), load)
    return load_profile(**names, changes=changes, folders=folders), notes


def _check_model_path(given: object) -> Path:
    """Return a value as the path of a model file.

    Raises:
        UsageError: the value is not a file name, or is the name of a G-code file.
    """
    if not isinstance(given, str | os.PathLike):
        raise UsageError(
            f"the part must be a file name or a Mesh, not {describe_type(given)}",
            remedy='Pass a file name or a Mesh, for example ps.slice("part.stl")',
        )
    path = Path(given)
    if is_gcode(path):
        raise UsageError(
            f"{path}: is G-code, which is already sliced",
            remedy="Read it with ps.job_from(path, profile)",
        )
    return path


def _check_options(options: Mapping[str, object]) -> None:
    """Check that profiles are given by name, and that all other arguments are settings.

    Raises:
        UsageError: a profile is a value instead of a name, or an argument is an option of the command line that this
            function does not have.
    """
    for name, value in options.items():
        if isinstance(value, Profile):
            raise UsageError(f"{name}: expected the name of a profile, not a Profile", remedy=_PROFILE_REMEDY)
        if name in KINDS:
            check_argument(name, value, (*PATH, NoneType))
        if name in _OPTION_REMEDIES:
            raise UsageError(f"{name}={value!r}: no such setting", remedy=_OPTION_REMEDIES[name])


def _rename_options(settings: Mapping[str, object]) -> dict[str, object]:
    """Replace options of the command line, such as `walls`, by the settings that they change.

    Raises:
        UsageError: an option and its setting are both given.
    """
    result: dict[str, object] = {}
    for name, value in settings.items():
        key = _OPTION_SETTINGS.get(name, name)
        if name == "infill" and (not isinstance(value, str) or value.endswith("%")):
            key = "infill_density"  # `infill` is also the setting of the pattern
            if isinstance(value, int | float) and not isinstance(value, bool) and value > 1:
                value = f"{value}%"  # noqa: PLW2901 - the value of the setting
        if key == "brim_width" and isinstance(value, bool):
            value = _BRIM_WIDTH if value else 0  # noqa: PLW2901 - the value of the setting
        if key in result or (key != name and key in settings):
            raise UsageError(f"{name} and {key} are the same setting", remedy="Remove one of them")
        result[key] = value
    return result


def _flatten_settings(settings: Mapping[str, object], table: str = "") -> Iterator[tuple[str, object]]:
    """Yield (dotted key, value) of settings in nested tables; `planner` becomes the key `planner.kind`."""
    for name, value in settings.items():
        key = table + str(name).replace("__", ".")
        if isinstance(value, Mapping):
            yield from _flatten_settings(value, f"{key}.")
        elif key.removeprefix("quality.") == "planner":
            yield f"{key}.kind", value
        else:
            yield key, value
