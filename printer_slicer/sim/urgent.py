"""Commands that act ahead of their turn: what an emergency parser sees in the bytes as they arrive.

Known are M108, M112, M410, M524 and M876; the letters S000, P000 and R000 of Marlin's real-time reporting are not.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["URGENT_CODES", "EmergencyParser"]

_URGENT: Final = re.compile(rb" *(?:N[-0-9 ]*)?(M108|M112|M410|M524|M876 *S[0-9])").match
"""What it recognises at the start of a line, whatever follows."""

URGENT_CODES: Final = frozenset({"M108", "M112", "M410"})
"""What is seen without one when an un-numbered line enters the queue."""


class EmergencyParser:
    """Sees urgent commands as soon as their line is complete.

    Args:
        longest: bytes of a line of which more is not looked at.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._arriving = b""

    def arrive(self, data: bytes) -> list[str]:
        """The urgent commands that these bytes complete."""
        data = self._arriving + data.replace(b"\r", b"\n")
        *lines, rest = data.split(b"\n")
        self._arriving = rest[: self._longest]
        return [match[1][:4].decode() for match in map(_URGENT, lines) if match is not None]
