"""Set the acceleration of moves by role."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, SmallInt
from printer_slicer.model import Acceleration, Program
from printer_slicer.profile import Printer, Profile
from printer_slicer.roles import ROLES, Role

__all__ = ["acceleration_events", "move_accelerations"]


def acceleration_events(
    role: SmallInt, on_bed: Bool, settings_id: Int, profiles: tuple[Profile, ...]
) -> tuple[Acceleration, ...]:
    """Return the changes of acceleration between moves; none if all moves have the printer's acceleration.

    Args:
        role: (K,) role of each move.
        on_bed: (K,) whether the move belongs to a first layer.
        settings_id: (K,) index of each move's profile in `profiles`.
        profiles: the profiles.
    """
    profile = profiles[0]
    of_role = np.stack([_role_accelerations(one) for one in profiles])
    first, usual = profile.accelerations.first_layer, profile.printer.acceleration
    if (of_role == usual).all() and first in {0, usual}:
        return ()
    beads = np.flatnonzero(role != Role.TRAVEL)
    acceleration = of_role[settings_id[beads], role[beads]]
    if first:
        acceleration = np.where(on_bed[beads], first, acceleration)
    change = np.flatnonzero(np.diff(acceleration, prepend=usual) != 0)
    return tuple(
        Acceleration(index, value)
        for index, value in zip(beads[change].tolist(), acceleration[change].tolist(), strict=True)
    )


def move_accelerations(program: Program, printer: Printer, first: int, last: int) -> Float | None:
    """Return the acceleration (n,) of moves from `first` up to `last`, mm/s²; None if the program never changes it."""
    events = [event for event in program.events if isinstance(event, Acceleration)]
    if not events:
        return None
    change = np.clip([event.index for event in events], first, last)
    acceleration = np.repeat(
        np.array([printer.acceleration, *(event.value for event in events)], np.float64),
        np.diff(change, prepend=first, append=last),
    )
    if printer.firmware.has_single_acceleration:
        return acceleration
    moves = np.ones(last - first, np.bool_)
    xyz = program.xyz[first:last]
    moves[:1] = (xyz[:1] != (program.xyz[first - 1] if first else program.origin)).any(axis=1)
    (xyz[1:] != xyz[:-1]).any(axis=1, out=moves[1:])
    feeds = program.filament[first:last] != 0
    others = np.flatnonzero(~(moves & feeds))
    acceleration[others] = np.where(feeds[others], printer.retract_acceleration, printer.travel_acceleration)
    return acceleration


def _role_accelerations(profile: Profile) -> Float:
    """Return the acceleration (roles,) of each role, mm/s²."""
    return np.array([getattr(profile.accelerations, row.acceleration) for row in ROLES])
