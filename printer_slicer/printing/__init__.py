"""Printing over a port: the job, the wishes of people meanwhile, and what is left to take it up again."""

from printer_slicer.printing.controls import Controls
from printer_slicer.printing.keeper import print_job, resume_print
from printer_slicer.printing.options import Done, Options

__all__ = ["Controls", "Done", "Options", "print_job", "resume_print"]
