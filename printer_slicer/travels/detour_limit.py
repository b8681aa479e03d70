"""Limits for the length of detours that avoid a retraction."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Printer, Profile

__all__ = ["detour_limits"]


def detour_limits(straight: Float, profile: Profile) -> Float:
    """(W,) mm: how long a way inside may be where the straight one of `straight` (W,) mm needs a retraction.

    Longer by `quality.max_detour`, or as long as takes no more time than straight way and retraction, all of them from
    rest to rest; corners are not counted.
    """
    speed = min(profile.speeds.travel, profile.printer.max_speed_x, profile.printer.max_speed_y)
    machine = limits_of(profile.printer)
    acceleration = min(machine.travel_acceleration, *machine.max_acceleration[:2])
    seconds = _seconds(straight, speed, acceleration) + _retraction(profile.printer)
    full = speed / acceleration  # s to reach the speed
    as_quick = np.where(seconds < 2 * full, acceleration * seconds**2 / 4, speed * (seconds - full))
    return np.asarray(np.maximum(as_quick, straight + profile.quality.max_detour))


def _retraction(printer: Printer) -> float:
    """S that pulling filament back, pushing it forward and lifting the nozzle in between take."""
    machine = limits_of(printer)
    speeds = (min(one, printer.max_speed_e) for one in (printer.retract_speed, printer.deretract_speed))
    pull = min(printer.retract_acceleration, printer.max_acceleration_e)
    hop = min(printer.acceleration, machine.max_acceleration[2])
    turns = sum(float(_seconds(np.float64(printer.retract_length), speed, pull)) for speed in speeds)
    return turns + 2 * float(_seconds(np.float64(printer.z_hop), printer.max_speed_z, hop))


def _seconds(distance: Float | np.float64, speed: float, acceleration: float) -> Float:
    """From rest to rest over `distance`, mm."""
    ramps = speed**2 / acceleration  # mm to reach the speed and to stop from it
    return np.where(
        distance < ramps, 2 * np.sqrt(distance / acceleration), distance / speed + speed / acceleration
    )
