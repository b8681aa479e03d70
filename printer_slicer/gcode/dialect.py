"""What a dialect of G-code has to say in its own way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from printer_slicer.gcode.reading import Action
from printer_slicer.macros import number
from printer_slicer.motion.counting import Rule
from printer_slicer.profile import Printer

__all__ = [
    "Dialect",
    "axes_line",
    "bed_line",
    "fan_line",
    "jerk_line",
    "marlin_limits",
    "nozzle_line",
    "retraction_lines",
]


@dataclass(frozen=True, slots=True)
class Dialect:
    """Commands that differ between firmwares, as functions that give whole lines.

    Attributes:
        limits: the motion limits of the profile, so that the machine moves as the time model says.
        acceleration: mm/s² while printing; of all moves, where the firmware has one acceleration.
        pause: waits for a person, where the profile has no pause G-code of its own.
        pressure_advance: s; None where there is no command for it.
        retraction: tells the firmware how to retract; None where it cannot be told.
        progress: percent done and minutes left; None where nothing would show it.
        labels: how things on the plate are marked where the profile says `auto`, a key of `LABEL_WORDS`.
        m486: how where it says `m486`, likewise.
        counting: by which rule G90, G91, M82 and M83 are read.
        any_case: whether the firmware accepts commands and words in lower case.
        reads: what commands mean that mean something else in Marlin 2, for who reads files.
    """

    limits: Callable[[Printer], list[str]]
    acceleration: Callable[[float], str]
    pause: str
    pressure_advance: Callable[[float], str] | None = None
    retraction: Callable[[Printer], list[str]] | None = None
    progress: Callable[[int, int], str] | None = None
    labels: str = "octoprint"
    m486: str = "m486"
    counting: Rule = "together"
    any_case: bool = False
    reads: Mapping[str, Action] = field(default_factory=dict)


def fan_line(ratio: float) -> str:
    """M106 with the fan at a ratio from 0 to 1, M107 for off; all firmwares know S as a share of 255."""
    return f"M106 S{round(ratio * 255)}" if ratio > 0 else "M107"


def nozzle_line(temperature: float, tool: int | None = None) -> str:
    """M104: heat, do not wait; the nozzle of a tool, or of the one in use."""
    return f"M104{'' if tool is None else f' T{tool}'} S{number(temperature)}"


def bed_line(temperature: float) -> str:
    """M140: heat, do not wait."""
    return f"M140 S{number(temperature)}"


def axes_line(code: str, printer: Printer, limit: str, scale: float = 1.0) -> str:
    """A limit (`max_speed`, `max_acceleration`) of all four axes."""
    words = [f"{axis.upper()}{number(scale * getattr(printer, f'{limit}_{axis}'))}" for axis in "xyze"]
    return f"{code} {' '.join(words)}"


def jerk_line(code: str, printer: Printer, scale: float = 1.0) -> str:
    """The jerk of all four axes."""
    xy, z, e = (number(scale * jerk) for jerk in (printer.jerk_xy, printer.jerk_z, printer.jerk_e))
    return f"{code} X{xy} Y{xy} Z{z} E{e}"


def marlin_limits(printer: Printer, corner: str) -> list[str]:
    """M201, M203, M204, all in mm and s, and a line about corners."""
    print_, retract = number(printer.acceleration), number(printer.retract_acceleration)
    return [
        f"{axes_line('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{axes_line('M203', printer, 'max_speed')} ; mm/s",
        f"M204 P{print_} R{retract} T{number(printer.travel_acceleration)} ; mm/s^2",
        corner,
    ]


def retraction_lines(printer: Printer) -> list[str]:
    """M207 and M208 for G10 and G11, without lift: lifting is left to the moves. F in mm/min."""
    back, forward = number(printer.retract_speed * 60), number(printer.deretract_speed * 60)
    return [
        f"M207 S{number(printer.retract_length)} F{back} Z0",
        f"M208 S{number(printer.deretract_extra)} F{forward}",
    ]
