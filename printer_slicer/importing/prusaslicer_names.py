"""PrusaSlicer's settings: the kind of preset that each one belongs to, and its default.

Source: output of PrusaSlicer 2.5 (`--help-fff`, `--save`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

__all__ = ["DEFAULTS", "METADATA", "find_setting_kind"]

_PRINTER: Final = re.compile(
    r"machine_\w+|retract_\w+|deretract_speed|display_\w+|thumbnails\w*|printer_\w+|serial_\w+|print_host|printhost_\w+"
    r"|octoprint_\w+|host_type|bed_(shape|exclude_area|custom_\w+)|max_print_height|nozzle_\w+|extruder_(colour|offset)"
    r"|extruders_count|(start|end|layer|before_layer|between_objects|toolchange|color_change|pause_print"
    r"|template_custom)_gcode|gcode_flavor|use_(firmware_retraction|relative_e_distances|volumetric_e)|wipe|wipe_advanced\w*"
    r"|(min|max)_layer_height|variable_layer_height|z_offset|z_step|z_lift_\w+|silent_mode|remaining_times"
    r"|single_extruder_multi_material|cooling_tube_\w+|parking_pos_retraction|extra_loading_move"
    r"|high_current_on_filament_swap|default_(print|filament)_profile|extrusion_axis|travel_(ramping|slope|lift|max)\w*"
    r"|binary_gcode|autoemit_temperature_commands|start_gcode_manual|tool_name|milling_\w+|prefer_clockwise_movements"
    r"|(time_estimation|resolution)_compensation|multimaterial_purging|fan_speedup_\w+|fan_kickstart"
)
_MATERIAL: Final = re.compile(
    r"(start_|end_)?filament_\w+|(first_layer_)?(bed_)?temperature|chamber_\w+|(bridge|min|max|top|external_perimeter)_fan_speed"
    r"|cooling|fan_(always_on|below_layer_time)|slowdown_below_layer_time|min_print_speed|disable_fan_first_layers"
    r"|full_fan_speed_layer|extrusion_multiplier|idle_temperature|enable_dynamic_fan_speeds|overhang_fan_(speed_\d|threshold)"
    r"|enable_overhang_bridge_fan|(pressure_advance|enable_pressure_advance)|\w+_fan_speed|max_speed_reduction|first_layer_fan_speed|cooling_\w+"
)
METADATA: Final = re.compile(
    r"inherits\w*|renamed_[Ff]rom|compatible_\w+|(print|filament|printer)_settings_id|\w*notes|\w*_vendor|\w*colou?r"
    r"|printer_(model|variant|technology)|default_\w+_profile|physical_printer_\w+|output_filename_format|threads"
    r"|gcode_comments|print_host\w*|printhost_\w+|octoprint_\w+|host_type|bed_custom_\w+|serial_\w+|\w*spool_weight"
    r"|variable_layer_height|silent_mode|extruder_clearance_\w+|duplicate_distance|thumbnails_\w+|preset_names?"
    r"|machine_limits_usage|slicing_mode|gcode_label_objects|profile_\w+|wiping_volumes_\w+|colorprint_heights"
    r"|type|name|from|version|instantiation|is_custom_defined|(setting|filament|base|user)_id|updated_time"
    r"|description"
)
"""Settings that do not change the print: inheritance, compatibility, notes, colours, heads of presets."""

DEFAULTS: Final[Mapping[str, str]] = {
    # printer
    "bed_shape": "0x0,200x0,200x200,0x200",
    "max_print_height": "200",
    "gcode_flavor": "reprap",
    "printer_notes": "",
    "printer_model": "",
    "single_extruder_multi_material": "0",
    "nozzle_diameter": "0.4",
    "min_layer_height": "0.07",
    "max_layer_height": "0",
    "machine_max_acceleration_e": "10000",
    "machine_max_acceleration_extruding": "1500",
    "machine_max_acceleration_retracting": "1500",
    "machine_max_acceleration_travel": "1500",
    "machine_max_acceleration_x": "9000",
    "machine_max_acceleration_y": "9000",
    "machine_max_acceleration_z": "500",
    "machine_max_feedrate_e": "120",
    "machine_max_feedrate_x": "500",
    "machine_max_feedrate_y": "500",
    "machine_max_feedrate_z": "12",
    "machine_max_jerk_e": "2.5",
    "machine_max_jerk_x": "10",
    "machine_max_jerk_y": "10",
    "machine_max_jerk_z": "0.2",
    "retract_length": "2",
    "retract_speed": "40",
    "deretract_speed": "0",
    "retract_before_travel": "2",
    "retract_lift": "0",
    "retract_restart_extra": "0",
    "z_offset": "0",
    "start_gcode": "G28 ; home all axes\\nG1 Z5 F5000 ; lift nozzle\\n",
    "end_gcode": "M104 S0 ; turn off temperature\\nG28 X0 ; home X axis\\nM84 ; disable motors\\n",
    "printer_technology": "FFF",
    "use_relative_e_distances": "0",
    # filament
    "temperature": "200",
    "first_layer_temperature": "200",
    "bed_temperature": "0",
    "first_layer_bed_temperature": "0",
    "filament_diameter": "1.75",
    "filament_density": "0",
    "filament_cost": "0",
    "filament_type": "PLA",
    "extrusion_multiplier": "1",
    "filament_max_volumetric_speed": "0",
    "fan_always_on": "0",
    "cooling": "1",
    "min_fan_speed": "35",
    "max_fan_speed": "100",
    "bridge_fan_speed": "100",
    "disable_fan_first_layers": "3",
    "full_fan_speed_layer": "0",
    "fan_below_layer_time": "60",
    "slowdown_below_layer_time": "5",
    "min_print_speed": "10",
    # print
    "layer_height": "0.3",
    "first_layer_height": "0.35",
    "perimeters": "3",
    "perimeter_generator": "arachne",
    "top_solid_layers": "3",
    "bottom_solid_layers": "3",
    "top_solid_min_thickness": "0",
    "bottom_solid_min_thickness": "0",
    "seam_position": "aligned",
    "fill_density": "20%",
    "fill_pattern": "stars",
    "fill_angle": "45",
    "infill_anchor": "600%",
    "infill_anchor_max": "50",
    "infill_every_layers": "1",
    "solid_infill_below_area": "70",
    "thick_bridges": "1",
    "bridge_flow_ratio": "1",
    "gcode_resolution": "0.0125",
    "resolution": "0",
    "skirts": "1",
    "skirt_distance": "6",
    "skirt_height": "1",
    "brim_type": "outer_only",
    "raft_contact_distance": "0.1",
    "raft_first_layer_density": "90%",
    "raft_first_layer_expansion": "3",
    "ironing_spacing": "0.1",
    "ironing_flowrate": "15%",
    "ironing_speed": "15",
    "perimeter_speed": "60",
    "external_perimeter_speed": "50%",
    "small_perimeter_speed": "15",
    "infill_speed": "80",
    "solid_infill_speed": "20",
    "top_solid_infill_speed": "15",
    "bridge_speed": "60",
    "gap_fill_speed": "20",
    "support_material_speed": "60",
    "support_material_interface_speed": "100%",
    "first_layer_speed": "30",
    "max_print_speed": "80",
    "travel_speed": "130",
    "first_layer_extrusion_width": "200%",
}
"""Defaults of the settings that have an equivalent here or that occur in conditions."""


def find_setting_kind(name: str) -> str:
    """Return the kind of preset that a setting belongs to: `printer`, `material` or `quality`."""
    if _PRINTER.fullmatch(name):
        return "printer"
    return "material" if _MATERIAL.fullmatch(name) else "quality"
