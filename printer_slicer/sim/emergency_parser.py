"""The emergency parser, which recognizes urgent commands as soon as their bytes arrive.

It knows M108, M112, M410, M524 and M876, but not S000, P000 and R000 of Marlin's real-time reporting.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["URGENT_CODES", "EmergencyParser"]

_match_urgent: Final = re.compile(rb" *(?:N[-0-9 ]*)?(M108|M112|M410|M524|M876 *S[0-9])").match
"""Matches an urgent command at the start of a line."""

URGENT_CODES: Final = frozenset({"M108", "M112", "M410"})
"""Urgent commands that are recognized without an emergency parser when an unnumbered line is queued."""


class EmergencyParser:
    """Recognizes urgent commands as soon as their line is complete.

    Args:
        max_length: maximum line length, bytes.
    """

    def __init__(self, max_length: int) -> None:
        self._max_length = max_length
        self._partial_line = b""

    def add_bytes(self, data: bytes) -> list[str]:
        """Add received bytes; return the urgent commands whose lines they complete."""
        data = self._partial_line + data.replace(b"\r", b"\n")
        *lines, rest = data.split(b"\n")
        self._partial_line = rest[: self._max_length]
        return [match[1][:4].decode() for match in map(_match_urgent, lines) if match is not None]
