"""PrusaSlicer's adaptive layers, which only its window offers: the rule, and the file that hands the result over.

The rule was written anew from its description: a facet whose normal has the horizontal part s and the vertical part c
lets a layer be as high as min(d / 0.184, 1.44 d √(s / c)), which keeps the area of the stairs' triangles constant. d is
a height between the thinnest, the nominal and the thickest layer, chosen by a quality from 0 (finest) to 1.
From the bed up each layer takes the least that the facets it meets allow; a facet that begins inside the layer and asks
for less ends the layer where it begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh

__all__ = ["HeightLimits", "adaptive_profile", "model_xml", "stack_profile", "write_3mf"]

_TOUCHING = 1e-4  # mm; a facet that ends this near over the last layer has no say
_ROUGHNESS = 0.184
_STEEP = 1e-5  # vertical part of a normal under which a facet is a wall
_PLACES = 9  # decimals of z and heights in the file: their sums must not drift

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
    """Layer heights in mm: the fixed first one, and what the others are chosen from."""

    first: float
    thinnest: float
    nominal: float
    thickest: float


def adaptive_profile(mesh: Mesh, heights: HeightLimits, quality: float) -> Float:
    """(n, 2) z and layer height there, mm: what the window of PrusaSlicer makes of a part.

    The slicer reads it as a broken line and samples it anew, so the layers it prints are not quite these.

    Args:
        mesh: the part, standing on z = 0.
        heights: first, thinnest, nominal and thickest layer.
        quality: 0, all thinnest, to 1; 0.5 is what the window begins with.
    """
    low, high, allowed = _facets(mesh, _spread(heights, quality))
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


def _spread(heights: HeightLimits, quality: float) -> float:
    """The layer height that stands for the quality, mm."""
    return float(np.interp(quality, [0.0, 0.5, 1.0], [heights.thinnest, heights.nominal, heights.thickest]))


def _facets(mesh: Mesh, height: float) -> tuple[Float, Float, Float]:
    """Lowest and highest z of each facet and the layer height it allows, mm, by ascending lowest z."""
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
    """(n, 2) z and layer height there, mm: a line of steps that makes PrusaSlicer print layers with these tops.

    Args:
        top: (L,) mm, ascending.
        part_height: mm; the slicer drops a profile that does not end there.
    """
    bottom = np.concatenate([[0.0], top[:-1]])
    height = top - bottom
    ends = np.minimum(np.stack([bottom, top], axis=1), part_height)
    ends[-1, 1] = part_height
    return np.stack([ends, np.repeat(height[:, None], 2, axis=1)], axis=2).reshape(-1, 2)


def model_xml(mesh: Mesh) -> str:
    """The part as the model of a 3MF file."""
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
