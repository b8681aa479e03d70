"""Read and write model files.

One module per format; `reading` chooses between them, and `soundness` judges what came out. STL and OBJ are read
piece by piece, 3MF as a stream of XML, GLB, PLY and OFF from their arrays; STEP goes through OpenCASCADE,
imported only then.

What a file may contain and still be a part: it has facets, all coordinates are finite, and it extends in x, y and z.
Facets with two equal corners are left out and counted. Whether the surface is closed, faces outward and encloses a
volume is for `healing` to find.
"""

from __future__ import annotations

from printer_slicer.mesh_io.binary_stl import export_stl
from printer_slicer.mesh_io.limits import LIMITS, Limits
from printer_slicer.mesh_io.reading import FORMATS, Model, load_mesh, load_model
from printer_slicer.mesh_io.units import UNITS, likely_unit, unit_advice

__all__ = [
    "FORMATS",
    "LIMITS",
    "UNITS",
    "Limits",
    "Model",
    "export_stl",
    "likely_unit",
    "load_mesh",
    "load_model",
    "unit_advice",
]
