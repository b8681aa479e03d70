"""Properties of a firmware: its G-code, its serial protocol, and how it moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

from printer_slicer.deprecation import accept_former_fields
from printer_slicer.texts import format_number
from printer_slicer.values import Struct, field

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = [
    "MARLIN_NUMBERS",
    "MARLIN_RESEND",
    "STRTOD_NUMBERS",
    "CommandMeaning",
    "CountingRule",
    "Dialect",
    "Firmware",
    "NumberReading",
    "SetsAccelerations",
    "SetsLimits",
    "SetsRetraction",
    "WireDialect",
    "format_axis_limits",
    "format_jerk",
    "format_marlin_limits",
    "format_retraction",
]


CountingRule: TypeAlias = Literal["together", "either", "apart"]
"""How G90, G91, M82 and M83 are read; `motion.positioning_mode` explains the three rules."""


class NumberReading(NamedTuple):
    """What a firmware does with `X`, `Xnan` and `X1.2.3`, as phrases for messages."""

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
"""How firmwares read such words if they use C's `strtod`."""


class SetsLimits(Struct, frozen=True):
    """A command that sets motion limits.

    Attributes:
        marlin_command: Marlin's command for these limits: M201, M203 or M205.
        letters: letters of this command -> letters of `marlin_command`; other letters are ignored. None: the same
            letters.
        scale: factor that converts the numbers to mm and s.
    """

    marlin_command: str
    letters: Mapping[str, str] | None = None
    scale: float = 1.0


class SetsAccelerations(Struct, frozen=True):
    """A command that sets accelerations, mm/s².

    Attributes:
        sets: words of the command -> the accelerations (`printing`, `travel`, `retract`) that it sets to the smallest
            number of these words.
    """

    sets: Mapping[tuple[str, ...], tuple[str, ...]]


class SetsRetraction(Struct, frozen=True):
    """A command that sets up firmware retraction (G10 and G11).

    Attributes:
        words: words for length (mm), retraction speed, deretraction speed (mm/s) and extra length (mm).
    """

    words: tuple[str, str, str, str]


CommandMeaning: TypeAlias = SetsLimits | SetsAccelerations | SetsRetraction | None
"""What a command sets; None: nothing that affects moves."""


@accept_former_fields(reads="commands")
class Dialect(Struct, frozen=True):
    """How a firmware writes and reads G-code. The functions return whole lines.

    Attributes:
        limits: formats the motion limits of the profile, so that the machine matches the time estimate.
        acceleration: formats the printing acceleration, mm/s²; in a firmware with a single acceleration, it applies
            to all moves.
        pause: command that waits for a person, used if the profile has no pause G-code.
        pressure_advance: formats pressure advance, s; None: no command takes seconds.
        retraction: formats the settings of G10 and G11; None: a file cannot set them.
        progress: formats percentage and remaining minutes; None: no display shows them.
        labels: format of object labels for `labels = auto`, a key of `LABEL_FORMATS`.
        m486: format of object labels for `labels = m486`, a key of `LABEL_FORMATS`.
        counting: the rule by which G90, G91, M82 and M83 are read.
        home_offset: when M206 moves the origin.
        machine_coordinates: `G53 G1 ...` moves in machine coordinates; elsewhere it depends on the build.
        tool_temperatures: M568, and G10 with a tool, set the temperature of that tool.
        extended_commands: has named commands, such as SET_VELOCITY_LIMIT, and ignores those it does not know.
        any_case: accepts commands and words in lower case.
        numbers: how it reads words without a valid number.
        commands: commands that differ from Marlin 2, and what they set.
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
    commands: Mapping[str, CommandMeaning] = field(default_factory=dict)


def format_axis_limits(code: str, printer: Printer, limit: str, scale: float = 1.0) -> str:
    """Format a command that sets one limit (`max_speed`, `max_acceleration`) of x, y, z and e."""
    words = [f"{axis.upper()}{format_number(scale * getattr(printer, f'{limit}_{axis}'))}" for axis in "xyze"]
    return f"{code} {' '.join(words)}"


def format_jerk(code: str, printer: Printer, scale: float = 1.0) -> str:
    """Format a command that sets the jerk of x, y, z and e."""
    xy, z, e = (format_number(scale * jerk) for jerk in (printer.jerk_xy, printer.jerk_z, printer.jerk_e))
    return f"{code} X{xy} Y{xy} Z{z} E{e}"


def format_marlin_limits(printer: Printer, corner: str = "") -> list[str]:
    """Format M201, M203, M204 and `corner`, by default M205 with the jerk of each axis. Units are mm and s."""
    print_, retract = format_number(printer.acceleration), format_number(printer.retract_acceleration)
    return [
        f"{format_axis_limits('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{format_axis_limits('M203', printer, 'max_speed')} ; mm/s",
        f"M204 P{print_} R{retract} T{format_number(printer.travel_acceleration)} ; mm/s^2",
        corner or f"{format_jerk('M205', printer)} ; mm/s",
    ]


def format_retraction(printer: Printer) -> list[str]:
    """Format M207 and M208, which set up G10 and G11. They set no lift, because the moves contain the lift."""
    back, forward = format_number(printer.retract_speed * 60), format_number(printer.deretract_speed * 60)
    return [
        f"M207 S{format_number(printer.retract_length)} F{back} Z0",
        f"M208 S{format_number(printer.deretract_extra)} F{forward}",
    ]


MARLIN_RESEND: Final = ("Error:checksum mismatch, Last Line: 6", "Resend: 7", "ok")
"""The lines with which Marlin requests line 7 again."""


class WireDialect(Struct, frozen=True, kw_only=True):
    """The serial protocol of one kind of firmware.

    Attributes:
        title: its name in messages.
        m115_pattern: regular expression that matches the firmware name in its reply to M115.
        resend_request: the lines with which it requests line 7 again, as an example for tests and documentation.
        checksum: the checksum at the end of each line; a CRC finds errors that XOR misses.
        checks_line_numbers: it rejects a line whose number is not the next one. Without that, lost lines go unnoticed.
        unnumbered_lines: how it treats lines without a number. A line whose start was lost looks like a line without
            a number. If the firmware executes such lines, at most two lines may be in flight on a bad cable.
        reports_last_line: it answers M110 alone with the number of the last line.
        ok_when_read: it sends ok when it has read a line; the answer to M105 follows when the line is executed.
        max_line_bytes: maximum length of a line, without its line break.
        queue_size: number of commands that it reads ahead. One place is kept free for M112 unless it handles M112 as
            soon as it arrives.
        max_lines_in_flight: maximum number of lines that are sent without an acknowledgement.
        advice: advice for the user before streaming; empty if there is none.
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


def _format_marlin_baby_step(mm: float) -> bytes:
    """Format M290, which shifts the nozzle by mm."""
    return b"M290 Z%.3f" % mm


class Firmware(Struct, frozen=True, kw_only=True):
    """The properties of one firmware.

    Attributes:
        title: its name in messages.
        dialect: its G-code dialect.
        wire: its wire dialects by name; several if its versions differ.
        planner_blocks: number of moves that it plans ahead.
        also_reads: other flavours of G-code that it executes correctly, too.
        has_single_acceleration: printing and travel moves share one acceleration.
        halts_out_of_bounds: a move beyond the machine ends the print; other firmwares clip it and continue.
        allows_unhomed_moves: it moves before homing.
        has_quick_stop: it has M410, which discards the planned moves.
        resume_command: ends a pause that the printer started; M108 ends a wait within a command.
        baby_step_command: formats the command that shifts the nozzle by mm during a print.
        set_z_command: formats the command that sets the current z, mm, without homing; None: G92.
        cancel_object_command: formats the command that cancels an object by name; None: the host skips its commands.
        prusaslicer_name: its value of `gcode_flavor` in PrusaSlicer and its relatives; empty if there is none.
    """

    title: str
    dialect: Dialect
    wire: Mapping[str, WireDialect]
    planner_blocks: int
    also_reads: frozenset[str] = frozenset()
    has_single_acceleration: bool = False
    halts_out_of_bounds: bool = False
    allows_unhomed_moves: bool = True
    has_quick_stop: bool = False
    resume_command: bytes = b"M108"
    baby_step_command: Callable[[float], bytes] = _format_marlin_baby_step
    set_z_command: Callable[[float], bytes] | None = None
    cancel_object_command: Callable[[str], bytes] | None = None
    prusaslicer_name: str = ""
