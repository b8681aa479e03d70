"""What other slicers' placeholders are called here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

__all__ = ["ALIASES", "FACTS", "IN_LAYERS", "Ours"]


class Ours(NamedTuple):
    """An expression of ours, what kind of value it has (`int`, `float`, `text`, `bool`, `list`), and what differs."""

    text: str
    kind: str = "float"
    differs: str = ""


FACTS: Final[Mapping[str, Ours]] = {
    # temperatures
    "first_layer_temperature": Ours("first_layer_nozzle_temperature", "int"),
    "temperature": Ours("nozzle_temperature", "int"),
    "first_layer_bed_temperature": Ours("first_layer_bed_temperature", "int"),
    "bed_temperature": Ours("bed_temperature", "int"),
    # material
    "filament_diameter": Ours("filament_diameter"),
    "filament_density": Ours("density"),
    "filament_cost": Ours("cost"),
    "filament_type": Ours("material.type", "text"),
    "filament_settings_id": Ours("material_name", "text"),
    "filament_preset": Ours("material_name", "text"),
    "extrusion_multiplier": Ours("flow_ratio"),
    "filament_max_volumetric_speed": Ours("max_flow"),
    "pressure_advance": Ours("pressure_advance"),
    # quality
    "layer_height": Ours("quality.layer_height"),
    # quality.first_layer_height may be 0 in profiles whose planner chooses it.
    "first_layer_height": Ours("layer_tops[0]"),
    "print_settings_id": Ours("quality_name", "text"),
    "print_preset": Ours("quality_name", "text"),
    "travel_speed": Ours("quality.speeds.travel"),
    "first_layer_speed": Ours("quality.speeds.first_layer"),
    "perimeter_speed": Ours("quality.speeds.inner_perimeter"),
    "infill_speed": Ours("quality.speeds.sparse"),
    "bridge_speed": Ours("quality.speeds.bridge"),
    "perimeters": Ours("perimeters", "int"),
    "extrusion_width": Ours(
        "(quality.extrusion_width == 0 ? 1.125 * nozzle_diameter : quality.extrusion_width)"
    ),
    # printer
    "nozzle_diameter": Ours("nozzle_diameter"),
    "max_print_height": Ours("bed_z"),
    "machine_width": Ours("bed_x"),
    "machine_depth": Ours("bed_y"),
    "printer_settings_id": Ours("printer_name", "text"),
    "printer_preset": Ours("printer_name", "text"),
    "retract_length": Ours("retract_length"),
    "retract_speed": Ours("retract_speed"),
    "retract_lift": Ours("z_hop"),
    "machine_max_feedrate_x": Ours("max_speed_x"),
    "machine_max_feedrate_y": Ours("max_speed_y"),
    "machine_max_feedrate_z": Ours("max_speed_z"),
    "machine_max_feedrate_e": Ours("max_speed_e"),
    "machine_max_acceleration_x": Ours("max_acceleration_x"),
    "machine_max_acceleration_y": Ours("max_acceleration_y"),
    "machine_max_acceleration_z": Ours("max_acceleration_z"),
    "machine_max_acceleration_e": Ours("max_acceleration_e"),
    "machine_max_acceleration_extruding": Ours("acceleration"),
    "machine_max_acceleration_retracting": Ours("retract_acceleration"),
    "machine_max_acceleration_travel": Ours("travel_acceleration"),
    # the print
    "first_layer_print_min": Ours("first_layer_min", "list", "holds the skirt, too"),
    "first_layer_print_max": Ours("first_layer_max", "list", "holds the skirt, too"),
    "first_layer_print_size": Ours("first_layer_size", "list", "holds the skirt, too"),
    "total_layer_count": Ours("layer_count", "int"),
    "total_weight": Ours("filament_used_g"),
    "layer_num": Ours("(layer_count - 1)", "int"),
    "layer_z": Ours(
        "part_height", "float", "is the height of the part here, there that of the nozzle, lifted or not"
    ),
    "max_layer_z": Ours("part_height"),
    # one tool prints
    "initial_tool": Ours("tool", "int"),
    "initial_extruder": Ours("tool", "int"),
    "initial_no_support_extruder": Ours("tool", "int"),
    "initial_filament_type": Ours("material.type", "text"),
    "current_extruder": Ours("tool", "int"),
    "has_wipe_tower": Ours("false", "bool"),
    "has_single_extruder_multi_material_priming": Ours("false", "bool"),
    "total_toolchanges": Ours("0", "int"),
}
"""PrusaSlicer's names, in start and end G-code."""

IN_LAYERS: Final[Mapping[str, Ours]] = {
    "layer_num": Ours("layer_num", "int"),
    "layer_z": Ours("layer_z"),
    "max_layer_z": Ours("layer_z"),
}
"""What means something else in G-code between layers."""

ALIASES: Final[Mapping[str, Mapping[str, str]]] = {
    "orca": {
        "nozzle_temperature_initial_layer": "first_layer_temperature",
        "first_layer_temperature": "first_layer_temperature",
        "nozzle_temperature": "temperature",
        "bed_temperature_initial_layer": "first_layer_bed_temperature",
        "bed_temperature_initial_layer_single": "first_layer_bed_temperature",
        "hot_plate_temp_initial_layer": "first_layer_bed_temperature",
        "textured_plate_temp_initial_layer": "first_layer_bed_temperature",
        "cool_plate_temp_initial_layer": "first_layer_bed_temperature",
        "hot_plate_temp": "bed_temperature",
        "textured_plate_temp": "bed_temperature",
        "initial_layer_print_height": "first_layer_height",
        "initial_layer_speed": "first_layer_speed",
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
        "first_layer_print_min": "first_layer_print_min",
        "first_layer_print_max": "first_layer_print_max",
    },
    "cura": {
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
        "retraction_speed": "retract_speed",
        "retraction_hop": "retract_lift",
        "machine_max_feedrate_x": "machine_max_feedrate_x",
        "layer_height": "layer_height",
        "initial_extruder_nr": "initial_tool",
    },
}
"""What slicers call what PrusaSlicer calls otherwise."""
