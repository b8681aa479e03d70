"""Values of flags: what is typed, as a number, or a message that says what was expected."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf, isfinite
from typing import Final, NamedTuple

__all__ = [
    "address",
    "angles",
    "attached",
    "box_of",
    "factor",
    "factors",
    "height",
    "length",
    "number",
    "patience",
    "pixels",
    "point",
    "positive",
    "seconds",
    "whole",
]

_WITH_SIGN: Final = ("--rotate", "--center", "--box", "--range")
"""Flags whose values may begin with a minus sign, which argparse takes for a flag."""
_SMALLEST_BOX: Final = 0.01  # mm


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


def attached(argv: Sequence[str]) -> list[str]:
    """The arguments, with values such as `-90,0,0` joined to their flags, as argparse needs it."""
    result: list[str] = []
    for argument in argv:
        if result and result[-1] in _WITH_SIGN and re.match(r"-[\d.]", argument):
            result[-1] += f"={argument}"
        else:
            result.append(argument)
    return result


def _numbers(text: str, counts: tuple[int, ...], example: str) -> list[float]:
    """Numbers with commas between them, as many as one of the counts."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}")
    return numbers


class _Factors(NamedTuple):
    """Of --scale: along each axis, and as they were written."""

    x: float
    y: float
    z: float
    text: str


def factors(text: str) -> _Factors:
    """One factor for all axes or one for each, as numbers or percentages."""
    example = "a factor over 0 such as 2, 50% or 1,1,2"
    words = [word.strip() for word in text.split(",")]
    plain = ",".join(word.removesuffix("%") for word in words)
    numbers = _numbers(plain, (1, 3), example)
    each = [
        number / 100 if word.endswith("%") else number for number, word in zip(numbers, words, strict=True)
    ]
    if not all(one > 0 for one in each):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}; mirror a part where it was made")
    x, y, z = each * 3 if len(each) == 1 else each
    return _Factors(x, y, z, text)


def angles(text: str) -> tuple[float, float, float]:
    """Degrees about x, y and z."""
    numbers = _numbers(text, (1, 3), "degrees about z such as 45, or X,Y,Z such as 90,0,45")
    x, y, z = [0.0, 0.0, *numbers] if len(numbers) == 1 else numbers
    return x, y, z


def point(text: str) -> tuple[float, float]:
    """A place on the bed, mm."""
    x, y = _numbers(text, (2,), "X,Y in mm on the bed, such as 110,110")
    return x, y


def box_of(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Two corners of a rectangle on the bed, mm."""
    example = "two corners X0,Y0,X1,Y1 in mm on the bed, such as 100,100,120,110"
    x0, y0, x1, y1 = _numbers(text, (4,), example)
    if min(abs(x1 - x0), abs(y1 - y0)) < _SMALLEST_BOX:
        raise argparse.ArgumentTypeError(
            f"{text!r}: less than {_SMALLEST_BOX:g} mm wide or high; expected {example}"
        )
    return (x0, y0), (x1, y1)
