"""How a firmware reads lines from the wire: one row for each kind that must be spoken to in its own way.

switch          what it decides
checksum        which one a line carries; `crc16` sees what an exclusive or cannot
sequence        a line whose number is not next is refused; without that a lost line leaves no trace
strays          what happens to a line without number: executed, or refused. The tail of a line whose beginning was
                lost looks like one, so where it is executed no more than two lines may be in flight on a bad cable
places          commands read ahead; one is kept free for M112 where no parser looks at the bytes as they arrive
counts          M110 alone answers with the number of the last line, so a doubt is settled without another line
request         how the firmware asks for a line again: what the tests say to the host, and the documents to people
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["MARLIN_REQUEST", "WireDialect"]

MARLIN_REQUEST: Final = ("Error:checksum mismatch, Last Line: 6", "Resend: 7", "ok")


@dataclass(frozen=True, slots=True, kw_only=True)
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
    advice: str = ""
