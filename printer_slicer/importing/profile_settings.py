"""Describe a profile in settings of PrusaSlicer, on which the conversion of single typed settings depends."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.macros.names import add_names_of_other_slicers
from printer_slicer.profile import Profile, list_settings

__all__ = ["describe_profile"]

_SWITCHES: Final[Mapping[str, tuple[str, ...]]] = {
    "fan_always_on": ("min_fan_speed",),
    "wipe": ("wipe_distance", "retract_before_wipe"),
    "brim_ears": ("brim_ears_max_angle",),
    "enable_dynamic_overhang_speeds": tuple(f"overhang_speed_{number}" for number in range(4)),
    "enable_dynamic_fan_speeds": tuple(f"overhang_fan_speed_{number}" for number in range(4)),
}
"""Switch -> settings that have an effect only if it is on; who types one of these wants it on."""


_OVERHANG_SPEEDS: Final = ((0, "15"), (25, "15"), (50, "20"), (75, "25"))
"""Percentage of the width that is supported, and PrusaSlicer's default of the speed, mm/s."""


def describe_profile(profile: Profile, typed: Collection[str]) -> dict[str, str]:
    """Return the settings of PrusaSlicer that correspond to a profile, and on which other settings depend.

    Args:
        profile: the profile.
        typed: PrusaSlicer's names of the settings that a user typed.
    """
    plain: dict[str, Any] = {key.partition(".")[2]: value for key, value in list_settings(profile)}
    speeds = {
        f"quality.speeds.{key}": getattr(profile.speeds, key)
        for key in type(profile.speeds).__struct_fields__
    }
    known = add_names_of_other_slicers(
        {**plain, **speeds, "quality.layer_height": profile.quality.layer_height}
    )
    found = {
        key: str(value[0] if isinstance(value, tuple) else value)
        for key, value in known.items()
        if key in DEFAULTS
    }
    found |= _describe_quality(profile) | _describe_fan(profile)
    return found | {switch: "1" for switch, names in _SWITCHES.items() if {*typed} & {*names}}


def _describe_quality(profile: Profile) -> dict[str, str]:
    """Return speeds, ironing, scarf joints and the compensation of contours."""
    quality, speeds = profile.quality, profile.speeds
    found = {
        "brim_width": f"{quality.brim_width:g}",
        "support_material_speed": f"{speeds.support:g}",
        "xy_size_compensation": f"{quality.xy_compensation:g}",
        "xy_inner_size_compensation": f"{-quality.hole_compensation:g}",
        "ironing": str(int(quality.ironing)),
        "extrusion_width": f"{profile.extrusion_width:.6g}",
    }
    for number, (share, usual) in enumerate(_OVERHANG_SPEEDS):
        ratio = getattr(speeds, f"overhang_{share}_ratio")
        found[f"overhang_speed_{number}"] = f"{ratio * speeds.external_perimeter:g}" if ratio < 1 else usual
    if quality.scarf_length:
        found |= {"seam_slope_type": "all", "seam_slope_min_length": f"{quality.scarf_length:g}"}
    return found


def _describe_fan(profile: Profile) -> dict[str, str]:
    """Return fan speeds, in percent."""
    material = profile.material
    found = {
        "max_fan_speed": f"{100 * material.fan_ratio_max:g}",
        "bridge_fan_speed": f"{100 * material.fan_ratio_bridge:g}",
        "fan_always_on": str(int(material.fan_ratio > 0)),
    }
    for number, share in enumerate((0, 25, 50, 75)):
        ratio = getattr(material, f"fan_overhang_{share}_ratio")
        found[f"overhang_fan_speed_{number}"] = f"{100 * ratio * (material.fan_ratio_bridge or 1):g}"
    return found | ({"min_fan_speed": f"{100 * material.fan_ratio:g}"} if material.fan_ratio else {})
