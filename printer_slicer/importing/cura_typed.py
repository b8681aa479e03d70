"""Translate typed settings of Cura to settings of PrusaSlicer; a profile supplies the settings they depend on."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.firmware import FIRMWARES
from printer_slicer.importing.cura_names import CURA_NAMES, CURA_PATTERNS, CURA_SEAMS, translate_cura
from printer_slicer.importing.cura_values import CuraExpressionError
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.presets import OFF_WORDS, ON_WORDS, parse_quantity
from printer_slicer.profile import Profile

__all__ = ["CURA_SETTINGS", "TranslatedSetting", "translate_cura_settings"]

_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "adhesion_type": ("skirt", "brim", "raft", "none"),
    "infill_pattern": (*CURA_PATTERNS, "grid", "triangles", "cubic", "concentric", "gyroid", "lightning"),
    "inset_direction": ("inside_out", "outside_in"),
    "machine_shape": ("rectangular", "elliptic"),
    "support_structure": ("normal", "tree"),
    "support_type": ("everywhere", "buildplate"),
    "retraction_combing": ("off", "all", "no_outer_surfaces", "noskin", "infill"),
    "z_seam_type": tuple(CURA_SEAMS),
}
"""Setting -> its words."""

_PERCENTAGES: Final = frozenset(
    {
        "bridge_fan_speed",
        "cool_fan_speed",
        "cool_fan_speed_0",
        "cool_fan_speed_max",
        "cool_fan_speed_min",
        "infill_sparse_density",
        "initial_layer_line_width_factor",
        "ironing_flow",
        "material_flow",
        "skin_overlap",
    }
)
"""Settings in percent, which may be written with or without the sign."""

_CHILDREN: Final[Mapping[str, tuple[str, ...]]] = {
    "cool_fan_speed": ("cool_fan_speed_min", "cool_fan_speed_max"),
    "material_print_temperature": ("material_print_temperature_layer_0",),
    "material_bed_temperature": ("material_bed_temperature_layer_0",),
    "retraction_speed": ("retraction_retract_speed", "retraction_prime_speed"),
    "speed_layer_0": ("speed_print_layer_0",),
    "speed_topbottom": ("speed_roofing",),
    "support_interface_enable": ("support_roof_enable",),
    "support_interface_height": ("support_roof_height",),
    "support_z_distance": ("support_top_distance", "support_bottom_distance"),
    "wall_line_width": ("wall_line_width_0", "wall_line_width_x"),
}
"""Setting -> settings that have the same value unless they are set too. Source: Cura's fdmprinter definition."""

_SWITCHES: Final[Mapping[str, str]] = {
    "acceleration_": "acceleration_enabled",
    "bridge_": "bridge_settings_enabled",
}
"""Beginning of settings -> the switch without which they have no effect; who types one of these wants it on."""

_AFFECTED: Final[Mapping[str, tuple[str, ...]]] = {
    "adhesion_type": ("skirts", "brim_width", "raft_layers"),
    "cool_fan_enabled": ("fan_always_on",),
}
"""Setting -> PrusaSlicer's settings that depend on it, whatever the profile has."""

_DERIVED: Final[Mapping[str, tuple[str, ...]]] = {
    "wall_thickness": ("wall_line_count",),
    "top_bottom_thickness": ("top_layers", "bottom_layers"),
    "speed_wall": ("speed_wall_0", "speed_wall_x"),
}
"""Setting -> settings that are computed from it unless they are set too."""

CURA_SETTINGS: Final = (
    frozenset(CURA_NAMES.values())
    | _CHILDREN.keys()
    | _DERIVED.keys()
    | _PERCENTAGES
    | _WORDS.keys()
    | {
        "acceleration_infill",
        "acceleration_print",
        "acceleration_print_layer_0",
        "acceleration_topbottom",
        "acceleration_travel",
        "acceleration_wall_0",
        "acceleration_wall_x",
        "bridge_wall_speed",
        "cool_fan_enabled",
        "cool_fan_full_layer",
        "hole_xy_offset",
        "machine_center_is_zero",
        "machine_depth",
        "machine_disallowed_areas",
        "machine_end_gcode",
        "machine_gcode_flavor",
        "machine_start_gcode",
        "machine_width",
        "material_bed_temperature_layer_0",
        "outer_inset_first",
        "raft_airgap",
        "retraction_amount",
        "retraction_enable",
        "retraction_hop",
        "retraction_hop_enabled",
        "skirt_line_count",
        "support_angle",
        "support_join_distance",
        "support_line_distance",
        "support_roof_enable",
        "support_roof_height",
        "support_roof_line_distance",
        "xy_offset_layer_0",
    }
    | {f"machine_max_feedrate_{axis}" for axis in "xyze"}
)
"""Settings of Cura that can be translated."""


_ACCELERATIONS: Final = (
    ("wall_x", "perimeter"),
    ("wall_0", "external_perimeter"),
    ("infill", "internal_infill"),
    ("topbottom", "solid_infill"),
    ("print_layer_0", "first_layer"),
    ("print", "default"),
)
"""End of a setting of Cura -> acceleration of a quality."""


class TranslatedSetting(NamedTuple):
    """A setting under PrusaSlicer's name, with the names of the typed settings of Cura that it comes from."""

    entry: SourceSetting
    owners: tuple[str, ...]


def translate_cura_settings(typed: Mapping[str, str], profile: Profile) -> dict[str, TranslatedSetting]:
    """Return the settings that typed settings of Cura change, under PrusaSlicer's names.

    Args:
        typed: Cura's name -> value.
        profile: the profile that is changed.

    Raises:
        ProfileError: a value is invalid.
    """
    usual = _describe_profile(profile)
    usual |= {
        switch: True for begin, switch in _SWITCHES.items() if any(one.startswith(begin) for one in typed)
    }
    given = {name: _parse_value(name, text, usual) for name, text in typed.items()}
    everything = _translate(usual, given, typed)
    found: dict[str, TranslatedSetting] = {}
    for name in typed:
        others = _translate(usual, {key: value for key, value in given.items() if key != name}, typed)
        for prusa, entry in everything.items():
            before = others.get(prusa)
            own = {name, *_CHILDREN.get(name, ()), *_DERIVED.get(name, ())}
            is_changed = before is None or before.text != entry.text or entry.name in own
            if is_changed or prusa in _AFFECTED.get(name, ()):
                owners = found[prusa].owners if prusa in found else ()
                place = f"{name}={typed[name]}"
                found[prusa] = TranslatedSetting(SourceSetting(name, entry.text, place), (*owners, name))
    return found


def _translate(
    usual: Mapping[str, Any], given: Mapping[str, Any], typed: Mapping[str, str]
) -> dict[str, SourceSetting]:
    """Return all settings under PrusaSlicer's names."""
    known = dict(usual)
    for name, value in given.items():
        known |= {child: value for child in _CHILDREN.get(name, ()) if child not in typed}
    known |= given
    known |= {key: value for key, value in _derive_children(known, given).items() if key not in typed}
    if "skirt_line_count" in typed and "adhesion_type" not in typed:
        known["adhesion_type"] = "skirt"

    def get(key: str) -> Any:
        if key not in known:
            raise CuraExpressionError(key)
        return known[key]

    return translate_cura(get, lambda key: key)


def _derive_children(known: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Compute settings that follow from typed ones, such as the number of walls from their thickness."""
    found: dict[str, Any] = {}
    if "wall_thickness" in given:
        rest = float(given["wall_thickness"]) - float(known["wall_line_width_0"])
        walls = max(1, round(rest / float(known["wall_line_width_x"])) + 1)
        found["wall_line_count"] = walls if given["wall_thickness"] else 0
    if "top_bottom_thickness" in given:
        layers = ceil(round(float(given["top_bottom_thickness"]) / float(known["layer_height"]), 4))
        found |= {"top_layers": layers, "bottom_layers": layers}
    if "speed_wall" in given:
        found |= {"speed_wall_0": given["speed_wall"], "speed_wall_x": 2 * float(given["speed_wall"])}
    if given.get("cool_fan_enabled") is False:
        found |= {"cool_fan_speed_min": 0, "cool_fan_speed_max": 0}
    return found


def _parse_value(name: str, text: str, usual: Mapping[str, Any]) -> Any:
    """Convert the text of a setting to the type of its value in `usual`; without one, to a number.

    Raises:
        ProfileError: it has another type, or is not a word of this setting.
    """
    value, word = usual.get(name, 0.0), text.strip().lower()
    where = f"{name}={text}"
    if isinstance(value, bool):
        if word not in (*ON_WORDS, *OFF_WORDS):
            raise ProfileError(f"{where}: expected true or false", remedy="Write true or false")
        return word in ON_WORDS
    if isinstance(value, str):
        if word not in _WORDS.get(name, (word,)):
            raise ProfileError(
                f"{where}: unknown value {text!r}", remedy=f"Choose one of: {', '.join(_WORDS[name])}"
            )
        return word if name in _WORDS else text
    number = parse_quantity(text)
    if number is None or (number.is_percent and name not in _PERCENTAGES):
        problem = "takes no percentage" if number else "is not a number"
        raise ProfileError(f"{where}: {name if number else repr(text)} {problem}", remedy="Write a number")
    return number.value


def _describe_profile(profile: Profile) -> dict[str, Any]:
    """Return the settings of Cura that a translation needs, with the values of a profile."""
    parts = (
        _describe_printer,
        _describe_material,
        _describe_quality,
        _describe_walls,
        _describe_adhesion,
        _describe_supports,
    )
    return {key: value for describe in parts for key, value in describe(profile).items()}


def _describe_printer(profile: Profile) -> dict[str, Any]:
    """Return the settings of the printer."""
    printer = profile.printer
    return {
        "machine_width": printer.bed_x,
        "machine_depth": printer.bed_y,
        "machine_center_is_zero": printer.origin == "centre",
        "machine_disallowed_areas": [],
        "machine_shape": "rectangular",
        "machine_gcode_flavor": FIRMWARES[printer.flavour].prusaslicer_name or "marlin2",
        "machine_start_gcode": "",
        "machine_end_gcode": "",
        "machine_heated_bed": True,
        **{f"machine_max_feedrate_{axis}": getattr(printer, f"max_speed_{axis}") for axis in "xyze"},
        "acceleration_enabled": False,
        "acceleration_travel": printer.travel_acceleration,
        "retraction_enable": True,
        "retraction_amount": printer.retract_length,
        "retraction_hop_enabled": True,
        "retraction_hop": printer.z_hop,
        "machine_firmware_retract": printer.firmware_retraction,
        "relative_extrusion": printer.relative_extrusion,
    }


def _describe_material(profile: Profile) -> dict[str, Any]:
    """Return the settings of the material."""
    material = profile.material
    return {
        "material_bed_temperature": material.bed_temperature,
        "material_bed_temperature_layer_0": material.first_layer_bed_temperature,
        "material_flow": 100 * material.flow_ratio,
        "cool_fan_enabled": True,
        "cool_fan_speed": 100 * material.fan_ratio,
        "cool_fan_speed_min": 100 * material.fan_ratio,
        "cool_fan_speed_max": 100 * material.fan_ratio_max,
        "bridge_settings_enabled": False,
        "bridge_fan_speed": 100 * material.fan_ratio_bridge,
        "cool_fan_speed_0": 0.0,
        "cool_fan_full_layer": 2.0,
    }


def _describe_quality(profile: Profile) -> dict[str, Any]:
    """Return the print settings."""
    quality, speeds = profile.quality, profile.speeds
    return {
        "infill_sparse_density": 100 * quality.infill_density,
        "infill_pattern": "grid",
        "z_seam_type": "sharpest_corner",
        "ironing_enabled": quality.ironing,
        "ironing_flow": 100 * quality.ironing_flow_ratio,
        "outer_inset_first": False,
        "inset_direction": "outside_in" if quality.external_perimeter_first else "inside_out",
        "retraction_combing": "all" if quality.avoid_crossing else "off",
        "magic_spiralize": quality.spiral,
        "infill_before_walls": quality.infill_first,
        "speed_wall_0": speeds.external_perimeter,
        "bridge_wall_speed": speeds.bridge,
        "xy_offset": quality.xy_compensation,
        "xy_offset_layer_0": quality.xy_compensation - quality.elephant_foot,
        "hole_xy_offset": quality.hole_compensation + quality.xy_compensation,
        **{f"acceleration_{name}": getattr(profile.accelerations, ours) for name, ours in _ACCELERATIONS},
    }


def _describe_walls(profile: Profile) -> dict[str, Any]:
    """Return layer heights, walls and line widths."""
    quality, width = profile.quality, profile.extrusion_width
    return {
        "layer_height": quality.layer_height,
        "layer_height_0": quality.first_layer_height or quality.layer_height,
        "wall_line_count": quality.perimeters,
        "wall_line_width_0": quality.external_perimeter_width or width,
        "wall_line_width_x": width,
        "infill_line_width": width,
        "skin_line_width": width,
        "initial_layer_line_width_factor": 100 * profile.width_on_bed / width,
    }


def _describe_adhesion(profile: Profile) -> dict[str, Any]:
    """Return the settings of skirt, brim and raft; some that are off in the profile get Cura's defaults."""
    quality = profile.quality
    sizes = {"raft": quality.raft_height, "brim": quality.brim_width, "skirt": quality.skirt_loops}
    return {
        "adhesion_type": next((kind for kind, size in sizes.items() if size), "none"),
        "skirt_line_count": quality.skirt_loops or 1,
        "brim_width": quality.brim_width or 8.0,
        "raft_base_thickness": 1.2 * (quality.first_layer_height or quality.layer_height),
        "raft_interface_thickness": 1.5 * quality.layer_height,
        "raft_surface_thickness": quality.layer_height,
        "raft_airgap": quality.raft_gap,
        "raft_margin": quality.raft_margin,
    }


def _describe_supports(profile: Profile) -> dict[str, Any]:
    """Return the settings of supports that are switches or words."""
    quality = profile.quality
    return {
        "support_enable": quality.support != "off",
        "support_structure": "tree" if quality.support == "tree" else "normal",
        "support_type": "buildplate" if quality.support_on_bed_only else "everywhere",
        "support_interface_enable": quality.support_interface_layers > 0,
        "support_roof_enable": quality.support_interface_layers > 0,
    }
