"""The table of G-code commands and their effects, for all code that reads, sends or checks G-code.

Code that needs one kind of command (commands that wait, heat, move or set a mode) takes it from this table, so that all
parts of the program agree. Differences between firmwares are in `firmware`.

Sources: Marlin's G-code index, Duet3D's G-code dictionary, Klipper's G-Codes, Smoothieware's supported G-codes,
Prusa-Firmware's list of commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Flag, auto
from math import inf
from typing import Final, Literal, TypeAlias

from printer_slicer.values import Struct

__all__ = [
    "TABLE",
    "CommandRow",
    "Effect",
    "HeaterName",
    "find_codes",
    "find_codes_as_text",
    "find_heater",
    "takes_text",
]

HeaterName: TypeAlias = Literal["nozzle", "bed", "chamber"]


class Effect(Flag):
    """The effects that a command can have; one command may have several.

    Attributes:
        MOVES: moves to the position that its words state.
        ARC: moves along an arc.
        MOVES_UNSEEN: moves to a position that only the machine knows.
        HOMES: homes axes.
        SETS_POSITION: sets the coordinates of the current position.
        SETS_HOME_OFFSET: moves the origin by a known amount.
        MOVES_ORIGIN: moves the origin by an unknown amount.
        MODE: sets absolute or relative coordinates.
        UNITS: sets inches or mm.
        RETRACTS: retracts or deretracts by the firmware's own length.
        FAN: sets a fan.
        WAITS: is acknowledged after all earlier moves have finished.
        WAITS_FOR_HEAT: is acknowledged after heaters have reached their targets.
        WAITS_FOR_PERSON: is acknowledged after a person has confirmed it.
        ENDED_BY_M108: waits until M108 ends the wait.
        RUNS_MACRO: runs a macro of the printer.
        REPEATABLE: has the same effect if it is sent twice.
        STICKY: sets a value that lasts until the printer restarts; its words state the whole value.
        TAKES_TEXT: takes free text.
    """

    NONE = 0
    MOVES = auto()
    ARC = auto()
    MOVES_UNSEEN = auto()
    HOMES = auto()
    SETS_POSITION = auto()
    SETS_HOME_OFFSET = auto()
    MOVES_ORIGIN = auto()
    MODE = auto()
    UNITS = auto()
    RETRACTS = auto()
    FAN = auto()
    WAITS = auto()
    WAITS_FOR_HEAT = auto()
    WAITS_FOR_PERSON = auto()
    ENDED_BY_M108 = auto()
    RUNS_MACRO = auto()
    REPEATABLE = auto()
    STICKY = auto()
    TAKES_TEXT = auto()


class CommandRow(Struct, frozen=True):
    """The effects of one command.

    Attributes:
        effect: effects of the command.
        heater: the heater whose target temperature the command sets.
        seconds: maximum time of the command itself, s, counted from the end of all earlier moves.
    """

    effect: Effect
    heater: HeaterName | None = None
    seconds: float = 0.0


# Maximum times of commands, s.
_PROBING: Final = 600.0  # probing and homing
_LEVELLING: Final = 1200.0
_HEATING: Final = 1800.0

_E: Final = Effect
_UNSEEN: Final = Effect.MOVES_UNSEEN
_REPEATABLE: Final = Effect.REPEATABLE
_LASTING: Final = Effect.REPEATABLE | Effect.STICKY
_HEAT: Final = Effect.WAITS | Effect.WAITS_FOR_HEAT
_PERSON: Final = Effect.WAITS | Effect.WAITS_FOR_PERSON

_ROWS: Final[tuple[tuple[str, CommandRow], ...]] = (
    ("G0 G1", CommandRow(_E.MOVES)),
    ("G2 G3", CommandRow(_E.MOVES | _E.ARC)),
    ("G4", CommandRow(_E.WAITS)),
    ("G5 G26 G38 G42 G61 G425 M701 M702", CommandRow(_UNSEEN)),
    ("G10 G11", CommandRow(_E.RETRACTS)),
    ("G12 G27 G30 M48", CommandRow(_UNSEEN, seconds=_PROBING)),
    ("G17", CommandRow(_LASTING)),
    ("G20 G21", CommandRow(_E.UNITS | _REPEATABLE)),
    ("G28", CommandRow(_E.HOMES | _E.WAITS | _REPEATABLE, seconds=_PROBING)),
    ("G29", CommandRow(_UNSEEN | _E.WAITS | _REPEATABLE, seconds=_LEVELLING)),
    ("G32", CommandRow(_UNSEEN | _E.RUNS_MACRO, seconds=_LEVELLING)),
    ("G33 G34 G35 G76 G80", CommandRow(_UNSEEN, seconds=_LEVELLING)),
    ("G54 G55 G56 G57 G58 G59 M428", CommandRow(_E.MOVES_ORIGIN)),
    ("G90 G91 M82 M83", CommandRow(_E.MODE | _REPEATABLE)),
    ("G92", CommandRow(_E.SETS_POSITION | _REPEATABLE)),
    ("M0 M1", CommandRow(_PERSON | _E.ENDED_BY_M108, seconds=inf)),
    ("M25", CommandRow(_E.WAITS_FOR_PERSON, seconds=inf)),
    ("M98", CommandRow(_UNSEEN | _E.RUNS_MACRO | _E.TAKES_TEXT, seconds=_HEATING)),
    ("M104", CommandRow(_REPEATABLE, "nozzle")),
    ("M106 M107", CommandRow(_E.FAN | _REPEATABLE)),
    ("M109", CommandRow(_HEAT | _E.ENDED_BY_M108 | _REPEATABLE, "nozzle", _HEATING)),
    ("M116", CommandRow(_HEAT | _REPEATABLE, seconds=_HEATING)),
    ("M117 M486", CommandRow(_REPEATABLE | _E.TAKES_TEXT)),
    ("M125", CommandRow(_PERSON | _UNSEEN, seconds=inf)),
    ("M140", CommandRow(_REPEATABLE, "bed")),
    ("M141", CommandRow(_REPEATABLE, "chamber")),
    ("M190", CommandRow(_HEAT | _E.ENDED_BY_M108 | _REPEATABLE, "bed", _HEATING)),
    ("M191", CommandRow(_HEAT | _E.ENDED_BY_M108 | _REPEATABLE, "chamber", _HEATING)),
    ("M201 M203 M204 M205 M207 M208 M220 M221 M900 M572 M566 M92 M302", CommandRow(_LASTING)),
    ("M200 M851 SET_PRESSURE_ADVANCE SET_VELOCITY_LIMIT SET_RETRACTION", CommandRow(_E.STICKY)),
    ("M206", CommandRow(_E.SETS_HOME_OFFSET)),
    ("M226 M600 M601 PAUSE", CommandRow(_PERSON, seconds=inf)),
    ("@PAUSE", CommandRow(_E.WAITS_FOR_PERSON)),
    ("M303", CommandRow(_E.NONE, seconds=_HEATING)),
    ("M400", CommandRow(_E.WAITS | _REPEATABLE)),
    ("M568", CommandRow(_REPEATABLE, "nozzle")),
    ("G94 M17 M18 M73 M84 M105 M114 M115 M155 M593 M906", CommandRow(_REPEATABLE)),
    ("TEMPERATURE_WAIT", CommandRow(_HEAT, seconds=_HEATING)),
    ("M16 M23 M28 M30 M32 M33 M36 M37 M38 M118 M291 M550 M551 M862 M928", CommandRow(_E.TAKES_TEXT)),
    ("M810 M811 M812 M813 M814 M815 M816 M817 M818 M819", CommandRow(_E.TAKES_TEXT)),
)

TABLE: Final[Mapping[bytes, CommandRow]] = {
    code: row for codes, row in _ROWS for code in codes.encode().split()
}
"""Commands by code, or by name in upper case; commands that are not listed have no effect that matters here."""


def find_codes(effect: Effect) -> frozenset[bytes]:
    """Return the codes of the commands that have at least one of these effects."""
    return frozenset(code for code, row in TABLE.items() if row.effect & effect)


def find_codes_as_text(effect: Effect) -> frozenset[str]:
    """Return the codes of the commands that have at least one of these effects, as text."""
    return frozenset(code.decode() for code in find_codes(effect))


def find_heater(code: str) -> HeaterName | None:
    """Return the heater whose target temperature a command sets; None if the command sets none."""
    row = TABLE.get(code.encode())
    return row.heater if row else None


def takes_text(code: str) -> bool:
    """Return whether a command takes free text, such as M117."""
    row = TABLE.get(code.encode())
    return row is not None and Effect.TAKES_TEXT in row.effect
