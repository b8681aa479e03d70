"""Estimate a lower bound of the cost of trees; no trees are grown where columns cost less than this bound."""

from __future__ import annotations

from math import pi, sqrt, tan
from math import radians as as_radians
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.model import Supports, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.supports.patch_groups import PatchGroups

__all__ = ["estimate_least_tree_costs"]

_MIN_LOOPS: Final = 0.5  # in each layer of a group; less area is a rest of a column


def estimate_least_tree_costs(
    columns: Supports, paths: Toolpaths, groups: PatchGroups, profile: Profile
) -> Float:
    """Return a lower estimate (G,) of the cost of trees for each group: print time and price of filament, min.

    Trees have the same interfaces as columns. Branches start below them, one for each rectangle between joists and
    tips. They approach each other at a limited angle, so the higher a layer, the more of them it has at least.

    Args:
        columns: the columns for the same overhangs.
        paths: their paths.
        groups: of patches.
        profile: settings of trees, speeds and accelerations.
    """
    quality, layers, n = profile.quality, columns.plan.layers, groups.count
    areas = columns.base.of_layers(np.arange(1, layers.n_layers))  # the lowest layer has a foot
    group = groups.find(areas.xy[areas.ring_start[:-1]])
    covered = np.bincount(group * layers.n_layers + areas.ring_layer, areas.ring_area(), n * layers.n_layers)
    covered = covered.reshape(n, layers.n_layers)
    highest = np.where(covered > 0, layers.top, 0.0).max(axis=1)
    reach = tan(as_radians(quality.support_tree_slow_angle_deg)) * np.maximum(
        highest[:, None] - layers.top, 0.0
    )
    each = (
        quality.support_joist_spacing * quality.support_tip_distance + pi * reach**2
    )  # mm² that a branch carries
    loops = covered / each
    loops = np.where(covered > 0, np.maximum(loops, _MIN_LOOPS), 0.0)
    length = pi * (quality.support_branch_diameter - profile.extrusion_width)
    width = np.maximum(profile.extrusion_width, layers.height)
    volume = loops @ (length * bead.cross_section(width, layers.height))
    seconds = (loops * (_time_loop(length, profile) + _time_travels(np.sqrt(each), profile))).sum(axis=1)
    own = groups.find(paths.xy[paths.start[:-1]])
    lines = np.where(paths.role == Role.SUPPORT_INTERFACE, paths.length(), 0.0)
    seconds += np.bincount(own, lines, n) / profile.speeds.support_interface
    section = bead.cross_section(paths.width[paths.start[:-1]], paths.height)
    volume += np.bincount(own, lines * section, n)
    grams = volume * profile.material.density / 1000
    return np.asarray(seconds / 60 + quality.support_minutes_per_gram * grams)


def _time_loop(length: float, profile: Profile) -> float:
    """Return the time of a round loop, s; in a circle, acceleration limits the speed."""
    speed = min(profile.speeds.support, sqrt(profile.accelerations.default * length / (2 * pi)))
    return length / speed


def _time_travels(length: Float, profile: Profile) -> Float:
    """Return the time of travels of some lengths, mm, from rest to rest, s."""
    speed, acceleration = profile.speeds.travel, profile.printer.travel_acceleration
    short = 2 * np.sqrt(length / acceleration)
    return np.asarray(
        np.where(length < speed**2 / acceleration, short, length / speed + speed / acceleration)
    )
