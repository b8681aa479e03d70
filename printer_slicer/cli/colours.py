"""Colours of messages: on terminals only, and not where NO_COLOR says that they are not wanted (https://no-color.org)."""

from __future__ import annotations

import os
from typing import Final, TextIO

__all__ = ["coloured"]

_CODES: Final = {"error": "1;31", "warning": "1;33"}


def coloured(text: str, kind: str, stream: TextIO) -> str:
    """The text as it is shown on a stream: `kind` is error or warning."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return text
    return f"\x1b[{_CODES[kind]}m{text}\x1b[0m"
