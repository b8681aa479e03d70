"""The list of G-code flavours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.gcode.dialect import Dialect
from printer_slicer.gcode.klipper import KLIPPER
from printer_slicer.gcode.marlin import MARLIN
from printer_slicer.gcode.marlin_legacy import MARLIN_LEGACY
from printer_slicer.gcode.prusa import PRUSA
from printer_slicer.gcode.repetier import REPETIER
from printer_slicer.gcode.reprapfirmware import REPRAPFIRMWARE
from printer_slicer.gcode.smoothie import SMOOTHIE

__all__ = ["FLAVOURS"]

FLAVOURS: Final[Mapping[str, Dialect]] = {
    "marlin": MARLIN,
    "marlin_legacy": MARLIN_LEGACY,
    "klipper": KLIPPER,
    "reprapfirmware": REPRAPFIRMWARE,
    "repetier": REPETIER,
    "smoothie": SMOOTHIE,
    "prusa": PRUSA,
}
