"""Read 3MF files: objects, components and build items of all model files in an archive.

Sources: 3MF Core Specification 1.3 and Production Extension 1.1. Objects of other types than model (support, surface,
other) and build items with `printable="0"` are left out. Support enforcers and blockers, negative volumes, modifiers
and facets painted for supports are kept apart from the part.
"""

from __future__ import annotations

import math
import posixpath
from array import array
from collections import Counter
from collections.abc import Hashable
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.input_files import MODEL_SUFFIXES
from printer_slicer.mesh_io.assembly import (
    PART,
    ObjectBuilder,
    ObjectReference,
    ObjectTable,
    assemble_facets,
    assemble_painted_facets,
    count_facets,
    find_original,
)
from printer_slicer.mesh_io.element_runs import ElementRun
from printer_slicer.mesh_io.facet_paint import BLOCKED, ENFORCED
from printer_slicer.mesh_io.markup import XmlReader, get_integer, get_number
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN, LARGEST
from printer_slicer.mesh_io.units import UNITS, parse_unit
from printer_slicer.mesh_io.volume_types import (
    BLOCK,
    ENFORCE,
    MAX_LISTED_NAMES,
    MODIFIER,
    NEGATIVE,
    read_volume_types,
)
from printer_slicer.model import Mesh, Volumes
from printer_slicer.values import Struct, field

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.archive import Archive
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["NAMESPACE_ROOT", "ROOT_MODEL_TYPE", "read_three_mf"]

NAMESPACE_ROOT: Final = "http://schemas.microsoft.com/3dmanufacturing/"
ELEMENT_PREFIXES: Final = ("", f"{NAMESPACE_ROOT}core/2015/02 ", f"{NAMESPACE_ROOT}2013/01 ")
"""Prefixes of the names of elements: the namespaces of the core specification."""
PATH_ATTRIBUTES: Final = tuple(f"{NAMESPACE_ROOT}production/{year} path" for year in ("2015/06", "2021/04"))
SUPPORTED_EXTENSIONS: Final = tuple(
    f"{NAMESPACE_ROOT}{name}/" for name in ("core", "production", "material", "trianglesets")
)
"""Extensions that a file may require; those for colours or groups of facets do not affect the shape."""
RELATIONSHIPS_FILE: Final = "_rels/.rels"
RELATIONSHIP_PREFIXES: Final = ("", "http://schemas.openxmlformats.org/package/2006/relationships ")
ROOT_MODEL_TYPE: Final = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
SUPPORT_PAINT: Final = ("custom_supports", "paint_supports")
"""Attributes of facets painted for supports in files of PrusaSlicer, and of Bambu Studio and OrcaSlicer."""
PAINT_VERSIONS: Final = ("slic3rpe:FdmSupportsPaintingVersion", "BambuStudio:FdmSupportsPaintingVersion")
"""Names of the metadata that tell the version of the paint."""
NEWEST_PAINT: Final = 1
IGNORED_PAINT: Final = {
    "custom_seam": "seams",
    "paint_seam": "seams",
    "mmu_segmentation": "colours",
    "paint_color": "colours",
    "fuzzy_skin": "fuzzy skin",
    "paint_fuzzy_skin": "fuzzy skin",
}
"""Attributes of facets painted for something else."""
USUAL_ROOT_MODEL: Final = "3d/3dmodel.model"


class _Model(Struct, eq=False):
    """The data of one model file of an archive."""

    objects: ObjectTable
    unit: str = "millimeter"
    kinds: dict[Hashable, str] = field(default_factory=dict)
    items: list[ObjectReference] = field(default_factory=list)
    n_unprintable: int = 0
    painted: Counter[tuple[Hashable, str]] = field(default_factory=Counter)
    """Object and value of IGNORED_PAINT -> number of facets."""
    paint_version: int = 0
    """Version of the paint for supports."""


class _ModelReader(XmlReader):
    """Reader of one model file."""

    def __init__(self, path: Path, limits: Limits, part: str) -> None:
        super().__init__(path, limits, part)
        self.model = _Model(ObjectTable(path, limits))
        self.check_limits = self.model.objects.check_limits  # type: ignore[method-assign]
        self._part = part
        self._key: Hashable = None
        self._body = ObjectBuilder("no object")
        for name, handler in {
            "model": self._begin_model,
            "object": self._begin_object,
            "vertex": self._add_vertex,
            "triangle": self._add_triangle,
            "component": self._add_component,
            "item": self._add_item,
        }.items():
            self.register((f"{space}{name}" for space in ELEMENT_PREFIXES), handler)
        self.register_text((f"{space}metadata" for space in ELEMENT_PREFIXES), self._read_metadata)
        for run in (
            ElementRun("vertices", "vertex", ("x", "y", "z"), "d", self._add_vertices),
            ElementRun("triangles", "triangle", ("v1", "v2", "v3"), "q", self._add_triangles),
        ):
            self.register_run(ELEMENT_PREFIXES, run)

    def _begin_model(self, attributes: list[str]) -> None:
        given = dict(zip(attributes[::2], attributes[1::2], strict=True))
        self.model.unit = given.get("unit", "millimeter")
        for prefix in given.get("requiredextensions", "").split():
            extension = self.namespaces.get(prefix, prefix)
            if not extension.startswith(SUPPORTED_EXTENSIONS):
                raise self.make_error(
                    f"the file requires the 3MF extension '{extension[:100]}', which is not supported",
                    "Export the part as a plain mesh, or as STL",
                )

    def _begin_object(self, attributes: list[str]) -> None:
        given = dict(zip(attributes[::2], attributes[1::2], strict=True))
        self._key = key = (self._part, _normalize_number(given.get("id", "")))
        self._body = self.model.objects.add_object(key, f"object {key[1]}")
        self._body.label = given.get("name", "")
        self.model.kinds[key] = given.get("type", "model")

    def _add_vertex(self, attributes: list[str]) -> None:
        # Most files write only x, y, z, in this order; there can be millions of vertices.
        if attributes[::2] == ["x", "y", "z"]:
            self._body.xyz.extend((float(attributes[1]), float(attributes[3]), float(attributes[5])))
        else:
            self._body.xyz.extend([get_number(attributes, name) for name in "xyz"])

    def _add_triangle(self, attributes: list[str]) -> None:
        if attributes[:6:2] == ["v1", "v2", "v3"]:
            self._body.corners.extend((int(attributes[1]), int(attributes[3]), int(attributes[5])))
        else:
            self._body.corners.extend([get_integer(attributes, name) for name in ("v1", "v2", "v3")])
        if len(attributes) > 6:
            self._read_paint(attributes)

    def _read_paint(self, attributes: list[str]) -> None:
        """Read how the facet that was added last is painted."""
        for name, value in zip(attributes[::2], attributes[1::2], strict=True):
            local = name.rpartition(" ")[2]
            if what := IGNORED_PAINT.get(local):
                self.model.painted[self._key, what] += 1
            elif local in SUPPORT_PAINT and value:
                self._body.paint[len(self._body.corners) // 3 - 1] = value

    def _read_metadata(self, attributes: list[str], text: str) -> None:
        given = dict(zip(attributes[::2], attributes[1::2], strict=True))
        if given.get("name") in PAINT_VERSIONS:
            self.model.paint_version = int(text)

    def _add_vertices(self, values: array[float]) -> None:
        self._body.xyz.extend(values)

    def _add_triangles(self, values: array[int]) -> None:
        self._body.corners.extend(values)

    def _add_component(self, attributes: list[str]) -> None:
        self._body.parts.append(
            self._make_reference(dict(zip(attributes[::2], attributes[1::2], strict=True)))
        )

    def _add_item(self, attributes: list[str]) -> None:
        given = dict(zip(attributes[::2], attributes[1::2], strict=True))
        if given.get("printable", "1").strip().lower() in ("0", "false"):
            self.model.n_unprintable += 1
        else:
            self.model.items.append(self._make_reference(given))

    def _make_reference(self, given: dict[str, str]) -> ObjectReference:
        """Return a reference to an object in this or another model file."""
        self.model.objects.count_reference()
        part = next((_normalize_path(given[name]) for name in PATH_ATTRIBUTES if name in given), self._part)
        return ObjectReference(
            (part, _normalize_number(given.get("objectid", ""))),
            self._parse_transform(given.get("transform", "")),
        )

    def _parse_transform(self, text: str) -> Float | None:
        """Return the matrix (4, 4) for the twelve numbers of a transform."""
        if not text:
            return None
        numbers = [float(word) for word in text.split()]
        if len(numbers) != 12 or not all(map(math.isfinite, numbers)):
            raise self.make_error(f"a transform must have 12 numbers, found '{text[:80]}'")
        matrix = np.eye(4)
        matrix[:, :3] = np.reshape(numbers, (4, 3))
        return matrix


class _RelationshipReader(XmlReader):
    """Reader of the relationships that name the root model file."""

    def __init__(self, path: Path, limits: Limits) -> None:
        super().__init__(path, limits, RELATIONSHIPS_FILE)
        self.start = ""
        self.register((f"{space}Relationship" for space in RELATIONSHIP_PREFIXES), self._read_relationship)

    def _read_relationship(self, attributes: list[str]) -> None:
        given = dict(zip(attributes[::2], attributes[1::2], strict=True))
        if given.get("Type") == ROOT_MODEL_TYPE and not self.start:
            self.start = _normalize_path(given.get("Target", ""))


def read_three_mf(
    archive: Archive, limits: Limits, unit: str | None
) -> tuple[Float, str, list[str], list[tuple[str, int]], list[Volumes | None]]:
    """Read all build items of a 3MF archive.

    Args:
        archive: the open archive.
        limits: limits for the content.
        unit: unit of the coordinates, a key in UNITS; None: the unit that the file states.

    Returns:
        Corners (F, 3, 3), mm; the unit of the file; warnings; the name and the number of facets of each object on the
        plate; volumes that are not printed and painted facets of each object.

    Raises:
        MeshError: the 3MF is not valid.
    """
    path, start = archive.path, _find_root_model(archive, limits)
    first = _read_model_file(archive, limits, start)
    own_unit = unit or parse_unit(first.unit, path)
    whole = _read_referenced(archive, limits, start, first)
    bodies = whole.objects.bodies
    _check_paint_version(whole, path)
    types = read_volume_types(archive, limits)
    types.name_objects(bodies, start)
    copies = {key for key, kind in whole.kinds.items() if kind == "model"}
    first.items = [find_original(one, bodies, copies) for one in first.items]
    notes = types.separate_volumes(bodies, start, path)
    _empty_other_kinds(bodies, whole.kinds, notes)
    notes += _describe_ignored_paint(whole.painted, bodies)
    if first.n_unprintable:
        notes.append(f"{_format_item_count(first.n_unprintable)} marked as not printable and left out")
    if not first.items:
        raise MeshError(
            f"{path}: the file contains no printable object",
            remedy="Mark a part as printable, then export the file again",
        )
    triangles = assemble_facets(first.items, bodies, path, limits, UNITS[own_unit])
    printed = [(root, count_facets(root, bodies, path, limits)) for root in first.items]
    printed = [(root, count) for root, count in printed if count]
    counts = [(bodies[root.key].label, count) for root, count in printed]
    has_volumes = any(
        body.paint or any(use.volume_type != PART for use in body.parts) for body in bodies.values()
    )
    volumes = [
        _read_volumes(root, bodies, path, limits, UNITS[own_unit]) if has_volumes else None
        for root, _ in printed
    ]
    return triangles, own_unit, notes, counts, volumes


def _read_volumes(
    root: ObjectReference,
    bodies: dict[Hashable, ObjectBuilder],
    path: Path,
    limits: Limits,
    scale: float,
) -> Volumes | None:
    """Return the volumes of an object that are not printed, and its painted facets; None if there are none."""

    def read_mesh(volume_type: str, name: str) -> Mesh | None:
        """Return the volumes of a type as one mesh; None if there are none."""
        triangles = assemble_facets([root], bodies, path, limits, scale, volume_type=volume_type)
        if not (np.abs(triangles) < LARGEST).all():
            raise MeshError(
                f"{path}: a {volume_type} has a coordinate that is too large or no number",
                remedy=EXPORT_AGAIN,
            )
        return Mesh(triangles, name) if len(triangles) else None

    enforce, block, negative = (
        read_mesh(kind, f"{path.stem}: {kind}") for kind in (ENFORCE, BLOCK, NEGATIVE)
    )
    given = dict.fromkeys(use.volume_type for use in bodies[root.key].parts)
    names = [kind for kind in given if kind.startswith(MODIFIER)]
    modifiers = [read_mesh(kind, kind.removeprefix(MODIFIER)) for kind in names]
    pieces, state = assemble_painted_facets([root], bodies, path, limits, scale)
    volumes = Volumes(
        enforce,
        block,
        negative,
        pieces[state == ENFORCED],
        pieces[state == BLOCKED],
        tuple(mesh for mesh in modifiers if mesh),
    )
    return None if volumes.is_empty else volumes


def _check_paint_version(model: _Model, path: Path) -> None:
    """Reject facets that a newer program painted for supports.

    Raises:
        MeshError: the version of the paint is unknown.
    """
    if model.paint_version > NEWEST_PAINT and any(body.paint for body in model.objects.bodies.values()):
        raise MeshError(
            f"{path}: the facets are painted for supports in version {model.paint_version}, which is unknown; the "
            f"newest known version is {NEWEST_PAINT}",
            remedy="Remove the paint in the program that made the file, or use support enforcers and blockers",
        )


def _read_model_file(archive: Archive, limits: Limits, part: str) -> _Model:
    reader = _ModelReader(archive.path, limits, part)
    reader.read(archive.read_chunks(part))
    return reader.model


def _read_referenced(archive: Archive, limits: Limits, start: str, first: _Model) -> _Model:
    """Return the data of the root model file together with those of other model files that it uses.

    The root model file may use objects of other model files, but those may not use further files.
    """
    bodies = first.objects.bodies
    uses = [*first.items, *(use for body in bodies.values() for use in body.parts)]
    wanted = {use.key[0] for use in uses if isinstance(use.key, tuple)}
    for part in sorted(wanted - {start}):
        model = _read_model_file(archive, limits, part)
        bodies |= model.objects.bodies
        first.kinds |= model.kinds
        first.painted += model.painted
        first.paint_version = max(first.paint_version, model.paint_version)
    return first


def _find_root_model(archive: Archive, limits: Limits) -> str:
    """Return the name of the root model file."""
    if RELATIONSHIPS_FILE in archive:
        reader = _RelationshipReader(archive.path, limits)
        reader.read(archive.read_chunks(RELATIONSHIPS_FILE))
        if reader.start in archive:
            return reader.start
    models = [name for name in archive.names if name.endswith(".model")]
    if USUAL_ROOT_MODEL in models or len(models) == 1:
        return USUAL_ROOT_MODEL if USUAL_ROOT_MODEL in models else models[0]
    others = [
        name.rpartition("/")[2] for name in archive.names if name.lower().endswith((*MODEL_SUFFIXES, ".amf"))
    ]
    if others:
        listed = ", ".join(name[:60] for name in others[:3]) + (", ..." if len(others) > 3 else "")
        raise MeshError(
            f"{archive.path}: a ZIP archive of models ({listed}), not a 3MF",
            remedy="Unpack it and give the paths of the models in it; models given together share one plate",
        )
    raise MeshError(f"{archive.path}: the archive contains no 3D model", remedy=EXPORT_AGAIN)


def _empty_other_kinds(
    bodies: dict[Hashable, ObjectBuilder], kinds: dict[Hashable, str], notes: list[str]
) -> None:
    """Remove the facets of objects that are not models (supports, surfaces), and add warnings to `notes`."""
    for key, kind in kinds.items():
        if kind != "model":
            notes.append(f"{bodies[key].name} is of type '{kind[:40]}' and left out")
            bodies[key] = ObjectBuilder(bodies[key].name)


def _describe_ignored_paint(
    painted: Counter[tuple[Hashable, str]], bodies: dict[Hashable, ObjectBuilder]
) -> list[str]:
    """Return a warning for each kind of painted facets, all of which are ignored."""
    owners = {use.key: body.label for body in bodies.values() if body.label for use in body.parts}
    notes = []
    for what in dict.fromkeys(IGNORED_PAINT.values()):
        found = {key: count for (key, kind), count in painted.items() if kind == what and key in bodies}
        names = dict.fromkeys(bodies[key].label or owners.get(key) or bodies[key].name for key in found)
        if found:
            listed = ", ".join(f"'{name[:40]}'" for name in list(names)[:MAX_LISTED_NAMES])
            more = f" and {len(names) - MAX_LISTED_NAMES} more" if len(names) > MAX_LISTED_NAMES else ""
            count = "1 facet" if sum(found.values()) == 1 else f"{sum(found.values())} facets"
            notes.append(f"painted {what} are ignored: {count} of {listed}{more}")
    return notes


def _format_item_count(count: int) -> str:
    return "1 item is" if count == 1 else f"{count} items are"


def _normalize_number(text: str) -> str:
    """Normalise an object number, which may be written in several ways."""
    return str(int(text))


def _normalize_path(name: str) -> str:
    """Return the name of an archive member in lower case, relative to the root of the archive."""
    return posixpath.normpath("/" + name).lstrip("/").lower()
