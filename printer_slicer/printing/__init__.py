"""Printing over a port: the job, its control by users, and its recovery after an interruption.

Names are imported when they are first used: a process that only has a wish for another one's print needs none of them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.printing.controls import Controls
    from printer_slicer.printing.keeper import print_job, resume_print
    from printer_slicer.printing.options import Done, Options

_HOMES = {
    "Controls": "controls",
    "Done": "options",
    "Options": "options",
    "print_job": "keeper",
    "resume_print": "keeper",
}

__all__ = ["Controls", "Done", "Options", "print_job", "resume_print"]


def __getattr__(name: str) -> object:
    """Import a public name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
