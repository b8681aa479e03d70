"""What keeps a printer from being printed to: the port as the system has it, and the printer behind it."""

from printer_slicer.doctor.checks import PortCheck
from printer_slicer.doctor.examination import Examination, examine
from printer_slicer.doctor.port import PortState, state_of

__all__ = ["Examination", "PortCheck", "PortState", "examine", "state_of"]
