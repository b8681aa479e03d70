"""The list of firmwares, and a program as the text of one of them."""

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
    """The text of a program in the printer's dialect, settings included as comments.

    Args:
        program: the moves.
        profile: what they were made with; its macros are filled in.
        seconds: (K,) modelled time of each move; what needs it is left out if it is not known.
        facts: more to tell at the top.
        comments: lines that stand behind the first one as they are.
        labels: which moves lay which of several things.
        flavour: takes the place of the profile's.
        made: when, in UTC, for the first line; None: it has no date.

    Raises:
        ProfileError: a macro that cannot be filled in.
    """
    dialect = flavour or FLAVOURS[profile.printer.flavour]
    return write_program(program, profile, dialect, Told(seconds, facts, comments, labels, made))
