"""Commands in lower case, which most firmwares do not know: each dialect says by `any_case` whether its does.

Texts of messages and names of files, words with more than one letter, and commands for the host (`@pause`) may be in
lower case everywhere.
"""

from __future__ import annotations

import re
from typing import Final

from printer_slicer.firmware import FIRMWARES, FLAVOURS
from printer_slicer.gcode.commands import takes_text
from printer_slicer.gcode.lexer import code_and_rest, number_and_command, parse

__all__ = ["lower_case_fault"]

_TEXT: Final = re.compile(r'"[^"]*"?|\([^)]*\)?|\{[^}]*\}?')
_LOWER_WORD: Final = re.compile(r"(?<![A-Za-z_])[a-z](?![A-Za-z_])")


def lower_case_fault(line: bytes, flavour: str) -> str:
    """What is wrong with the case of a line's letters, and how to write it; empty if nothing is.

    Args:
        line: one command, without comment.
        flavour: of the firmware, a key of `FLAVOURS`.
    """
    if FLAVOURS[flavour].any_case or line == line.upper():
        return ""
    head, rest = code_and_rest(number_and_command(line.strip())[1])
    if not head:
        return ""
    behind = rest.decode("latin-1")
    free = takes_text(parse(head)[0].decode())
    if head.isupper() and (free or not _LOWER_WORD.search(_TEXT.sub(" ", behind))):
        return ""
    capitals = head.decode().upper() + (behind if free else _in_capitals(behind))
    return f"is in lower case, which {FIRMWARES[flavour].title} does not know: write {capitals}"


def _in_capitals(words: str) -> str:
    """The words of a command in capitals, with its texts as they are."""
    texts = iter(_TEXT.findall(words))
    return "".join(part.upper() + next(texts, "") for part in _TEXT.split(words))
