"""Make infill toolpaths from regions; one pattern per file, all listed in `PATTERNS`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.arrays import Int
from printer_slicer.geometry import Polylines
from printer_slicer.infill.combined_infill import group_layers
from printer_slicer.infill.custom_pattern import Infill, make_checked_pattern
from printer_slicer.infill.infill_task import InfillTask, Pattern
from printer_slicer.infill.internal_bridges import layers_below_bridges, support_internal_bridges
from printer_slicer.infill.internal_infill import (
    PatternLayout,
    internal_infill_paths,
    lay_out_pattern,
    lines_on_layers,
)
from printer_slicer.infill.solid import solid_paths
from printer_slicer.layer_settings import resolve_layer_settings
from printer_slicer.lazy_names import LazyTable
from printer_slicer.model import Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["PATTERNS", "Infill", "InfillTask", "Pattern", "infill_paths"]

PATTERNS: Final[Mapping[str, Pattern]] = LazyTable(
    __name__,
    {
        "rectilinear": "rectilinear.rectilinear_lines",
        "grid": "grid.grid_lines",
        "triangles": "triangles.triangle_lines",
        "cubic": "cubic.cubic_lines",
        "gyroid": "gyroid.gyroid_lines",
        "honeycomb": "honeycomb.honeycomb_lines",
        "concentric": "concentric.concentric_lines",
        "lightning": "lightning.lightning_lines",
    },
)


def infill_paths(
    regions: Regions, profile: Profile, groups: Int | None = None, custom: Infill | None = None
) -> Toolpaths:
    """Fill every region with lines: solid regions completely, internal infill to `quality.infill_density`.

    Args:
        regions: the area inside the perimeters.
        profile: pattern, density and anchors.
        groups: (L,) first layer of the group whose internal infill is printed together; None computes it.
        custom: custom pattern that replaces the profile's.

    Raises:
        StrategyError: the lines of `custom` cannot be printed, or do not have the density.
    """
    layered = resolve_layer_settings(profile, regions.plan)
    begins, limit = layered.run_starts(), min(profile.quality.internal_infill_every, profile.highest_bead)
    groups = group_layers(regions.internal_infill, regions.plan, limit, groups, lowest_allowed=begins)
    layouts = [_lay_out_infill(regions.of_layers(here), groups, one, custom) for one, here in layered.each()]
    supporting = layers_below_bridges(regions)
    unconnected = [lines_on_layers(layout, supporting) for layout in layouts if layout]
    if unconnected:
        regions = support_internal_bridges(regions, Polylines.joined(unconnected), profile)
    parts: list[Toolpaths] = []
    for (one, here), layout in zip(layered.each(), layouts, strict=True):
        some = regions.of_layers(here)
        parts += solid_paths(some, one)
        parts += [internal_infill_paths(layout, some, one)] if layout else []
    return Toolpaths.joined(regions.plan, parts)


def _lay_out_infill(
    regions: Regions, groups: Int, profile: Profile, custom: Infill | None
) -> PatternLayout | None:
    """Lay out the custom pattern, or that of the profile if there is none; None if the density is 0."""
    quality = profile.quality
    if quality.infill_density == 0:
        return None
    if custom:
        layout = lay_out_pattern(
            regions, groups, make_checked_pattern(custom), profile, measured=custom.measured
        )
        return replace(layout, strict_name=custom.name if custom.measured else "")
    # Lightning trees have this density only directly below the areas that they support.
    measured = quality.infill != "lightning"
    layout = lay_out_pattern(regions, groups, PATTERNS[quality.infill], profile, measured=measured)
    if measured:
        return layout
    from printer_slicer.infill.lightning import lightning_pattern  # noqa: PLC0415 - one pattern of eight

    return replace(layout, pattern=lightning_pattern(layout.task))
