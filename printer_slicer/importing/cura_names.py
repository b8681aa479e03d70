"""Translate Cura's settings to PrusaSlicer's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from math import cos, pi, sin
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.cura_values import CuraExpressionError
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.prusaslicer_names import DEFAULTS

__all__ = ["CURA_DEFAULTS", "CURA_NAMES", "CURA_PATTERNS", "CURA_SEAMS", "translate_cura"]

_GetValue = Callable[[str], Any]
_GetPlace = Callable[[str], str]

CURA_DEFAULTS: Final[Mapping[str, str]] = dict(DEFAULTS) | {
    "max_layer_height": "0",
    "min_layer_height": "0.05",
    "infill_anchor": "0",
    "infill_anchor_max": "0",
    "ensure_vertical_shell_thickness": "1",
    "small_perimeter_speed": "0",
    "perimeter_generator": "arachne",
    "fan_always_on": "1",
    "thick_bridges": "0",
}

_FLAVOURS: Final = {
    "RepRap (Marlin/Sprinter)": "marlin",
    "RepRap (RepRap)": "reprapfirmware",
    "Repetier": "repetier",
    "Cheetah": "marlin2",
    "Marlin": "marlin",
}
CURA_PATTERNS: Final = {
    "lines": "rectilinear",
    "zigzag": "rectilinear",
    "trihexagon": "stars",
    "cubicsubdiv": "adaptivecubic",
    "quarter_cubic": "quartercubic",
    "octet": "quartercubic",
    "tetrahedral": "quartercubic",
    "cross": "crosshatch",
    "cross_3d": "crosshatch",
}
CURA_SEAMS: Final = {"sharpest_corner": "aligned", "back": "rear", "shortest": "nearest", "random": "random"}
_UNLIMITED: Final = 1e9  # mm/s; definitions use this value for unknown limits
_USUAL_LIMITS: Final = {"x": "500", "y": "500", "z": "10", "e": "60"}

# PrusaSlicer's name -> Cura's name, for settings whose values are the same
CURA_NAMES: Final[Mapping[str, str]] = {
    "max_print_height": "machine_height",
    "nozzle_diameter": "machine_nozzle_size",
    "machine_max_acceleration_x": "machine_max_acceleration_x",
    "machine_max_acceleration_y": "machine_max_acceleration_y",
    "machine_max_acceleration_z": "machine_max_acceleration_z",
    "machine_max_acceleration_e": "machine_max_acceleration_e",
    "machine_max_acceleration_extruding": "machine_acceleration",
    "machine_max_acceleration_retracting": "machine_acceleration",
    "machine_max_jerk_x": "machine_max_jerk_xy",
    "machine_max_jerk_y": "machine_max_jerk_xy",
    "machine_max_jerk_z": "machine_max_jerk_z",
    "machine_max_jerk_e": "machine_max_jerk_e",
    "retract_speed": "retraction_retract_speed",
    "deretract_speed": "retraction_prime_speed",
    "retract_before_travel": "retraction_min_travel",
    "retract_restart_extra": "retraction_extra_prime_amount",
    "use_firmware_retraction": "machine_firmware_retract",
    "use_relative_e_distances": "relative_extrusion",
    "filament_diameter": "material_diameter",
    "temperature": "material_print_temperature",
    "first_layer_temperature": "material_print_temperature_layer_0",
    "min_fan_speed": "cool_fan_speed_min",
    "max_fan_speed": "cool_fan_speed_max",
    "fan_below_layer_time": "cool_min_layer_time_fan_speed_max",
    "slowdown_below_layer_time": "cool_min_layer_time",
    "min_print_speed": "cool_min_speed",
    "layer_height": "layer_height",
    "first_layer_height": "layer_height_0",
    "perimeters": "wall_line_count",
    "perimeter_extrusion_width": "wall_line_width_x",
    "external_perimeter_extrusion_width": "wall_line_width_0",
    "infill_extrusion_width": "infill_line_width",
    "solid_infill_extrusion_width": "skin_line_width",
    "top_solid_layers": "top_layers",
    "bottom_solid_layers": "bottom_layers",
    "spiral_vase": "magic_spiralize",
    "ironing": "ironing_enabled",
    "ironing_spacing": "ironing_line_spacing",
    "ironing_speed": "speed_ironing",
    "perimeter_speed": "speed_wall_x",
    "external_perimeter_speed": "speed_wall_0",
    "infill_speed": "speed_infill",
    "solid_infill_speed": "speed_topbottom",
    "top_solid_infill_speed": "speed_roofing",
    "support_material_speed": "speed_support",
    "support_material_interface_speed": "speed_support_interface",
    "raft_speed": "raft_speed",
    "first_layer_travel_speed": "speed_travel_layer_0",
    "first_layer_speed": "speed_print_layer_0",
    "travel_speed": "speed_travel",
    "xy_size_compensation": "xy_offset",
    "solid_infill_below_area": "min_infill_area",
    "infill_first": "infill_before_walls",
    "gcode_resolution": "meshfix_maximum_deviation",
    "skirt_distance": "skirt_gap",
    "brim_separation": "brim_gap",
    "support_material": "support_enable",
    "support_material_style": "support_structure",
    "support_material_contact_distance": "support_top_distance",
    "support_material_bottom_contact_distance": "support_bottom_distance",
    "support_material_xy_spacing": "support_xy_distance",
    "support_material_with_sheath": "support_wall_count",
    "minimum_support_area": "minimum_support_area",
    "support_tree_angle": "support_tree_angle",
    "support_tree_angle_slow": "support_tree_angle_slow",
    "support_tree_branch_diameter": "support_tree_branch_diameter",
    "support_tree_branch_diameter_angle": "support_tree_branch_diameter_angle",
    "support_tree_tip_diameter": "support_tree_tip_diameter",
}


def translate_cura(get: _GetValue, place: _GetPlace) -> dict[str, SourceSetting]:
    """Return the settings of a machine under PrusaSlicer's names.

    Args:
        get: function that returns the value of a Cura setting, or raises CuraExpressionError if it has none.
        place: function that returns where a Cura setting is set.

    Raises:
        ProfileError: the bed has no size.
    """
    entries: dict[str, SourceSetting] = {}
    for cura in ("machine_width", "machine_depth"):
        if float(get(cura)) <= 0:
            raise ProfileError(
                f"{place(cura)}: {cura}: the bed size is {get(cura)} mm", remedy="Set the size of the bed"
            )

    def put(name: str, cura: str, text: str) -> None:
        """Add one setting."""
        entries[name] = SourceSetting(cura, text, place(cura))

    for name, cura in CURA_NAMES.items():
        with suppress(CuraExpressionError):
            put(name, cura, _format_value(get(cura)))
    for convert in (_convert_machine, _convert_material, _convert_quality, _convert_raft, _convert_supports):
        convert(get, put)
    return entries


_PutSetting = Callable[[str, str, str], None]


def _format_value(value: Any) -> str:
    """Format a value as PrusaSlicer writes it."""
    if isinstance(value, bool):
        return "1" if value else "0"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _get_value_or_default(get: _GetValue, key: str, default: Any) -> Any:
    """Return the value of a setting, or a default if this version of Cura does not have the setting."""
    try:
        return get(key)
    except CuraExpressionError:
        return default


def _escape(text: Any) -> str:
    """Escape backslashes and line breaks as PrusaSlicer does."""
    return str(text).replace("\\", "\\\\").replace("\n", "\\n")


def _format_areas(areas: Any, x: float, y: float) -> str:
    """Format polygons as outlines that are separated by semicolons.

    Cura measures them from the middle of the bed, which is at (x, y); its second axis points to the front.
    """
    return ";".join(
        ",".join(f"{x + float(right):.10g}x{y - float(front):.10g}" for right, front in area)
        for area in areas
    )


def _convert_machine(get: _GetValue, put: _PutSetting) -> None:
    """Convert the settings of the printer."""
    width, depth = float(get("machine_width")), float(get("machine_depth"))
    left, front = (-width / 2, -depth / 2) if get("machine_center_is_zero") else (0.0, 0.0)
    if get("machine_shape") == "elliptic":
        angles = [2 * pi * step / 72 for step in range(72)]
        corners = [(left + width / 2 * (1 + cos(a)), front + depth / 2 * (1 + sin(a))) for a in angles]
    else:
        corners = [(left, front), (left + width, front), (left + width, front + depth), (left, front + depth)]
    put("bed_shape", "machine_width", ",".join(f"{x:.3f}x{y:.3f}" for x, y in corners))
    areas = _get_value_or_default(get, "machine_disallowed_areas", [])
    if isinstance(areas, list) and areas:
        x, y = left + width / 2, front + depth / 2
        put("bed_exclude_area", "machine_disallowed_areas", _format_areas(areas, x, y))
    _convert_head(get, put)
    flavour = str(get("machine_gcode_flavor"))
    put("gcode_flavor", "machine_gcode_flavor", _FLAVOURS.get(flavour, flavour))
    put("start_gcode", "machine_start_gcode", _escape(get("machine_start_gcode")))
    put("end_gcode", "machine_end_gcode", _escape(get("machine_end_gcode")))
    for axis, usual in _USUAL_LIMITS.items():
        limit = float(get(f"machine_max_feedrate_{axis}"))
        put(
            f"machine_max_feedrate_{axis}",
            f"machine_max_feedrate_{axis}" if limit < _UNLIMITED else "",
            usual if limit >= _UNLIMITED else _format_value(limit),
        )
    if get("acceleration_enabled"):
        put(
            "machine_max_acceleration_travel",
            "acceleration_travel",
            _format_value(get("acceleration_travel")),
        )
    put(
        "retract_length",
        "retraction_amount",
        _format_value(get("retraction_amount") if get("retraction_enable") else 0),
    )
    put(
        "retract_lift",
        "retraction_hop",
        _format_value(get("retraction_hop") if get("retraction_hop_enabled") else 0),
    )


def _convert_head(get: _GetValue, put: _PutSetting) -> None:
    """Convert the outline of the print head and the height of the gantry, for parts that are printed in sequence."""
    head = _get_value_or_default(get, "machine_head_with_fans_polygon", [])
    if isinstance(head, list) and len(head) > 2:
        corners = ",".join(f"{float(x):.10g}x{float(y):.10g}" for x, y in head)
        put("extruder_clearance_polygon", "machine_head_with_fans_polygon", corners)
        gantry = float(_get_value_or_default(get, "gantry_height", 0))
        put("extruder_clearance_height", "gantry_height", _format_value(gantry))


def _convert_material(get: _GetValue, put: _PutSetting) -> None:
    """Convert the settings of the material."""
    has_heated_bed = bool(get("machine_heated_bed"))
    for name, cura in (
        ("bed_temperature", "material_bed_temperature"),
        ("first_layer_bed_temperature", "material_bed_temperature_layer_0"),
    ):
        put(name, cura, _format_value(get(cura) if has_heated_bed else 0))
    put("extrusion_multiplier", "material_flow", _format_value(float(get("material_flow")) / 100))
    has_fan = bool(get("cool_fan_enabled"))
    put("fan_always_on", "cool_fan_enabled", _format_value(has_fan))
    if not has_fan:
        put("max_fan_speed", "cool_fan_enabled", "0")
    bridge_fan = (
        _get_value_or_default(get, "bridge_fan_speed", 100)
        if _get_value_or_default(get, "bridge_settings_enabled", False)
        else get("cool_fan_speed_max")
    )
    put("bridge_fan_speed", "bridge_fan_speed", _format_value(bridge_fan if has_fan else 0))
    put("disable_fan_first_layers", "cool_fan_speed_0", "0" if get("cool_fan_speed_0") else "1")
    put(
        "full_fan_speed_layer",
        "cool_fan_full_layer",
        _format_value(max(int(get("cool_fan_full_layer")) - 1, 0)),
    )


def _convert_overlap(get: _GetValue, put: _PutSetting) -> None:
    """Convert the overlap of infill with walls from a percentage of their mean line width to mm."""
    wall = get("wall_line_width_x" if int(get("wall_line_count")) > 1 else "wall_line_width_0")
    for name, cura, line in (
        ("infill_overlap", "infill_overlap", "infill_line_width"),
        ("solid_infill_overlap", "skin_overlap", "skin_line_width"),
    ):
        percent = _get_value_or_default(get, cura, None)
        if percent is not None:
            width = (float(_get_value_or_default(get, line, wall)) + float(wall)) / 2
            put(name, cura, _format_value(round(float(percent) / 100 * width, 6)))


def _convert_quality(get: _GetValue, put: _PutSetting) -> None:
    """Convert the print settings."""
    put("fill_density", "infill_sparse_density", f"{float(get('infill_sparse_density')):g}%")
    _convert_overlap(get, put)
    pattern = str(get("infill_pattern"))
    put("fill_pattern", "infill_pattern", CURA_PATTERNS.get(pattern, pattern))
    put("seam_position", "z_seam_type", CURA_SEAMS.get(str(get("z_seam_type")), "aligned"))
    factor = float(get("initial_layer_line_width_factor")) / 100
    put(
        "first_layer_extrusion_width",
        "initial_layer_line_width_factor",
        _format_value(float(get("wall_line_width_0")) * factor),
    )
    order = _get_value_or_default(get, "print_sequence", "all_at_once")
    put("print_sequence", "print_sequence", str(order))
    put("ironing_flowrate", "ironing_flow", f"{float(get('ironing_flow')):g}%")
    outer_first = (
        _get_value_or_default(get, "outer_inset_first", False)
        or _get_value_or_default(get, "inset_direction", "") == "outside_in"
    )
    put("external_perimeters_first", "inset_direction", _format_value(bool(outer_first)))
    put("avoid_crossing_perimeters", "retraction_combing", _format_value(get("retraction_combing") != "off"))
    bridge = (
        _get_value_or_default(get, "bridge_wall_speed", 0)
        if _get_value_or_default(get, "bridge_settings_enabled", False)
        else get("speed_wall_0")
    )
    put("bridge_speed", "bridge_wall_speed", _format_value(bridge))
    put(
        "elefant_foot_compensation",
        "xy_offset_layer_0",
        _format_value(max(float(get("xy_offset")) - float(get("xy_offset_layer_0")), 0)),
    )
    holes = float(get("xy_offset")) - float(_get_value_or_default(get, "hole_xy_offset", 0))
    put("xy_inner_size_compensation", "hole_xy_offset", _format_value(holes))
    adhesion = str(get("adhesion_type"))
    put("skirts", "skirt_line_count", _format_value(get("skirt_line_count") if adhesion == "skirt" else 0))
    put("brim_width", "brim_width", _format_value(get("brim_width") if adhesion == "brim" else 0))
    if get("acceleration_enabled"):
        for name, cura in (
            ("perimeter_acceleration", "acceleration_wall_x"),
            ("external_perimeter_acceleration", "acceleration_wall_0"),
            ("infill_acceleration", "acceleration_infill"),
            ("solid_infill_acceleration", "acceleration_topbottom"),
            ("first_layer_acceleration", "acceleration_print_layer_0"),
            ("default_acceleration", "acceleration_print"),
        ):
            put(name, cura, _format_value(get(cura)))


def _convert_raft(get: _GetValue, put: _PutSetting) -> None:
    """Convert the three thicknesses of a raft to a number of layers with the same total height."""
    if get("adhesion_type") != "raft":
        return
    names = ("raft_base_thickness", "raft_interface_thickness", "raft_surface_thickness")
    total = sum(float(_get_value_or_default(get, name, 0)) for name in names)
    first, height = float(get("layer_height_0")), float(get("layer_height"))
    put("raft_layers", "raft_base_thickness", _format_value(max(round((total - first) / height) + 1, 1)))
    put("raft_contact_distance", "raft_airgap", _format_value(get("raft_airgap")))
    put("raft_first_layer_expansion", "raft_margin", _format_value(get("raft_margin")))


def _convert_supports(get: _GetValue, put: _PutSetting) -> None:
    """Convert settings of supports that have another meaning; a definition may lack any of them."""

    def convert(name: str, cura: str, change: Callable[[Any], float | bool]) -> None:
        value = _get_value_or_default(get, cura, None)
        if value is not None:
            put(name, cura, _format_value(change(value)))

    convert("support_material_threshold", "support_angle", lambda angle: 90 - float(angle))
    convert("support_material_buildplate_only", "support_type", lambda where: where == "buildplate")
    convert("support_material_closing_radius", "support_join_distance", lambda gap: float(gap) / 2)
    if _get_value_or_default(get, "support_line_distance", 0):
        convert("support_material_spacing", "support_line_distance", float)
    has_roof = _get_value_or_default(get, "support_roof_enable", None)
    if has_roof:
        height = float(get("layer_height"))
        convert(
            "support_material_interface_layers",
            "support_roof_height",
            lambda roof: max(round(float(roof) / height), 1),
        )
        width = float(_get_value_or_default(get, "support_roof_line_width", 0) or get("wall_line_width_x"))
        convert(
            "support_material_interface_spacing",
            "support_roof_line_distance",
            lambda distance: round(max(float(distance) - width, 0), 6),
        )
    elif has_roof is not None:
        put("support_material_interface_layers", "support_roof_enable", "0")
