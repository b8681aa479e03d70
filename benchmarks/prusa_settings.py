"""Convert our profile to options of PrusaSlicer's command line."""

from __future__ import annotations

from printer_slicer.profile import Profile

__all__ = ["prusa_settings"]

_FLAGS = (
    "only-retract-when-crossing-perimeters",
    "no-extra-perimeters",
)
"""Switches that turn off features that we lack, and make others work as ours do."""


def prusa_settings(profile: Profile, walls: str = "classic") -> dict[str, str]:
    """Return options (without dashes) -> value; switches have an empty value. The caller sets layer heights.

    A setting that both programs have gets our value. A setting that only PrusaSlicer has gets the value that is closest
    to our behaviour. Shells are given in mm to both.

    Args:
        profile: ours.
        walls: the perimeter generator, `classic` or `arachne`.
    """
    generator = {"perimeter-generator": walls}
    return dict.fromkeys(_FLAGS, "") | _machine(profile) | _shape(profile) | generator | _speeds(profile)


def _machine(profile: Profile) -> dict[str, str]:
    printer, material = profile.printer, profile.material
    (left, front), (right, back) = printer.corners
    numbers = {
        "max-print-height": printer.bed_z,
        "nozzle-diameter": printer.nozzle_diameter,
        "retract-length": printer.retract_length,
        "retract-speed": printer.retract_speed,
        "deretract-speed": printer.deretract_speed,
        "retract-before-travel": printer.retract_before_travel,
        "retract-lift": printer.z_hop,
        "filament-diameter": material.filament_diameter,
        "extrusion-multiplier": material.flow_ratio,
        "filament-max-volumetric-speed": profile.max_flow,
        "temperature": material.nozzle_temperature,
        "first-layer-temperature": material.first_layer_nozzle_temperature,
        "bed-temperature": material.bed_temperature,
        "first-layer-bed-temperature": material.first_layer_bed_temperature,
        "slowdown-below-layer-time": material.min_layer_time,
        "min-print-speed": material.min_speed,
    }
    return (
        {key: f"{number:g}" for key, number in numbers.items()}
        | {
            "gcode-flavor": "marlin2",  # both our dialects accept it, and version 2.5 supports no other one of ours
            "bed-shape": f"{left:g}x{front:g},{right:g}x{front:g},{right:g}x{back:g},{left:g}x{back:g}",
            "center": f"{(left + right) / 2:g},{(front + back) / 2:g}",
            "start-gcode": "G28",  # priming and presenting the part are not compared
            "end-gcode": "M84",
        }
    )


def _shape(profile: Profile) -> dict[str, str]:
    quality, width = profile.quality, profile.extrusion_width
    numbers = {
        "extrusion-width": width,
        "first-layer-extrusion-width": width,
        "perimeters": quality.perimeters,
        "bottom-solid-layers": 1,
        "top-solid-layers": 1,
        "bottom-solid-min-thickness": quality.bottom_thickness,
        "top-solid-min-thickness": quality.top_thickness,
        "fill-angle": quality.infill_angle_deg,
        "solid-infill-below-area": quality.solid_infill_below_area,
        "skirts": quality.skirt_loops,
        "skirt-distance": quality.skirt_distance,
        "min-skirt-length": 0,
        "brim-width": quality.brim_width,
        "min-bead-width": profile.bead_widths[0],
        "min-feature-size": profile.thinnest_feature,
        "resolution": quality.resolution,
    }
    return (
        {key: f"{number:g}" for key, number in numbers.items()}
        | {
            "seam-position": quality.seam,
            "fill-pattern": quality.infill,
            "top-fill-pattern": "rectilinear",
            "bottom-fill-pattern": "rectilinear",
            "fill-density": f"{100 * quality.infill_density:g}%",
            "infill-overlap": f"{100 * quality.internal_infill_overlap:g}%",
        }
        | ({"external-perimeters-first": ""} if quality.external_perimeter_first else {})
    )


def _speeds(profile: Profile) -> dict[str, str]:
    speeds = profile.speeds
    numbers = {
        "perimeter-speed": speeds.perimeter,
        "external-perimeter-speed": speeds.external_perimeter,
        "small-perimeter-speed": speeds.external_perimeter,
        "gap-fill-speed": speeds.perimeter,
        "infill-speed": speeds.internal_infill,
        "solid-infill-speed": speeds.solid_infill,
        "top-solid-infill-speed": speeds.top_solid_infill,
        "bridge-speed": speeds.bridge,
        "first-layer-speed": speeds.first_layer,
        "travel-speed": speeds.travel,
    }
    return {key: f"{number:g}" for key, number in numbers.items()}
