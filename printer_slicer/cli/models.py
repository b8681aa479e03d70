"""The models of a command line as one plate, with warnings, and the settings of 3MF projects."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from printer_slicer.cli.output import sanitize, warn
from printer_slicer.cli.settings import changes_from
from printer_slicer.errors import PartError
from printer_slicer.healing import repair, require_no_repair
from printer_slicer.mesh_io import Model, load_model
from printer_slicer.placing import Placement, copy_in_grid, join, transform
from printer_slicer.profile import profile_with, settings_of

if TYPE_CHECKING:
    from printer_slicer.cli.output import Stages
    from printer_slicer.importing.projects import Project
    from printer_slicer.model import Mesh, Repairs
    from printer_slicer.overlaps import Overlap
    from printer_slicer.profile import Printer, Profile

__all__ = ["Plate", "keep_memory", "plate_from", "plate_name", "repaired_plate", "with_projects"]

_SMALLEST_GAP = 0.01  # mm above the bed from which a part is reported
_MOST_SHOWN = 3
_ARCHIVE = b"PK"
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # parameters of mallopt(3)
_LARGEST, _LARGEST_BEFORE = 1 << 30, 32 << 20  # bytes; glibc before 2.35 accepts no more than the second
_MOST_KEPT = 1 << 30  # bytes


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """Facts about the models that are printed together.

    Attributes:
        placement: position of the parts on the bed.
        warnings: sentences for the user.
        models: facts about each file, for JSON.
    """

    placement: Placement
    warnings: tuple[str, ...]
    models: tuple[dict[str, Any], ...]

    def facts(self) -> dict[str, Any]:
        """Return the facts for JSON."""
        return {"models": list(self.models), "warnings": list(self.warnings)}


def plate_from(arguments: argparse.Namespace, printer: Printer, report: Stages) -> tuple[Mesh, Plate]:
    """Read all models of a command line into one mesh, scaled and rotated, at the positions of their files.

    Warnings are printed to stderr at once.

    Raises:
        UsageError, MeshError: a file cannot be read, or is not a model.
        PartError: parts overlap and --fuse is not given.
    """
    keep_memory()
    room = np.array([printer.bed_x, printer.bed_y, printer.bed_z])
    factors, models, meshes, warnings = arguments.scale, [], [], []
    for path in arguments.models:
        model = load_model(path, units=arguments.units, progress=_progress(report, path))
        mesh = transform(
            model.mesh, scale=factors[:3] if factors else 1.0, rotate=arguments.rotate or (0.0, 0.0, 0.0)
        )
        warnings += [f"{path.name}: {note}" for note in model.notes]
        doubts = model.size_warning(room) if factors is None and arguments.units is None else ""
        # A part that does not fit the bed is refused when it is placed, with the same advice.
        warnings += [doubts] if doubts and (mesh.size <= room).all() else []
        models.append(_facts(model))
        meshes.append(mesh)
    placement = _placement(arguments, {(one["unit"], one["format"] == "step") for one in models})
    warnings += _floating_parts(arguments.models, meshes, placement)
    if not arguments.fuse:
        _refuse_overlaps(arguments.models, meshes)
        _refuse_collisions(models, meshes)
    warn(arguments, warnings)
    mesh = copy_in_grid(join(meshes), arguments.copies, printer)
    return mesh, Plate(placement, tuple(warnings), tuple(models))


def _placement(arguments: argparse.Namespace, units: set[tuple[str, bool]]) -> Placement:
    """Return the placement of the plate.

    Args:
        arguments: the command line.
        units: unit assumed for each file, and whether the file states it.
    """
    unit, certain = units.pop() if len(units) == 1 and arguments.scale is None else ("", False)
    return Placement(
        arguments.center,
        arguments.as_placed,
        arguments.drop,
        unit="" if certain else unit,
        unit_given=arguments.units is not None,
        scale=arguments.scale.text if arguments.scale else "100%",
    )


def repaired_plate(
    arguments: argparse.Namespace, printer: Printer, report: Stages
) -> tuple[Mesh, Plate, Repairs]:
    """Read the models as one repaired mesh; return it with facts about the models and the repairs.

    Raises:
        PrinterSlicerError: the mesh cannot be read or repaired, or --strict refuses repairs.
    """
    report("loading")
    mesh, plate = plate_from(arguments, printer, report)
    report("repairing")
    repaired, repairs = repair(mesh)
    if arguments.strict:
        require_no_repair(mesh.name, repairs)
    return repaired, plate, repairs


def _progress(report: Stages, path: Path) -> Any:
    """Return a function that reports every tenth of a large file."""
    last = -1

    def progress(share: float) -> None:
        """Report the share of the file that has been read, 0 to 1."""
        nonlocal last
        tenth = int(share * 10)
        if tenth > last:
            last = tenth
            report(f"loading {path.name}: {10 * tenth} %")

    return progress


def _facts(model: Model) -> dict[str, Any]:
    return {
        "file": str(model.path),
        "format": model.kind,
        "unit": model.unit,
        "facets": model.mesh.n_facets,
        "facets_without_area": model.n_folded,
    }


def _floating_parts(paths: Sequence[Path], meshes: Sequence[Mesh], placement: Placement) -> list[str]:
    """Return a warning for each file whose part does not reach the bed."""
    bottoms = [float(mesh.bounds[0, 2]) for mesh in meshes]
    bed = min(bottoms) if placement.drop else 0.0
    return [
        f"{path.name}: the part starts {bottom - bed:.4g} mm above the bed, as placed in its file"
        for path, bottom in zip(paths, bottoms, strict=True)
        if bottom - bed > _SMALLEST_GAP
    ]


def _refuse_overlaps(paths: Sequence[Path], meshes: Sequence[Mesh]) -> None:
    """Reject parts of different files that overlap; objects of one file may overlap.

    Raises:
        PartError: some do; names the files and the size of the overlap.
    """
    if len(meshes) < 2:
        return
    from printer_slicer.overlaps import find_overlaps

    names = [path.name for path in dict.fromkeys(paths)]
    called = [str(path) if names.count(path.name) > 1 else path.name for path in paths]
    if overlapping := _describe_overlaps(find_overlaps(meshes), called):
        raise PartError(
            f"{overlapping}, as their files place them",
            remedy="Slice them separately with -o FOLDER/, move one in its file, or print them as one with --fuse",
        )


def _refuse_collisions(models: Sequence[dict[str, Any]], meshes: Sequence[Mesh]) -> None:
    """Reject objects of one 3MF file that occupy the same space; bodies of one object may.

    Raises:
        PartError: some do; names the objects and the size of the overlap.
    """
    for model, mesh in zip(models, meshes, strict=True):
        if model["format"] != "3mf" or len(mesh.objects) < 2 or not all(item.count for item in mesh.objects):
            continue
        from printer_slicer.overlaps import find_collisions

        if overlapping := _describe_overlaps(find_collisions(mesh), [item.name for item in mesh.objects]):
            raise PartError(
                f"{model['file']}: {overlapping}",
                remedy="Move them apart in the program that made the file, or print them as one with --fuse",
            )


def _describe_overlaps(overlaps: Iterable[Overlap], names: Sequence[str]) -> str:
    """Describe the first overlaps of parts with these names; empty if there are none."""
    found = list(islice(overlaps, _MOST_SHOWN + 1))
    described = [
        f"{names[one.second]} overlaps {names[one.first]} by {one.width:.4g} x {one.depth:.4g} mm"
        + (f", the largest of {one.places} places" if one.places > 1 else "")
        for one in found[:_MOST_SHOWN]
    ]
    return "; ".join([*described, *(["and more"] if len(found) > _MOST_SHOWN else [])])


def plate_name(paths: Sequence[Path]) -> str:
    """Return the name of the models for messages."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} and {len(paths) - 1} more"


def keep_memory() -> None:
    """Keep freed memory for the next array instead of handing it back to the system at once.

    Slicing allocates and frees arrays of megabytes all the time. The C library requests each from the system, which
    clears every page first: a sixth of the CPU time of a large part. Only the command line changes this, because the
    setting applies to the whole process. Only glibc has it.
    """
    if not sys.platform.startswith("linux"):
        return
    import ctypes

    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        if not mallopt(_MMAP_THRESHOLD, _LARGEST):
            mallopt(_MMAP_THRESHOLD, _LARGEST_BEFORE)
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)


# Settings of 3MF projects


def with_projects(
    arguments: argparse.Namespace, profile: Profile, mesh: Mesh, plate: Plate
) -> tuple[Profile, Plate]:
    """Return the profile with the object settings of 3MF projects, and the plate with warnings about unused settings.

    Used settings are listed on stderr, unused ones as warnings. The command line and the profile take precedence.

    Args:
        arguments: the command line.
        profile: the profile from the command line.
        mesh: all models; its items are the objects to print.
        plate: facts about the models.

    Raises:
        UsageError: a project is damaged, or its settings contradict the profile.
    """
    projects = _projects(arguments, profile, mesh)
    if not projects:
        return profile, plate
    changes, unused = _changes(arguments, profile, projects)
    if not arguments.quiet:
        for path, project in projects.items():
            for text in project.used:
                print(sanitize(f"printer-slicer: {path.name}: {text}"), file=sys.stderr)
    warn(arguments, unused)
    plate = replace(plate, warnings=(*plate.warnings, *unused))
    return profile_with(profile, changes) if changes else profile, plate


def _projects(arguments: argparse.Namespace, profile: Profile, mesh: Mesh) -> dict[Path, Project]:
    """Read the projects of all 3MF files that hold settings of a slicer."""
    found: dict[Path, Project] = {}
    for path in arguments.models:
        if not _is_archive(path):
            continue
        from printer_slicer.importing.projects import read_project

        project = read_project(path, profile, {item.name for item in mesh.objects})
        if project.overrides or project.layer_heights or project.unused or project.has_settings:
            found[path] = project
    return found


def _is_archive(path: Path) -> bool:
    """Return whether it is a regular file, not a pipe, and starts like a 3MF file."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_ARCHIVE)) == _ARCHIVE


def _changes(
    arguments: argparse.Namespace, profile: Profile, projects: Mapping[Path, Project]
) -> tuple[dict[str, object], list[str]]:
    """Return the settings to change, and messages about unused settings."""
    typed = changes_from(arguments)
    changes: dict[str, object] = {}
    unused: list[str] = []
    tables: list[Mapping[str, Any]] = []
    for path, project in projects.items():
        tables += project.overrides
        unused += [f"{path.name}: {text}" for text in project.unused]
        if project.has_settings and arguments.quality is None:
            unused.append(
                f"{path.name}: its print, filament and printer settings are not used; "
                f"import them with `printer-slicer profiles import {path}`"
            )
        for name, height in project.layer_heights:
            if len(arguments.models) > 1 or any(
                key.endswith(("layer_height", "planner.kind")) for key in typed
            ):
                unused.append(f"{path.name}: {name}: layer_height = {height:g} is not used")
            else:
                changes |= {"quality.planner.kind": "uniform", "quality.layer_height": height}
    if tables:
        own = settings_of(profile)["quality"].get("overrides", [])
        changes["quality.overrides"] = [*tables, *own]
    return changes, unused
