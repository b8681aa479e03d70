"""The hardware of the simulated printer; the defaults are those of an unconfigured Marlin."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from printer_slicer.motion.rules import Axes, MotionLimits
from printer_slicer.sim.heater import HeaterSpec
from printer_slicer.sim.heater_protection import ProtectionLimits
from printer_slicer.values import Struct, field

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["AXES", "Machine", "Position", "replace_axis_values"]

Position = tuple[float, float, float]
"""Coordinates x, y, z, mm."""

AXES = "XYZE"
"""Letters of the axes in the order of every `Axes` tuple."""


def _default_limits() -> MotionLimits:
    """Return the motion limits of an unconfigured Marlin."""
    return MotionLimits(
        max_speed=(300.0, 300.0, 5.0, 25.0),
        max_acceleration=(3000.0, 3000.0, 100.0, 10000.0),
        acceleration=3000.0,
        travel_acceleration=3000.0,
        retract_acceleration=3000.0,
        corner="junction_deviation",
        junction_deviation=0.01,
        jerk=(10.0, 10.0, 0.3, 5.0),
        square_corner_velocity=5.0,
    )


def _default_hotend() -> HeaterSpec:
    """Return the properties of a typical hotend with a heater of 40 W."""
    return HeaterSpec(power=40.0, heat_capacity=12.0, loss=0.1, fan_loss=0.03, highest=260.0)


def _default_bed() -> HeaterSpec:
    """Return the properties of a typical bed with a heater of 220 W."""
    return HeaterSpec(power=220.0, heat_capacity=750.0, loss=1.6, fan_loss=0.2, highest=140.0)


def _default_bed_protection() -> ProtectionLimits:
    """Return the limits of Marlin's heater protection for a bed."""
    return ProtectionLimits(margin=10.0, watch_seconds=60.0, hysteresis=2.0, runaway_seconds=20.0)


class Machine(Struct, frozen=True):
    """The hardware of a printer with a bed and one or more extruders.

    Attributes:
        limits: maximum speeds and accelerations, and number of planner blocks, at power-on.
        box_min, box_max: corners of the reachable volume, x, y, z, mm.
        home: positions of the endstops, x, y, z, mm.
        homing_speed: homing speeds of x, y, z, mm/s.
        homing_bump: time per axis for backing off and touching again, s.
        steps: steps per mm of x, y, z, e; used only for the step counts of M114.
        hotend, bed: properties of the heaters; all extruders have equal hotends.
        one_hotend: whether the extruders share one hotend.
        hotend_protection, bed_protection: limits of the heater protection.
        melting: heat that the filament carries away, J per mm³ and °C above ambient.
        extruders: number of extruders.
        tool_change: duration of a tool change, s.
        coldest_extrusion: minimum extrusion temperature, °C (M302 changes it).
        longest_extrusion: maximum extrusion of one move, mm of filament; longer ones are ignored.
        ambient: room temperature, °C.
        filament_diameter: mm.
        filament_left: filament on the spool, mm; infinity: unlimited.
        runout_sensor: whether the printer detects a filament runout.
        nozzle: nozzle diameter, mm; Klipper rejects extrusions with a cross-section of more than 4 nozzle².
        card: whether there is a card reader with a card.
        probe_points: number of points of G29; 0: there is no probe, so G29 is unknown.
        probe_seconds: time for one point of G29, s.
        person_seconds: time until a person presses the button after M0 or M1, s; infinity: never.
        first_move_delay: time that an idle machine waits for a third move before it starts, s.
    """

    limits: MotionLimits = field(default_factory=_default_limits)
    box_min: Position = (0.0, 0.0, 0.0)
    box_max: Position = (200.0, 200.0, 200.0)
    home: Position = (0.0, 0.0, 0.0)
    homing_speed: Position = (50.0, 50.0, 4.0)
    homing_bump: float = 1.5
    steps: Axes = (80.0, 80.0, 400.0, 500.0)
    hotend: HeaterSpec = field(default_factory=_default_hotend)
    bed: HeaterSpec = field(default_factory=_default_bed)
    hotend_protection: ProtectionLimits = field(default_factory=ProtectionLimits)
    bed_protection: ProtectionLimits = field(default_factory=_default_bed_protection)
    melting: float = 0.0022
    extruders: int = 1
    one_hotend: bool = False
    tool_change: float = 2.0
    coldest_extrusion: float = 170.0
    longest_extrusion: float = 200.0
    ambient: float = 21.0
    filament_diameter: float = 1.75
    filament_left: float = inf
    runout_sensor: bool = False
    nozzle: float = 0.4
    card: bool = False
    probe_points: int = 0
    probe_seconds: float = 3.0
    person_seconds: float = inf
    first_move_delay: float = 0.1


def replace_axis_values(axes: Axes, changes: Mapping[str, float]) -> Axes:
    """Return `axes` with new values for the axis letters in `changes`."""
    x, y, z, e = (changes.get(letter, value) for letter, value in zip(AXES, axes, strict=True))
    return x, y, z, e
