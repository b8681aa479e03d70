"""Estimate the print time of the layers of a plate, to compare a plan for each object with one plan for all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.planning.line_timing import time_moves
from printer_slicer.profile import Profile, profile_with
from printer_slicer.surface import read_surface
from printer_slicer.values import Struct

__all__ = ["GroupLayers", "estimate_plate_seconds", "list_changes_of_group"]

_SAME_TOP: Final = 6  # decimals, mm


class GroupLayers(Struct, frozen=True, eq=False):
    """The layers of a group of objects.

    Attributes:
        mesh: the group, standing on z = 0; equal groups share it.
        plan: its layers; those above its top are not counted.
        place: (x, y) of its middle on the bed, mm.
        least: minimum layer time, s, of this group alone.
    """

    mesh: Mesh
    plan: LayerPlan
    place: tuple[float, float]
    least: float

    @property
    def n_layers(self) -> int:
        """Number of layers that cut the mesh."""
        return int(np.searchsorted(self.plan.cut, self.mesh.height))


def estimate_plate_seconds(groups: Sequence[GroupLayers], profile: Profile) -> float:
    """Return the modelled print time of all groups together with the travels between them, s."""
    known: dict[tuple[int, int], float] = {}
    for one in groups:
        key = id(one.mesh), id(one.plan)
        if key not in known:
            known[key] = _estimate_layer_seconds(one, profile)
    seconds = sum(known[id(one.mesh), id(one.plan)] for one in groups)
    if profile.quality.print_order == "by_object":
        return seconds
    return seconds + _estimate_travel_seconds(groups, profile)


def _estimate_layer_seconds(group: GroupLayers, profile: Profile) -> float:
    """Return the modelled time of the layers of a group, s."""
    own = profile_with(profile, {"material.min_layer_time": group.least})
    n = group.n_layers
    heights = group.plan.height[:n]
    times = LayerTimes(read_surface(group.mesh), own, group.plan.cut[:n])
    distinct = np.unique(heights)
    times.prepare(distinct)
    return float(sum(times.seconds(np.flatnonzero(heights == one), one).sum() for one in distinct.tolist()))


def _estimate_travel_seconds(groups: Sequence[GroupLayers], profile: Profile) -> float:
    """Return the time of the travels from group to group, with their retractions, s."""
    begin, end = list_changes_of_group([one.plan.top[: one.n_layers] for one in groups])
    place = np.array([one.place for one in groups])
    printer, limits = profile.printer, limits_of(profile.printer)
    travels = time_moves(
        np.hypot(*(place[end] - place[begin]).T), profile.speeds.travel, limits.travel_acceleration
    )
    pulled = sum(
        float(time_moves(printer.retract_length, speed, limits.retract_acceleration))
        for speed in (printer.retract_speed, printer.deretract_speed)
    )
    hop = 2 * float(time_moves(printer.z_hop, printer.max_speed_z, printer.max_acceleration_z))
    return float((travels + pulled + hop).sum())


def list_changes_of_group(tops: Sequence[Float]) -> tuple[Int, Int]:
    """Return the groups (C,) before and after each change of group, if layers follow in the order of their tops.

    Groups whose layers have the same top begin with the group that is printed already.

    Args:
        tops: tops of the layers of each group, mm, ascending.
    """
    number = np.repeat(np.arange(len(tops)), [len(one) for one in tops])
    top = np.round(np.concatenate([*tops]), _SAME_TOP)
    order = np.lexsort((number, top))
    top, number = top[order], number[order]
    visited: list[int] = []
    for here in np.split(number, np.flatnonzero(np.diff(top)) + 1):
        last = visited[-1:]
        visited += [one for one in here.tolist() if one not in last]
    sequence = np.array(visited, np.int64)
    return sequence[:-1], sequence[1:]
