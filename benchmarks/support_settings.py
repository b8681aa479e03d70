"""Settings of supports for PrusaSlicer and CuraEngine that equal those of a profile."""

from __future__ import annotations

from printer_slicer import bead
from printer_slicer.profile import Profile

__all__ = ["NOT_EQUAL", "cura_supports", "prusa_supports"]

_STEEPEST = 90.0

NOT_EQUAL = (
    "PrusaSlicer: supports end lower below bridges, which are as thick as the nozzle is wide",
    "PrusaSlicer: columns have no loops, also slim ones; ours have, because lines alone do not hold those upright",
    "PrusaSlicer: no smallest area of overhangs",
    "CuraEngine: supports have the layers of the part; gaps are whole layers",
    "CuraEngine: no bridges without supports, no smallest reach",
    "CuraEngine: trees have tips 1 mm apart, its default, because nothing lies across them",
    "CuraEngine: extrusions are modelled as rectangles, so lines of equal width contain more material",
)
"""What could not be made equal."""


def prusa_supports(profile: Profile, style: str, *, skip_bridges: bool) -> dict[str, str]:
    """Return options (without dashes) -> value of supports, for `grid` or `snug`; switches have an empty value.

    Distances are between the edges of lines there and between their centre lines here.

    Args:
        profile: ours.
        style: `grid` or `snug`.
        skip_bridges: its setting `dont_support_bridges`.
    """
    quality, width = profile.quality, profile.extrusion_width
    line = float(bead.spacing(width, quality.layer_height))
    numbers = {
        "support-material-threshold": quality.support_threshold_deg,
        "support-material-contact-distance": quality.support_gap,
        "support-material-bottom-contact-distance": quality.support_bottom_gap,
        "support-material-xy-spacing": quality.support_xy_gap,
        "support-material-spacing": quality.support_spacing - line,
        "support-material-interface-layers": quality.support_interface_layers,
        "support-material-bottom-interface-layers": min(quality.support_interface_layers, 1),
        "support-material-interface-spacing": width + quality.support_interface_spacing - line,
        "support-material-extrusion-width": width,
        "support-material-speed": profile.speeds.support,
        "support-material-interface-speed": profile.speeds.support_interface or profile.speeds.support,
        "support-material-closing-radius": 2 * quality.support_closing,
        "raft-first-layer-expansion": quality.support_first_layer_expansion,
        "max-layer-height": quality.support_layer_max or 0.75 * profile.printer.nozzle_diameter,
    }
    switches = [
        "support-material",
        "dont-support-bridges" if skip_bridges else "no-dont-support-bridges",
        "support-material-with-sheath" if quality.support_walls else "no-support-material-with-sheath",
    ]
    return (
        {key: f"{number:g}" for key, number in numbers.items()}
        | {"raft-first-layer-density": f"{100 * 2 * line / quality.support_spacing:.0f}%"}
        | {"support-material-style": style}
        | dict.fromkeys(switches, "")
    )


def cura_supports(profile: Profile, structure: str) -> dict[str, object]:
    """Return the settings (name -> value) of supports, for `normal` or `tree`.

    Args:
        profile: ours.
        structure: `normal` or `tree`.
    """
    quality, width = profile.quality, profile.extrusion_width
    interface = quality.support_interface_layers
    return {
        "support_enable": True,
        "support_structure": structure,
        "support_type": "buildplate" if quality.support_on_bed_only else "everywhere",
        "support_angle": _STEEPEST - quality.support_threshold_deg,
        "support_line_width": width,
        "support_z_distance": quality.support_gap,
        "support_top_distance": quality.support_gap,
        "support_bottom_distance": quality.support_bottom_gap,
        "support_xy_distance": quality.support_xy_gap,
        "support_xy_distance_overhang": quality.support_xy_gap,
        "support_join_distance": 2 * quality.support_closing,
        "support_interface_enable": interface > 0,
        "support_roof_height": interface * quality.layer_height,
        "support_bottom_height": quality.layer_height,
        "support_roof_line_distance": width + quality.support_interface_spacing,
        "support_bottom_line_distance": width + quality.support_interface_spacing,
        "support_interface_pattern": "zigzag",
        "support_brim_enable": quality.support_first_layer_expansion > 0,
        "support_brim_width": quality.support_first_layer_expansion,
        "support_tree_angle": quality.support_tree_angle_deg,
        "support_tree_branch_diameter": quality.support_branch_diameter,
        "support_tree_branch_diameter_angle": quality.support_branch_growth_deg,
        "speed_support": profile.speeds.support,
        "speed_support_interface": profile.speeds.support_interface or profile.speeds.support,
    } | (
        {
            "support_line_distance": quality.support_spacing,
            "support_initial_layer_line_distance": quality.support_spacing / 2,
            "support_wall_count": quality.support_walls,
        }
        if structure == "normal"
        else {}
    )
