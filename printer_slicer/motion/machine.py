"""The limits of motion that a printer's profile describes."""

from __future__ import annotations

from printer_slicer.motion.rules import MotionLimits
from printer_slicer.profile import Printer

__all__ = ["limits_of"]


def limits_of(printer: Printer) -> MotionLimits:
    """What the firmware of this printer obeys: speeds mm/s, accelerations mm/s²."""
    one = printer.firmware.one_acceleration
    return MotionLimits(
        max_speed=(printer.max_speed_x, printer.max_speed_y, printer.max_speed_z, printer.max_speed_e),
        max_acceleration=(
            printer.max_acceleration_x,
            printer.max_acceleration_y,
            printer.max_acceleration_z,
            printer.max_acceleration_e,
        ),
        acceleration=printer.acceleration,
        travel_acceleration=printer.acceleration if one else printer.travel_acceleration,
        retract_acceleration=printer.retract_acceleration,
        corner=printer.corner,
        junction_deviation=printer.junction_deviation,
        jerk=(printer.jerk_xy, printer.jerk_xy, printer.jerk_z, printer.jerk_e),
        square_corner_velocity=printer.square_corner_velocity,
        minimum_cruise_ratio=printer.minimum_cruise_ratio,
        planner_blocks=printer.firmware.planner_blocks,
        min_segment_seconds=printer.min_segment_time,
    )
