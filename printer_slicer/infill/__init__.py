"""Make infill toolpaths from regions; one pattern per file, all listed in `PATTERNS`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from printer_slicer.arrays import Int
from printer_slicer.geometry import Polylines
from printer_slicer.infill.combined_infill import group_layers
from printer_slicer.infill.concentric import concentric_lines
from printer_slicer.infill.cubic import cubic_lines
from printer_slicer.infill.custom_pattern import Infill, checked_pattern
from printer_slicer.infill.grid import grid_lines
from printer_slicer.infill.gyroid import gyroid_lines
from printer_slicer.infill.honeycomb import honeycomb_lines
from printer_slicer.infill.infill_task import InfillTask, Pattern
from printer_slicer.infill.internal_bridges import layers_below_bridges, support_internal_bridges
from printer_slicer.infill.internal_infill import (
    PatternLayout,
    internal_infill_paths,
    lay_out_pattern,
    lines_on_layers,
)
from printer_slicer.infill.lightning import lightning_lines, lightning_pattern
from printer_slicer.infill.rectilinear import rectilinear_lines
from printer_slicer.infill.solid import solid_paths
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
    """Fill every region with lines: solid regions completely, internal infill to `quality.infill_density`.

    Args:
        regions: the area inside the perimeters.
        profile: pattern, density and anchors.
        groups: (L,) first layer of the group whose internal infill is printed together; None computes it.
        own: custom pattern that replaces the profile's.

    Raises:
        StrategyError: the lines of `own` cannot be printed, or miss the density.
    """
    layered = settings_by_layer(profile, regions.plan)
    begins, limit = layered.run_starts(), min(profile.quality.internal_infill_every, profile.highest_bead)
    groups = group_layers(regions.internal_infill, regions.plan, limit, groups, begins=begins)
    layouts = [_laid_out(regions.of_layers(here), groups, one, own) for one, here in layered.each()]
    carried = layers_below_bridges(regions)
    bare = [lines_on_layers(layout, carried) for layout in layouts if layout]
    if bare:
        regions = support_internal_bridges(regions, Polylines.joined(bare), profile)
    parts: list[Toolpaths] = []
    for (one, here), layout in zip(layered.each(), layouts, strict=True):
        some = regions.of_layers(here)
        parts += solid_paths(some, one)
        parts += [internal_infill_paths(layout, some, one)] if layout else []
    return Toolpaths.joined(regions.plan, parts)


def _laid_out(regions: Regions, groups: Int, profile: Profile, own: Infill | None) -> PatternLayout | None:
    """Lay out the profile's pattern or the custom one; None without infill."""
    quality = profile.quality
    if quality.infill_density == 0:
        return None
    if own:
        layout = lay_out_pattern(regions, groups, checked_pattern(own), profile, measured=own.measured)
        return replace(layout, insisting_on=own.name if own.measured else "")
    # Lightning trees have this density only below what they support.
    measured = quality.infill != "lightning"
    layout = lay_out_pattern(regions, groups, PATTERNS[quality.infill], profile, measured=measured)
    return layout if measured else replace(layout, pattern=lightning_pattern(layout.task))
