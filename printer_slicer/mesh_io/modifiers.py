"""Volumes in the 3MF files of slicers that are not to be printed: modifiers, blockers, enforcers, holes.

PrusaSlicer keeps all volumes of an object in one mesh and tells by ranges of facets what each is; Bambu Studio and
OrcaSlicer keep each as a component. Neither is part of the 3MF standard, but to print a support blocker as plastic
would be no answer to that.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.assembly import Body
from printer_slicer.mesh_io.markup import Reader

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.archive import Archive
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["Modifiers", "read_modifiers"]

FILES: Final = ("metadata/slic3r_pe_model.config", "metadata/model_settings.config")
PLAIN: Final = frozenset({"modelpart", "normal_part", ""})
HOLES: Final = frozenset({"negativevolume", "negative_part"})


class Modifiers(Reader):
    """What the configuration file of a slicer says about volumes."""

    def __init__(self, path: Path, limits: Limits, what: str) -> None:
        super().__init__(path, limits, what)
        self._object = ""
        self._range: tuple[int, int] | None = None
        self.ranges: dict[str, list[tuple[int, int]]] = {}
        self.components: set[tuple[str, str]] = set()
        self.n_holes = 0
        self._n_marked = 0
        self.on(["object"], self._begin_object)
        self.on(["volume"], self._begin_volume)
        self.on(["metadata"], self._metadata)
        self.on(["part"], self._part)

    def _begin_object(self, attributes: list[str]) -> None:
        self._object = _given(attributes).get("id", "")

    def _begin_volume(self, attributes: list[str]) -> None:
        given = _given(attributes)
        self._range = (int(given.get("firstid", "0")), int(given.get("lastid", "-1")))

    def _metadata(self, attributes: list[str]) -> None:
        given = _given(attributes)
        kind = given.get("value", "").lower()
        if (
            given.get("type") == "volume"
            and given.get("key") == "volume_type"
            and kind not in PLAIN
            and self._range
        ):
            self.ranges.setdefault(self._object, []).append(self._range)
            self._count()
            self.n_holes += kind in HOLES

    def _part(self, attributes: list[str]) -> None:
        given = _given(attributes)
        kind = given.get("subtype", "").lower()
        if kind not in PLAIN:
            self.components.add((self._object, given.get("id", "")))
            self._count()
            self.n_holes += kind in HOLES

    def _count(self) -> None:
        self._n_marked += 1
        if self._n_marked > self.limits.instances:
            raise self.fault(f"over {self.limits.instances} volumes")

    def taken_from(self, bodies: dict[Hashable, Body], part: str) -> list[str]:
        """Take these volumes out of the objects of a model file.

        Returns:
            What deserves a look.
        """
        n_taken = 0
        for number, ranges in self.ranges.items():
            body = bodies.get((part, number))
            if body is None:
                continue
            keep = np.ones(len(body.corners) // 3, dtype=np.bool_)
            for first, last in ranges:
                keep[max(first, 0) : max(last + 1, 0)] = False
            corners = np.frombuffer(body.corners, dtype=np.int64).reshape(-1, 3)[keep]
            bodies[part, number] = Body(body.name, body.xyz, array("q", corners.tobytes()), body.parts)
            n_taken += len(ranges)
        for number, child in self.components:
            body = bodies.get((part, number))
            if body is None:
                continue
            kept = [use for use in body.parts if not (isinstance(use.key, tuple) and use.key[1] == child)]
            n_taken += len(body.parts) - len(kept)
            bodies[part, number] = Body(body.name, body.xyz, body.corners, kept)
        notes = []
        if n_taken:
            notes.append(
                f"{n_taken} volumes that only change settings, supports or other volumes are left out"
            )
        if n_taken and self.n_holes:
            notes.append(f"{self.n_holes} of them are holes, which are not cut")
        return notes


def read_modifiers(archive: Archive, limits: Limits) -> Modifiers:
    """What the slicer that made an archive says about its volumes; nothing where no slicer did.

    Raises:
        MeshError: the slicer's file is no sound XML.
    """
    name = next((name for name in FILES if name in archive), "")
    reader = Modifiers(archive.path, limits, name)
    if name:
        reader.read(archive.pieces(name))
    return reader


def _given(attributes: list[str]) -> dict[str, str]:
    return dict(zip(attributes[::2], attributes[1::2], strict=True))
