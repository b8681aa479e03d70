"""Options that several commands share: profiles and settings, models, output, checks, connection."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from printer_slicer.cli.help import advanced
from printer_slicer.errors import UsageError

__all__ = [
    "FIRMWARES",
    "SETTING_OPTIONS",
    "STRICT",
    "SettingOption",
    "add_allow",
    "add_connection",
    "add_firmware",
    "add_layer_options",
    "add_machine",
    "add_models",
    "add_output",
    "add_settings",
    "address",
    "angles",
    "attach_values",
    "box_of",
    "copies",
    "factor",
    "factors",
    "height",
    "infill_share",
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
"""Options whose values may begin with a minus sign, which argparse would take for an option."""
_SMALLEST_BOX: Final = 0.01  # mm


def address(text: str) -> tuple[str, int]:
    """Parse HOST:PORT."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65_535:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:8888")
    return host.strip("[]") or "127.0.0.1", int(port)


def factor(text: str) -> float:
    """Parse a factor, 0 or more."""
    return _number(text, "0 or more", lambda value: 0 <= value < inf)


def height(text: str) -> float:
    """Parse a height above the bed, mm."""
    return _number(text, "a height above the bed in mm, such as 2.4", lambda value: 0 <= value < 10000)


def length(text: str) -> float:
    """Parse a length in mm, greater than 0."""
    return _number(text, "a length in mm, such as 0.4", lambda value: 0 < value < 1000)


def number(text: str) -> float:
    """Parse any number."""
    return _number(text, "a number, such as 0.02", lambda _: True)


def copies(text: str) -> int:
    """Return a number of copies."""
    return int(_number(text, "a number of copies from 1 to 1000", lambda value: 1 <= value <= 1000, int))


def pixels(text: str) -> int:
    """Parse the size of a picture in pixels."""
    return int(_number(text, "a whole number between 100 and 8000", lambda value: 100 <= value <= 8000, int))


def positive(text: str) -> int:
    """Parse a whole number greater than 0."""
    return int(_number(text, "a whole number greater than 0", lambda value: value > 0, int))


def whole(text: str) -> int:
    """Parse a whole number."""
    return int(_number(text, "a whole number", lambda _: True, int))


def _number(
    text: str, expected: str, fits: Callable[[float], bool], read: Callable[[str], float] = float
) -> float:
    """Parse a number, and raise an error that says what is expected if it does not fit."""
    with suppress(ValueError):
        value = read(text)
        if fits(value):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: expected {expected}")


def patience(text: str) -> float:
    """Parse a time in s, 0 or more."""
    return _number(text, "seconds, 0 or more, such as 120", lambda value: 0 <= value < inf)


def seconds(text: str) -> float:
    """Parse a time such as 90m, 1h30m, 45s or 5400 into seconds."""
    number = r"(\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"{number}h\s*{number}()", text.strip())  # 1h30: minutes
    found = found or re.fullmatch(rf"(?:{number}h)?\s*(?:{number}m(?:in)?)?\s*(?:{number}s?)?", text.strip())
    if not found or not any(found.groups()):
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; write 1h30m, 90m or 5400 (seconds)")
    hours, minutes, seconds = (float(part or 0) for part in found.groups())
    return 3600 * hours + 60 * minutes + seconds


def attach_values(argv: Sequence[str]) -> list[str]:
    """Join values such as `-90,0,0` to their options, as argparse needs it."""
    result: list[str] = []
    for argument in argv:
        if result and result[-1] in _WITH_SIGN and re.match(r"-[\d.]", argument):
            result[-1] += f"={argument}"
        else:
            result.append(argument)
    return result


def _numbers(text: str, counts: tuple[int, ...], example: str) -> list[float]:
    """Parse numbers separated by commas, as many as one of the counts."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}")
    return numbers


class _Factors(NamedTuple):
    """Scale factors along each axis, and as they were typed."""

    x: float
    y: float
    z: float
    text: str


def factors(text: str) -> _Factors:
    """Parse one factor for all axes or one for each, as numbers or percentages."""
    example = "a factor greater than 0, such as 2, 50% or 1,1,2"
    words = [word.strip() for word in text.split(",")]
    plain = ",".join(word.removesuffix("%") for word in words)
    numbers = _numbers(plain, (1, 3), example)
    each = [
        number / 100 if word.endswith("%") else number for number, word in zip(numbers, words, strict=True)
    ]
    if not all(one > 0 for one in each):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}; parts cannot be mirrored here")
    x, y, z = each * 3 if len(each) == 1 else each
    return _Factors(x, y, z, text)


def angles(text: str) -> tuple[float, float, float]:
    """Parse degrees about z, or about x, y and z."""
    numbers = _numbers(text, (1, 3), "degrees about z such as 45, or X,Y,Z such as 90,0,45")
    x, y, z = [0.0, 0.0, *numbers] if len(numbers) == 1 else numbers
    return x, y, z


def point(text: str) -> tuple[float, float]:
    """Parse a point on the bed, mm."""
    x, y = _numbers(text, (2,), "X,Y in mm on the bed, such as 110,110")
    return x, y


def box_of(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Parse two corners of a rectangle on the bed, mm."""
    example = "two corners X0,Y0,X1,Y1 in mm on the bed, such as 100,100,120,110"
    x0, y0, x1, y1 = _numbers(text, (4,), example)
    if min(abs(x1 - x0), abs(y1 - y0)) < _SMALLEST_BOX:
        raise argparse.ArgumentTypeError(f"{text!r}: smaller than {_SMALLEST_BOX:g} mm; expected {example}")
    return (x0, y0), (x1, y1)


_Flags = argparse._ActionsContainer  # noqa: SLF001 - a parser or a group of one


# Output


def add_output(
    parser: argparse.ArgumentParser, group: argparse._ArgumentGroup | None = None
) -> argparse._ArgumentGroup:
    """Add the options for the form of the output, to this group or to a new one; return the group."""
    group = group or parser.add_argument_group("output")
    group.add_argument("--json", action="store_true", help="print the result as JSON")
    advanced(group.add_argument("-q", "--quiet", action="store_true", help="print only errors"))
    advanced(group.add_argument("-v", "--verbose", action="store_true", help="print more details"))
    return group


# Profiles and settings


def add_settings(parser: argparse.ArgumentParser, *, strict: str = "") -> argparse._ArgumentGroup:
    """Add the options that choose profiles and change settings; return their group.

    Args:
        parser: of the command.
        strict: help of --strict, for commands that slice; these also get the everyday print settings.
    """
    group = parser.add_argument_group("settings")
    group.add_argument("--printer", metavar="NAME", help="printer profile: a name or a .toml file")
    group.add_argument("--material", metavar="NAME", help="material profile: a name or a .toml file")
    group.add_argument("--quality", metavar="NAME", help="quality profile: a name or a .toml file")
    if strict:
        _add_setting_options(group, is_advanced=False)
        group.add_argument(
            "--supports",
            metavar="STYLE",
            nargs="?",
            action=_SupportsAction,
            help="not available yet",
        )
        advanced(
            group.add_argument(
                "--load",
                metavar="FILE",
                type=Path,
                action="append",
                default=[],
                help="take profiles from a file of PrusaSlicer, OrcaSlicer or Cura, or a .toml file; may be repeated",
            )
        )
    group.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting; may be repeated"
    )
    advanced(
        group.add_argument(
            "--profiles",
            metavar="FOLDER",
            type=Path,
            action="append",
            default=[],
            help="search profiles in this folder first; may be repeated",
        )
    )
    if strict:
        advanced(group.add_argument("--strict", action="store_true", help=strict))
    return group


class _SupportsAction(argparse.Action):
    """Reject --supports with a remedy."""

    def __call__(self, *_: object) -> None:
        raise UsageError(
            "--supports: supports are not available yet",
            remedy="Rotate the part so that nothing needs support (--rotate), or model supports",
        )


STRICT: Final = "fail if the mesh needs repair"
_OPTIMAL: Final = " (--planner optimal)"


class SettingOption(NamedTuple):
    """An option that stands for a setting.

    Attributes:
        setting: its key.
        metavar: of the value.
        more: text behind the meaning of the setting.
        is_advanced: whether only --help-all shows it, among the options of the layer planner.
        alias: another name of the option.
        alone: value of the option if it is given without one; empty: it needs one.
        meaning: help, if not the meaning of the setting.
    """

    setting: str
    metavar: str
    more: str = ""
    is_advanced: bool = True
    alias: str = ""
    alone: str = ""
    meaning: str = ""

    @property
    def help(self) -> str:
        """Return the meaning of the setting, from where it is declared, and its choices."""
        if self.meaning:
            return self.meaning
        meaning, choices = _meanings()[self.setting]
        return meaning + (f": {choices}" if choices else "") + self.more


SETTING_OPTIONS: Final[Mapping[str, SettingOption]] = {
    "--layer-height": SettingOption("quality.layer_height", "MM", is_advanced=False),
    "--infill": SettingOption(
        "quality.infill_density",
        "PERCENT",
        is_advanced=False,
        meaning="infill density, such as 20%",
    ),
    "--walls": SettingOption(
        "quality.perimeters", "N", is_advanced=False, alias="--perimeters", meaning="number of perimeters"
    ),
    "--brim": SettingOption(
        "quality.brim_width",
        "MM",
        is_advanced=False,
        alone="5",
        meaning="brim around the part; without MM 5 mm wide",
    ),
    "--planner": SettingOption("quality.planner.kind", "NAME"),
    "--tolerance": SettingOption("quality.tolerance", "MM"),
    "--first-layer": SettingOption("quality.first_layer_height", "MM"),
    "--containment": SettingOption("quality.containment", "NAME"),
    "--objective": SettingOption("quality.planner.objective", "NAME", _OPTIMAL),
    "--error-price": SettingOption("quality.planner.error_price", "S", _OPTIMAL),
    "--snap": SettingOption("quality.planner.snap_tolerance", "MM", _OPTIMAL),
    "--max-step": SettingOption("quality.planner.max_step", "MM", _OPTIMAL),
    "--max-layers": SettingOption("quality.planner.max_layers", "N", _OPTIMAL),
    "--time-budget": SettingOption(
        "quality.planner.time_budget", "TIME", "; for example 90m, 1h30m or 5400" + _OPTIMAL
    ),
}
"""Option -> setting, in the order of the help."""


def infill_share(text: str) -> float:
    """Return an infill density from 0 to 1: `20%` and `20` are 0.2, as in other slicers."""
    expected = "a percentage, such as 20%; the pattern is set by --set infill=gyroid"
    value = _number(text.removesuffix("%"), expected, lambda value: 0 <= value <= _WHOLE_PERCENT)
    return value / _WHOLE_PERCENT if text.endswith("%") or value > 1 else value


_WHOLE_PERCENT: Final = 100
_READERS: Final[Mapping[str, Callable[[str], object]]] = {"--time-budget": seconds, "--infill": infill_share}


@cache
def _meanings() -> Mapping[str, tuple[str, str]]:
    """Return the meaning and the choices of each setting; settings of the optimal planner without its name."""
    from printer_slicer.profile.tables import settings_table

    rows = [row for row in settings_table() if "[" not in row.key or "[optimal]" in row.key]
    return {row.key.replace("[optimal]", ""): (row.meaning, row.choices) for row in rows}


class _SettingAction(argparse._StoreAction):  # noqa: SLF001 - what `action="store"` is has no other name
    """An action whose help is made when it is read, so that parsing does not load the settings."""

    def __init__(self, *given: Any, option: SettingOption, **named: Any) -> None:
        self._option = option
        super().__init__(*given, **named)

    @property
    def help(self) -> str:
        """Return the text for --help."""
        return self._option.help.replace("%", "%%")

    @help.setter  # noqa: A003 - argparse's name for it
    def help(self, _: object) -> None:
        """Ignore what argparse sets."""


def _add_setting_options(group: argparse._ArgumentGroup, *, is_advanced: bool) -> None:
    """Add the options of one tier that stand for a setting."""
    for flag, option in SETTING_OPTIONS.items():
        if option.is_advanced != is_advanced:
            continue
        optional: dict[str, Any] = {"nargs": "?", "const": option.alone} if option.alone else {}
        action = group.add_argument(
            flag,
            *([option.alias] if option.alias else []),
            action=_SettingAction,
            option=option,
            metavar=option.metavar,
            dest=f"setting {option.setting}",
            type=_READERS.get(flag, str),
            **optional,
        )
        if is_advanced:
            advanced(action)


def add_layer_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for overrides and for the layer planner."""
    group = parser.add_argument_group("overrides")
    advanced(
        group.add_argument(
            "--range",
            metavar="LOW:HIGH:KEY=VALUE",
            action="append",
            default=[],
            help="change a setting, tolerance or layer_height between two heights in mm; may be repeated",
        )
    )
    advanced(
        group.add_argument(
            "--set-for",
            metavar="OBJECT:KEY=VALUE",
            action="append",
            default=[],
            help="change a setting for one object; may be repeated",
        )
    )
    group = parser.add_argument_group("layer planner")
    _add_setting_options(group, is_advanced=True)
    advanced(
        group.add_argument(
            "--heights",
            metavar="LIST",
            dest="setting heights",
            help="allowed layer heights in mm: 0.1,0.2,0.3 or LOW:HIGH or LOW:HIGH:STEP",
        )
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
    "copies": 1,
}
"""Defaults of the options for models."""


def add_models(
    parser: argparse.ArgumentParser,
    *,
    gcode: bool = False,
    flag: str = "",
    meaning: str = "",
    required: bool = False,
) -> None:
    """Add the models of a command, and the options for their units and placement.

    Args:
        parser: of the command.
        gcode: whether one G-code file may be given instead.
        flag: the option that names the models, for commands with another positional argument.
        meaning: help of that option.
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
        what = "models (STL, 3MF, OBJ, STEP, ...), printed together on one plate" + (
            "; or one G-code file" if gcode else ""
        )
        parser.add_argument("models", metavar=metavar, type=Path, nargs="+", help=what)
    _add_placement(parser)


def _add_placement(parser: argparse.ArgumentParser) -> None:
    """Add the options for units and placement of models."""
    group = parser.add_argument_group("model placement")
    group.add_argument("--scale", metavar="FACTOR", type=factors, help="2, 50%% or X,Y,Z factors")
    group.add_argument(
        "--rotate", metavar="ANGLES", type=angles, help="degrees about z, or X,Y,Z; after --scale"
    )
    advanced(
        group.add_argument(
            "--copies",
            metavar="N",
            type=copies,
            default=1,
            help="print this many of all models, in rows and columns beside each other",
        )
    )
    where = group.add_mutually_exclusive_group()
    advanced(
        where.add_argument(
            "--center", metavar="X,Y", type=point, help="centre of the plate; default: centre of the bed"
        )
    )
    advanced(
        where.add_argument(
            "--as-placed", action="store_true", help="keep x and y of the files as bed coordinates"
        )
    )
    advanced(
        group.add_argument(
            "--drop",
            action=argparse.BooleanOptionalAction,
            default=True,
            help="move the models down onto the bed (default), or keep the z of the files",
        )
    )
    advanced(
        group.add_argument(
            "--units",
            choices=UNITS,
            metavar="UNIT",
            help=f"unit of the files: {', '.join(UNITS)}; default: as the files say, else mm",
        )
    )
    advanced(
        group.add_argument(
            "--fuse",
            action="store_true",
            help="print overlapping parts of several files as one part; default: an error",
        )
    )


def refuse_model_flags(arguments: argparse.Namespace) -> None:
    """Refuse options for models, and further files, if G-code is printed.

    Raises:
        UsageError: there is such an option, or more than one file.
    """
    if len(arguments.models) > 1:
        raise UsageError(
            f"{arguments.models[0]}: only one G-code file can be printed at a time, not {len(arguments.models)}",
            remedy="Print the files one after the other, or slice the models together",
        )
    given = [name for name, usual in _USUAL.items() if getattr(arguments, name) != usual]
    if given:
        flag = "--no-drop" if given[0] == "drop" else f"--{given[0].replace('_', '-')}"
        raise UsageError(
            f"{arguments.models[0]}: {flag} does not apply to G-code, which is printed as it is",
            remedy=f"Leave out {flag}, or give the model instead",
        )


# G-code and machines


# The keys of diagnostics.NAMES, which is not imported to keep --help fast.
_ALLOWED: Final = (
    "temperature, box, feed, flow, ratio, unsupported, cold, homing, eeprom, limits, calibration, autotune, "
    "protection, endstops, offsets, halt, wait, firmware, files, pins, macros, link, debug, shell, unreadable"
)


def add_allow(parser: _Flags) -> None:
    """Add the option that accepts G-code with findings that are errors otherwise."""
    advanced(
        parser.add_argument(
            "--allow",
            metavar="NAME",
            action="append",
            default=[],
            help=f"accept G-code despite this error; may be repeated: {_ALLOWED}",
        )
    )


def add_machine(parser: _Flags) -> None:
    """Add the options for the machine that G-code is checked for."""
    parser.add_argument("--printer", metavar="NAME", help="printer profile: a name or a .toml file")
    parser.add_argument("--material", metavar="NAME", help="material profile: a name or a .toml file")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting; may be repeated"
    )
    add_allow(parser)


def add_connection(parser: argparse.ArgumentParser) -> None:
    """Add the options for the connection to a printer, and for its loss."""
    group = parser.add_argument_group("connection")
    advanced(
        group.add_argument(
            "--dtr",
            choices=("auto", "on", "off"),
            default="auto",
            help="level of the DTR line, which resets many boards when the port is opened; default: auto, as the "
            "system sets it",
        )
    )
    advanced(
        group.add_argument(
            "--reconnect",
            metavar="S",
            type=patience,
            default=30.0,
            help="seconds to wait for a printer whose cable was unplugged; default: 30",
        )
    )
    advanced(
        group.add_argument(
            "--guard",
            metavar="S",
            type=patience,
            default=120.0,
            help="if this program crashes and the print is not resumed within this many seconds, a second process "
            "switches the heaters off; 0: never; default: 120",
        )
    )


FIRMWARES: Final = (
    *("marlin 1.1", "marlin 2.0", "marlin 2.1", "marlin 2.1 advanced", "marlin 2.1.3", "prusa mk3"),
    *("reprapfirmware", "klipper", "repetier", "smoothie", "octoprint virtual"),
)
"""The names in `sim.firmwares`, which is not imported before it is needed; a test compares the two."""


def _firmware(text: str) -> str:
    """Return a name of the list, with its words joined by spaces."""
    name = " ".join(text.lower().replace("_", " ").replace("-", " ").split())
    if name not in FIRMWARES:
        raise argparse.ArgumentTypeError(f"unknown firmware {text!r}; choose one of: {', '.join(FIRMWARES)}")
    return name


def add_firmware(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options for the simulated printer; return their group."""
    group = parser.add_argument_group("simulated printer")
    advanced(
        group.add_argument(
            "--firmware",
            metavar="NAME",
            type=_firmware,
            help=f"firmware, for which parts are sliced too: {', '.join(FIRMWARES)}; default: marlin 2.1 with the "
            "commands of the printer's flavour",
        )
    )
    advanced(
        group.add_argument(
            "--extruders",
            metavar="N",
            type=positive,
            help="number of extruders; default: 1, or up to the tool that the printer's profile uses",
        )
    )
    advanced(group.add_argument("--one-hotend", action="store_true", help="all extruders share one hotend"))
    group.add_argument("--faults", metavar="FILE.toml", type=Path, help="fault script, see docs/simulator.md")
    advanced(
        group.add_argument(
            "--seed", metavar="N", type=whole, help="random seed of faults; default: of the script, else 0"
        )
    )
    return group
