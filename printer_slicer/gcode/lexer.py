"""Split a G-code line into its code and the numbers of its words, ignoring case.

Plain Python and nothing else, so that the host can use it without loading numpy.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["letters", "parse"]

_CODE: Final = re.compile(rb"([GMT])\s*(\d+)")
_VALUE: Final = re.compile(rb"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_LETTER: Final = re.compile(rb"([A-Z])\s*(?:[-+]?(?:\d+\.?\d*|\.\d+))?")
_NONSENSE: Final = 1e9
"""Larger numbers count as missing, as in the reader."""


def parse(command: bytes) -> tuple[bytes, dict[bytes, float]]:
    """Return the code of a command (`G1`, `M104`, `T0`; empty if there is none) and the numbers of its words.

    Args:
        command: without line number, checksum and comment.
    """
    if not command.isupper():
        command = command.upper()
    found = _CODE.match(command)
    if not found:
        return b"", {}
    values = {letter: float(value) for letter, value in _VALUE.findall(command, found.end())}
    if values and max(map(abs, values.values())) >= _NONSENSE:
        values = {letter: value for letter, value in values.items() if abs(value) < _NONSENSE}
    return b"%s%d" % (found[1], int(found[2])), values


def letters(command: bytes) -> frozenset[bytes]:
    """Return the letters after the code of a command, with or without numbers, such as the axes of `G28 X Y`."""
    command = command.upper()
    found = _CODE.match(command)
    return frozenset(_LETTER.findall(command, found.end())) if found else frozenset()
