"""PrusaSlicer's rule for adaptive layers, which has no command line option, and the 3MF file that passes on its result.

The rule was implemented from its description. A facet whose normal has the horizontal component s and the vertical
component c allows a layer height of min(d / 0.184, 1.44 d √(s / c)). This keeps the area of the stair triangles
constant. A quality from 0 (finest) to 1 selects d between the thinnest, the nominal and the thickest layer. From the
bed up, each layer gets the least height that its facets allow. If a facet that allows less starts inside the layer, the
layer ends where the facet starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh

__all__ = ["HeightLimits", "adaptive_profile", "model_xml", "stack_profile", "write_3mf"]

_TOUCHING = 1e-4  # mm; a facet that ends within this distance above the last layer is ignored
_ROUGHNESS = 0.184
_STEEP = 1e-5  # a facet whose normal has a smaller vertical component is a wall
_PLACES = 9  # decimals of z and heights in the file, enough that sums stay accurate

_CONTENT_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Target="/3D/3dmodel.model" Id="rel-1"
  Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""
_MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
 <resources><object id="1" type="model"><mesh>
 <vertices>
{vertices}
 </vertices>
 <triangles>
{triangles}
 </triangles>
 </mesh></object></resources>
 <build><item objectid="1"/></build>
</model>
"""


@dataclass(frozen=True, slots=True)
class HeightLimits:
    """Layer heights in mm: the fixed first one, and the range for the others."""

    first: float
    thinnest: float
    nominal: float
    thickest: float


def adaptive_profile(mesh: Mesh, heights: HeightLimits, quality: float) -> Float:
    """Return z and layer height there (n, 2), mm, as PrusaSlicer's window computes them for a part.

    The slicer interpolates and resamples the profile, so its printed layers differ slightly.

    Args:
        mesh: the part, standing on z = 0.
        heights: first, thinnest, nominal and thickest layer.
        quality: from 0, thinnest layers only, to 1; the window's default is 0.5.
    """
    low, high, allowed = _allowed_heights(mesh, _height_of_quality(heights, quality))
    points = [(0.0, heights.first), (heights.first, heights.first), (heights.first, heights.first)]
    z = heights.first
    while z + _TOUCHING < mesh.height:
        some = slice(0, int(np.searchsorted(low, z + heights.thickest)))
        met = high[some] >= z + _TOUCHING
        asked = np.maximum(allowed[some][met], low[some][met] - z)
        height = max(min(float(asked.min(initial=np.inf)), heights.thickest), heights.thinnest)
        points.append((z, height))
        z += height
    gap = mesh.height - points[-1][0]
    if gap > 0:
        points.append((mesh.height, min(max(gap, heights.thinnest), heights.thickest)))
    return np.array(points)


def _height_of_quality(heights: HeightLimits, quality: float) -> float:
    """Return the layer height of a quality, mm."""
    return float(np.interp(quality, [0.0, 0.5, 1.0], [heights.thinnest, heights.nominal, heights.thickest]))


def _allowed_heights(mesh: Mesh, height: float) -> tuple[Float, Float, Float]:
    """Return lowest and highest z of each facet and the layer height it allows, mm, by ascending lowest z."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    level, upright = np.hypot(normal[:, 0], normal[:, 1]), np.abs(normal[:, 2])
    slope = np.sqrt(level / np.maximum(upright, _STEEP))
    stairs = np.where(upright > _STEEP, 1.44 * height * slope, np.inf)
    z = mesh.triangles[:, :, 2]
    low, high, allowed = z.min(axis=1), z.max(axis=1), np.minimum(height / _ROUGHNESS, stairs)
    order = np.argsort(low, kind="stable")
    return low[order], high[order], allowed[order]


def stack_profile(top: Float, part_height: float) -> Float:
    """Return z and layer height there (n, 2), mm: a stepped line that makes PrusaSlicer print layers with these tops.

    Args:
        top: (L,) mm, ascending.
        part_height: mm; the slicer ignores a profile that does not end there.
    """
    bottom = np.concatenate([[0.0], top[:-1]])
    height = top - bottom
    ends = np.minimum(np.stack([bottom, top], axis=1), part_height)
    ends[-1, 1] = part_height
    return np.stack([ends, np.repeat(height[:, None], 2, axis=1)], axis=2).reshape(-1, 2)


def model_xml(mesh: Mesh) -> str:
    """Return the part as the model of a 3MF file."""
    corners, index = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    vertices = (f'<vertex x="{x:.6f}" y="{y:.6f}" z="{z:.6f}"/>' for x, y, z in corners.tolist())
    triangles = (
        f'<triangle v1="{i}" v2="{j}" v3="{k}"/>'
        for i, j, k in index.reshape(-1, 3).tolist()
        if i != j != k != i
    )
    return _MODEL.format(vertices="\n".join(vertices), triangles="\n".join(triangles))


def write_3mf(path: Path, model: str, profile: Float | None = None) -> None:
    """Write a model to a 3MF file, with a layer height profile (n, 2) for PrusaSlicer if one is given."""
    with ZipFile(path, "w", ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("[Content_Types].xml", _CONTENT_TYPES)
        archive.writestr("_rels/.rels", _RELATIONS)
        archive.writestr("3D/3dmodel.model", model)
        if profile is not None:
            numbers = ";".join(f"{number:.{_PLACES}f}" for number in profile.ravel())
            archive.writestr("Metadata/Slic3r_PE_layer_heights_profile.txt", f"object_id=1|{numbers}")
