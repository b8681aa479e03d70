"""Set the acceleration of moves by role."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Acceleration, Program
from printer_slicer.profile import Printer, Profile
from printer_slicer.roles import ROLES, Role

__all__ = ["acceleration_events", "move_accelerations"]


def acceleration_events(
    role: Int, on_bed: Bool, settings_id: Int, profiles: tuple[Profile, ...]
) -> tuple[Acceleration, ...]:
    """Return the changes of acceleration between moves; none if all moves have the printer's acceleration.

    Args:
        role: (K,) role of each move.
        on_bed: (K,) whether the move belongs to a first layer.
        settings_id: (K,) index of each move's profile in `profiles`.
        profiles: the profiles.
    """
    profile = profiles[0]
    beads = np.flatnonzero(role != Role.TRAVEL)
    acceleration = np.stack([_role_accelerations(one) for one in profiles])[settings_id[beads], role[beads]]
    first = profile.accelerations.first_layer
    if first:
        acceleration = np.where(on_bed[beads], first, acceleration)
    change = np.flatnonzero(np.diff(acceleration, prepend=profile.printer.acceleration) != 0)
    return tuple(
        Acceleration(index, value)
        for index, value in zip(beads[change].tolist(), acceleration[change].tolist(), strict=True)
    )


def move_accelerations(program: Program, printer: Printer, first: int, last: int) -> Float | None:
    """Return the acceleration (n,) of moves from `first` up to `last`, mm/s²; None if the program never changes it."""
    events = [event for event in program.events if isinstance(event, Acceleration)]
    if not events:
        return None
    at = np.searchsorted([event.index for event in events], np.arange(first, last), side="right")
    set_by_then = np.array([printer.acceleration, *(event.value for event in events)])[at]
    if printer.firmware.has_single_acceleration:
        return set_by_then
    moves = (program.xyz[first:last] != program.start[first:last]).any(axis=1)
    feeds = program.filament[first:last] != 0
    others = np.where(feeds, printer.retract_acceleration, printer.travel_acceleration)
    return np.where(moves & feeds, set_by_then, others)


def _role_accelerations(profile: Profile) -> Float:
    """Return the acceleration (roles,) of each role, mm/s²."""
    return np.array([getattr(profile.accelerations, row.acceleration) for row in ROLES])
