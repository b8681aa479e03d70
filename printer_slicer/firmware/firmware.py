"""What is known about a firmware: the G-code that it takes, how it reads it, how lines are sent to it, how it moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

from printer_slicer.texts import number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = [
    "MARLIN_NUMBERS",
    "MARLIN_RESEND",
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
    """The G-code of a firmware, as it is written and as it is read. Functions give whole lines.

    Attributes:
        limits: formats the motion limits of the profile, so that the machine moves as the time model says.
        acceleration: formats the acceleration of printing, mm/s²; of all moves, where the firmware has only one.
        pause: waits for a person, where the profile has no pause G-code of its own.
        pressure_advance: formats pressure advance, s; None where no command takes seconds.
        retraction: formats what G10 and G11 do; None where a file cannot set it.
        progress: formats percent done and minutes left; None where no display shows it.
        labels: format of object labels where the profile says `auto`, a key of `LABEL_WORDS`.
        m486: format of object labels where the profile says `m486`, a key of `LABEL_WORDS`.
        counting: the rule by which G90, G91, M82 and M83 are read.
        home_offset: when M206 moves the origin.
        machine_coordinates: `G53 G1 ...` moves in machine coordinates; elsewhere it depends on the build.
        tool_temperatures: M568, and G10 with a tool, set the temperature of that tool.
        extended_commands: has commands of words, such as SET_VELOCITY_LIMIT, and ignores those it does not know.
        any_case: accepts commands and words in lower case.
        numbers: what it does with words without a valid number.
        reads: commands that set something else than in Marlin 2, and what.
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
    """Format a command that sets one limit (`max_speed`, `max_acceleration`) of x, y, z and e."""
    words = [f"{axis.upper()}{number(scale * getattr(printer, f'{limit}_{axis}'))}" for axis in "xyze"]
    return f"{code} {' '.join(words)}"


def jerk_line(code: str, printer: Printer, scale: float = 1.0) -> str:
    """Format a command that sets the jerk of x, y, z and e."""
    xy, z, e = (number(scale * jerk) for jerk in (printer.jerk_xy, printer.jerk_z, printer.jerk_e))
    return f"{code} X{xy} Y{xy} Z{z} E{e}"


def marlin_limits(printer: Printer, corner: str = "") -> list[str]:
    """Format M201, M203, M204, all in mm and s, and a line about corners; empty: M205 with the jerk of each axis."""
    print_, retract = number(printer.acceleration), number(printer.retract_acceleration)
    return [
        f"{axes_line('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{axes_line('M203', printer, 'max_speed')} ; mm/s",
        f"M204 P{print_} R{retract} T{number(printer.travel_acceleration)} ; mm/s^2",
        corner or f"{jerk_line('M205', printer)} ; mm/s",
    ]


def retraction_lines(printer: Printer) -> list[str]:
    """Format M207 and M208 for G10 and G11, without lift: the moves lift. F in mm/min."""
    back, forward = number(printer.retract_speed * 60), number(printer.deretract_speed * 60)
    return [
        f"M207 S{number(printer.retract_length)} F{back} Z0",
        f"M208 S{number(printer.deretract_extra)} F{forward}",
    ]


MARLIN_RESEND: Final = ("Error:checksum mismatch, Last Line: 6", "Resend: 7", "ok")


@dataclass(frozen=True, slots=True, kw_only=True)
class WireDialect:
    """How one kind of firmware reads lines from the wire.

    Attributes:
        title: its name for people.
        m115_pattern: regular expression of the firmware name in its reply to M115.
        resend_request: the lines with which it asks for line 7 again, for tests and documents.
        checksum: at the end of each line; a CRC finds damage that an exclusive or misses.
        checks_line_numbers: it refuses a line whose number is not the next. Without that a lost line leaves no trace.
        unnumbered_lines: what it does with a line without number. The tail of a line whose beginning was lost looks
            like one, so where these are executed at most two lines may be in flight on a bad cable.
        reports_last_line: M110 alone makes it say the number of the last line.
        ok_when_read: it sends the ok when it has read a line; the answer to M105 comes later, when it is executed.
        max_line_bytes: bytes of a line, without its line break.
        queue_size: commands it reads ahead. One place is kept free for M112 where it does not look at bytes as they
            arrive.
        max_lines_in_flight: where that does no harm.
        advice: what the user should know before streaming; empty if nothing.
    """

    title: str
    m115_pattern: str
    resend_request: tuple[str, ...]
    checksum: Literal["xor", "crc16"] = "xor"
    checks_line_numbers: bool = True
    unnumbered_lines: Literal["executed", "refused"] = "executed"
    reports_last_line: bool = False
    ok_when_read: bool = False
    max_line_bytes: int = 95
    queue_size: int = 4
    max_lines_in_flight: int = 6
    advice: str = ""


def _marlin_baby_step(mm: float) -> bytes:
    """Format M290."""
    return b"M290 Z%.3f" % mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """One firmware.

    Attributes:
        title: its name in messages.
        dialect: its G-code.
        wire: name -> how lines are sent to it; several where its versions read them differently.
        planner_blocks: number of moves it plans ahead.
        has_single_acceleration: printing and travelling share one acceleration.
        halts_out_of_bounds: a move beyond the machine ends the print; others stop at the end of the axis and go on.
        allows_unhomed_moves: it moves before homing.
        has_quick_stop: it has M410, which discards the planned moves.
        resume_command: ends a pause that the printer began by itself; M108 where it waits in the middle of a command.
        baby_step_command: formats the command that shifts the nozzle by mm during a print.
        set_z_command: formats the command that sets the current z, mm, without homing; None: G92 does.
        cancel_object_command: formats the command that cancels the object of this name; None: the host leaves out
            its commands.
        prusaslicer_name: its name in the setting `gcode_flavor` of PrusaSlicer and its relatives; empty if it has none.
    """

    title: str
    dialect: Dialect
    wire: Mapping[str, WireDialect]
    planner_blocks: int
    has_single_acceleration: bool = False
    halts_out_of_bounds: bool = False
    allows_unhomed_moves: bool = True
    has_quick_stop: bool = False
    resume_command: bytes = b"M108"
    baby_step_command: Callable[[float], bytes] = _marlin_baby_step
    set_z_command: Callable[[float], bytes] | None = None
    cancel_object_command: Callable[[str], bytes] | None = None
    prusaslicer_name: str = ""
