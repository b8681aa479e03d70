"""Values of flags: what is typed, as a number, or a message that says what was expected."""

from __future__ import annotations

import argparse
import re
from math import inf

__all__ = ["address", "factor", "height", "length", "patience", "pixels", "positive", "seconds"]


def address(text: str) -> tuple[str, int]:
    """A host and a port to listen at."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65_535:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:8888")
    return host.strip("[]") or "127.0.0.1", int(port)


def factor(text: str) -> float:
    """A number that time can be multiplied by."""
    value = float(text)
    if not value >= 0:
        raise argparse.ArgumentTypeError(f"{text} is not 0 or more")
    return value


def height(text: str) -> float:
    """A height over the bed."""
    value = float(text)
    if not 0 <= value < 10000:
        raise argparse.ArgumentTypeError(f"{text} is no height over the bed in mm")
    return value


def length(text: str) -> float:
    """A number of mm over 0."""
    value = float(text)
    if not 0 < value < 1000:
        raise argparse.ArgumentTypeError(f"{text} is no length in mm")
    return value


def pixels(text: str) -> int:
    """A size that a picture can have."""
    value = int(text)
    if not 100 <= value <= 8000:
        raise argparse.ArgumentTypeError(f"{text} is not between 100 and 8000")
    return value


def patience(text: str) -> float:
    """A time in s, 0 or more."""
    value = float(text)
    if not 0 <= value < inf:
        raise argparse.ArgumentTypeError("expected seconds, 0 or more, such as 120")
    return value


def positive(text: str) -> int:
    """A whole number over 0."""
    value = int(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not over 0")
    return value


def seconds(text: str) -> float:
    """A time such as 90m, 1h30m, 45s or 5400, in seconds."""
    number = r"(\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"{number}h\s*{number}()", text.strip())  # 1h30: minutes
    found = found or re.fullmatch(rf"(?:{number}h)?\s*(?:{number}m(?:in)?)?\s*(?:{number}s?)?", text.strip())
    if not found or not any(found.groups()):
        raise argparse.ArgumentTypeError(f"{text!r} is no time; write 1h30m, 90m or 5400 (seconds)")
    hours, minutes, seconds = (float(part or 0) for part in found.groups())
    return 3600 * hours + 60 * minutes + seconds
