"""Names of placeholders in macros, including those of PrusaSlicer, OrcaSlicer, BambuStudio and Cura."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.macros.values import Items, Value

__all__ = [
    "END_FACTS",
    "FACTS",
    "LAYER_FACTS",
    "add_names_of_other_slicers",
    "get_placeholder_names",
    "map_prusaslicer_names",
]

_PRUSASLICER: Final[Mapping[str, str]] = {
    # material
    "first_layer_temperature": "first_layer_nozzle_temperature",
    "temperature": "nozzle_temperature",
    "first_layer_bed_temperature": "first_layer_bed_temperature",
    "bed_temperature": "bed_temperature",
    "filament_diameter": "filament_diameter",
    "filament_density": "density",
    "filament_cost": "cost",
    "filament_type": "material.type",
    "filament_settings_id": "material_name",
    "filament_preset": "material_name",
    "initial_filament_type": "material.type",
    "extrusion_multiplier": "flow_ratio",
    "filament_max_volumetric_speed": "max_flow",
    "pressure_advance": "pressure_advance",
    "slowdown_below_layer_time": "min_layer_time",
    "fan_below_layer_time": "fan_layer_time",
    "min_print_speed": "min_speed",
    # quality
    "layer_height": "quality.layer_height",
    "print_settings_id": "quality_name",
    "print_preset": "quality_name",
    "travel_speed": "quality.speeds.travel",
    "first_layer_speed": "quality.speeds.first_layer",
    "perimeter_speed": "quality.speeds.perimeter",
    "external_perimeter_speed": "quality.speeds.external_perimeter",
    "infill_speed": "quality.speeds.internal_infill",
    "solid_infill_speed": "quality.speeds.solid_infill",
    "top_solid_infill_speed": "quality.speeds.top_solid_infill",
    "bridge_speed": "quality.speeds.bridge",
    "perimeters": "perimeters",
    "skirts": "skirt_loops",
    "skirt_distance": "skirt_distance",
    "brim_width": "brim_width",
    "spiral_vase": "spiral",
    "seam_position": "seam",
    # printer
    "nozzle_diameter": "nozzle_diameter",
    "max_print_height": "bed_z",
    "min_layer_height": "min_layer",
    "max_layer_height": "max_layer",
    "machine_width": "bed_x",
    "machine_depth": "bed_y",
    "printer_model": "model",
    "printer_settings_id": "printer_name",
    "printer_preset": "printer_name",
    "retract_length": "retract_length",
    "retract_speed": "retract_speed",
    "deretract_speed": "deretract_speed",
    "retract_lift": "z_hop",
    "retract_before_travel": "retract_before_travel",
    "use_relative_e_distances": "relative_extrusion",
    "use_firmware_retraction": "firmware_retraction",
    "machine_max_feedrate_x": "max_speed_x",
    "machine_max_feedrate_y": "max_speed_y",
    "machine_max_feedrate_z": "max_speed_z",
    "machine_max_feedrate_e": "max_speed_e",
    "machine_max_acceleration_x": "max_acceleration_x",
    "machine_max_acceleration_y": "max_acceleration_y",
    "machine_max_acceleration_z": "max_acceleration_z",
    "machine_max_acceleration_e": "max_acceleration_e",
    "machine_max_acceleration_extruding": "acceleration",
    "machine_max_acceleration_retracting": "retract_acceleration",
    "machine_max_acceleration_travel": "travel_acceleration",
    # the print
    "total_layer_count": "layer_count",
    "total_weight": "filament_used_g",
    "used_filament": "filament_used",
    "initial_tool": "tool",
    "initial_extruder": "tool",
    "initial_no_support_extruder": "tool",
    "current_extruder": "tool",
}
_WHOLE_NUMBERS: Final = frozenset(
    {
        "first_layer_temperature",
        "temperature",
        "first_layer_bed_temperature",
        "bed_temperature",
        "perimeters",
        "skirts",
        "total_layer_count",
        "initial_tool",
        "initial_extruder",
        "initial_no_support_extruder",
        "current_extruder",
    }
)
"""Placeholders whose values are whole numbers, because a division of whole numbers gives a whole number."""

_OTHER_NAMES: Final[Mapping[str, str]] = {
    # OrcaSlicer, BambuStudio
    "nozzle_temperature_initial_layer": "first_layer_temperature",
    "nozzle_temperature": "temperature",
    "bed_temperature_initial_layer": "first_layer_bed_temperature",
    "bed_temperature_initial_layer_single": "first_layer_bed_temperature",
    "hot_plate_temp_initial_layer": "first_layer_bed_temperature",
    "textured_plate_temp_initial_layer": "first_layer_bed_temperature",
    "cool_plate_temp_initial_layer": "first_layer_bed_temperature",
    "eng_plate_temp_initial_layer": "first_layer_bed_temperature",
    "hot_plate_temp": "bed_temperature",
    "textured_plate_temp": "bed_temperature",
    "cool_plate_temp": "bed_temperature",
    "eng_plate_temp": "bed_temperature",
    "initial_layer_speed": "first_layer_speed",
    "outer_wall_speed": "external_perimeter_speed",
    "inner_wall_speed": "perimeter_speed",
    "sparse_infill_speed": "infill_speed",
    "printable_height": "max_print_height",
    "retraction_length": "retract_length",
    "retraction_speed": "retract_speed",
    "z_hop": "retract_lift",
    "line_width": "extrusion_width",
    "machine_max_speed_x": "machine_max_feedrate_x",
    "machine_max_speed_y": "machine_max_feedrate_y",
    "machine_max_speed_z": "machine_max_feedrate_z",
    "machine_max_speed_e": "machine_max_feedrate_e",
    "wall_loops": "perimeters",
    "filament_flow_ratio": "extrusion_multiplier",
    "initial_layer_print_height": "first_layer_height",
    # Cura
    "material_print_temperature": "temperature",
    "material_print_temperature_layer_0": "first_layer_temperature",
    "material_initial_print_temperature": "first_layer_temperature",
    "material_bed_temperature": "bed_temperature",
    "material_bed_temperature_layer_0": "first_layer_bed_temperature",
    "print_temperature": "temperature",
    "print_bed_temperature": "bed_temperature",
    "material_diameter": "filament_diameter",
    "machine_nozzle_size": "nozzle_diameter",
    "machine_height": "max_print_height",
    "layer_height_0": "first_layer_height",
    "speed_travel": "travel_speed",
    "speed_layer_0": "first_layer_speed",
    "retraction_amount": "retract_length",
    "retraction_retract_speed": "retract_speed",
    "retraction_hop": "retract_lift",
    "initial_extruder_nr": "initial_tool",
}
"""Name of another slicer -> PrusaSlicer's name."""


def _split_words(text: str) -> frozenset[str]:
    """Return the set of words in a text."""
    return frozenset(text.split())


FACTS: Final = _split_words("""
    bed_x_middle bed_y_middle bed_y_end first_layer_min_x first_layer_min_y first_layer_max_x first_layer_max_y
    first_layer_min first_layer_max first_layer_size layer_count layer_tops part_height filament_used filament_used_g
    print_seconds object_names printer_name material_name quality_name layer_heights pause_at
    first_layer_print_min first_layer_print_max first_layer_print_size print_bed_min print_bed_max print_bed_size
    extrusion_width first_layer_height extruded_volume total_cost num_objects num_instances num_extruders
    num_printing_extruders is_extruder_used print_time normal_print_time
    support_material enable_support support_enable support_material_auto dont_support_bridges
    support_material_threshold support_threshold_angle support_angle
    support_material_contact_distance support_top_z_distance support_top_distance
    support_material_bottom_contact_distance support_bottom_z_distance support_material_xy_spacing
    support_material_interface_layers support_interface_top_layers support_material_interface_spacing
    support_material_buildplate_only support_on_build_plate_only support_material_synchronize_layers
    has_wipe_tower has_single_extruder_multi_material_priming total_toolchanges input_filename input_filename_base
    """)
"""Placeholders of every macro, in addition to settings."""

END_FACTS: Final = frozenset({"layer_num", "layer_z", "max_layer_z"})
"""Additional placeholders of end G-code."""

LAYER_FACTS: Final = END_FACTS | {"current_layer_height", "filament_so_far", "seconds_so_far"}
"""Additional placeholders of layer and pause G-code."""


def map_prusaslicer_names() -> Mapping[str, str]:
    """Map PrusaSlicer's names to ours, for settings and facts whose values are the same."""
    return _PRUSASLICER


def get_placeholder_names(macro: str, settings: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return all placeholder names of a macro.

    Args:
        macro: name of the setting that holds the macro, such as `layer_gcode`.
        settings: names of settings to include.
    """
    further = END_FACTS if macro == "end_gcode" else frozenset()
    if macro in ("before_layer_gcode", "layer_gcode", "pause_gcode"):
        further = LAYER_FACTS
    return settings | FACTS | further | _PRUSASLICER.keys() | _OTHER_NAMES.keys()


def add_names_of_other_slicers(known: Mapping[str, Value]) -> dict[str, Value]:
    """Add placeholders with the names of other slicers; their values are vectors of one item.

    Args:
        known: settings and facts under the names of this program.
    """
    found = dict(known)
    for theirs, ours in _PRUSASLICER.items():
        value = known.get(ours)
        if isinstance(value, (int, float, str)):
            is_whole = theirs in _WHOLE_NUMBERS and not isinstance(value, str) and float(value).is_integer()
            found[theirs] = Items((int(value) if is_whole else value,))
    return found | {name: found[same] for name, same in _OTHER_NAMES.items() if same in found}
