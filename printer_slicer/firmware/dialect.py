"""What G-code a firmware takes, and how it reads it, where firmwares differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

from printer_slicer.texts import number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = [
    "MARLIN_NUMBERS",
    "STRTOD_NUMBERS",
    "CountingRule",
    "Dialect",
    "Meaning",
    "NumberReading",
    "SetsAccelerations",
    "SetsLimits",
    "SetsRetraction",
    "axes_line",
    "jerk_line",
    "marlin_limits",
    "retraction_lines",
]

CountingRule: TypeAlias = Literal["together", "either", "apart"]
"""How G90, G91, M82 and M83 are read; `motion.counting` explains the three rules."""


class NumberReading(NamedTuple):
    """What a firmware does with `X`, with `Xnan` and with `X1.2.3`, as a message says it."""

    bare: str
    not_a_number: str
    malformed: str


MARLIN_NUMBERS: Final = NumberReading(
    "ignores the word", "ignores the word", "reads only the valid part at its start"
)
STRTOD_NUMBERS: Final = NumberReading(
    "reads it as 0",
    "reads it as NaN or infinity and loses its position",
    "reads only the valid part at its start",
)
"""Of firmwares that read numbers by C's `strtod`."""


@dataclass(frozen=True, slots=True)
class SetsLimits:
    """A command that sets limits of the motion.

    Attributes:
        like: Marlin's command for them: M201, M203 or M205.
        letters: its letters -> those of `like`; others are ignored. None: the same letters.
        scale: its unit in mm and s.
    """

    like: str
    letters: Mapping[str, str] | None = None
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class SetsAccelerations:
    """A command that sets accelerations, mm/s².

    Attributes:
        sets: words of the command -> which of `printing`, `travel` and `retract` get the least of their numbers.
    """

    sets: Mapping[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class SetsRetraction:
    """A command that sets what G10 and G11 do.

    Attributes:
        words: for mm back, mm/s back, mm/s forward and mm more forward.
    """

    words: tuple[str, str, str, str]


Meaning: TypeAlias = SetsLimits | SetsAccelerations | SetsRetraction | None
"""What a command sets; None: nothing that matters for moves."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """The G-code of a firmware. Functions give whole lines.

    Attributes:
        limits: the motion limits of the profile, so that the machine moves as the time model says.
        acceleration: mm/s² while printing; of all moves, where the firmware has one acceleration.
        pause: waits for a person, where the profile has no pause G-code of its own.
        pressure_advance: s; None where there is no command for it that takes seconds.
        retraction: tells the firmware how to retract by G10 and G11; None where a file cannot tell it.
        progress: percent done and minutes left; None where nothing would show it.
        labels: how the objects on the plate are marked where the profile says `auto`, a key of `LABEL_WORDS`.
        m486: how where it says `m486`, likewise.
        counting: by which rule G90, G91, M82 and M83 are read.
        home_offset: when M206 moves the origin.
        machine_coordinates: `G53 G1 ...` moves in machine coordinates; elsewhere it depends on the build.
        tool_temperatures: M568, and G10 with a tool, set the temperature of that tool.
        extended_commands: has commands of words, such as SET_VELOCITY_LIMIT, and ignores those it does not know.
        any_case: accepts commands and words in lower case.
        numbers: what it does with words without a valid number.
        reads: commands that set something else than in Marlin 2.
    """

    limits: Callable[[Printer], list[str]]
    acceleration: Callable[[float], str]
    pause: str
    pressure_advance: Callable[[float], str] | None = None
    retraction: Callable[[Printer], list[str]] | None = None
    progress: Callable[[int, int], str] | None = None
    labels: str = "octoprint"
    m486: str = "m486"
    counting: CountingRule = "together"
    home_offset: Literal["at once", "when homed", "never"] = "at once"
    machine_coordinates: bool = False
    tool_temperatures: bool = False
    extended_commands: bool = False
    any_case: bool = False
    numbers: NumberReading = MARLIN_NUMBERS
    reads: Mapping[str, Meaning] = field(default_factory=dict)


def axes_line(code: str, printer: Printer, limit: str, scale: float = 1.0) -> str:
    """A limit (`max_speed`, `max_acceleration`) of all four axes."""
    words = [f"{axis.upper()}{number(scale * getattr(printer, f'{limit}_{axis}'))}" for axis in "xyze"]
    return f"{code} {' '.join(words)}"


def jerk_line(code: str, printer: Printer, scale: float = 1.0) -> str:
    """The jerk of all four axes."""
    xy, z, e = (number(scale * jerk) for jerk in (printer.jerk_xy, printer.jerk_z, printer.jerk_e))
    return f"{code} X{xy} Y{xy} Z{z} E{e}"


def marlin_limits(printer: Printer, corner: str = "") -> list[str]:
    """M201, M203, M204, all in mm and s, and a line about corners; empty: the jerk of each axis."""
    print_, retract = number(printer.acceleration), number(printer.retract_acceleration)
    return [
        f"{axes_line('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{axes_line('M203', printer, 'max_speed')} ; mm/s",
        f"M204 P{print_} R{retract} T{number(printer.travel_acceleration)} ; mm/s^2",
        corner or f"{jerk_line('M205', printer)} ; mm/s",
    ]


def retraction_lines(printer: Printer) -> list[str]:
    """M207 and M208 for G10 and G11, without lift: lifting is left to the moves. F in mm/min."""
    back, forward = number(printer.retract_speed * 60), number(printer.deretract_speed * 60)
    return [
        f"M207 S{number(printer.retract_length)} F{back} Z0",
        f"M208 S{number(printer.deretract_extra)} F{forward}",
    ]
