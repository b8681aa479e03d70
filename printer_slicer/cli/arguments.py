"""Options that several commands share: for profiles and settings, models, output, checks and the connection."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from printer_slicer.cli.help import mark_advanced

if TYPE_CHECKING:
    from printer_slicer.cli.setting_options import SettingOption

__all__ = [
    "MAX_COPIES",
    "STRICT_HELP",
    "add_allow_option",
    "add_keep_up_option",
    "add_layer_options",
    "add_machine_options",
    "add_model_options",
    "add_output_options",
    "add_printers_file_option",
    "add_setting_options",
    "add_strict_supports_option",
    "add_transform_options",
    "add_units_option",
    "attach_values",
    "parse_address",
    "parse_angles",
    "parse_box",
    "parse_copies",
    "parse_distance",
    "parse_duration",
    "parse_factor",
    "parse_height",
    "parse_infill_density",
    "parse_integer",
    "parse_length",
    "parse_number",
    "parse_pixels",
    "parse_point",
    "parse_positive_integer",
    "parse_scale",
    "parse_tilt",
    "parse_timeout",
]

MAX_COPIES: Final = 1000
"""Maximum number of copies of a model."""

_SIGNED_OPTIONS: Final = ("--rotate", "--center", "--box", "--range")
"""Options whose values may begin with a minus sign; argparse would mistake such a value for an option."""
_SHORTEST_SIDE: Final = 0.01  # mm, of a box
_WHOLE_PERCENT: Final = 100


def attach_values(argv: Sequence[str]) -> list[str]:
    """Join values such as `-90,0,0` to their options with `=`, because argparse would take them for options."""
    result: list[str] = []
    for argument in argv:
        if result and result[-1] in _SIGNED_OPTIONS and re.match(r"-[\d.]", argument):
            result[-1] += f"={argument}"
        else:
            result.append(argument)
    return result


def parse_address(text: str) -> tuple[str, int]:
    """Parse HOST:PORT into a host name and a port number."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65_535:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:8888")
    return host.strip("[]") or "127.0.0.1", int(port)


def parse_distance(text: str) -> float:
    """Parse a distance in mm, 0 or more."""
    return _parse_checked_number(text, "a distance below 1000 mm, such as 6", lambda value: 0 <= value < 1000)


def parse_factor(text: str) -> float:
    """Parse a factor, 0 or more."""
    return _parse_checked_number(text, "0 or more", lambda value: 0 <= value < inf)


def parse_height(text: str) -> float:
    """Parse a height above the bed, mm."""
    return _parse_checked_number(
        text, "a height above the bed in mm, such as 2.4", lambda value: 0 <= value < 10000
    )


def parse_length(text: str) -> float:
    """Parse a length in mm, greater than 0."""
    return _parse_checked_number(text, "a length in mm, such as 0.4", lambda value: 0 < value < 1000)


def parse_number(text: str) -> float:
    """Parse any number."""
    return _parse_checked_number(text, "a number, such as 0.02", lambda _: True)


def parse_copies(text: str) -> int:
    """Parse a number of copies, 1 to `MAX_COPIES`."""
    expected = f"a number of copies from 1 to {MAX_COPIES}"
    return int(_parse_checked_number(text, expected, lambda value: 1 <= value <= MAX_COPIES, int))


def parse_pixels(text: str) -> int:
    """Parse the size of a picture in pixels."""
    return int(
        _parse_checked_number(
            text, "a whole number between 100 and 8000", lambda value: 100 <= value <= 8000, int
        )
    )


def parse_positive_integer(text: str) -> int:
    """Parse a whole number greater than 0."""
    return int(_parse_checked_number(text, "a whole number greater than 0", lambda value: value > 0, int))


def parse_integer(text: str) -> int:
    """Parse a whole number."""
    return int(_parse_checked_number(text, "a whole number", lambda _: True, int))


def _parse_checked_number(
    text: str, expected: str, is_valid: Callable[[float], bool], convert: Callable[[str], float] = float
) -> float:
    """Parse a number, and raise an error with the text `expected` if it is not valid."""
    with suppress(ValueError):
        value = convert(text)
        if is_valid(value):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: expected {expected}")


def parse_tilt(text: str) -> float:
    """Parse an angle from the vertical, degrees."""
    return _parse_checked_number(text, "degrees from 0 to 180, such as 60", lambda value: 0 <= value <= 180)


def parse_timeout(text: str) -> float:
    """Parse a time in s, 0 or more."""
    return _parse_checked_number(text, "seconds, 0 or more, such as 120", lambda value: 0 <= value < inf)


def parse_duration(text: str) -> float:
    """Parse a duration such as 90m, 1h30m, 45s or 5400; return it in seconds."""
    number = r"(\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"{number}h\s*{number}()", text.strip())  # 1h30: minutes
    found = found or re.fullmatch(rf"(?:{number}h)?\s*(?:{number}m(?:in)?)?\s*(?:{number}s?)?", text.strip())
    if not found or not any(found.groups()):
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; write 1h30m, 90m or 5400 (seconds)")
    hours, minutes, seconds = (float(part or 0) for part in found.groups())
    return 3600 * hours + 60 * minutes + seconds


def _parse_numbers(text: str, counts: tuple[int, ...], example: str) -> list[float]:
    """Parse numbers separated by commas; `counts` are the numbers of them that are allowed."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise argparse.ArgumentTypeError(f"{text!r}: expected {example}")
    return numbers


class _ScaleFactors(NamedTuple):
    """Scale factors along x, y and z, and the text that was typed."""

    x: float
    y: float
    z: float
    text: str


def parse_scale(text: str) -> _ScaleFactors:
    """Parse one scale factor for all axes, or one for each; they may be percentages."""
    example = "a factor greater than 0, such as 2, 50% or 1,1,2"
    words = [word.strip() for word in text.split(",")]
    plain = ",".join(word.removesuffix("%") for word in words)
    numbers = _parse_numbers(plain, (1, 3), example)
    each = [
        number / 100 if word.endswith("%") else number for number, word in zip(numbers, words, strict=True)
    ]
    if not all(one > 0 for one in each):
        raise argparse.ArgumentTypeError(
            f"{text!r}: expected {example}; negative factors cannot mirror a part"
        )
    x, y, z = each * 3 if len(each) == 1 else each
    return _ScaleFactors(x, y, z, text)


def parse_angles(text: str) -> tuple[float, float, float]:
    """Parse rotation angles in degrees: one about z, or three about x, y and z."""
    numbers = _parse_numbers(text, (1, 3), "degrees about z such as 45, or X,Y,Z such as 90,0,45")
    x, y, z = [0.0, 0.0, *numbers] if len(numbers) == 1 else numbers
    return x, y, z


def parse_point(text: str) -> tuple[float, float]:
    """Parse a point on the bed, mm."""
    x, y = _parse_numbers(text, (2,), "X,Y in mm on the bed, such as 110,110")
    return x, y


def parse_box(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Parse two corners of a rectangle on the bed, mm."""
    example = "two corners X0,Y0,X1,Y1 in mm on the bed, such as 100,100,120,110"
    x0, y0, x1, y1 = _parse_numbers(text, (4,), example)
    if min(abs(x1 - x0), abs(y1 - y0)) < _SHORTEST_SIDE:
        raise argparse.ArgumentTypeError(
            f"{text!r}: a side is shorter than {_SHORTEST_SIDE:g} mm; expected {example}"
        )
    return (x0, y0), (x1, y1)


def parse_infill_density(text: str) -> float:
    """Parse an infill density in percent, `20%` or `20`, into a ratio from 0 to 1."""
    expected = "a percentage, such as 20%; the pattern is set by --set infill=gyroid"
    value = _parse_checked_number(
        text.removesuffix("%"), expected, lambda value: 0 <= value <= _WHOLE_PERCENT
    )
    if 0 < value <= 1 and not text.endswith("%"):
        percent = f"{_WHOLE_PERCENT * value:g}%"
        raise argparse.ArgumentTypeError(
            f"{text}: write {percent}" if value < 1 else f"{text}: write {percent} for solid infill, or 1%"
        )
    return value / _WHOLE_PERCENT


_Container = argparse._ActionsContainer  # noqa: SLF001 - base class of parsers and argument groups


# Output


def add_output_options(
    parser: argparse.ArgumentParser, group: argparse._ArgumentGroup | None = None
) -> argparse._ArgumentGroup:
    """Add --json, --quiet and --verbose to a group of options, by default to a new one; return the group."""
    group = group or parser.add_argument_group("output")
    group.add_argument("--json", action="store_true", help="print the result as JSON")
    mark_advanced(group.add_argument("-q", "--quiet", action="store_true", help="print only errors"))
    mark_advanced(group.add_argument("-v", "--verbose", action="store_true", help="print more details"))
    return group


# Profiles and settings


def add_setting_options(parser: argparse.ArgumentParser, *, strict_help: str = "") -> argparse._ArgumentGroup:
    """Add the options that choose profiles and change settings; return their group.

    Args:
        parser: parser of the command.
        strict_help: help of --strict, for commands that slice; they also get the options for everyday settings.
    """
    group = parser.add_argument_group("settings")
    group.add_argument("--printer", metavar="NAME", help="printer profile: a name or a .toml file")
    group.add_argument("--material", metavar="NAME", help="material profile: a name or a .toml file")
    group.add_argument("--quality", metavar="NAME", help="quality profile: a name or a .toml file")
    if strict_help:
        _add_slicing_options(group)
    group.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting; may be repeated"
    )
    mark_advanced(
        group.add_argument(
            "--profiles",
            metavar="FOLDER",
            type=Path,
            action="append",
            default=[],
            help="search for profiles in this folder first; may be repeated",
        )
    )
    if strict_help:
        mark_advanced(group.add_argument("--strict", action="store_true", help=strict_help))
    return group


def _add_slicing_options(group: argparse._ArgumentGroup) -> None:
    """Add the options for everyday settings, supports, and profiles of other slicers."""
    _add_single_setting_options(group, is_advanced=False)
    mark_advanced(
        group.add_argument(
            "--no-supports",
            action="store_const",
            const="off",
            dest="setting quality.support",
            help="print without supports",
        )
    )
    group.add_argument(
        "--load",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="profile file, also of PrusaSlicer, Orca or Cura",
    )


def add_strict_supports_option(group: argparse._ArgumentGroup) -> argparse._ArgumentGroup:
    """Add the option that rejects parts with unsupported islands; return the group."""
    mark_advanced(
        group.add_argument(
            "--strict-supports",
            action="store_true",
            help="fail if an island of the part gets no support",
        )
    )
    return group


STRICT_HELP: Final = "fail if the mesh needs repair"
_NO_SUPPORTS: Final = frozenset({"0", "false", "no", "none", "off"})
"""Values of --supports that switch supports off, in lower case."""

_PARSERS: Final[Mapping[str, Callable[[str], object]]] = {
    "--planner": str.lower,
    "--containment": str.lower,
    "--objective": str.lower,
    "--time-budget": parse_duration,
    "--infill": parse_infill_density,
    "--supports": lambda style: "off" if style.lower() in _NO_SUPPORTS else style.lower(),
}


class _SettingAction(argparse._StoreAction):  # noqa: SLF001 - what `action="store"` is has no other name
    """An action that creates its help text only when it is shown, so that parsing does not load the settings."""

    def __init__(self, *given: Any, option: SettingOption, **named: Any) -> None:
        self._option = option
        super().__init__(*given, **named)

    @property
    def help(self) -> str:
        """Return the text for --help."""
        return self._option.help.replace("%", "%%")

    @help.setter  # noqa: A003 - argparse's name for it
    def help(self, _: object) -> None:
        """Ignore the text that argparse sets."""


def _add_single_setting_options(group: argparse._ArgumentGroup, *, is_advanced: bool) -> None:
    """Add the options that change one setting each: the everyday ones, or the advanced ones."""
    from printer_slicer.cli.setting_options import SETTING_OPTIONS

    for flag, option in SETTING_OPTIONS.items():
        if option.is_advanced != is_advanced or not option.metavar:
            continue
        optional: dict[str, Any] = (
            {"nargs": "?", "const": option.value_if_omitted} if option.value_if_omitted else {}
        )
        action = group.add_argument(
            flag,
            *([option.alias] if option.alias else []),
            action=_SettingAction,
            option=option,
            metavar=option.metavar,
            dest=f"setting {option.setting}",
            type=_PARSERS.get(flag, str),
            **optional,
        )
        if is_advanced:
            mark_advanced(action)


def _add_switches(group: argparse._ArgumentGroup) -> None:
    """Add the options without a value that change one setting each."""
    from printer_slicer.cli.setting_options import SETTING_OPTIONS

    for flag, option in SETTING_OPTIONS.items():
        if not option.metavar:
            name, value = f"setting {option.setting}", option.value_if_omitted
            mark_advanced(
                group.add_argument(flag, action="store_const", const=value, dest=name, help=option.meaning)
            )


def add_layer_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for overrides and for the layer planner."""
    group = parser.add_argument_group("overrides")
    mark_advanced(
        group.add_argument(
            "--range",
            metavar="LOW:HIGH:KEY=VALUE",
            action="append",
            default=[],
            help="change a setting, or tolerance or layer_height, between two heights in mm, such as "
            "5:10:perimeters=4; may be repeated",
        )
    )
    mark_advanced(
        group.add_argument(
            "--set-for",
            metavar="OBJECT:KEY=VALUE",
            action="append",
            default=[],
            help="change a setting of one object, such as lid:perimeters=4; may be repeated",
        )
    )
    group = parser.add_argument_group("layer planner")
    _add_single_setting_options(group, is_advanced=True)
    mark_advanced(
        group.add_argument(
            "--heights",
            metavar="LIST",
            dest="setting heights",
            help="allowed layer heights in mm: a list such as 0.1,0.2,0.3, or a range LOW:HIGH or LOW:HIGH:STEP",
        )
    )


# Models


UNITS: Final = ("mm", "cm", "m", "inch", "foot", "micron")


def add_model_options(
    parser: argparse.ArgumentParser,
    *,
    gcode: bool = False,
    flag: str = "",
    meaning: str = "",
    required: bool = False,
    always_arranges: bool = False,
) -> None:
    """Add the argument for the models of a command, and the options for their units and placement.

    Args:
        parser: parser of the command.
        gcode: whether one G-code file may be given instead.
        flag: the option that names the models, for commands with another positional argument.
        meaning: help of that option.
        required: whether that option is required.
        always_arranges: whether the command arranges the models in any case.
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
        what = "models (STL, 3MF, STEP, ...); MODEL*3: three copies" + (
            "; or one G-code file" if gcode else ""
        )
        parser.add_argument("models", metavar=metavar, type=Path, nargs="+", help=what)
    _add_placement_options(parser, arranges=not flag, prints=gcode, always_arranges=always_arranges)


def _add_placement_options(
    parser: argparse.ArgumentParser, *, arranges: bool, prints: bool, always_arranges: bool
) -> None:
    """Add the options for units and placement of models.

    Args:
        parser: parser of the command.
        arranges: whether --arrange is an everyday option.
        prints: whether the command prints, so that --orient is not an everyday option.
        always_arranges: whether --gap is an everyday option instead of --arrange.
    """
    group = parser.add_argument_group("model placement")
    add_transform_options(group)
    if arranges:
        _add_orientation_options(group, is_advanced=prints)
    group.add_argument(
        "--copies",
        metavar="N",
        type=parse_copies,
        default=1,
        help="print N copies of each model, arranged on the bed",
    )
    _add_switches(group)
    where = group.add_mutually_exclusive_group()
    arrange = where.add_argument(
        "--arrange", action="store_true", help="arrange the parts; default: if they overlap"
    )
    if always_arranges or not arranges:
        mark_advanced(arrange)
    mark_advanced(
        where.add_argument(
            "--center",
            metavar="X,Y",
            type=parse_point,
            help="where to centre the models on the bed; default: the centre of the bed",
        )
    )
    mark_advanced(
        where.add_argument(
            "--as-placed", action="store_true", help="use the x and y of the files as positions on the bed"
        )
    )
    _add_plate_options(group, always_arranges=always_arranges)
    _add_file_reading_options(group)


def add_transform_options(group: argparse._ArgumentGroup) -> tuple[argparse.Action, argparse.Action]:
    """Add --scale and --rotate; return them."""
    scale = group.add_argument(
        "--scale",
        metavar="FACTOR",
        type=parse_scale,
        help="scale by a factor such as 2 or 50%%, or by X,Y,Z",
    )
    rotate = group.add_argument(
        "--rotate",
        metavar="ANGLES",
        type=parse_angles,
        help="rotate by degrees about z, or X,Y,Z; after --scale",
    )
    return scale, rotate


def _add_orientation_options(group: argparse._ArgumentGroup, *, is_advanced: bool) -> None:
    """Add the options that turn parts so that they print well; `is_advanced`: only --help-all shows them."""
    orient = group.add_argument(
        "--orient",
        choices=("off", "fast", "careful"),
        default="off",
        metavar="HOW",
        help="turn each part to print well: off, fast or careful",
    )
    if is_advanced:
        mark_advanced(orient)
    mark_advanced(add_keep_up_option(group, "--orient-keep-up"))
    mark_advanced(
        group.add_argument(
            "--orient-row",
            metavar="N",
            type=parse_positive_integer,
            help="turn the part as in row N of the table of `printer-slicer orient`; default: the best row, or as in "
            "the file if that saves less than 5%%",
        )
    )


def add_keep_up_option(group: _Container, flag: str) -> argparse.Action:
    """Add an option that keeps the upper side of parts up; return it."""
    return group.add_argument(
        flag,
        metavar="DEG",
        type=parse_tilt,
        help="tilt the z axis of a part by at most DEG degrees; below 90, its top never faces down",
    )


def _add_plate_options(group: argparse._ArgumentGroup, *, always_arranges: bool) -> None:
    """Add the options for arranged plates; --gap is an everyday option of a command that always arranges."""
    gap = group.add_argument(
        "--gap",
        metavar="MM",
        type=parse_distance,
        help="arrange the parts, with at least this distance between them; default: 6, or with --sequential what the "
        "print head needs",
    )
    if not always_arranges:
        mark_advanced(gap)
    mark_advanced(
        group.add_argument(
            "--plate",
            metavar="N",
            type=parse_positive_integer,
            help="use only plate N, counted from 1, if the parts need several plates",
        )
    )


def _add_file_reading_options(group: argparse._ArgumentGroup) -> None:
    """Add the options that control how the models are read from their files, and the volumes read with them."""
    for name, what in (("enforcer", "supports are made under"), ("blocker", "no supports are made under")):
        mark_advanced(
            group.add_argument(
                f"--support-{name}",
                metavar="FILE",
                type=Path,
                action="append",
                default=[],
                help=f"a closed mesh; {what} overhangs within it; it is placed, scaled and rotated with the models",
            )
        )
    mark_advanced(
        group.add_argument(
            "--modifier",
            metavar="FILE",
            type=Path,
            action="append",
            default=[],
            help="a closed mesh with settings of its own, such as --set-for FILE:infill_density=0.6 without the suffix "
            "of the file; it is placed, scaled and rotated with the models",
        )
    )
    mark_advanced(
        group.add_argument(
            "--drop",
            action=argparse.BooleanOptionalAction,
            default=True,
            help="move the models down onto the bed; --no-drop keeps the z of the files; default: --drop",
        )
    )
    mark_advanced(add_units_option(group))
    mark_advanced(
        group.add_argument(
            "--fuse",
            action="store_true",
            help="print overlapping parts of several files as one part; without it, they are arranged",
        )
    )


def add_units_option(group: argparse._ArgumentGroup) -> argparse.Action:
    """Add --units; return it."""
    return group.add_argument(
        "--units",
        choices=UNITS,
        metavar="UNIT",
        help=f"length unit of the files: {', '.join(UNITS)}; default: the unit in the file, or mm if it has none",
    )


# G-code and machines


# The keys of diagnostics.NAMES; that module is not imported, so that --help stays fast.
_FINDING_NAMES: Final = (
    "temperature, box, feed, flow, ratio, unsupported, head, cold, homing, eeprom, limits, calibration, autotune, "
    "protection, endstops, offsets, halt, wait, firmware, files, pins, macros, link, debug, shell, unreadable"
)


def add_printers_file_option(parser: _Container) -> None:
    """Add --printers-file, which names the file with the printers of the queue."""
    mark_advanced(
        parser.add_argument(
            "--printers-file",
            metavar="FILE.toml",
            type=Path,
            help="file with the printers; default: printers.toml in your configuration folder",
        )
    )


def add_allow_option(parser: _Container) -> None:
    """Add --allow, which accepts G-code despite named errors."""
    mark_advanced(
        parser.add_argument(
            "--allow",
            metavar="NAME",
            action="append",
            default=[],
            help=f"accept G-code that has this error; may be repeated; NAME is one of {_FINDING_NAMES}",
        )
    )


def add_machine_options(parser: _Container) -> None:
    """Add the options for the printer and material with which G-code is checked."""
    parser.add_argument("--printer", metavar="NAME", help="printer profile: a name or a .toml file")
    parser.add_argument("--material", metavar="NAME", help="material profile: a name or a .toml file")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting; may be repeated"
    )
    add_allow_option(parser)
