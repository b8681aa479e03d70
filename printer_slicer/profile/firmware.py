"""What firmwares differ in beyond their words: one row each; the words are in `gcode`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["FIRMWARES", "Firmware"]


@dataclass(frozen=True, slots=True)
class Firmware:
    """How one kind of firmware behaves.

    Attributes:
        planner_blocks: moves it plans ahead.
        one_acceleration: printing and travelling have the same.
        extended_commands: has commands of words, such as SET_VELOCITY_LIMIT, and passes over those it does not know.
        pressure_advance: has a command for it whose value is in seconds.
        firmware_retraction: has G10 and G11 of a length that a file can set.
        ends_beyond: a move beyond the machine ends the print; others stop at the end of the axis and go on.
    """

    planner_blocks: int
    one_acceleration: bool = False
    extended_commands: bool = False
    pressure_advance: bool = True
    firmware_retraction: bool = True
    ends_beyond: bool = False


FIRMWARES: Final[Mapping[str, Firmware]] = {
    "marlin": Firmware(16),
    "marlin_legacy": Firmware(16),
    # Klipper plans about a second ahead, which is never fewer moves than this.
    "klipper": Firmware(1000, one_acceleration=True, extended_commands=True, ends_beyond=True),
    # A ring of 40 moves on the Duet 2; later boards have more.
    "reprapfirmware": Firmware(40, ends_beyond=True),
    # Retraction lengths are part of its EEPROM, and M233 counts in units of its own.
    "repetier": Firmware(16, pressure_advance=False, firmware_retraction=False),
    "smoothie": Firmware(32, one_acceleration=True, pressure_advance=False),
    "prusa": Firmware(16),
}
"""By the names that `printer.flavour` may have.

Sources: Marlin's Configuration_adv.h (BLOCK_BUFFER_SIZE); Klipper's documents, "Kinematics"; Duet3D's G-code dictionary
(M595); Repetier-Firmware's Configuration.h (PRINTLINE_CACHE_SIZE) and the list of commands in its sources;
Smoothieware's planner_queue_size; Prusa-Firmware's Configuration_adv.h.
"""
