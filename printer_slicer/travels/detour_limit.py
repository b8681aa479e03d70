"""Length limits for detours that avoid a retraction."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Printer, Profile

__all__ = ["detour_limits"]


def detour_limits(straight: Float, profile: Profile) -> Float:
    """Return the largest length (W,) of detours inside the part, mm.

    A detour may be longer than the straight travel by `quality.max_detour`. It may also be as long as possible without
    taking more time than the straight travel with a retraction, each from standstill to standstill. Corners are not
    counted.

    Args:
        straight: (W,) mm, lengths of the straight travels that need a retraction.
        profile: speeds, accelerations and retraction.
    """
    speed = min(profile.speeds.travel, profile.printer.max_speed_x, profile.printer.max_speed_y)
    machine = limits_of(profile.printer)
    acceleration = min(machine.travel_acceleration, *machine.max_acceleration[:2])
    seconds = _estimate_move_time(straight, speed, acceleration) + _estimate_retraction_time(profile.printer)
    full = speed / acceleration  # s to reach the speed
    equal_time = np.where(seconds < 2 * full, acceleration * seconds**2 / 4, speed * (seconds - full))
    return np.asarray(np.maximum(equal_time, straight + profile.quality.max_detour))


def _estimate_retraction_time(printer: Printer) -> float:
    """Return the time for retraction, Z hop and deretraction, s."""
    machine = limits_of(printer)
    speeds = (min(one, printer.max_speed_e) for one in (printer.retract_speed, printer.deretract_speed))
    pull = min(printer.retract_acceleration, printer.max_acceleration_e)
    hop = min(printer.acceleration, machine.max_acceleration[2])
    turns = sum(
        float(_estimate_move_time(np.float64(printer.retract_length), speed, pull)) for speed in speeds
    )
    return turns + 2 * float(_estimate_move_time(np.float64(printer.z_hop), printer.max_speed_z, hop))


def _estimate_move_time(distance: Float | np.float64, speed: float, acceleration: float) -> Float:
    """Return the time from standstill to standstill over `distance` mm, s."""
    ramps = speed**2 / acceleration  # mm to reach the speed and to stop from it
    return np.where(
        distance < ramps, 2 * np.sqrt(distance / acceleration), distance / speed + speed / acceleration
    )
