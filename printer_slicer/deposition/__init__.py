"""What plastic is laid onto: a relief of the plate, fed by moves of any source; extrusion that nothing holds."""

from printer_slicer.deposition.marks import marks_of
from printer_slicer.deposition.unsupported import Tracker, Unsupported, describe, unsupported_of_program

__all__ = ["Tracker", "Unsupported", "describe", "marks_of", "unsupported_of_program"]
