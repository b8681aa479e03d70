"""Load the models of a command line as one plate, and apply the settings of 3MF projects."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from printer_slicer.cli.arrange_models import (
    ArrangedPlates,
    arrange_models,
    check_plate_number,
    count_fused_copies,
    describe_other_plates,
    explain_arranging,
    is_arranging_requested,
    reject_positions_with_copies,
)
from printer_slicer.cli.output import sanitize, warn
from printer_slicer.cli.settings import collect_changes
from printer_slicer.errors import PartError, UsageError
from printer_slicer.freed_memory import keep_freed_memory
from printer_slicer.healing import repair, require_no_repair
from printer_slicer.mesh_io import Model, load_model
from printer_slicer.model import Volumes
from printer_slicer.placing import Placement, join, transform
from printer_slicer.profile import profile_with, settings_as_dict
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.cli.output import StageReport
    from printer_slicer.model import Mesh, Repairs
    from printer_slicer.overlaps import Overlap
    from printer_slicer.profile import Printer, Profile

__all__ = [
    "Plate",
    "apply_projects",
    "format_model_names",
    "load_arranged_plates",
    "load_plate",
    "load_plates",
    "load_repaired_plate",
]

_SMALLEST_GAP = 0.01  # mm above the bed; a part that starts higher is reported
_MAX_SHOWN = 3


class Plate(Struct, frozen=True, eq=False):
    """Placement, warnings and facts of the models that are printed together.

    Attributes:
        placement: position of the parts on the bed.
        warnings: sentences for the user.
        models: facts about each file, for JSON.
        number: number of the plate, from 1.
        count: number of plates that the parts need.
        parts: facts about the places of the parts on all plates, for JSON; empty if they are not arranged.
        names: names of the objects and modifiers on all plates, if there are several.
        turned: facts about the parts that --orient turned, for JSON.
        comments: the same for the head of the G-code.
        tells: whether messages about settings of projects are printed, which are the same for all plates.
    """

    placement: Placement
    warnings: tuple[str, ...]
    models: tuple[dict[str, Any], ...]
    number: int = 1
    count: int = 1
    parts: tuple[dict[str, Any], ...] = ()
    names: frozenset[str] = frozenset()
    turned: tuple[dict[str, Any], ...] = ()
    comments: tuple[str, ...] = ()
    tells: bool = True

    def collect_facts(self) -> dict[str, Any]:
        """Return the facts for JSON."""
        places = {"plate": self.number, "plates": self.count, "parts": list(self.parts)}
        turned = {"orientations": list(self.turned)} if self.turned else {}
        return {"models": list(self.models), "warnings": list(self.warnings), **places, **turned}


class _LoadedFile(NamedTuple):
    """A model file, and its mesh scaled and rotated."""

    model: Model
    mesh: Mesh


def load_plate(arguments: argparse.Namespace, profile: Profile, report: StageReport) -> tuple[Mesh, Plate]:
    """Read the models of a command that uses one plate, as `load_plates`.

    Raises:
        UsageError, MeshError, PartError: as `load_plates`.
        UsageError: the parts need several plates, and --plate is not given.
    """
    meshes, plates = load_plates(arguments, profile, report)
    if len(meshes) > 1:
        raise UsageError(
            f"the parts need {len(meshes)} plates, but this command uses one; "
            f"{describe_other_plates(plates[0].parts)}",
            remedy="Choose a plate with --plate N, or make G-code of all plates with `printer-slicer slice`",
        )
    return meshes[0], plates[0]


def load_plates(
    arguments: argparse.Namespace, profile: Profile, report: StageReport
) -> tuple[list[Mesh], list[Plate]]:
    """Read all models of a command line, scaled and rotated, into one mesh for each plate.

    The parts have the positions of their files, or are arranged. Warnings are printed to stderr at once. With --plate,
    only this plate is returned.

    Raises:
        UsageError, MeshError: a file cannot be read, or is not a model.
        PartError: parts overlap where they may not, or a part does not fit the bed.
    """
    loaded = _load_parts(arguments, profile, report)
    if loaded.why is None:
        warn(arguments, loaded.plate.warnings)
        check_plate_number(arguments, 1)
        return [join(loaded.parts).with_volumes(loaded.volumes)], [loaded.plate]
    arranged, plate = _arrange_parts(arguments, loaded, profile, report)
    return _list_arranged_plates(arguments, arranged, plate)


def load_arranged_plates(
    arguments: argparse.Namespace, profile: Profile, report: StageReport
) -> tuple[ArrangedPlates, Plate]:
    """Read all models of a command line, and arrange them; --arrange must be set.

    Raises:
        UsageError, MeshError, PartError: as `load_plates`.
    """
    loaded = _load_parts(arguments, profile, report)
    arranged, plate = _arrange_parts(arguments, loaded, profile, report)
    check_plate_number(arguments, plate.count)
    return arranged, plate


class _LoadedParts(NamedTuple):
    """The parts to print, and why they are arranged: empty if this is requested; None: they are not arranged."""

    parts: list[Mesh]
    why: str | None
    volumes: Volumes | None
    plate: Plate


def _load_parts(arguments: argparse.Namespace, profile: Profile, report: StageReport) -> _LoadedParts:
    """Read the models of a command line, and decide whether they are arranged; as `load_plates`."""
    keep_freed_memory()
    reject_positions_with_copies(arguments)
    files = {path: _load_transformed(arguments, path, report) for path in dict.fromkeys(arguments.models)}
    separate = _split_files(arguments, files)
    turned: tuple[dict[str, Any], ...] = ()
    comments: tuple[str, ...] = ()
    if _is_orientation_requested(arguments):
        from printer_slicer.cli.orient_models import turn_models

        separate, turned, comments = turn_models(arguments, separate, profile, report)
    volumes = _load_volumes(arguments, report)
    room = np.array(profile.printer.print_volume)
    warnings = list(_list_file_warnings(arguments, files, room))
    placement = _make_placement(arguments, [one.model for one in files.values()])
    if not arguments.fuse:
        _reject_overlapping_objects(files)
    parts, why = _collect_parts(arguments, separate, profile.printer)
    if why is None:
        warnings += _list_floating_part_warnings(separate, placement)
    models = tuple(_collect_model_facts(one.model) for one in files.values())
    plate = Plate(placement, tuple(warnings), models, turned=turned, comments=comments)
    return _LoadedParts(parts, why, volumes, plate)


def _arrange_parts(
    arguments: argparse.Namespace, loaded: _LoadedParts, profile: Profile, report: StageReport
) -> tuple[ArrangedPlates, Plate]:
    """Arrange parts; return them, and the facts that all plates have in common. Warnings are printed."""
    report("arranging")
    arranged = arrange_models(arguments, _add_volumes(loaded.parts, loaded.volumes), profile)
    told = [f"{loaded.why}: {arranged.describe()}"] if loaded.why else []
    plate = replace(
        loaded.plate,
        placement=arranged.placement,
        warnings=(*loaded.plate.warnings, *told),
        count=len(arranged.meshes),
        parts=arranged.parts,
    )
    warn(arguments, plate.warnings)
    return arranged, plate


def _split_files(
    arguments: argparse.Namespace, files: Mapping[Path, _LoadedFile]
) -> Mapping[Path, Sequence[Mesh]]:
    """Return the parts of each file: several if they are moved separately, to arrange or to turn them.

    Raises:
        UsageError: parts of a file are to be turned, but to keep their positions.
    """
    is_turned = getattr(arguments, "orient", "off") != "off"
    if arguments.fuse or not (is_turned or arguments.arrange):
        return {path: [one.mesh] for path, one in files.items()}
    from printer_slicer.overlaps import split_separate_objects

    parts: dict[Path, Sequence[Mesh]] = {
        path: split_separate_objects(one.mesh) for path, one in files.items()
    }
    flag = "--as-placed" if arguments.as_placed else "--center" if arguments.center is not None else ""
    for path, own in parts.items():
        if flag and is_turned and len(own) > 1:
            raise UsageError(
                f"{flag}: --orient turns each of the {len(own)} parts of {path.name}, which then cannot keep "
                "their positions",
                remedy=f"Leave out {flag}, or turn the parts together with --fuse",
            )
    return parts


def _is_orientation_requested(arguments: argparse.Namespace) -> bool:
    """Return whether there is an option for turning parts, which may also be one without effect."""
    options = ("orient", "orient_keep_up", "orient_row")
    return any(getattr(arguments, name, None) not in {None, "off"} for name in options)


def _collect_parts(
    arguments: argparse.Namespace, files: Mapping[Path, Sequence[Mesh]], printer: Printer
) -> tuple[list[Mesh], str | None]:
    """Return the parts to print, and why they are arranged: empty if this is requested; None: they are not arranged.

    Raises:
        PartError: parts overlap, but positions are given.
    """
    parts = [part for path in arguments.models for part in files[path]]
    if arguments.fuse:
        count = count_fused_copies(arguments)
        fused = [join([part for own in files.values() for part in own])] * count
        return fused, "" if is_arranging_requested(arguments) else None
    if is_arranging_requested(arguments):
        return [part for part in parts for _ in range(arguments.copies)], ""
    if split := [path.name for path, own in files.items() if len(own) > 1]:
        return parts, f"the parts of {split[0]} are oriented one by one"
    is_placed = arguments.as_placed or arguments.center is not None
    overlaps = _describe_overlapping_files(arguments.models, parts, _MAX_SHOWN if is_placed else 1)
    return parts, explain_arranging(arguments, parts, overlaps, printer) or None


def _add_volumes(parts: Sequence[Mesh], volumes: Volumes | None) -> list[Mesh]:
    """Return the parts, each with the volumes of the command line; copies stay the same mesh."""
    own = {id(part): part.with_volumes(volumes) for part in parts}
    return [own[id(part)] for part in parts]


def _list_arranged_plates(
    arguments: argparse.Namespace, arranged: ArrangedPlates, plate: Plate
) -> tuple[list[Mesh], list[Plate]]:
    """Return the meshes and plates of arranged parts; with --plate, only this one.

    Raises:
        UsageError: there is no such plate.
    """
    meshes, count = list(arranged.meshes), len(arranged.meshes)
    check_plate_number(arguments, count)
    names = frozenset[str]()
    if count > 1:
        from printer_slicer.objects import list_overridable_names

        names = frozenset(name for mesh in meshes for name in list_overridable_names(mesh))
    plates = [replace(plate, number=number, names=names, tells=number == 1) for number in range(1, count + 1)]
    if arguments.plate is None:
        return meshes, plates
    chosen = arguments.plate - 1
    return [meshes[chosen]], [replace(plates[chosen], tells=True)]


def _list_file_warnings(
    arguments: argparse.Namespace, files: Mapping[Path, _LoadedFile], room: Float
) -> Iterator[str]:
    """Yield the warnings about files and their units; `room` (3,) is the size of the print volume, mm."""
    for path, (model, mesh) in files.items():
        yield from (f"{path.name}: {note}" for note in model.notes)
        unit_warning = model.size_warning(room) if arguments.scale is None and arguments.units is None else ""
        # A part that does not fit the bed is rejected when it is placed, with the same advice.
        if unit_warning and (mesh.size <= room).all():
            yield unit_warning


def _load_transformed(arguments: argparse.Namespace, path: Path, report: StageReport) -> _LoadedFile:
    """Read a file; return the model, and its mesh scaled and rotated."""
    model = load_model(path, units=arguments.units, progress=_make_progress_callback(report, path))
    scale = arguments.scale[:3] if arguments.scale else 1.0
    mesh = transform(model.mesh, scale=scale, rotate=arguments.rotate or (0.0, 0.0, 0.0))
    return _LoadedFile(model, mesh)


def _load_volumes(arguments: argparse.Namespace, report: StageReport) -> Volumes | None:
    """Read the support enforcers, blockers and modifiers of a command line."""
    enforcers, blockers, modifiers = (
        [replace(_load_transformed(arguments, path, report).mesh, volumes=None, objects=()) for path in paths]
        for paths in (arguments.support_enforcer, arguments.support_blocker, arguments.modifier)
    )
    steering = [*(Volumes(enforce=mesh) for mesh in enforcers), *(Volumes(block=mesh) for mesh in blockers)]
    return Volumes.joined([*steering, Volumes(modifiers=tuple(modifiers))])


def _make_placement(arguments: argparse.Namespace, models: Iterable[Model]) -> Placement:
    """Return the placement of parts that are not arranged."""
    units = {(one.unit, one.kind == "step") for one in models}  # STEP files state their unit
    unit, certain = units.pop() if len(units) == 1 and arguments.scale is None else ("", False)
    return Placement(
        arguments.center,
        arguments.as_placed,
        arguments.drop,
        unit="" if certain else unit,
        unit_given=arguments.units is not None,
        scale=arguments.scale.text if arguments.scale else "100%",
    )


def load_repaired_plate(
    arguments: argparse.Namespace, profile: Profile, report: StageReport
) -> tuple[Mesh, Plate, Repairs]:
    """Read the models as one mesh and repair it; return the mesh, the plate and the repairs.

    Raises:
        PrinterSlicerError: the mesh cannot be read or repaired, or needs repair in spite of --strict.
    """
    report("loading")
    mesh, plate = load_plate(arguments, profile, report)
    report("repairing")
    repaired, repairs = repair(mesh)
    if arguments.strict:
        require_no_repair(mesh.name, repairs)
    return repaired, plate, repairs


def _make_progress_callback(report: StageReport, path: Path) -> Any:
    """Return a function that reports the loading of a large file in steps of 10 %."""
    last = -1

    def progress(share: float) -> None:
        """Report the share of the file that has been read, 0 to 1."""
        nonlocal last
        tenth = int(share * 10)
        if tenth > last:
            last = tenth
            report(f"loading {path.name}: {10 * tenth} %")

    return progress


def _collect_model_facts(model: Model) -> dict[str, Any]:
    """Return the facts about a model file for JSON."""
    return {
        "file": str(model.path),
        "format": model.kind,
        "unit": model.unit,
        "facets": model.mesh.n_facets,
        "facets_without_area": model.n_folded,
    }


def _list_floating_part_warnings(parts: Mapping[Path, Sequence[Mesh]], placement: Placement) -> list[str]:
    """Return a warning for each file whose part does not touch the bed; each file has one mesh."""
    bottoms = {path: float(mesh.bounds[0, 2]) for path, (mesh,) in parts.items()}
    bed = min(bottoms.values()) if placement.drop else 0.0
    return [
        f"{path.name}: the part starts {bottom - bed:.4g} mm above the bed, because of its position in the file"
        for path, bottom in bottoms.items()
        if bottom - bed > _SMALLEST_GAP
    ]


def _describe_overlapping_files(paths: Sequence[Path], meshes: Sequence[Mesh], most: int) -> str:
    """Describe the first overlaps of parts of different files, at most `most`; empty if there are none."""
    if len(meshes) < 2:
        return ""
    from printer_slicer.overlaps import find_overlaps

    names = [path.name for path in dict.fromkeys(paths)]
    called = [str(path) if names.count(path.name) > 1 else path.name for path in paths]
    return _describe_overlaps(find_overlaps(meshes), called, most)


def _reject_overlapping_objects(files: Mapping[Path, _LoadedFile]) -> None:
    """Reject objects of one 3MF file that occupy the same space; the bodies of one object may overlap.

    Raises:
        PartError: objects overlap; the message names them and the size of the overlap.
    """
    for path, (model, mesh) in files.items():
        if model.kind != "3mf" or len(mesh.objects) < 2 or not all(item.count for item in mesh.objects):
            continue
        from printer_slicer.overlaps import find_collisions

        if overlapping := _describe_overlaps(find_collisions(mesh), [item.name for item in mesh.objects]):
            raise PartError(
                f"{path}: {overlapping}",
                remedy="Move them apart in the program that made the file, or print them as one part with --fuse",
            )


def _describe_overlaps(overlaps: Iterable[Overlap], names: Sequence[str], most: int = _MAX_SHOWN) -> str:
    """Describe the first overlaps of parts with these names, at most `most`; return an empty text if there are none."""
    found = list(islice(overlaps, most + 1))
    described = [
        f"{names[one.second]} overlaps {names[one.first]} by {one.width:.4g} x {one.depth:.4g} mm"
        + (f", the largest of {one.places} places" if one.places > 1 else "")
        for one in found[:most]
    ]
    return "; ".join([*described, *(["others overlap as well"] if len(found) > most else [])])


def format_model_names(paths: Sequence[Path]) -> str:
    """Format the file names of the models for messages: `part.stl and 2 more`."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} and {len(paths) - 1} more"


# Settings of 3MF projects


def apply_projects(
    arguments: argparse.Namespace, profile: Profile, mesh: Mesh, plate: Plate
) -> tuple[Profile, Plate]:
    """Apply the object settings of 3MF projects: return the changed profile, and the plate with additional warnings.

    The settings that are used are printed to stderr; settings that are not used are warnings. The command line and the
    profile take precedence.

    Args:
        arguments: the command line.
        profile: the profile from the command line.
        mesh: the mesh of the plate, with the objects to print.
        plate: the plate.

    Raises:
        UsageError: a project is damaged, or its settings contradict the profile.
    """
    from printer_slicer.project_settings import (
        apply_project_settings,
        chooses_layer_height,
        list_unused_model_warnings,
    )

    has_height = chooses_layer_height(collect_changes(arguments))
    applied = apply_project_settings(
        profile,
        arguments.models,
        mesh,
        names=plate.names,
        keeps_layer_height=has_height or len(arguments.models) > 1,
        has_quality=arguments.quality is not None,
    )
    if plate.tells and not arguments.quiet:
        for path, used in applied.used.items():
            for text in used:
                print(sanitize(f"printer-slicer: {path.name}: {text}"), file=sys.stderr)
    profile = applied.profile
    profile = _drop_foreign_overrides(profile, mesh, plate) if plate.count > 1 else profile
    warnings = [*applied.warnings, *list_unused_model_warnings(mesh, profile)]
    warn(arguments, warnings if plate.tells else [])
    return profile, replace(plate, warnings=(*plate.warnings, *warnings))


def _drop_foreign_overrides(profile: Profile, mesh: Mesh, plate: Plate) -> Profile:
    """Return the profile without overrides for objects that are only on other plates."""
    from printer_slicer.objects import list_overridable_names

    foreign = plate.names - set(list_overridable_names(mesh))
    own = settings_as_dict(profile)["quality"].get("overrides", [])
    kept = [one for one in own if one.get("object") not in foreign]
    return profile_with(profile, {"quality.overrides": kept}) if len(kept) < len(own) else profile
