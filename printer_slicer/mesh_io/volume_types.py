"""Read the data of other slicers in 3MF files: object names and the types of volumes.

Most types are not printed: modifiers, support blockers and enforcers, negative volumes. PrusaSlicer stores all volumes
of an object in one mesh and lists their ranges of facets; Bambu Studio and OrcaSlicer store each one as a component.
Neither is part of the 3MF standard, but without this data a support blocker would be printed as solid.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.assembly import PART, ObjectBuilder, ObjectReference
from printer_slicer.mesh_io.markup import XmlReader
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.archive import Archive
    from printer_slicer.mesh_io.limits import Limits

__all__ = [
    "BLOCK",
    "ENFORCE",
    "MAX_LISTED_NAMES",
    "MODIFIER",
    "NEGATIVE",
    "VolumeTypes",
    "is_modifier",
    "name_modifier",
    "read_volume_types",
]

ENFORCE: Final = "support enforcer"
BLOCK: Final = "support blocker"
NEGATIVE: Final = "negative volume"
MODIFIER: Final = "modifier "
"""The type of a modifier is this, followed by its name, because each modifier has settings of its own."""
IGNORED: Final = "ignored"

CONFIG_FILES: Final = ("metadata/slic3r_pe_model.config", "metadata/model_settings.config")
TYPES: Final = {
    "": PART,
    "modelpart": PART,
    "normal_part": PART,
    "supportenforcer": ENFORCE,
    "support_enforcer": ENFORCE,
    "supportblocker": BLOCK,
    "support_blocker": BLOCK,
    "negativevolume": NEGATIVE,
    "negative_part": NEGATIVE,
    "parametermodifier": MODIFIER,
    "modifier_part": MODIFIER,
    "modifier": MODIFIER,
}
"""Types of volumes by their names in the files of PrusaSlicer, and of Bambu Studio and OrcaSlicer, in lower case."""
MAX_LISTED_NAMES: Final = 5
LONGEST_NAME: Final = 40


class _Volume(Struct, frozen=True):
    """A volume that must not be printed, with its name and type in the file."""

    name: str
    kind: str
    full_name: str

    @property
    def volume_type(self) -> str:
        """The type of the volume."""
        found = TYPES.get(self.kind.lower(), IGNORED)
        return found + self.full_name if found == MODIFIER else found

    def describe(self) -> str:
        """Return the name and the kind for messages."""
        return f"'{self.name[:LONGEST_NAME]}' ({self.kind[:LONGEST_NAME]})"


class VolumeTypes(XmlReader):
    """Object names and volumes that must not be printed, from the configuration file of a slicer."""

    def __init__(self, path: Path, limits: Limits, what: str) -> None:
        super().__init__(path, limits, what)
        self._object = self._component = self._name = self._kind = ""
        self._range = (0, -1)
        self._n_unprinted = 0
        self._modifier_names: list[str] = []
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
        if TYPES.get(self._kind.lower()) == PART:
            return None
        self._n_unprinted += 1
        if self._n_unprinted > self.limits.instances:
            raise self.make_error(f"more than {self.limits.instances} volumes")
        full_name = ""
        if is_modifier(self._kind):
            full_name = name_modifier(self.names.get(self._object, ""), self._name, self._modifier_names)
            self._modifier_names.append(full_name)
        return _Volume(self._name, self._kind, full_name)

    def name_objects(self, bodies: dict[Hashable, ObjectBuilder], part: str) -> None:
        """Give unnamed objects of a model file the names that the slicer stored."""
        for number, name in self.names.items():
            body = bodies.get((part, number))
            if body is not None:
                body.label = body.label or name

    def separate_volumes(self, bodies: dict[Hashable, ObjectBuilder], part: str, path: Path) -> list[str]:
        """Make the volumes that must not be printed components of their objects, each with its type.

        Args:
            bodies: key -> object; changed.
            part: the model file whose objects the slicer describes.
            path: for messages.

        Returns:
            Warnings about the volumes that have no effect.
        """
        ignored: list[_Volume] = []
        for number, ranges in self.ranges.items():
            body = bodies.get((part, number))
            if body is not None:
                volumes = _separate_ranges(body, ranges, path)
                ignored += [volume for _, volume in ranges if volume.volume_type == IGNORED]
                references = []
                for k, ((_, volume), own) in enumerate(zip(ranges, volumes[1:], strict=True)):
                    key = (part, number, k)
                    bodies[key] = own
                    references.append(ObjectReference(key, volume_type=volume.volume_type))
                bodies[part, number] = volumes[0]
                volumes[0].parts.extend(references)
        for (number, child), volume in self.components.items():
            body = bodies.get((part, number))
            if body is None:
                continue
            is_volume = [isinstance(use.key, tuple) and use.key[1] == child for use in body.parts]
            body.parts[:] = [
                replace(use, volume_type=volume.volume_type) if own else use
                for use, own in zip(body.parts, is_volume, strict=True)
            ]
            ignored += [volume] * (sum(is_volume) if volume.volume_type == IGNORED else 0)
        return _describe_ignored(ignored)


def _separate_ranges(
    body: ObjectBuilder, ranges: Sequence[tuple[tuple[int, int], _Volume]], path: Path
) -> list[ObjectBuilder]:
    """Divide an object into the facets of no range and those of each range."""
    corners = body.indices(path)
    owner = np.zeros(len(corners), dtype=np.int64)
    for k, ((first, last), _) in enumerate(ranges):
        owner[max(first, 0) : max(last + 1, 0)] = k + 1
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(ranges) + 2))
    rank = np.zeros(len(corners), dtype=np.int64)
    rank[order] = np.arange(len(corners)) - start[owner[order]]
    paint: list[dict[int, str]] = [{} for _ in range(len(ranges) + 1)]
    for facet, text in body.paint.items():
        paint[owner[facet]][int(rank[facet])] = text
    divided = []
    for k in range(len(ranges) + 1):
        xyz, own = body.xyz, corners[order[start[k] : start[k + 1]]]
        if k:  # keep only the points of the volume: there may be many volumes
            used, own = np.unique(own, return_inverse=True)
            points = np.frombuffer(body.xyz, dtype=np.float64).reshape(-1, 3)
            xyz = array("d", points[used].tobytes())
        numbers = array("q", own.astype(np.int64).tobytes())
        parts = [] if k else body.parts
        divided.append(ObjectBuilder(body.name, xyz, numbers, parts, body.label, paint[k]))
    return divided


def _describe_ignored(volumes: Sequence[_Volume]) -> list[str]:
    """Return a warning about volumes that have no effect."""
    if not volumes:
        return []
    what = "1 volume is" if len(volumes) == 1 else f"{len(volumes)} volumes are"
    return [f"{what} of an unknown type and left out: {_list_volumes(volumes)}"]


def _list_volumes(volumes: Sequence[_Volume]) -> str:
    """Format the names of the first volumes, and how many more there are."""
    more = f" and {len(volumes) - MAX_LISTED_NAMES} more" if len(volumes) > MAX_LISTED_NAMES else ""
    return ", ".join(volume.describe() for volume in volumes[:MAX_LISTED_NAMES]) + more


def is_modifier(kind: str) -> bool:
    """Return whether a volume is a modifier by its type in the file."""
    return TYPES.get(kind.lower()) == MODIFIER


def name_modifier(object_name: str, name: str, earlier: Sequence[str]) -> str:
    """Return the name of a modifier: OBJECT/MODIFIER, with a number if an earlier one of the file has this name."""
    full = f"{object_name}/{name or 'modifier'}"
    count = sum(one == full or one.startswith(f"{full}_") for one in earlier)
    return f"{full}_{count + 1}" if count else full


def read_volume_types(archive: Archive, limits: Limits) -> VolumeTypes:
    """Read a slicer's data about volumes from an archive; empty if no slicer wrote the archive.

    Raises:
        MeshError: the slicer's file is not valid XML.
    """
    name = next((name for name in CONFIG_FILES if name in archive), "")
    reader = VolumeTypes(archive.path, limits, name)
    if name:
        reader.read(archive.read_chunks(name))
    return reader


def _to_dict(attributes: list[str]) -> dict[str, str]:
    """Convert the attributes of an element to a dictionary."""
    return dict(zip(attributes[::2], attributes[1::2], strict=True))
