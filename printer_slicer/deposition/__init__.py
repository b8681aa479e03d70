"""A height map of the plate, fed by moves of any source, and unsupported extrusion."""

from printer_slicer.deposition.marks import marks_of
from printer_slicer.deposition.unsupported import (
    Unsupported,
    UnsupportedTracker,
    describe,
    unsupported_of_program,
)

__all__ = ["Unsupported", "UnsupportedTracker", "describe", "marks_of", "unsupported_of_program"]
