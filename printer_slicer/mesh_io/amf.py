"""AMF, plain or in a ZIP archive: objects, volumes and constellations (ISO/ASTM 52915).

Curved facets are read as flat ones. What no constellation takes stands on the plate where it was drawn. Instances are
mirrored and scaled, as PrusaSlicer and Slic3r add to the standard, turned about x, then y, then z, then shifted. The
standard turns by degrees, as Slic3r did before version 1.2; since then, and in PrusaSlicer, angles are radians.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.assembly import Body, Shelf, Use, assembled
from printer_slicer.mesh_io.markup import Reader
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN
from printer_slicer.mesh_io.units import UNITS, named_unit

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.archive import Archive
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["amf_member", "read_amf"]

SPACES: Final = ("", "http://www.astm.org/Standards/ISOASTM52915 ")
SCALES: Final = ("scalex", "scaley", "scalez")
MIRRORS: Final = ("mirrorx", "mirrory", "mirrorz")
PLACE: Final = ("deltax", "deltay", "deltaz", "rx", "ry", "rz", "scale", *SCALES, *MIRRORS)
"""What an instance is moved by."""
HARMLESS: Final = frozenset({*PLACE, "printable", "metadata"})
SLICER: Final = re.compile(r"slic3r\s+(\d{1,4})\.(\d{1,4})")
RADIANS_SINCE: Final = (1, 2)
"""Version of Slic3r."""
MOST_NAMES: Final = 5
MODIFIERS: Final = frozenset({"slic3r.modifier", "slic3r.volume_type"})


class _AmfReader(Reader):
    """Reads an AMF document."""

    def __init__(self, path: Path, limits: Limits) -> None:
        super().__init__(path, limits)
        self.unit = "millimeter"
        self.shelf = Shelf(path, limits)
        self.check = self.shelf.check  # type: ignore[method-assign]
        self.n_left_out = self.n_curved = self.n_not_printed = 0
        self.unknown: set[str] = set()
        self.targets: set[str] = set()
        self._body = Body("no object")
        self._point = [math.nan] * 3
        self._facet = [-1] * 3
        self._place: dict[str, float] = {}
        self._target = ""
        self._printed = True
        self._unit_of_angles = math.radians(1)
        self._first = 0
        self._skipped = False
        self._metadata = ""
        self._register()

    def _register(self) -> None:
        for name, start, end in (
            ("amf", self._begin_amf, None),
            ("object", self._begin_object, None),
            ("constellation", self._begin_object, None),
            ("volume", self._begin_volume, self._end_volume),
            ("vertex", self._begin_vertex, self._end_vertex),
            ("triangle", self._begin_facet, self._end_facet),
            ("edge", self._curve, None),
            ("normal", self._curve, None),
            ("instance", self._begin_instance, self._end_instance),
            ("metadata", self._begin_metadata, self._end_metadata),
        ):
            self.on(_names(name), start, end)
        for axis, name in enumerate("xyz"):
            self.on(_names(name), self.gather, lambda axis=axis: self._coordinate(axis))  # type: ignore[misc]
        for corner in range(3):
            self.on(_names(f"v{corner + 1}"), self.gather, lambda corner=corner: self._corner(corner))  # type: ignore[misc]
        self.on(_names("printable"), self.gather, self._end_printable)
        for name in PLACE:
            self.on(_names(name), self.gather, lambda name=name: self._shift(name))  # type: ignore[misc]

    def _begin_amf(self, attributes: list[str]) -> None:
        self.unit = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("unit", self.unit)

    def _begin_object(self, attributes: list[str]) -> None:
        key = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("id", "").strip()
        self._body = self.shelf.begin(key, f"object {key[:40]}")

    # Meshes

    def _begin_volume(self, attributes: list[str]) -> None:
        kind = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("type", "")
        self._first, self._skipped = len(self._body.corners), kind.strip().lower() == "support"

    def _end_volume(self) -> None:
        if self._skipped:
            del self._body.corners[self._first :]
            self.n_left_out += 1
        self._skipped = False

    def _begin_vertex(self, _attributes: list[str]) -> None:
        self._point = [math.nan] * 3

    def _coordinate(self, axis: int) -> None:
        self._point[axis] = float(self.text)

    def _end_vertex(self) -> None:
        self._body.xyz.extend(self._point)

    def _begin_facet(self, _attributes: list[str]) -> None:
        self._facet = [-1] * 3

    def _corner(self, corner: int) -> None:
        self._facet[corner] = int(self.text)

    def _end_facet(self) -> None:
        self._body.corners.extend(self._facet)

    def _curve(self, _attributes: list[str]) -> None:
        self.n_curved += 1

    def _begin_metadata(self, attributes: list[str]) -> None:
        self._metadata = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("type", "")
        self.gather()

    def _end_metadata(self) -> None:
        value = self.text.strip().lower()
        if self._metadata == "slic3rpe_amf_version" or _turns_by_radians(self._metadata, value):
            self._unit_of_angles = 1.0
        if self._metadata in MODIFIERS and value not in ("0", "", "modelpart"):
            self._skipped = True

    # Constellations

    def _begin_instance(self, attributes: list[str]) -> None:
        self._place, self._printed = {}, True
        self._target = dict(zip(attributes[::2], attributes[1::2], strict=True)).get("objectid", "").strip()
        self._parser.StartElementHandler = self._start_in_instance

    def _start_in_instance(self, name: str, attributes: list[str]) -> None:
        local = name.rpartition(" ")[2]
        if local not in HARMLESS:
            self.unknown.add(local[:40])
        self._start(name, attributes)

    def _end_printable(self) -> None:
        self._printed = self.text.strip() != "0"

    def _shift(self, name: str) -> None:
        self._place[name] = float(self.text)
        if not math.isfinite(self._place[name]):
            raise self.fault(f"an instance with {name} {self.text.strip()}")

    def _end_instance(self) -> None:
        self._parser.StartElementHandler = self._start
        self.shelf.count_use()
        self.targets.add(self._target)
        if self._printed:
            self._body.parts.append(Use(self._target, _matrix(self._place, self._unit_of_angles)))
        else:
            self.n_not_printed += 1


def read_amf(
    pieces: Iterable[bytes], path: Path, limits: Limits, unit: str | None
) -> tuple[Float, str, list[str]]:
    """Everything in an AMF document.

    Args:
        pieces: of its text.
        path: of the file, for messages.
        limits: of what it holds.
        unit: the key in UNITS that its numbers mean; None: what it says itself.

    Returns:
        (F, 3, 3) corners, mm; the unit they were written in; what deserves a look.

    Raises:
        MeshError: it is no sound AMF.
    """
    reader = _AmfReader(path, limits)
    reader.read(pieces)
    own_unit = unit or named_unit(reader.unit, path)
    bodies = reader.shelf.bodies
    roots = [Use(key) for key in bodies if key not in reader.targets]
    if bodies and not roots:
        raise MeshError(f"{path}: every object is part of another one", remedy=EXPORT_AGAIN)
    return assembled(roots, bodies, path, limits, UNITS[own_unit]), own_unit, _notes(reader)


def _notes(reader: _AmfReader) -> list[str]:
    """What deserves a look."""
    notes = []
    if reader.n_left_out:
        notes.append(f"{reader.n_left_out} volumes are supports or modifiers and left out")
    if reader.n_not_printed:
        notes.append(f"{reader.n_not_printed} instances are marked as not printable and left out")
    if reader.n_curved:
        notes.append("curved facets are read as flat ones")
    if reader.unknown:
        names = sorted(reader.unknown)
        more = " and others" if len(names) > MOST_NAMES else ""
        notes.append(
            f"instances have {', '.join(names[:MOST_NAMES])}{more}, which is not followed: look at the shape"
        )
    return notes


def amf_member(archive: Archive) -> str:
    """Name of the AMF document in an archive; empty where there is none."""
    return next((name for name in archive.names if name.endswith(".amf")), "")


def _names(name: str) -> list[str]:
    return [f"{space}{name}" for space in SPACES]


def _turns_by_radians(kind: str, value: str) -> bool:
    """Whether a metadata says that the document is of a Slic3r whose angles are radians."""
    version = SLICER.match(value) if kind == "cad" else None
    return version is not None and (int(version[1]), int(version[2])) >= RADIANS_SINCE


def _matrix(place: dict[str, float], unit_of_angles: float) -> Float | None:
    """(4, 4) of an instance: mirrored, scaled, turned, then shifted.

    Args:
        place: what it is moved by.
        unit_of_angles: radians.
    """
    if not place:
        return None
    scale = place.get("scale", 1.0)
    size = [
        scale * place.get(one, 1.0) * place.get(other, 1.0)
        for one, other in zip(SCALES, MIRRORS, strict=True)
    ]
    matrix = np.diag([*size, 1.0])
    for axis, name in enumerate(("rx", "ry", "rz")):
        angle = unit_of_angles * place.get(name, 0.0)
        turn = np.eye(4)
        one, two = (axis + 1) % 3, (axis + 2) % 3
        turn[one, one] = turn[two, two] = math.cos(angle)
        turn[one, two], turn[two, one] = math.sin(angle), -math.sin(angle)
        matrix = matrix @ turn
    matrix[3, :3] = [place.get(name, 0.0) for name in ("deltax", "deltay", "deltaz")]
    return matrix
