"""Arguments that several commands share: settings, models, output, and what decides about a print."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from printer_slicer.errors import UsageError

__all__ = [
    "DIALS",
    "FIRMWARES",
    "Dial",
    "add_allow",
    "add_connection",
    "add_firmware",
    "add_machine",
    "add_models",
    "add_output",
    "add_settings",
    "add_slicing",
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
    "refuse_model_flags",
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


_Flags = argparse._ActionsContainer  # noqa: SLF001 - a parser or a group of one


# How results are said


def add_output(parser: argparse.ArgumentParser) -> None:
    """Flags that decide how results are said."""
    group = parser.add_argument_group("output")
    group.add_argument("--json", action="store_true", help="machine-readable result on stdout")
    group.add_argument("-q", "--quiet", action="store_true", help="only errors")
    group.add_argument("-v", "--verbose", action="store_true", help="more about what happens")


# Profiles and settings


def add_slicing(parser: argparse.ArgumentParser, *, strict: str = "fail if the mesh needs repair") -> None:
    """Flags that decide how a part becomes G-code, and how results are said; `strict` is the help of --strict."""
    group = add_settings(parser)
    group.add_argument("--strict", action="store_true", help=strict)
    _add_dials(parser)
    add_output(parser)


def add_settings(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The flags that choose profiles and change settings."""
    group = parser.add_argument_group("settings")
    group.add_argument("--printer", metavar="NAME", help="printer profile, or path of a .toml file")
    group.add_argument("--material", metavar="NAME", help="material profile, likewise")
    group.add_argument("--quality", metavar="NAME", help="quality profile, likewise")
    group.add_argument(
        "--profiles",
        metavar="FOLDER",
        type=Path,
        action="append",
        default=[],
        help="look for profiles there first; may be repeated",
    )
    group.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )
    return group


OPTIMAL: Final = " (--planner optimal)"


class Dial(NamedTuple):
    """A flag: the setting that it stands for, what is typed, and what is to be told beside the setting's meaning."""

    setting: str
    metavar: str
    more: str = ""

    @property
    def help(self) -> str:
        """What it means, from where the setting is declared."""
        meaning, choices = _meanings()[self.setting]
        return meaning + (f": {choices}" if choices else "") + self.more


DIALS: Final[Mapping[str, Dial]] = {
    "--layer-height": Dial("quality.layer_height", "MM", "; ranges may have their own layer_height"),
    "--planner": Dial("quality.planner.kind", "NAME"),
    "--tolerance": Dial("quality.tolerance", "MM"),
    "--first-layer": Dial("quality.first_layer_height", "MM"),
    "--containment": Dial("quality.containment", "NAME"),
    "--objective": Dial("quality.planner.objective", "NAME", OPTIMAL),
    "--error-price": Dial("quality.planner.error_price", "S", OPTIMAL),
    "--snap": Dial("quality.planner.snap_tolerance", "MM", OPTIMAL),
    "--max-step": Dial("quality.planner.max_step", "MM", OPTIMAL),
    "--max-layers": Dial("quality.planner.max_layers", "N", OPTIMAL),
    "--time-budget": Dial("quality.planner.time_budget", "TIME", ", as 90m, 1h30m, 5400" + OPTIMAL),
}
_READERS: Final[Mapping[str, Callable[[str], object]]] = {"--time-budget": seconds}


@cache
def _meanings() -> Mapping[str, tuple[str, str]]:
    """Setting -> meaning, and the words of which it is one; settings of a planner without its name."""
    from printer_slicer.profile.tables import settings_table

    rows = [row for row in settings_table() if "[" not in row.key or "[optimal]" in row.key]
    return {row.key.replace("[optimal]", ""): (row.meaning, row.choices) for row in rows}


class _Lazy(argparse._StoreAction):  # noqa: SLF001 - what `action="store"` is has no other name
    """A flag whose help is made when it is read: parsing need not load the settings."""

    def __init__(self, *given: Any, dial: Dial, **named: Any) -> None:
        self._dial = dial
        super().__init__(*given, **named)

    @property
    def help(self) -> str:
        """What --help says."""
        return self._dial.help.replace("%", "%%")

    @help.setter  # noqa: A003 - argparse's name for it
    def help(self, _: object) -> None:
        """Stays what the setting says."""


def _add_dials(parser: argparse.ArgumentParser) -> None:
    """Flags that decide where layers end, and what differs from place to place."""
    group = parser.add_argument_group("layer heights")
    for flag, dial in DIALS.items():
        group.add_argument(
            flag,
            action=_Lazy,
            dial=dial,
            metavar=dial.metavar,
            dest=f"dial {dial.setting}",
            type=_READERS.get(flag, str),
        )
    group.add_argument(
        "--heights",
        metavar="LIST",
        dest="dial heights",
        help="the only heights: 0.1,0.2,0.3 or LOW:HIGH or LOW:HIGH:STEP, in mm",
    )
    group = parser.add_argument_group("places of their own")
    group.add_argument(
        "--range",
        metavar="LOW:HIGH:KEY=VALUE",
        action="append",
        default=[],
        help="between two heights in mm another setting, or tolerance=MM or layer_height=MM; may be repeated",
    )
    group.add_argument(
        "--set-for",
        metavar="OBJECT:KEY=VALUE",
        action="append",
        default=[],
        help="another setting for one of several objects; may be repeated",
    )


# Models


UNITS: Final = ("mm", "cm", "m", "inch", "foot", "micron")
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
        "--scale", metavar="FACTOR", type=factors, help="2, 50%% or X,Y,Z; about the origin of the file"
    )
    group.add_argument(
        "--rotate",
        metavar="ANGLES",
        type=angles,
        help="degrees about z, or X,Y,Z: about x, then y, then z; after --scale",
    )
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "--center", metavar="X,Y", type=point, help="where the middle goes; default: middle of the bed"
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


# G-code and machines


# The keys of diagnostics.NAMES, which is not imported: --help answers at once.
_ALLOWED: Final = (
    "temperature, box, feed, flow, ratio, unsupported, cold, homing, eeprom, limits, calibration, autotune, "
    "protection, endstops, offsets, halt, wait, firmware, files, pins, macros, link, debug, shell, unreadable"
)


def add_allow(parser: _Flags) -> None:
    """What may be in a job although it is usually refused."""
    parser.add_argument(
        "--allow",
        metavar="NAME",
        action="append",
        default=[],
        help=f"take G-code although this is in it; may be repeated: {_ALLOWED}",
    )


def add_machine(parser: _Flags) -> None:
    """The machine by which G-code is judged, and what it may hold all the same."""
    add_allow(parser)
    parser.add_argument("--printer", metavar="NAME", help="printer profile, or path of a .toml file")
    parser.add_argument("--material", metavar="NAME", help="material profile, likewise")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )


def add_connection(parser: argparse.ArgumentParser) -> None:
    """Flags of a print over a port: what happens when the printer or this program is gone."""
    parser.add_argument(
        "--dtr",
        choices=("auto", "on", "off"),
        default="auto",
        help="level of the line that resets many boards when the port is opened; default: auto, as the system does",
    )
    parser.add_argument(
        "--reconnect",
        metavar="S",
        type=patience,
        default=30.0,
        help="wait so long for a printer whose cable was pulled; default: 30",
    )
    parser.add_argument(
        "--guard",
        metavar="S",
        type=patience,
        default=120.0,
        help="if this program dies and nobody resumes the print for so long, a second process switches the heaters "
        "off; 0: never, nor when the printer is given up; default: 120",
    )


FIRMWARES: Final = (
    *("marlin 1.1", "marlin 2.0", "marlin 2.1", "marlin 2.1 advanced", "marlin 2.1.3", "prusa mk3"),
    *("reprapfirmware", "klipper", "repetier", "smoothie", "octoprint virtual"),
)
"""As `sim.front_end` has them, which is not imported before it is needed; a test holds the two equal."""


def _firmware(text: str) -> str:
    """A name of the list, however its words are joined."""
    name = " ".join(text.lower().replace("_", " ").replace("-", " ").split())
    if name not in FIRMWARES:
        raise argparse.ArgumentTypeError(f"{text!r} is not known; known are {', '.join(FIRMWARES)}")
    return name


def add_firmware(parser: argparse.ArgumentParser) -> None:
    """Flags that decide which firmware is simulated and what goes wrong with it."""
    group = parser.add_argument_group("simulated printer")
    group.add_argument(
        "--firmware",
        metavar="NAME",
        type=_firmware,
        help=f"simulated firmware: {', '.join(FIRMWARES)}; parts are sliced for it; default: marlin 2.1 with the "
        "commands of the printer's flavour",
    )
    group.add_argument(
        "--extruders",
        metavar="N",
        type=positive,
        help="how many it has; default: 1, or up to the tool that the printer's profile prints with",
    )
    group.add_argument(
        "--one-hotend", action="store_true", help="the extruders share one, as with a changer of filaments"
    )
    group.add_argument(
        "--faults", metavar="FILE.toml", type=Path, help="what shall go wrong, see docs/simulator.md"
    )
    group.add_argument(
        "--seed", metavar="N", type=whole, help="of all chance; default: as the file says, else 0"
    )
