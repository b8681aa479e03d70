"""Read the data of other slicers in 3MF files: object names and volumes that must not be printed.

These volumes are modifiers, blockers, enforcers and negative volumes. PrusaSlicer stores all volumes of an object in
one mesh and lists their ranges of facets; Bambu Studio and OrcaSlicer store each one as a component. Neither is part of
the 3MF standard, but without this data a support blocker would be printed as solid.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.assembly import ObjectBuilder
from printer_slicer.mesh_io.markup import XmlReader
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.archive import Archive
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["MAX_LISTED_NAMES", "Modifiers", "read_modifiers"]

CONFIG_FILES: Final = ("metadata/slic3r_pe_model.config", "metadata/model_settings.config")
PRINTED_KINDS: Final = frozenset({"modelpart", "normal_part", ""})
MAX_LISTED_NAMES: Final = 5
LONGEST_NAME: Final = 40
NEGATIVE_KINDS: Final = frozenset({"negativevolume", "negative_part"})


class _Volume(Struct, frozen=True):
    """A volume that must not be printed."""

    name: str
    kind: str

    def describe(self) -> str:
        """Return the name and the kind for messages."""
        return f"'{self.name[:LONGEST_NAME]}' ({self.kind[:LONGEST_NAME]})"


class Modifiers(XmlReader):
    """Object names and volumes that must not be printed, from the configuration file of a slicer."""

    def __init__(self, path: Path, limits: Limits, what: str) -> None:
        super().__init__(path, limits, what)
        self._object = self._component = self._name = self._kind = ""
        self._range = (0, -1)
        self._n_unprinted = 0
        self._inside = False  # of a volume
        self.names: dict[str, str] = {}
        self.ranges: dict[str, list[tuple[tuple[int, int], _Volume]]] = {}
        self.components: dict[tuple[str, str], _Volume] = {}
        self.register(["object"], self._begin_object)
        self.register(["volume"], self._begin_volume, self._end_volume)
        self.register(["part"], self._begin_part, self._end_part)
        self.register(["metadata"], self._read_metadata)

    def _begin_object(self, attributes: list[str]) -> None:
        self._object = _to_dict(attributes).get("id", "")
        self._inside = False

    def _begin_volume(self, attributes: list[str]) -> None:
        given = _to_dict(attributes)
        self._range = (int(given.get("firstid", "0")), int(given.get("lastid", "-1")))
        self._name = self._kind = ""
        self._inside = True

    def _begin_part(self, attributes: list[str]) -> None:
        given = _to_dict(attributes)
        self._component, self._kind, self._name = given.get("id", ""), given.get("subtype", ""), ""
        self._inside = True

    def _read_metadata(self, attributes: list[str]) -> None:
        given = _to_dict(attributes)
        key, value = given.get("key"), given.get("value", "")
        if key == "name" and self._inside:
            self._name = value
        elif key == "name":
            self.names[self._object] = value
        elif key == "volume_type" and given.get("type") == "volume":
            self._kind = value
        elif key == "modifier" and given.get("type") == "volume" and value == "1":
            self._kind = self._kind or "modifier"  # files of older versions have no kinds

    def _end_volume(self) -> None:
        self._inside = False
        if volume := self._build_unprinted_volume():
            self.ranges.setdefault(self._object, []).append((self._range, volume))

    def _end_part(self) -> None:
        self._inside = False
        if volume := self._build_unprinted_volume():
            self.components[self._object, self._component] = volume

    def _build_unprinted_volume(self) -> _Volume | None:
        """Return the current volume if it must not be printed."""
        if self._kind.lower() in PRINTED_KINDS:
            return None
        self._n_unprinted += 1
        if self._n_unprinted > self.limits.instances:
            raise self.make_error(f"more than {self.limits.instances} volumes")
        return _Volume(self._name, self._kind)

    def name_objects(self, bodies: dict[Hashable, ObjectBuilder], part: str) -> None:
        """Give unnamed objects of a model file the names that the slicer stored."""
        for number, name in self.names.items():
            body = bodies.get((part, number))
            if body is not None:
                body.label = body.label or name

    def remove_unprinted(self, bodies: dict[Hashable, ObjectBuilder], part: str) -> list[str]:
        """Remove the volumes that must not be printed from the objects of a model file.

        Returns:
            Warnings.
        """
        taken: list[_Volume] = []
        for number, ranges in self.ranges.items():
            body = bodies.get((part, number))
            if body is None:
                continue
            keep = np.ones(len(body.corners) // 3, dtype=np.bool_)
            for (first, last), volume in ranges:
                keep[max(first, 0) : max(last + 1, 0)] = False
                taken.append(volume)
            corners = np.frombuffer(body.corners, dtype=np.int64).reshape(-1, 3)[keep]
            bodies[part, number] = ObjectBuilder(
                body.name, body.xyz, array("q", corners.tobytes()), body.parts, body.label
            )
        for (number, child), volume in self.components.items():
            body = bodies.get((part, number))
            if body is None:
                continue
            kept = [use for use in body.parts if not (isinstance(use.key, tuple) and use.key[1] == child)]
            taken += [volume] * (len(body.parts) - len(kept))
            bodies[part, number] = ObjectBuilder(body.name, body.xyz, body.corners, kept, body.label)
        return _describe_removed(taken)


def _describe_removed(taken: Sequence[_Volume]) -> list[str]:
    """Return warnings about the removed volumes."""
    if not taken:
        return []
    count = "1 volume that only changes" if len(taken) == 1 else f"{len(taken)} volumes that only change"
    verb = "is" if len(taken) == 1 else "are"
    notes = [f"{count} settings, supports or other volumes {verb} left out: {_list_volumes(taken)}"]
    if holes := [volume for volume in taken if volume.kind.lower() in NEGATIVE_KINDS]:
        them = (
            "1 of them is a negative volume and is"
            if len(holes) == 1
            else f"{len(holes)} of them are negative volumes and are"
        )
        notes.append(f"{them} not cut out: {_list_volumes(holes)}")
    return notes


def _list_volumes(volumes: Sequence[_Volume]) -> str:
    """Format the names of the first volumes, and how many more there are."""
    more = f" and {len(volumes) - MAX_LISTED_NAMES} more" if len(volumes) > MAX_LISTED_NAMES else ""
    return ", ".join(volume.describe() for volume in volumes[:MAX_LISTED_NAMES]) + more


def read_modifiers(archive: Archive, limits: Limits) -> Modifiers:
    """Read a slicer's data about volumes from an archive; empty if no slicer wrote the archive.

    Raises:
        MeshError: the slicer's file is not valid XML.
    """
    name = next((name for name in CONFIG_FILES if name in archive), "")
    reader = Modifiers(archive.path, limits, name)
    if name:
        reader.read(archive.read_chunks(name))
    return reader


def _to_dict(attributes: list[str]) -> dict[str, str]:
    """Convert the attributes of an element to a dictionary."""
    return dict(zip(attributes[::2], attributes[1::2], strict=True))
