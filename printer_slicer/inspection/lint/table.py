"""The lint rules: which commands are dangerous or suspicious, and why.

Commands that slicers write into every file must pass. Limits up to those of the profile pass silently; slightly higher
ones cause a warning. Sources: Marlin's documentation (G-code index); Klipper's documents, "G-Codes"; Duet3D's G-code
dictionary; Prusa-Firmware's list of D codes; the machine definitions of PrusaSlicer and Cura.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from printer_slicer.firmware.firmware import SetsLimits
from printer_slicer.gcode.commands import Effect, find_codes_as_text
from printer_slicer.gcode.lexer import LintCommand
from printer_slicer.profile import Printer
from printer_slicer.values import Struct

__all__ = ["RULES", "Rule", "RuleResult"]

RuleResult = tuple[bool, str]
"""Whether a command is an error (else a warning), and what the command does."""

_RuleCheck = Callable[[LintCommand, Printer], RuleResult | None]

_PER_MINUTE: Final = 60.0
_MAX_LIMIT_RATIO: Final = 20.0
"""A limit above this multiple of that of the profile is an error. The factor from mm/s to mm/min is 60; slicers write
up to 18 times too much for printers that they do not know."""

_OF_ONE_FIRMWARE: Final = frozenset({"M566", "SET_VELOCITY_LIMIT"})
"""Commands that only some firmwares know."""

_MAX_BABYSTEP: Final = 0.5  # mm; babysteps are smaller
_M118_OPTIONS: Final = re.compile(r"(?:[AEP]\d *)*")
_LOOKS_LIKE_REPLY: Final = re.compile(
    r"OK\b|RESEND|RS |ERROR|START\b|WAIT\b|!!|FATAL|ECHO: *BUSY|BUSY|FIRMWARE_NAME|CAP:|T\d*:|B:|X:"
)
_USUAL_FLOW: Final = (75.0, 130.0)
"""% flow that start G-code of known printers and materials sets."""

_USUAL_SPEED: Final = (25.0, 200.0)
_MIN_EXTRUSION_TEMPERATURE: Final = 170.0  # °C; Marlin's own EXTRUDE_MINTEMP


class Rule(Struct, frozen=True):
    """A rule for some commands.

    Attributes:
        name: diagnostic code.
        codes: codes of the commands.
        check: returns what a command does; None if it is harmless.
        reason: the reason why it matters.
    """

    name: str
    codes: frozenset[str]
    check: _RuleCheck
    reason: str


def _always_report(effect: str, *, is_warning: bool = False) -> _RuleCheck:
    """Make a check that reports every use of a command."""
    return lambda _command, _printer: (not is_warning, effect)


def _report_if_any(letters: str, effect: str, *, is_warning: bool = False) -> _RuleCheck:
    """Make a check that reports a command with any of the letters; without them, a command only queries."""

    def check(command: LintCommand, _printer: Printer) -> RuleResult | None:
        """Check a command for the letters."""
        return (not is_warning, effect) if set(command.words) & set(letters) else None

    return check


def _check_limits(command: LintCommand, printer: Printer) -> RuleResult | None:
    """Check motion limits: warn above the profile's limits; reject far higher limits and far lower speeds."""
    worst: tuple[float, str] = (1.0, "")
    for letter, requested, most in _requested_limits(command, printer):
        if command.code == "M203" and 0 < requested < most / _MAX_LIMIT_RATIO:
            unit = "mm/min" if _limit_unit(command, printer) == _PER_MINUTE else "mm/s"
            return (
                True,
                f"{letter} {requested:.3g} mm/s, the profile has {most:g} mm/s; the firmware expects {unit}",
            )
        if most > 0 and requested / most > worst[0] * 1.001:
            worst = (requested / most, f"{letter} {requested:g}, the profile has {most:g}")
    return (worst[0] > _MAX_LIMIT_RATIO, worst[1]) if worst[1] else None


def _requested_limits(command: LintCommand, printer: Printer) -> list[tuple[str, float, float]]:
    """Return letter, requested limit and profile limit for each limit that a command sets, in mm and s."""
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
        "M205": _corner_limits(printer),
        "M566": _corner_limits(printer),
        "SET_VELOCITY_LIMIT": {
            "accel": printer.acceleration,
            "velocity": max(printer.max_speed_x, printer.max_speed_y),
        },
    }
    unit = _limit_unit(command, printer)
    if command.code not in known or unit is None:
        return []
    given = {name: max(numbers) for name, numbers in command.words.items() if numbers} | command.settings
    return [
        (name, given[name.upper()] / unit, most)
        for name, most in known[command.code].items()
        if name.upper() in given
    ]


def _limit_unit(command: LintCommand, printer: Printer) -> float | None:
    """Return the unit of a limit command per mm/s; None if it sets no limits in the printer's firmware.

    A firmware ignores the limit commands of other firmwares; nearly all of them read those of Marlin.
    """
    reads = printer.firmware.dialect.commands
    if command.code not in reads:
        return None if command.code in _OF_ONE_FIRMWARE else 1.0
    meaning = reads[command.code]
    if meaning is None:
        return None
    return _PER_MINUTE if isinstance(meaning, SetsLimits) and meaning.scale != 1.0 else 1.0


def _corner_limits(printer: Printer) -> dict[str, float]:
    """Return the profile's cornering limits, with the letter that sets each."""
    if printer.corner == "jerk":
        return {"x": printer.jerk_xy, "y": printer.jerk_xy, "z": printer.jerk_z, "e": printer.jerk_e}
    return {"j": printer.junction_deviation} if printer.corner == "junction_deviation" else {}


def _check_cold_extrusion(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check whether M302 allows extrusion below the usual minimum temperature."""
    if command.code == "M302" and any(value for value in command.words.get("P", ())):
        return True, "allows cold extrusion"
    least = min((value for letter in "SR" for value in command.words.get(letter, ())), default=None)
    if least is None or least >= _MIN_EXTRUSION_TEMPERATURE:
        return None
    return True, f"allows extrusion at {least:g} °C"


def _check_flow_ratio(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check M221: flow values that are common in start G-code cause a warning, other values an error."""
    return _check_percentage(command, "flow", _USUAL_FLOW)


def _check_speed_ratio(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check M220: only extreme speed overrides are errors, because the firmware limits speeds."""
    return _check_percentage(command, "speed", _USUAL_SPEED)


def _check_percentage(command: LintCommand, quantity: str, usual: tuple[float, float]) -> RuleResult | None:
    """Check a percentage: warn if it is not 100; report an error outside the usual range."""
    percent = command.find_largest_number("S")
    if percent is None or percent == 100:
        return None
    low, high = usual
    return not low <= percent <= high, f"sets the {quantity} to {percent:g}%"


def _check_endstops(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check whether a command switches the endstops off by an argument of 0."""
    off = [letter for letter, values in command.words.items() if letter in "SH" and 0 in values]
    return (True, "switches the software endstops off") if off else None


def _check_wait(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check M0 and M1: with a time, the wait ends by itself; else a person must continue the print."""
    ends = [value for letter in "PS" for value in command.words.get(letter, ()) if value > 0]
    return (False, "waits for a fixed time") if ends else (True, "waits until somebody presses a button")


def _check_g10(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check G10: with L it sets an origin; without L it retracts or sets tool temperatures."""
    return (True, "shifts the origin") if "L" in command.words else None


def _check_babystep(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check M290: warn about babysteps, reject larger shifts; without a distance, nothing shifts."""
    steps = [abs(value) for letter in "XYZS" for value in command.words.get(letter, ())]
    most = max(steps, default=0.0)
    return (most > _MAX_BABYSTEP, f"shifts the nozzle by {most:g} mm") if most else None


def _check_m118(command: LintCommand, _printer: Printer) -> RuleResult | None:
    """Check whether M118 sends a text that hosts may take for a reply of the printer."""
    text = _M118_OPTIONS.sub("", command.text.partition("M118")[2].lstrip())
    if _LOOKS_LIKE_REPLY.match(text):
        return True, "sends a text that looks like a reply of the firmware"
    return (False, "sends an action command to the host") if "ACTION:" in text.replace(" ", "") else None


def _split_codes(text: str) -> frozenset[str]:
    """Return the command codes in a text, in which spaces separate them."""
    return frozenset(text.split())


_ENDED_BY_BUTTON: Final = _split_codes("M0 M1")
_OUTLIVES_PRINT: Final = "The change outlives the print"
_PROTECTION_OFF: Final = "A protection of the printer is switched off"

RULES: Final[tuple[Rule, ...]] = (
    Rule(
        "eeprom",
        _split_codes("M500"),
        _always_report("stores settings in the EEPROM of the printer"),
        _OUTLIVES_PRINT,
    ),
    Rule(
        "eeprom",
        _split_codes("M501"),
        _always_report("replaces the current settings by stored ones"),
        _OUTLIVES_PRINT,
    ),
    Rule(
        "eeprom",
        _split_codes("M502 M504"),
        _always_report("resets all settings of the firmware"),
        _OUTLIVES_PRINT,
    ),
    Rule(
        "eeprom",
        _split_codes("SAVE_CONFIG"),
        _always_report("writes the configuration and restarts Klipper"),
        _OUTLIVES_PRINT,
    ),
    Rule(
        "limits",
        _split_codes("M201 M203 M204 M205 M566 SET_VELOCITY_LIMIT"),
        _check_limits,
        "The motors may lose steps, or hardly move",
    ),
    Rule(
        "calibration",
        _split_codes("M92"),
        _report_if_any("XYZEABC", "sets steps per mm"),
        "Dimensions may come out wrong",
    ),
    Rule(
        "calibration",
        _split_codes("M301 M304 M306 M307"),
        _report_if_any("HPIDCRAS", "sets PID values of a heater"),
        "Temperatures may overshoot",
    ),
    Rule(
        "calibration",
        _split_codes("M305"),
        _report_if_any("PTBRS", "configures a thermistor"),
        "Temperatures may be read wrong",
    ),
    Rule(
        "calibration",
        _split_codes("M350 M569 M665 M666 M669 M667"),
        _report_if_any("XYZEABCDHLRSPT", "sets geometry or motor drivers", is_warning=True),
        "Check that the new values suit the printer",
    ),
    Rule(
        "calibration",
        _split_codes("M906 M907 M908 M913"),
        _report_if_any("XYZEABCS", "sets motor currents", is_warning=True),
        "Check that the currents suit the printer",
    ),
    Rule(
        "autotune",
        _split_codes("M303 PID_CALIBRATE"),
        _always_report("runs PID autotune"),
        "It heats by itself",
    ),
    Rule("cold", _split_codes("M302"), _check_cold_extrusion, "A cold extruder grinds the filament"),
    Rule("ratio", _split_codes("M221"), _check_flow_ratio, "The part was sliced for 100%"),
    Rule("ratio", _split_codes("M220"), _check_speed_ratio, "The part was sliced for 100%"),
    Rule(
        "protection",
        _split_codes("M143 M562 M570"),
        _always_report("changes the protection of the heaters"),
        _PROTECTION_OFF,
    ),
    Rule("endstops", _split_codes("M211 M564"), _check_endstops, _PROTECTION_OFF),
    Rule("endstops", _split_codes("FORCE_MOVE"), _always_report("moves beyond all limits"), _PROTECTION_OFF),
    Rule(
        "offsets",
        find_codes_as_text(Effect.MOVES_ORIGIN | Effect.SETS_HOME_OFFSET)
        | _split_codes("M851 SET_GCODE_OFFSET SET_KINEMATIC_POSITION"),
        lambda command, _: (
            (True, "shifts the origin")
            if command.words or command.settings or command.code != "M851"
            else None
        ),
        "The position of later moves is unknown",
    ),
    Rule(
        "offsets",
        _split_codes("M290"),
        _check_babystep,
        "The first layer may not stick, or the nozzle may hit the bed",
    ),
    Rule("offsets", _split_codes("G10"), _check_g10, "The position of later moves is unknown"),
    Rule(
        "halt",
        _split_codes("M112 EMERGENCY_STOP"),
        _always_report("halts the printer"),
        "The print ends there",
    ),
    Rule("halt", _split_codes("M410"), _always_report("drops all planned moves"), "The position is lost"),
    Rule(
        "halt",
        _split_codes("M81"),
        _always_report("switches the power off", is_warning=True),
        "The fans stop too",
    ),
    Rule("wait", _ENDED_BY_BUTTON, _check_wait, "The print stands still with hot heaters until then"),
    Rule(
        "wait",
        find_codes_as_text(Effect.WAITS_FOR_PERSON) - _ENDED_BY_BUTTON,
        _always_report("waits for a person", is_warning=True),
        "A person must continue the print",
    ),
    Rule(
        "firmware",
        _split_codes("M997"),
        _always_report("updates the firmware"),
        "The printer may behave differently afterwards",
    ),
    Rule(
        "firmware",
        _split_codes("M999 FIRMWARE_RESTART RESTART DFU UPGRADE BREAK"),
        _always_report("restarts the firmware, also after a fault"),
        "Position and errors are lost",
    ),
    Rule(
        "files",
        _split_codes("M23 M24 M28 M30 M32 M928 M471 M472 SDCARD_PRINT_FILE"),
        _always_report("reads, writes or deletes files on the printer"),
        "Their contents are unknown",
    ),
    Rule(
        "pins",
        _split_codes("M42 M43"),
        _always_report("switches pins of the board"),
        "A heater may be connected to one",
    ),
    Rule(
        "macros",
        frozenset(f"M{number}" for number in range(810, 820)),
        _always_report("stores or runs a macro"),
        "Its effect is unknown",
    ),
    Rule(
        "link",
        _split_codes("M110"),
        _always_report("changes line numbers that the host counts"),
        "Lines may get lost",
    ),
    Rule("link", _split_codes("M118"), _check_m118, "Hosts may take the text for a reply"),
    Rule(
        "link", _split_codes("M575"), _always_report("changes the baud rate"), "The host loses the connection"
    ),
    Rule(
        "link",
        _split_codes("M552 M586 M587 M588 M589"),
        _always_report("configures the network"),
        _OUTLIVES_PRINT,
    ),
    Rule(
        "debug",
        _split_codes("M111"),
        _report_if_any("S", "switches a debug mode on"),
        "The printer may not move or heat",
    ),
    Rule(
        "unreadable",
        _split_codes("G5 G6 G18 G19 G38 G42"),
        _always_report("is a move that this check does not support"),
        "Its target is unknown",
    ),
    Rule(
        "shell", _split_codes("RUN_SHELL_COMMAND"), _always_report("runs a program"), "Its effect is unknown"
    ),
)
