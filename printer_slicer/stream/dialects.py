"""What firmwares differ in on the wire: one row each, chosen by the name that M115 gives.

switch          what it decides
checksum        which one a line carries; `crc16` sees what an exclusive or cannot
sequence        a line whose number is not next is refused; without that a lost line leaves no trace
strays          what happens to a line without number: executed, or refused. The tail of a line whose beginning was
                lost looks like one, so where it is executed no more than two lines may be in flight on a bad cable
places          commands read ahead; one is kept free for M112 where no parser looks at the bytes as they arrive
counts          M110 alone answers with the number of the last line, so a doubt is settled without another line
request         how the firmware asks for a line again: what the tests say to the host, and the documents to people

Sources: Marlin's queue.cpp and its documentation of M110; Prusa-Firmware's cmdqueue.cpp; RepRapFirmware's
StringParser.cpp and "Line numbers and checksums" of its G-code dictionary; Klipper's gcode.py and "G-Codes";
Repetier-Firmware's gcode.cpp; Smoothieware's GcodeDispatch.cpp.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

from printer_slicer.errors import UsageError

__all__ = ["DIALECTS", "UNKNOWN", "WireDialect", "dialect_named", "dialect_of"]


@dataclass(frozen=True, slots=True)
class WireDialect:
    """How one kind of firmware reads lines.

    Attributes:
        title: as people call it.
        pattern: of the name that M115 gives.
        request: a request for line 7, as this firmware says it.
        checksum: at the end of each line.
        sequence: whether it takes lines in order only.
        strays: what it does to a line without number and right checksum.
        counts: M110 alone says the last line number.
        ok_when_read: a line gets its ok when it is read; what M105 tells comes by itself when it is its turn.
        longest: bytes of a line, without its line break.
        places: commands it reads ahead.
        most: lines in flight at most, where it is safe.
        flavour: determines the meaning of commands that firmwares read differently.
        advice: what its owner should know before streaming; empty if nothing.
    """

    title: str
    pattern: str
    request: tuple[str, ...]
    checksum: Literal["xor", "crc16"] = "xor"
    sequence: bool = True
    strays: Literal["executed", "refused"] = "executed"
    counts: bool = False
    ok_when_read: bool = False
    longest: int = 95
    places: int = 4
    most: int = 6
    flavour: str = "marlin"
    advice: str = ""


_MARLIN_ERROR: Final = "Error:checksum mismatch, Last Line: 6"
_KLIPPER_ADVICE: Final = (
    "Klipper checks neither number nor checksum of a line: a damaged one is executed as it arrives, and it plans better"
    " from a file. Upload the job to it instead, if you can"
)
_REPRAP_ADVICE: Final = (
    "RepRapFirmware drops a damaged line without a word: one line at a time is sent, and a missing answer is cleared up"
    " by asking for the position"
)

DIALECTS: Final[dict[str, WireDialect]] = {
    "klipper": WireDialect(
        "Klipper",
        r"Klipper",
        (),
        sequence=False,
        places=20,
        most=1,
        longest=200,
        flavour="klipper",
        advice=_KLIPPER_ADVICE,
    ),
    "reprapfirmware": WireDialect(
        "RepRapFirmware",
        r"RepRapFirmware",
        ("rs 7",),
        checksum="crc16",
        sequence=False,
        places=1,
        most=1,
        longest=160,
        flavour="reprapfirmware",
        advice=_REPRAP_ADVICE,
    ),
    "repetier": WireDialect(
        "Repetier",
        r"Repetier",
        ("Error:expected line 7 got 9", "", "Resend:7", "ok"),
        strays="refused",
        ok_when_read=True,
        places=2,
        flavour="repetier",
    ),
    "smoothie": WireDialect("Smoothie", r"Smoothie", ("rs N7",), longest=120, places=1, flavour="smoothie"),
    "prusa": WireDialect(
        "Prusa MK3",
        r"Prusa-Firmware(?!-Buddy)",
        (_MARLIN_ERROR, "Resend: 7", "ok"),
        strays="refused",
        flavour="prusa",
    ),
    "marlin_1": WireDialect(
        "Marlin 1.1", r"Marlin V?1\.", (_MARLIN_ERROR, "Resend: 7", "ok"), flavour="marlin_legacy"
    ),
    "marlin_2_1_3": WireDialect(
        "Marlin 2.1.3 and later",
        r"Marlin (?:bugfix-)?2\.(?:1\.(?:[3-9]|[12]\d)|[2-9])",
        (_MARLIN_ERROR, "Resend: 7", "ok"),
        counts=True,
    ),
    "marlin": WireDialect("Marlin 2", r"", (_MARLIN_ERROR, "Resend: 7", "ok")),
}
"""By the names that a profile or a person may use. The first whose pattern is found in the name that M115 gives."""

UNKNOWN: Final = "marlin"
"""Who says nothing is treated like this: every other sequence-checking firmware can live with it."""


def dialect_of(firmware: str) -> str:
    """Name of the dialect of a firmware that calls itself so."""
    return next(name for name, dialect in DIALECTS.items() if re.search(dialect.pattern, firmware))


def dialect_named(name: str) -> WireDialect:
    """The dialect with this name.

    Raises:
        UsageError: there is none.
    """
    if name not in DIALECTS:
        raise UsageError(
            f"no firmware is known by the name {name!r}", remedy=f"known are: {', '.join(DIALECTS)}"
        )
    return DIALECTS[name]
