"""Placeholders of macros: all settings, and facts about the print and its layers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.macros import Items, Value, add_names_of_other_slicers
from printer_slicer.model import Program
from printer_slicer.profile import Profile, list_settings
from printer_slicer.roles import Role
from printer_slicer.texts import format_duration

__all__ = ["collect_end_facts", "collect_layer_facts", "collect_print_facts"]

_DECIMALS = 6
_MAX_TOOLS = 255


def collect_print_facts(
    program: Program, profile: Profile, seconds: float = 0.0, names: tuple[str, ...] = (), name: str = ""
) -> dict[str, Value]:
    """Return the settings, each as `section.name` and as `name`, and facts about the print.

    Names of PrusaSlicer and other slicers are included.

    Args:
        program: the moves.
        profile: the profile that the program was sliced with.
        seconds: estimated time of the moves.
        names: names of the objects, if there are several.
        name: name of the sliced file, without suffix.
    """
    known = _collect_settings(profile)
    printer, material = profile.printer, profile.material
    (left, front), (right, back) = printer.corners
    first = np.flatnonzero(np.isin(program.layer, program.plan.stack_starts) & (program.role != Role.TRAVEL))
    beads = np.concatenate([program.xyz[np.maximum(first - 1, 0), :2], program.xyz[first, :2]])
    low, high = (beads.min(axis=0), beads.max(axis=0)) if len(beads) else (np.zeros(2), np.zeros(2))
    used = program.filament_used
    grams = used * material.filament_area / 1000 * material.density
    numbers = {
        "bed_x_middle": (left + right) / 2,
        "bed_y_middle": (front + back) / 2,
        "bed_y_end": back - 5,
        "first_layer_min_x": low[0],
        "first_layer_min_y": low[1],
        "first_layer_max_x": high[0],
        "first_layer_max_y": high[1],
        "layer_count": program.plan.n_layers,
        "part_height": program.plan.highest,
        "filament_used": used,
        "filament_used_g": grams,
        "print_seconds": seconds,
        "extruded_volume": used * material.filament_area,
        "total_cost": grams * material.cost / 1000,
        "first_layer_height": program.plan.top[0],
        "extrusion_width": profile.extrusion_width,
    }
    for key in ("layer_heights", "pause_at"):
        known[key] = known[f"quality.{key}"] = getattr(profile.quality, key)
    known |= {key: round(float(value), _DECIMALS) for key, value in numbers.items()}
    known |= _collect_bed_facts(profile, low, high) | _collect_extruder_facts(profile, len(names))
    known |= {"layer_tops": _round_to_tuple(program.plan.top), "object_names": names}
    known |= {"input_filename": f"{name}.gcode" if name else "", "input_filename_base": name}
    known |= dict.fromkeys(("print_time", "normal_print_time"), format_duration(seconds))
    return add_names_of_other_slicers(known | _collect_support_facts(profile))


def _collect_bed_facts(profile: Profile, low: Float, high: Float) -> dict[str, Value]:
    """Return corners and sizes of the bed and of the first layer, which extends from `low` to `high`."""
    (left, front), (right, back) = profile.printer.corners
    first = {"min": _round_to_tuple(low), "max": _round_to_tuple(high), "size": _round_to_tuple(high - low)}
    bed = {"min": (left, front), "max": (right, back), "size": (right - left, back - front)}
    return {
        **{f"print_bed_{name}": _round_to_tuple(np.array(values)) for name, values in bed.items()},
        **{f"first_layer_{name}": values for name, values in first.items()},
        **{f"first_layer_print_{name}": values for name, values in first.items()},
    }


def _collect_support_facts(profile: Profile) -> dict[str, Value]:
    """Return the placeholders of PrusaSlicer, OrcaSlicer and Cura for settings of supports."""
    quality, is_on = profile.quality, profile.quality.support != "off"
    numbers = {
        "support_material_threshold": quality.support_threshold_deg,
        "support_threshold_angle": quality.support_threshold_deg,
        "support_angle": 90 - quality.support_threshold_deg,
        "support_material_contact_distance": quality.support_gap,
        "support_top_z_distance": quality.support_gap,
        "support_top_distance": quality.support_gap,
        "support_material_bottom_contact_distance": quality.support_bottom_gap,
        "support_bottom_z_distance": quality.support_bottom_gap,
        "support_material_xy_spacing": quality.support_xy_gap,
        "support_material_interface_layers": quality.support_interface_layers,
        "support_interface_top_layers": quality.support_interface_layers,
        "support_material_interface_spacing": quality.support_interface_spacing,
    }
    flags = {
        **dict.fromkeys(("support_material", "enable_support", "support_enable"), is_on),
        "support_material_auto": quality.support_places == "all",
        "support_material_buildplate_only": quality.support_on_bed_only,
        "support_on_build_plate_only": quality.support_on_bed_only,
        "support_material_synchronize_layers": quality.support_synchronize_layers,
        "dont_support_bridges": quality.support_max_bridge > 0,
    }
    return {**numbers, **flags}


def _collect_extruder_facts(profile: Profile, objects: int) -> dict[str, Value]:
    """Return PrusaSlicer's placeholders about extruders, wipe tower and objects."""
    tools = {extruder.tool for extruder in profile.extruders}
    return {
        "num_objects": max(objects, 1),
        "num_instances": max(objects, 1),
        "num_extruders": len(tools),
        "num_printing_extruders": len(tools),
        "is_extruder_used": Items(tool in tools for tool in range(_MAX_TOOLS)),
        "has_wipe_tower": False,
        "has_single_extruder_multi_material_priming": False,
        "total_toolchanges": len(tools) - 1,
    }


def _round_to_tuple(values: Float) -> tuple[float, ...]:
    """Convert an array (n,) to a tuple of rounded numbers."""
    return tuple(np.round(values, _DECIMALS).tolist())


def _collect_settings(profile: Profile) -> dict[str, Value]:
    """Return all settings in use except macros; a speed name without a section means the speed of the quality."""
    known: dict[str, Value] = {}
    for key, value in list_settings(profile.resolved):
        owner, _, name = key.partition(".")
        if name.endswith("_gcode"):
            continue
        assert isinstance(value, bool | int | float | str)
        plain = value if isinstance(value, bool | str) else float(value)
        known[key] = plain
        if not (owner == "printer" and "." in name):
            known.setdefault(f"{owner}_name" if name == "name" else name, plain)
    return known


def collect_layer_facts(program: Program, layer: int, filament: float, seconds: float) -> Mapping[str, Value]:
    """Return the facts that only macros at the start of a layer may use.

    Args:
        program: the moves.
        layer: index of the layer, from 0.
        filament: filament extruded before the layer, mm.
        seconds: estimated time of the moves before the layer.
    """
    plan = program.plan
    top = round(float(plan.top[layer]), _DECIMALS)
    return {
        "layer_num": layer,
        "layer_z": top,
        "max_layer_z": round(float(plan.top[: layer + 1].max()), _DECIMALS),
        "current_layer_height": round(float(plan.height[layer]), _DECIMALS),
        "filament_so_far": round(filament, _DECIMALS),
        "seconds_so_far": round(seconds, _DECIMALS),
    }


def collect_end_facts(program: Program, profile: Profile) -> Mapping[str, Value]:
    """Return the facts that only the end G-code may use; `layer_z` includes the lift, as in PrusaSlicer."""
    top = program.plan.highest
    return {
        "layer_num": program.plan.n_layers - 1,
        "layer_z": round(top + profile.printer.z_hop, _DECIMALS),
        "max_layer_z": round(top, _DECIMALS),
    }
