"""Printing over a port: the job, its control by users, and its recovery after an interruption.

Names are imported when they are first used: a process that only sends a command to another print needs none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.printing.controls import Controls, PrintOptions, PrintResult
    from printer_slicer.printing.print_session import print_job, resume_print

_HOMES = {
    "Controls": "controls",
    "PrintResult": "controls",
    "PrintOptions": "controls",
    "print_job": "print_session",
    "resume_print": "print_session",
}

__all__ = ["Controls", "PrintOptions", "PrintResult", "print_job", "resume_print"]


__getattr__ = lazy_names(__name__, _HOMES, {"Done": "PrintResult"})
