"""Slice one model with one set of settings, as a worker does it; the G-code is that of the command `slice`."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, Final, NamedTuple
from zlib import compress

from printer_slicer.batching.tasks import (
    BatchResult,
    BatchTask,
    SlicedFile,
    TaskModel,
    describe_error,
    fail_task,
)
from printer_slicer.errors import PartError, PrinterSlicerError
from printer_slicer.extrusion import move_seconds
from printer_slicer.facts.findings import (
    choose_unsupported_remedy,
    list_slicing_warnings,
    list_unsupported_facts,
)
from printer_slicer.facts.objects import collect_object_facts
from printer_slicer.facts.slicing import collect_slicing_facts
from printer_slicer.gcode_text import gcode_in_pieces
from printer_slicer.inspection.deposition.unsupported import describe_unsupported, unsupported_of_program
from printer_slicer.mesh_io import Model, load_model
from printer_slicer.model import Mesh
from printer_slicer.orientation import find_orientations
from printer_slicer.orienting import turn_mesh
from printer_slicer.overlaps import name_parts, split_separate_objects
from printer_slicer.pipeline import slice_for_output
from printer_slicer.placing import IN_THE_MIDDLE, Placement, transform
from printer_slicer.plates import arrange
from printer_slicer.profile import Profile
from printer_slicer.progress import Report, quiet
from printer_slicer.project_settings import apply_project_settings, list_unused_model_warnings
from printer_slicer.saving import save
from printer_slicer.stages import Stages
from printer_slicer.surface import certify_stacks
from printer_slicer.thumbnails import encode_image, render
from printer_slicer.values import replace

__all__ = ["slice_task"]

_PICTURE: Final = (160, 120)  # px
_LOADED: Final[dict[tuple[str, str, str | None], Model]] = {}
"""The model that was read last, because a sweep slices the same one many times."""


def slice_task(task: BatchTask, report: Report = quiet) -> BatchResult:
    """Slice a model; a problem is a result, too.

    Args:
        task: the model and its settings.
        report: called with the name of each stage when it starts.
    """
    if task.model.path:
        return _slice_file(task, report)
    with TemporaryDirectory() as folder:
        path = Path(folder) / Path(task.model.name).name
        path.write_bytes(task.model.content)
        return _slice_file(replace(task, model=replace(task.model, path=str(path), content=b"")), report)


def _slice_file(task: BatchTask, report: Report) -> BatchResult:
    """Slice a model that is a file on this machine."""
    began, warnings = monotonic(), list[str]()
    files, picture, problem = list[SlicedFile](), b"", ""
    try:
        model = _load(task.model, task.options.units, report)
        parts, comments = _transform(model, task, report)
        picture = encode_image(render(parts[0], *_PICTURE), "PNG") if task.has_picture else b""
        warnings += model.notes
        files = [
            _slice_plate(task, one, comments, warnings, report) for one in _make_plates(task, parts, report)
        ]
    except PrinterSlicerError as error:
        problem = describe_error(error)
    except MemoryError:
        problem = "the model needs more memory than a task may use"
    except Exception as error:  # noqa: BLE001 - a fault costs one task, not the batch
        problem = f"internal error: {type(error).__name__}: {error}"
    return replace(
        fail_task(task, problem),
        warnings=tuple(dict.fromkeys(warnings)),
        files=() if problem else tuple(files),
        seconds=round(monotonic() - began, 3),
        picture=picture,
    )


def _load(file: TaskModel, units: str | None, report: Report) -> Model:
    """Read a model, unless it was read last."""
    key = (file.name, file.sha256, units)
    if key not in _LOADED:
        _LOADED.clear()
        report("loading")
        file.check_file()
        _LOADED[key] = _name_mesh(
            load_model(file.path, units=units), Path(file.path).stem, Path(file.name).stem
        )
    return _LOADED[key]


def _name_mesh(model: Model, stored: str, name: str) -> Model:
    """Return a model whose parts have the name of its file instead of the one under which it is stored."""
    if stored == name:
        return model
    mesh = model.mesh
    objects = tuple(replace(item, name=name) if item.name == stored else item for item in mesh.objects)
    return replace(
        model, mesh=replace(mesh, name=name if mesh.name == stored else mesh.name, objects=objects)
    )


def _transform(model: Model, task: BatchTask, report: Report) -> tuple[list[Mesh], list[str]]:
    """Return the parts of a model, scaled and turned, and comments; parts that need not be moved stay together."""
    options = task.options
    mesh = transform(model.mesh, scale=options.scale, rotate=options.rotate)
    if options.orient == "off":
        return [mesh], []
    turned, comments = list[Mesh](), list[str]()
    parts = split_separate_objects(mesh)
    for part, name in zip(parts, name_parts(task.model.name, parts), strict=True):
        found = find_orientations(
            part, task.profile, search=options.orient, keep_up=options.keep_up, report=report
        )
        turned.append(turn_mesh(part, found.chosen.rotate))
        comments.append(found.chosen.format_comment(name, options.orient))
    return turned, comments


class _Plate(NamedTuple):
    """A plate of parts, its placement, the name of its G-code file, its number, and the number of plates."""

    mesh: Mesh
    placement: Placement
    file: str
    number: int = 1
    n_plates: int = 1


def _make_plates(task: BatchTask, parts: list[Mesh], report: Report) -> list[_Plate]:
    """Return the plates; a single part is placed in the middle of the bed."""
    if task.options.copies == 1 and len(parts) == 1:
        return [_Plate(parts[0], IN_THE_MIDDLE, f"{task.name}.gcode")]
    report("arranging")
    plates = arrange([part for part in parts for _ in range(task.options.copies)], task.profile)
    if len(plates) == 1:
        return [_Plate(plates[0], Placement(as_placed=True), f"{task.name}.gcode")]
    return [
        _Plate(plate, Placement(as_placed=True), f"{task.name}-{number}.gcode", number, len(plates))
        for number, plate in enumerate(plates, start=1)
    ]


def _slice_plate(
    task: BatchTask, plate: _Plate, comments: list[str], warnings: list[str], report: Report
) -> SlicedFile:
    """Slice a plate, and write its G-code or return it; warnings are added to a list."""
    mesh = plate.mesh
    profile = _apply_project(task, mesh, warnings)
    stages = slice_for_output([mesh], profile, placement=plate.placement, report=report, strict=task.strict)
    unsupported = unsupported_of_program(stages.program, profile)
    if unsupported and task.strict:
        remedy = choose_unsupported_remedy(profile)
        raise PartError(f"{mesh.name}: {describe_unsupported(unsupported)}", remedy=remedy.capitalize())
    report("writing")
    text, facts = _write_text(stages, profile, comments)
    late = list_slicing_warnings(stages, profile, unsupported)
    warnings += late
    facts |= {"unsupported": list_unsupported_facts(unsupported), "warnings": late}
    facts |= {"plate": plate.number, "plates": plate.n_plates}
    digest = sha256(text).hexdigest()
    if task.folder:
        save(Path(task.folder) / plate.file, text)
    return SlicedFile(plate.file, digest, len(text), facts, b"" if task.folder else compress(text, 1))


def _apply_project(task: BatchTask, mesh: Mesh, warnings: list[str]) -> Profile:
    """Return the profile with the object settings of a 3MF file; warnings are added to a list."""
    applied = apply_project_settings(
        task.profile,
        [Path(task.model.path)],
        mesh,
        keeps_layer_height=task.keeps_layer_height,
        has_quality=task.has_quality,
    )
    warnings += [*applied.warnings, *list_unused_model_warnings(mesh, applied.profile)]
    return applied.profile


def _write_text(stages: Stages, profile: Profile, comments: list[str]) -> tuple[bytes, dict[str, Any]]:
    """Return the G-code of a plate, and its facts."""
    certificate = certify_stacks(stages.stacks)
    pieces = gcode_in_pieces(
        stages.program,
        profile,
        part=stages.part,
        certificate=certificate,
        labels=stages.labels,
        comments=comments,
    )
    seconds = move_seconds(stages.program, profile)
    objects = collect_object_facts(stages, profile, seconds) if stages.labels is not None else []
    facts = collect_slicing_facts(stages, profile, float(seconds.sum()), certificate)
    return b"".join(pieces), facts | {"objects": objects}
