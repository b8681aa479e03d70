"""Flags of every command that takes models: what is read, how it is scaled and turned, where it is put."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Final, NamedTuple

from printer_slicer.errors import UsageError

__all__ = ["add_models", "attached", "box_of", "refuse_model_flags"]

UNITS: Final = ("mm", "cm", "m", "inch", "foot", "micron")
_WITH_SIGN: Final = ("--rotate", "--center", "--box", "--range")
"""Flags whose values may begin with a minus sign, which argparse takes for a flag."""
_USUAL: Final = {
    "units": None,
    "scale": None,
    "rotate": None,
    "center": None,
    "as_placed": False,
    "drop": True,
    "fuse": False,
}
"""Flags of models as they are where nobody sets them."""
_SMALLEST_BOX: Final = 0.01  # mm


def add_models(
    parser: argparse.ArgumentParser,
    *,
    gcode: bool = False,
    flag: str = "",
    meaning: str = "",
    required: bool = False,
) -> None:
    """The models of a command, and the flags that say how they are taken.

    Args:
        parser: of the command.
        gcode: whether one G-code file may stand in their place.
        flag: for commands whose models are not what comes first: the flag that names them.
        meaning: of that flag.
        required: whether it must be given.
    """
    metavar = "MODEL|FILE.gcode" if gcode else "MODEL"
    if flag:
        parser.add_argument(
            flag,
            dest="models",
            metavar=metavar,
            type=Path,
            nargs="+",
            default=[],
            required=required,
            help=meaning,
        )
    else:
        what = "parts, on one plate as their files place them" + (
            "; or G-code of any slicer" if gcode else ": STL, 3MF, OBJ, PLY, OFF, GLB, STEP, ..."
        )
        parser.add_argument("models", metavar=metavar, type=Path, nargs="+", help=what)
    _add_group(parser)


def _add_group(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("model")
    group.add_argument(
        "--units",
        choices=UNITS,
        metavar="UNIT",
        help=f"what the numbers in the files mean: {', '.join(UNITS)}; default: what the files say, else mm",
    )
    group.add_argument(
        "--scale", metavar="FACTOR", type=_factors, help="2, 50%% or X,Y,Z; about the origin of the file"
    )
    group.add_argument(
        "--rotate",
        metavar="ANGLES",
        type=_angles,
        help="degrees about z, or X,Y,Z: about x, then y, then z; after --scale",
    )
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "--center", metavar="X,Y", type=_point, help="where the middle goes; default: middle of the bed"
    )
    where.add_argument(
        "--as-placed", action="store_true", help="keep x and y of the files: they are those of the bed"
    )
    group.add_argument(
        "--drop",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="put the plate down on the bed (default), or keep z of the files",
    )
    group.add_argument(
        "--fuse",
        action="store_true",
        help="print overlapping parts of several files as one part; default: an error",
    )


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


def _factors(text: str) -> _Factors:
    """One factor for all axes or one for each, as numbers or percentages."""
    example = "a factor over 0 such as 2, 50% or 1,1,2"
    words = [word.strip() for word in text.split(",")]
    plain = ",".join(word.removesuffix("%") for word in words)
    numbers = _numbers(plain, (1, 3), example)
    factors = [
        number / 100 if word.endswith("%") else number for number, word in zip(numbers, words, strict=True)
    ]
    if not all(factor > 0 for factor in factors):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}; mirror a part where it was made")
    x, y, z = factors * 3 if len(factors) == 1 else factors
    return _Factors(x, y, z, text)


def _angles(text: str) -> tuple[float, float, float]:
    numbers = _numbers(text, (1, 3), "degrees about z such as 45, or X,Y,Z such as 90,0,45")
    x, y, z = [0.0, 0.0, *numbers] if len(numbers) == 1 else numbers
    return x, y, z


def _point(text: str) -> tuple[float, float]:
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


def refuse_model_flags(arguments: argparse.Namespace) -> None:
    """G-code is printed as it is, and alone.

    Raises:
        UsageError: a flag wants to change it, or there is more than one file.
    """
    if len(arguments.models) > 1:
        raise UsageError(
            f"{arguments.models[0]}: G-code is printed alone, but there are {len(arguments.models)} files",
            remedy="slice several models together, or print one file after the other",
        )
    given = [name for name, usual in _USUAL.items() if getattr(arguments, name) != usual]
    if given:
        flag = "--no-drop" if given[0] == "drop" else f"--{given[0].replace('_', '-')}"
        raise UsageError(
            f"{arguments.models[0]}: {flag} has no meaning for G-code, which is printed as it is",
            remedy="leave it out, or give the model",
        )
