"""Values of flags: what is typed, as a number, or a message that says what was expected."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from contextlib import suppress
from math import inf

__all__ = [
    "address",
    "factor",
    "height",
    "length",
    "number",
    "patience",
    "pixels",
    "positive",
    "seconds",
    "whole",
]


def address(text: str) -> tuple[str, int]:
    """A host and a port to listen at."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65_535:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:8888")
    return host.strip("[]") or "127.0.0.1", int(port)


def factor(text: str) -> float:
    """A number that time can be multiplied by."""
    return _number(text, "0 or more", lambda value: 0 <= value < inf)


def height(text: str) -> float:
    """A height over the bed."""
    return _number(text, "a height over the bed in mm, such as 2.4", lambda value: 0 <= value < 10000)


def length(text: str) -> float:
    """A number of mm over 0."""
    return _number(text, "a length in mm, such as 0.4", lambda value: 0 < value < 1000)


def number(text: str) -> float:
    """Any number."""
    return _number(text, "a number, such as 0.02", lambda _: True)


def pixels(text: str) -> int:
    """A size that a picture can have."""
    return int(_number(text, "a whole number between 100 and 8000", lambda value: 100 <= value <= 8000, int))


def positive(text: str) -> int:
    """A whole number over 0."""
    return int(_number(text, "a whole number over 0", lambda value: value > 0, int))


def whole(text: str) -> int:
    """A whole number."""
    return int(_number(text, "a whole number", lambda _: True, int))


def _number(
    text: str, expected: str, fits: Callable[[float], bool], read: Callable[[str], float] = float
) -> float:
    """What is typed as a number, or a message that says what is expected."""
    with suppress(ValueError):
        value = read(text)
        if fits(value):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: expected {expected}")


def patience(text: str) -> float:
    """A time in s, 0 or more."""
    return _number(text, "seconds, 0 or more, such as 120", lambda value: 0 <= value < inf)


def seconds(text: str) -> float:
    """A time such as 90m, 1h30m, 45s or 5400, in seconds."""
    number = r"(\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"{number}h\s*{number}()", text.strip())  # 1h30: minutes
    found = found or re.fullmatch(rf"(?:{number}h)?\s*(?:{number}m(?:in)?)?\s*(?:{number}s?)?", text.strip())
    if not found or not any(found.groups()):
        raise argparse.ArgumentTypeError(f"{text!r} is no time; write 1h30m, 90m or 5400 (seconds)")
    hours, minutes, seconds = (float(part or 0) for part in found.groups())
    return 3600 * hours + 60 * minutes + seconds
