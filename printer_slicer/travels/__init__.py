"""Toolpaths -> Travels: how the nozzle gets from path to path, and where the filament is pulled back for it."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import crossings
from printer_slicer.model import Sections, Toolpaths, Travels, leaves
from printer_slicer.profile import Profile

__all__ = ["travel"]


def travel(paths: Toolpaths, sections: Sections, profile: Profile) -> Travels:
    """The ways between paths in printing order.

    The filament is pulled back where a way leaves the part; what oozes inside is not seen.
    """
    printer = profile.printer
    begin, end = leaves(paths)
    crossed = np.zeros(paths.n_paths, np.int64)
    crossed[1:] = crossings(sections.solid, begin[1:], end[1:], paths.layer[1:])
    long = np.hypot(*(end - begin).T) > printer.retract_before_travel
    return Travels.straight((crossed > 0) & long & (printer.retract_length > 0), crossed)
