"""Write 3MF files: each mesh once, and a build item for each copy of it.

Source: 3MF Core Specification 1.3. The same meshes and places always give the same bytes.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.mesh_io.three_mf import NAMESPACE_ROOT, ROOT_MODEL_TYPE
from printer_slicer.model import Mesh
from printer_slicer.values import Struct

__all__ = ["BuildItem", "make_three_mf"]

_CORE: Final = f"{NAMESPACE_ROOT}core/2015/02"
_CONTENT_TYPES: Final = """\
<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_RELATIONSHIPS: Final = f"""\
<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Target="/3D/3dmodel.model" Id="rel0" Type="{ROOT_MODEL_TYPE}"/>
</Relationships>
"""
_DATE: Final = (1980, 1, 1, 0, 0, 0)  # of the files in the archive


class BuildItem(Struct, frozen=True, eq=False):
    """A copy of a mesh at its place.

    Attributes:
        mesh: the shape, mm; copies have the same mesh. Its objects become objects of their own.
        rotation: (3, 3) matrix for column vectors.
        shift: (3,) mm, after the rotation.
    """

    mesh: Mesh
    rotation: Float
    shift: Float


def make_three_mf(items: Sequence[BuildItem]) -> bytes:
    """Return the bytes of a 3MF file with these items. Volumes and painted facets are left out."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name, text in {
            "[Content_Types].xml": _CONTENT_TYPES,
            "_rels/.rels": _RELATIONSHIPS,
            "3D/3dmodel.model": "".join(_write_model(items)),
        }.items():
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
    return buffer.getvalue()


def _write_model(items: Sequence[BuildItem]) -> Iterator[str]:
    """Yield the text of the model file."""
    yield f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}">\n'
    yield " <resources>\n"
    numbers: dict[int, range] = {}
    count = 0
    for item in items:
        if id(item.mesh) in numbers:
            continue
        shapes = list(_split_objects(item.mesh))
        numbers[id(item.mesh)] = range(count + 1, count + 1 + len(shapes))
        for name, triangles in shapes:
            count += 1
            yield from _write_object(count, name, triangles)
    yield " </resources>\n <build>\n"
    for item in items:
        transform = " ".join(f"{value:.12g}" for value in [*item.rotation.T.ravel(), *item.shift])
        for number in numbers[id(item.mesh)]:
            yield f'  <item objectid="{number}" transform="{transform}"/>\n'
    yield " </build>\n</model>\n"


def _split_objects(mesh: Mesh) -> Iterator[tuple[str, Float]]:
    """Yield name and triangles (F, 3, 3) of each object of a mesh."""
    if not mesh.objects or not all(one.count for one in mesh.objects):
        yield mesh.name, mesh.triangles
        return
    for one in mesh.objects:
        yield one.name, mesh.triangles[one.facets]


def _write_object(number: int, name: str, triangles: Float) -> Iterator[str]:
    """Yield the text of an object; corners with equal coordinates are one vertex."""
    vertices, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    text = "".join(letter for letter in name if letter.isprintable())
    yield f'  <object id="{number}" type="model" name={quoteattr(text)}>\n   <mesh>\n    <vertices>\n'
    yield "".join(f'     <vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>\n' for x, y, z in vertices.tolist())
    yield "    </vertices>\n    <triangles>\n"
    facets = corner.reshape(-1, 3).tolist()
    yield "".join(f'     <triangle v1="{a}" v2="{b}" v3="{c}"/>\n' for a, b, c in facets)
    yield "    </triangles>\n   </mesh>\n  </object>\n"
