"""Analysis of the surface of a part at every height, and proven error bounds for layer plans."""

from printer_slicer.surface.certificate import (
    Certificate,
    Surface,
    WorstLayer,
    certificate_comments,
    certify,
    certify_stacks,
    layer_bounds,
    read_surface,
)
from printer_slicer.surface.flats import find_downward_flats, find_flats
from printer_slicer.surface.thin_features import thin_areas

__all__ = [
    "Certificate",
    "Surface",
    "WorstLayer",
    "certificate_comments",
    "certify",
    "certify_stacks",
    "find_downward_flats",
    "find_flats",
    "layer_bounds",
    "read_surface",
    "thin_areas",
]
