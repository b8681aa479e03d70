"""Command codes by kind: one list for all code that tracks the state of a program.

Sources: Marlin's G-code index, Duet3D's G-code dictionary, Klipper's G-Codes, Smoothieware's supported G-codes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, Literal

__all__ = [
    "COUNTING_CODES",
    "HOME_OFFSET",
    "MACHINE_COORDINATES",
    "MOVES",
    "MOVES_UNSEEN",
    "OTHER_COORDINATES",
    "WAITS_FOR_MOTION",
    "is_macro",
]

MOVES: Final = frozenset({b"G0", b"G1", b"G2", b"G3"})
"""Moves to a given position."""

COUNTING_CODES: Final = frozenset({b"G90", b"G91", b"M82", b"M83"})
"""Commands for absolute and relative mode."""

MOVES_UNSEEN: Final = frozenset(
    b"G5 G12 G26 G27 G29 G30 G32 G33 G34 G35 G38 G42 G61 G76 G80 G425 M48 M98 M125 M701 M702".split()
)
"""Commands that move the machine to an unknown position; so does G28."""

OTHER_COORDINATES: Final = frozenset(b"G54 G55 G56 G57 G58 G59 M428".split())
"""Commands that select or move the origin by an unknown amount."""

WAITS_FOR_MOTION: Final = frozenset(b"G4 G28 G29 M0 M1 M109 M116 M190 M191 M226 M400 M600 M601".split())
"""Commands that are acknowledged after all earlier moves have finished."""

MACHINE_COORDINATES: Final = frozenset({"reprapfirmware", "smoothie"})
"""Flavours with `G53 G1 ...` in machine coordinates; in others it depends on the build."""

HOME_OFFSET: Final[Mapping[str, Literal["at once", "when homed", "never"]]] = {
    "marlin": "at once",
    "marlin_legacy": "at once",
    "prusa": "at once",
    "reprapfirmware": "at once",
    "klipper": "never",
    "repetier": "never",
    "smoothie": "when homed",
}
"""Flavour -> when M206 moves the origin. Klipper does not support it, and Repetier uses M206 to write its EEPROM."""

_SETS_ONLY: Final = re.compile(
    rb"(SET_|EXCLUDE_OBJECT|RESPOND\b|SAVE_GCODE_STATE|TURN_OFF_HEATERS|M\d|T\d|@|;|$)"
)
_CODE: Final = re.compile(rb"[GMT]\s*\d", re.IGNORECASE)


def is_macro(command: bytes) -> bool:
    """Whether a command is a macro of the printer, with unknown effects."""
    return not _CODE.match(command) and _SETS_ONLY.match(command.upper()) is None
