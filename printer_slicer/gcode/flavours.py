"""The list of G-code flavours, and writing a program in one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final

from printer_slicer.gcode.dialect import Dialect
from printer_slicer.gcode.klipper import KLIPPER
from printer_slicer.gcode.marlin import MARLIN
from printer_slicer.gcode.marlin_legacy import MARLIN_LEGACY
from printer_slicer.gcode.prusa import PRUSA
from printer_slicer.gcode.repetier import REPETIER
from printer_slicer.gcode.reprapfirmware import REPRAPFIRMWARE
from printer_slicer.gcode.smoothie import SMOOTHIE
from printer_slicer.gcode.writer import Told, write_program
from printer_slicer.model import Float, Labels, Program
from printer_slicer.profile import Profile

__all__ = ["FLAVOURS", "write_gcode"]

FLAVOURS: Final[Mapping[str, Dialect]] = {
    "marlin": MARLIN,
    "marlin_legacy": MARLIN_LEGACY,
    "klipper": KLIPPER,
    "reprapfirmware": REPRAPFIRMWARE,
    "repetier": REPETIER,
    "smoothie": SMOOTHIE,
    "prusa": PRUSA,
}


def write_gcode(  # noqa: PLR0913 - what else is known of a program
    program: Program,
    profile: Profile,
    seconds: Float | None = None,
    facts: Sequence[str] = (),
    *,
    comments: Sequence[str] = (),
    labels: Labels | None = None,
    flavour: Dialect | None = None,
    made: datetime | None = None,
) -> bytes:
    """Write a program in the printer's dialect, with the settings as comments.

    Args:
        program: the moves.
        profile: the profile it was sliced with, including the macros.
        seconds: (K,) modelled time of each move; what needs it is left out if it is not known.
        facts: further facts for the header.
        comments: lines to insert after the first one.
        labels: which moves belong to which object.
        flavour: overrides that of the profile.
        made: date in UTC for the first line; None: no date.

    Raises:
        ProfileError: a macro cannot be evaluated.
    """
    dialect = flavour or FLAVOURS[profile.printer.flavour]
    return write_program(program, profile, dialect, Told(seconds, facts, comments, labels, made))
