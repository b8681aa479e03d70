"""Absolute and relative positioning: G90, G91, M82 and M83, which firmwares interpret differently.

together  G90 and G91 set x, y, z and e; M82 and M83 set e until the next of these commands (Marlin 2, Smoothie)
either    e is relative after G91 and after M83 (Marlin 1.1, Klipper, Repetier)
apart     G90 and G91 set x, y and z; M82 and M83 set e (Prusa, RepRapFirmware)

Sources: Marlin's G-code index, M82 and M83, and its gcode.h; Marlin 1.1's Marlin_main.cpp; Prusa-Firmware's list of
commands, G90: "E axis is left intact"; Klipper's G-Codes; Duet3D's G-code dictionary; Repetier's gcode documentation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from printer_slicer.firmware.firmware import CountingRule

__all__ = ["PositioningMode"]


class PositioningMode(NamedTuple):
    """The current positioning mode.

    Attributes:
        rule: rule of the firmware, see above.
        has_relative_axes: whether x, y, z are relative (G91).
        has_relative_extruder: whether the last command that sets e made it relative. Such commands are M82 and M83, and
            G90 and G91 if they set e, too. The command must be sent again if the firmware has forgotten the mode.
    """

    rule: CountingRule = "together"
    has_relative_axes: bool = False
    has_relative_extruder: bool = False

    @property
    def has_relative_e(self) -> bool:
        """Whether e is relative."""
        return self.has_relative_extruder or (self.rule == "either" and self.has_relative_axes)

    def with_command(self, word: str) -> PositioningMode:
        """Return the mode after the command `word`; unchanged if the command does not set it."""
        if word in {"M82", "M83"}:
            return self._replace(has_relative_extruder=word == "M83")
        if word not in {"G90", "G91"}:
            return self
        is_relative = word == "G91"
        extruder = is_relative if self.rule == "together" else self.has_relative_extruder
        return self._replace(has_relative_axes=is_relative, has_relative_extruder=extruder)
