"""Limits for model files, which protect the machine from files made to exhaust it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError
from printer_slicer.input_files import WRITER_SECONDS

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["LIMITS", "Limits", "check_facets", "check_instances", "check_vertices"]

MIB: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Limits:
    """What `load_mesh` takes; everything beyond is a `MeshError`.

    Attributes:
        facets: of one file, copies of objects counted as often as they are placed; also its vertices, as 3MF, GLB and
            OBJ store them, and a third of the vertices of all copies.
        file_bytes: length of a file of any format.
        text_bytes: length of a file that is read as a whole: PLY, OFF, GLB, glTF with the files it
            names, STEP.
        expanded_bytes: length of all that is unpacked from one 3MF archive.
        expansion: unpacked length divided by packed length of a member of an archive, where it is over 1 MiB.
        members: files in an archive.
        instances: objects of one file, each copy counted; also components on the way to them.
        nesting: of components in components.
        json_bytes: length of the text in a GLB.
        names: different names of elements and attributes in an XML document.
        xml_depth: elements in elements.
        xml_token: bytes of one tag or comment.
        step_seconds: that turning a STEP file into facets may take.
        pipe_seconds: that a named pipe may wait for a program that writes to it.
    """

    facets: int = 20_000_000
    file_bytes: int = 2048 * MIB
    text_bytes: int = 128 * MIB
    expanded_bytes: int = 1024 * MIB
    expansion: float = 100.0
    members: int = 10_000
    instances: int = 100_000
    nesting: int = 32
    json_bytes: int = 16 * MIB
    names: int = 10_000
    xml_depth: int = 64
    xml_token: int = MIB
    step_seconds: float = 600.0
    pipe_seconds: float = WRITER_SECONDS


LIMITS: Final = Limits()
"""The limits that hold when nobody says otherwise."""


def check_facets(count: int, path: Path, limits: Limits) -> None:
    """Refuse more facets than allowed.

    Raises:
        MeshError: there are.
    """
    if count > limits.facets:
        raise MeshError(
            f"{path}: {count} facets; the limit is {limits.facets}",
            remedy="Export the part with fewer facets, or raise `Limits.facets` from Python",
        )


def check_vertices(count: int, path: Path, limits: Limits, most: int = 1) -> None:
    """Refuse more vertices than `most` per facet allowed.

    Raises:
        MeshError: there are.
    """
    if count > most * limits.facets:
        raise MeshError(
            f"{path}: {count} vertices; the limit is {most * limits.facets}",
            remedy="Export the part with fewer facets, or raise `Limits.facets` from Python",
        )


def check_instances(count: int, path: Path, limits: Limits) -> None:
    """Refuse more objects placed than allowed.

    Raises:
        MeshError: there are.
    """
    if count > limits.instances:
        raise MeshError(
            f"{path}: more than {limits.instances} objects are placed",
            remedy="Join the objects in the program that made them, or export the part as STL",
        )
