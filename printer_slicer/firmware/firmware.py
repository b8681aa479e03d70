"""One firmware: the G-code that it takes and how it reads it, how lines are sent to it, and how it moves.

How lines are sent to it differs in these switches of `WireDialect`:

switch          what it decides
checksum        which one a line carries; `crc16` sees what an exclusive or cannot
sequence        a line whose number is not next is refused; without that a lost line leaves no trace
strays          what happens to a line without number: executed, or refused. The tail of a line whose beginning was
                lost looks like one, so where it is executed no more than two lines may be in flight on a bad cable
places          commands read ahead; one is kept free for M112 where no parser looks at the bytes as they arrive
counts          M110 alone answers with the number of the last line, so a doubt is settled without another line
request         how the firmware asks for a line again: what the tests say to the host, and the documents to people
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

from printer_slicer.texts import number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = [
    "MARLIN_NUMBERS",
    "MARLIN_REQUEST",
    "STRTOD_NUMBERS",
    "CountingRule",
    "Dialect",
    "Firmware",
    "Meaning",
    "NumberReading",
    "SetsAccelerations",
    "SetsLimits",
    "SetsRetraction",
    "WireDialect",
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


MARLIN_REQUEST: Final = ("Error:checksum mismatch, Last Line: 6", "Resend: 7", "ok")


@dataclass(frozen=True, slots=True, kw_only=True)
class WireDialect:
    """How one kind of firmware reads lines.

    Attributes:
        title: as people call it.
        pattern: of the name that M115 gives.
        request: a request for line 7, as this firmware says it.
        checksum: at the end of each line.
        sequence: whether it takes lines in order only.
        strays: what it does to a line without number and right checksum.
        counts: M110 alone says the last line number.
        ok_when_read: a line gets its ok when it is read; what M105 tells comes by itself when it is its turn.
        longest: bytes of a line, without its line break.
        places: commands it reads ahead.
        most: lines in flight at most, where it is safe.
        advice: what its owner should know before streaming; empty if nothing.
    """

    title: str
    pattern: str
    request: tuple[str, ...]
    checksum: Literal["xor", "crc16"] = "xor"
    sequence: bool = True
    strays: Literal["executed", "refused"] = "executed"
    counts: bool = False
    ok_when_read: bool = False
    longest: int = 95
    places: int = 4
    most: int = 6
    advice: str = ""


def _marlin_baby_step(mm: float) -> bytes:
    return b"M290 Z%.3f" % mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """One firmware.

    Attributes:
        title: as messages call it.
        dialect: its G-code.
        wire: name -> how lines are sent to it. Several, where versions read them differently; the first whose pattern
            is found in what M115 says counts.
        planner_blocks: moves it plans ahead.
        one_acceleration: printing and travelling have the same.
        ends_beyond: a move beyond the machine ends the print; others stop at the end of the axis and go on.
        moves_unhomed: moves before homing; others refuse.
        quick_stop: has M410, which throws away the planned moves.
        resume: ends a pause that the printer has begun by itself; M108 where it waits in the middle of a command.
        baby_step: shifts the nozzle by mm while it prints.
        set_z: says at which height, mm, the nozzle stands when nothing is homed; None where G92 does.
        cancel_object: says that the object of this name is not printed any further; None where the host leaves it out.
        prusaslicer: its name in the setting `gcode_flavor` of PrusaSlicer and its relatives; empty if it has none.
    """

    title: str
    dialect: Dialect
    wire: Mapping[str, WireDialect]
    planner_blocks: int
    one_acceleration: bool = False
    ends_beyond: bool = False
    moves_unhomed: bool = True
    quick_stop: bool = False
    resume: bytes = b"M108"
    baby_step: Callable[[float], bytes] = _marlin_baby_step
    set_z: Callable[[float], bytes] | None = None
    cancel_object: Callable[[str], bytes] | None = None
    prusaslicer: str = ""
