"""Whether numbers of commands count from where the machine is: G90, G91, M82 and M83, which firmwares read differently.

together  G90 and G91 set x, y, z and e; M82 and M83 set e until the next of them (Marlin 2, Smoothie)
either    e counts from where it is after G91, and after M83 (Marlin 1.1, Klipper, Repetier)
apart     G90 and G91 set x, y and z, M82 and M83 set e (Prusa, RepRapFirmware)

Sources: Marlin's G-code index, M82 and M83, and its gcode.h; Marlin 1.1's Marlin_main.cpp; Prusa-Firmware's list of
commands, G90: "E axis is left intact"; Klipper's G-Codes; Duet3D's G-code dictionary; Repetier's gcode documentation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from printer_slicer.firmware.firmware import CountingRule

__all__ = ["PositioningMode"]


class PositioningMode(NamedTuple):
    """How numbers are read.

    Attributes:
        rule: of the firmware.
        axes: x, y, z count from where they are (G91).
        extruder: what M82 or M83 has said, or G90 or G91 where they speak of e too; to be said again where the
            firmware has forgotten it.
    """

    rule: CountingRule = "together"
    axes: bool = False
    extruder: bool = False

    @property
    def e(self) -> bool:
        """Whether e counts from where it is."""
        return self.extruder or (self.rule == "either" and self.axes)

    def after(self, word: str) -> PositioningMode:
        """How numbers are read after a command; as before, if it does not speak of that."""
        if word in {"M82", "M83"}:
            return self._replace(extruder=word == "M83")
        if word not in {"G90", "G91"}:
            return self
        axes = word == "G91"
        return self._replace(axes=axes, extruder=axes if self.rule == "together" else self.extruder)
