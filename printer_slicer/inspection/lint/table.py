"""Which commands are looked at, what is made of them, and why: one row for each kind.

What slicers write into every file of a machine must pass: limits at or under the profile's without a word, those a
little over are told. Sources: Marlin's documentation (G-code index); Klipper's documents, "G-Codes"; Duet3D's G-code
dictionary; Prusa-Firmware's list of D codes; what PrusaSlicer's and Cura's definitions of machines hold.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from printer_slicer.firmware.firmware import SetsLimits
from printer_slicer.gcode.commands import Effect, names_that
from printer_slicer.gcode.lexer import LintCommand
from printer_slicer.profile import Printer

__all__ = ["RULES", "Rule", "Said"]

Said = tuple[bool, str]
"""Whether it is refused, and what it does."""

_Judge = Callable[[LintCommand, Printer], Said | None]

_MINUTE: Final = 60.0
_FAR: Final = 20.0
"""Times the profile's limit from which on a limit is no matter of taste: mm/min for mm/s is 60, what slicers write for
machines of which they know nothing is up to 18."""

_OF_ONE_FIRMWARE: Final = frozenset({"M566", "SET_VELOCITY_LIMIT"})
"""Commands that only firmwares with a meaning for them in their row know."""

_STEP: Final = 0.5  # mm; a babystep is smaller
_OPTION: Final = re.compile(r"(?:[AEP]\d *)*")
_ANSWER: Final = re.compile(
    r"OK\b|RESEND|RS |ERROR|START\b|WAIT\b|!!|FATAL|ECHO: *BUSY|BUSY|FIRMWARE_NAME|CAP:|T\d*:|B:|X:"
)
_FLOW: Final = (75.0, 130.0)
"""% of flow that start G-code of known machines and materials sets."""

_SPEED: Final = (25.0, 200.0)
_COLDEST: Final = 170.0  # °C; Marlin's own EXTRUDE_MINTEMP


@dataclass(frozen=True, slots=True)
class Rule:
    """What to make of some commands.

    Attributes:
        name: what allows it.
        codes: of the commands.
        judge: what one of them does; None if nothing that matters.
        why: that matters.
    """

    name: str
    codes: frozenset[str]
    judge: _Judge
    why: str


def _always(what: str, *, told: bool = False) -> _Judge:
    return lambda _command, _printer: (not told, what)


def _if_any(letters: str, what: str, *, told: bool = False) -> _Judge:
    """Only where one of the letters is there: without, firmware answers what is set."""

    def judge(command: LintCommand, _printer: Printer) -> Said | None:
        """Look for the letters."""
        return (not told, what) if set(command.words) & set(letters) else None

    return judge


def _limits(command: LintCommand, printer: Printer) -> Said | None:
    """Limits above the profile's: a warning; refused if far above it, or for speeds far below it."""
    worst: tuple[float, str] = (1.0, "")
    for letter, asked, most in _asked_limits(command, printer):
        if command.code == "M203" and 0 < asked < most / _FAR:
            unit = "mm/min" if _unit(command, printer) == _MINUTE else "mm/s"
            return True, f"{letter} {asked:.3g} mm/s, the profile has {most:g}; the firmware expects {unit}"
        if most > 0 and asked / most > worst[0] * 1.001:
            worst = (asked / most, f"{letter} {asked:g}, the profile has {most:g}")
    return (worst[0] > _FAR, worst[1]) if worst[1] else None


def _asked_limits(command: LintCommand, printer: Printer) -> list[tuple[str, float, float]]:
    """Letter, asked for, and the profile's, mm and s."""
    axes = "xyze"
    known: dict[str, dict[str, float]] = {
        "M201": {axis: getattr(printer, f"max_acceleration_{axis}") for axis in axes},
        "M203": {axis: getattr(printer, f"max_speed_{axis}") for axis in axes},
        "M204": {
            "s": max(printer.acceleration, printer.travel_acceleration),
            "p": printer.acceleration,
            "t": printer.travel_acceleration,
            "r": printer.retract_acceleration,
        },
        "M205": _corners(printer),
        "M566": _corners(printer),
        "SET_VELOCITY_LIMIT": {
            "accel": printer.acceleration,
            "velocity": max(printer.max_speed_x, printer.max_speed_y),
        },
    }
    unit = _unit(command, printer)
    if command.code not in known or unit is None:
        return []
    given = {name: max(numbers) for name, numbers in command.words.items() if numbers} | command.settings
    return [
        (name, given[name.upper()] / unit, most)
        for name, most in known[command.code].items()
        if name.upper() in given
    ]


def _unit(command: LintCommand, printer: Printer) -> float | None:
    """How many units of the command a mm and a second are; None: the printer's firmware does not set limits by it.

    A firmware ignores commands that only another one has; nearly all read those of Marlin.
    """
    reads = printer.firmware.dialect.commands
    if command.code not in reads:
        return None if command.code in _OF_ONE_FIRMWARE else 1.0
    meaning = reads[command.code]
    if meaning is None:
        return None
    return _MINUTE if isinstance(meaning, SetsLimits) and meaning.scale != 1.0 else 1.0


def _corners(printer: Printer) -> dict[str, float]:
    if printer.corner == "jerk":
        return {"x": printer.jerk_xy, "y": printer.jerk_xy, "z": printer.jerk_z, "e": printer.jerk_e}
    return {"j": printer.junction_deviation} if printer.corner == "junction_deviation" else {}


def _cold(command: LintCommand, _printer: Printer) -> Said | None:
    if command.code == "M302" and any(value for value in command.words.get("P", ())):
        return True, "lets the extruder turn cold"
    least = min((value for letter in "SR" for value in command.words.get(letter, ())), default=None)
    if least is None or least >= _COLDEST:
        return None
    return True, f"lets the extruder turn at {least:g} °C"


def _flow_ratio(command: LintCommand, _printer: Printer) -> Said | None:
    """M221: values that start G-code commonly sets cause a warning; severe under- or overextrusion is refused."""
    return _ratio(command, "extrudes", _FLOW)


def _speed_ratio(command: LintCommand, _printer: Printer) -> Said | None:
    """M220: the firmware limits speeds, so only extreme values are refused."""
    return _ratio(command, "moves at", _SPEED)


def _ratio(command: LintCommand, what: str, usual: tuple[float, float]) -> Said | None:
    percent = command.most("S")
    if percent is None or percent == 100:
        return None
    low, high = usual
    of = "the flow" if what == "extrudes" else "the speed"
    return not low <= percent <= high, f"{what} {percent:g} % of {of} from here on"


def _off(command: LintCommand, _printer: Printer) -> Said | None:
    """Only where a zero switches something off."""
    off = [letter for letter, values in command.words.items() if letter in "SH" and 0 in values]
    return (True, "moves are no longer kept inside the machine") if off else None


def _wait(command: LintCommand, _printer: Printer) -> Said | None:
    """With a time it ends by itself; in the middle of a print somebody must come."""
    ends = [value for letter in "PS" for value in command.words.get(letter, ()) if value > 0]
    return (False, "waits for a while") if ends else (True, "waits until somebody presses a button")


def _kept(command: LintCommand, _printer: Printer) -> Said | None:
    """G10 with L sets an origin; without, it retracts or sets temperatures of tools."""
    return (True, "sets another origin") if "L" in command.words else None


def _nudge(command: LintCommand, _printer: Printer) -> Said | None:
    """M290: a babystep is small; without letters, or with zeros, it asks or forgets."""
    steps = [abs(value) for letter in "XYZS" for value in command.words.get(letter, ())]
    most = max(steps, default=0.0)
    return (most > _STEP, f"shifts everything by {most:g} mm") if most else None


def _says(command: LintCommand, _printer: Printer) -> Said | None:
    """M118: the firmware says what the file wants it to say, and hosts may take it for an answer."""
    text = _OPTION.sub("", command.text.partition("M118")[2].lstrip())
    if _ANSWER.match(text):
        return True, "makes the printer say what only its firmware should"
    return (False, "has a wish for the host") if "ACTION:" in text.replace(" ", "") else None


def _codes(text: str) -> frozenset[str]:
    return frozenset(text.split())


_ENDED_BY_BUTTON: Final = _codes("M0 M1")
_STORED: Final = "settings that outlive the print"
_GUARDS: Final = "what guards the machine is switched off"

RULES: Final[tuple[Rule, ...]] = (
    Rule("eeprom", _codes("M500"), _always("stores the settings in the firmware's memory"), _STORED),
    Rule("eeprom", _codes("M501"), _always("loads stored settings over those in use"), _STORED),
    Rule("eeprom", _codes("M502 M504"), _always("resets all settings"), _STORED),
    Rule("eeprom", _codes("SAVE_CONFIG"), _always("writes the configuration and restarts"), _STORED),
    Rule(
        "limits",
        _codes("M201 M203 M204 M205 M566 SET_VELOCITY_LIMIT"),
        _limits,
        "the machine may lose steps, or hardly move",
    ),
    Rule("calibration", _codes("M92"), _if_any("XYZEABC", "sets steps per mm"), "lengths come out wrong"),
    Rule(
        "calibration",
        _codes("M301 M304 M306 M307"),
        _if_any("HPIDCRAS", "sets the control of a heater"),
        "temperatures may overshoot",
    ),
    Rule("calibration", _codes("M305"), _if_any("PTBRS", "sets a thermistor"), "temperatures are read wrong"),
    Rule(
        "calibration",
        _codes("M350 M569 M665 M666 M669 M667"),
        _if_any("XYZEABCDHLRSPT", "sets geometry or drives", told=True),
        "it should suit the machine",
    ),
    Rule(
        "calibration",
        _codes("M906 M907 M908 M913"),
        _if_any("XYZEABCS", "sets currents of motors", told=True),
        "they should suit the machine",
    ),
    Rule("autotune", _codes("M303 PID_CALIBRATE"), _always("heats to tune a heater"), "it heats by itself"),
    Rule("cold", _codes("M302"), _cold, "an extruder that turns cold grinds its filament"),
    Rule("ratio", _codes("M221"), _flow_ratio, "the part was sliced for 100 %"),
    Rule("ratio", _codes("M220"), _speed_ratio, "the part was sliced for 100 %"),
    Rule("protection", _codes("M143 M562 M570"), _always("changes what guards heaters"), _GUARDS),
    Rule("endstops", _codes("M211 M564"), _off, _GUARDS),
    Rule("endstops", _codes("FORCE_MOVE"), _always("moves past all limits"), _GUARDS),
    Rule(
        "offsets",
        names_that(Effect.MOVES_ORIGIN | Effect.SETS_HOME_OFFSET)
        | _codes("M851 SET_GCODE_OFFSET SET_KINEMATIC_POSITION"),
        lambda command, _: (
            (True, "sets another origin")
            if command.words or command.settings or command.code != "M851"
            else None
        ),
        "where the moves lead is not known",
    ),
    Rule("offsets", _codes("M290"), _nudge, "the first layer may miss the bed, or the nozzle hit it"),
    Rule("offsets", _codes("G10"), _kept, "where the moves lead is not known"),
    Rule("halt", _codes("M112 EMERGENCY_STOP"), _always("halts the machine"), "the print ends there"),
    Rule("halt", _codes("M410"), _always("drops all moves"), "the position is lost"),
    Rule(
        "halt",
        _codes("M81"),
        _always("switches the power off", told=True),
        "fans stop, too",
    ),
    Rule("wait", _ENDED_BY_BUTTON, _wait, "the print stands still, heated, until then"),
    Rule(
        "wait",
        names_that(Effect.WAITS_FOR_PERSON) - _ENDED_BY_BUTTON,
        _always("waits for a person", told=True),
        "somebody must come",
    ),
    Rule(
        "firmware", _codes("M997"), _always("updates the firmware"), "the printer is not the same afterwards"
    ),
    Rule(
        "firmware",
        _codes("M999 FIRMWARE_RESTART RESTART DFU UPGRADE BREAK"),
        _always("restarts the firmware, also after a fault"),
        "position and faults are forgotten",
    ),
    Rule(
        "files",
        _codes("M23 M24 M28 M30 M32 M928 M471 M472 SDCARD_PRINT_FILE"),
        _always("reads, writes or deletes files of the printer"),
        "what they hold is not known",
    ),
    Rule("pins", _codes("M42 M43"), _always("switches pins of the board"), "a heater may be behind one"),
    Rule(
        "macros",
        frozenset(f"M{number}" for number in range(810, 820)),
        _always("stores commands, or runs stored ones"),
        "what they do is not known",
    ),
    Rule("link", _codes("M110"), _always("sets line numbers behind the host's back"), "lines get lost"),
    Rule("link", _codes("M118"), _says, "hosts may take it for an answer"),
    Rule("link", _codes("M575"), _always("sets the speed of the serial port"), "the host is cut off"),
    Rule("link", _codes("M552 M586 M587 M588 M589"), _always("sets up the network"), _STORED),
    Rule(
        "debug", _codes("M111"), _if_any("S", "switches to a mode for developers"), "nothing may move or heat"
    ),
    Rule(
        "unreadable",
        _codes("G5 G6 G18 G19 G38 G42"),
        _always("moves in a way that is not followed here"),
        "where it leads is not known",
    ),
    Rule("shell", _codes("RUN_SHELL_COMMAND"), _always("runs a program"), "what it does is not known"),
)
