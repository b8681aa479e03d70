"""Regions -> Toolpaths. One pattern a file; this table is the whole list."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from printer_slicer.arrays import Int
from printer_slicer.geometry import Polylines
from printer_slicer.infill.concentric import concentric_lines
from printer_slicer.infill.cubic import cubic_lines
from printer_slicer.infill.grid import grid_lines
from printer_slicer.infill.gyroid import gyroid_lines
from printer_slicer.infill.honeycomb import honeycomb_lines
from printer_slicer.infill.lightning import lightning_lines, planted
from printer_slicer.infill.own import Infill, InfillTask, pattern_of
from printer_slicer.infill.rectilinear import rectilinear_lines
from printer_slicer.infill.resting import carried_layers, rested
from printer_slicer.infill.solid import solid_paths
from printer_slicer.infill.sparse import PatternLayout, bare_lines, laid_out, sparse_paths
from printer_slicer.infill.task import Pattern
from printer_slicer.infill.thick import groups_of
from printer_slicer.infill.triangles import triangle_lines
from printer_slicer.layer_settings import settings_by_layer
from printer_slicer.model import Regions, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["PATTERNS", "Infill", "InfillTask", "Pattern", "infill_paths"]

PATTERNS: Final[Mapping[str, Pattern]] = {
    "rectilinear": rectilinear_lines,
    "grid": grid_lines,
    "triangles": triangle_lines,
    "cubic": cubic_lines,
    "gyroid": gyroid_lines,
    "honeycomb": honeycomb_lines,
    "concentric": concentric_lines,
    "lightning": lightning_lines,
}


def infill_paths(
    regions: Regions, profile: Profile, groups: Int | None = None, own: Infill | None = None
) -> Toolpaths:
    """Lines that fill every region: solid ones bead by bead, sparse ones to `quality.infill_density`.

    Args:
        regions: what is inside the walls.
        profile: pattern, density, anchors.
        groups: (L,) the first of those layers with which each one's sparse infill is printed, if that is known already.
        own: takes the place of the profile's pattern.

    Raises:
        StrategyError: `own` gives what cannot be printed, or misses the density.
    """
    layered = settings_by_layer(profile, regions.plan)
    begins, limit = layered.run_starts(), min(profile.quality.internal_infill_every, profile.highest_bead)
    groups = groups_of(regions.sparse, regions.plan, limit, groups, begins=begins)
    layouts = [_laid_out(regions.of_layers(here), groups, one, own) for one, here in layered.each()]
    carried = carried_layers(regions)
    bare = [bare_lines(layout, carried) for layout in layouts if layout]
    if bare:
        regions = rested(regions, Polylines.joined(bare), profile)
    parts: list[Toolpaths] = []
    for (one, here), layout in zip(layered.each(), layouts, strict=True):
        some = regions.of_layers(here)
        parts += solid_paths(some, one)
        parts += [sparse_paths(layout, some, one)] if layout else []
    return Toolpaths.joined(regions.plan, parts)


def _laid_out(regions: Regions, groups: Int, profile: Profile, own: Infill | None) -> PatternLayout | None:
    """Where the lines lie, of the profile's pattern or of one's own; None where there are none."""
    quality = profile.quality
    if quality.infill_density == 0:
        return None
    if own:
        layout = laid_out(regions, groups, pattern_of(own), profile, measured=own.measured)
        return replace(layout, insisting_on=own.name if own.measured else "")
    # Trees have the density only where they hold something.
    measured = quality.infill != "lightning"
    layout = laid_out(regions, groups, PATTERNS[quality.infill], profile, measured=measured)
    return layout if measured else replace(layout, pattern=planted(layout.task))
