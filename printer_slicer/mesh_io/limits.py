"""Limits for model files, which protect against files made to exhaust memory or time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError
from printer_slicer.input_files import WRITER_SECONDS
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["LIMITS", "Limits", "check_facets", "check_instances", "check_vertices"]

MIB: Final = 1 << 20


class Limits(Struct, frozen=True):
    """Maximum values that `load_mesh` accepts; it raises a `MeshError` beyond them.

    Attributes:
        facets: facets of one file, counting every instance of an object; also the vertices stored in a 3MF, GLB or
            OBJ file, and a third of the vertices of all instances.
        file_bytes: length of a file of any format, bytes.
        text_bytes: length of a file that is read as a whole, bytes: PLY, OFF, GLB, STEP, and glTF with the files it
            refers to.
        expanded_bytes: unpacked length of all files read from one 3MF archive, bytes.
        expansion: unpacked length of an archive member divided by its packed length, if it is over 1 MiB.
        members: files in an archive.
        instances: objects placed by one file, counting every copy and the components that contain them.
        nesting: depth of components in components.
        json_bytes: length of the JSON in a GLB, bytes.
        names: different names of elements and attributes in an XML document.
        xml_depth: nesting of XML elements.
        xml_token: length of one tag or comment, bytes.
        step_seconds: time for the conversion of a STEP file to facets, s.
        pipe_seconds: time to wait until a program writes to a named pipe, s.
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
"""The default limits."""


def check_facets(count: int, path: Path, limits: Limits) -> None:
    """Check the number of facets against the limit.

    Raises:
        MeshError: there are more than allowed.
    """
    if count > limits.facets:
        raise MeshError(
            f"{path}: the file has {count} facets; the limit is {limits.facets}",
            remedy="Export the part with fewer facets, or raise `Limits.facets` from Python",
        )


def check_vertices(count: int, path: Path, limits: Limits, per_facet: int = 1) -> None:
    """Check the number of vertices, of which at most `per_facet` times the facet limit are allowed.

    Raises:
        MeshError: there are more than allowed.
    """
    if count > per_facet * limits.facets:
        raise MeshError(
            f"{path}: the file has {count} vertices; the limit is {per_facet * limits.facets}",
            remedy="Export the part with fewer facets, or raise `Limits.facets` from Python",
        )


def check_instances(count: int, path: Path, limits: Limits) -> None:
    """Check the number of placed objects against the limit.

    Raises:
        MeshError: there are more than allowed.
    """
    if count > limits.instances:
        raise MeshError(
            f"{path}: more than {limits.instances} objects are placed",
            remedy="Join the objects in the program that made them, or export the part as STL",
        )
