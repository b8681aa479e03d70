"""What a dialect of G-code has to say in its own way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from printer_slicer.macros import number
from printer_slicer.profile import Printer

__all__ = ["Dialect", "bed_line", "fan_line", "nozzle_line"]


@dataclass(frozen=True, slots=True)
class Dialect:
    """Commands that differ between firmwares, as functions that give whole lines.

    Attributes:
        limits: the motion limits of the profile, so that the machine moves as the time model says.
        fan: part fan at a ratio from 0 to 1.
        nozzle: nozzle temperature, °C, without waiting.
        bed: bed temperature, °C, without waiting.
        pause: waits for a person, where the profile has no pause G-code of its own.
    """

    limits: Callable[[Printer], list[str]]
    fan: Callable[[float], str]
    nozzle: Callable[[float], str]
    bed: Callable[[float], str]
    pause: str


def fan_line(ratio: float) -> str:
    """M106 with the fan at a ratio from 0 to 1, M107 for off."""
    return f"M106 S{round(ratio * 255)}" if ratio > 0 else "M107"


def nozzle_line(temperature: float) -> str:
    """M104: heat, do not wait."""
    return f"M104 S{number(temperature)}"


def bed_line(temperature: float) -> str:
    """M140: heat, do not wait."""
    return f"M140 S{number(temperature)}"
