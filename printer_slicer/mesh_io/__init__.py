"""Read and write model files.

There is one module per format. `reading` chooses between them, and `soundness` checks the result. STL and OBJ are read
in chunks, 3MF as a stream of XML, and GLB, PLY and OFF from their arrays. STEP is converted by OpenCASCADE, which is
imported only when it is needed.

A file holds a part if it has facets, all coordinates are finite, and it extends in x, y and z. Facets with two equal
corners are dropped and counted. `healing` checks whether the surface is closed, faces outward and encloses a volume.
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
