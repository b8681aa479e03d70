"""Convert materials of other slicers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.conditions import SettingValues
from printer_slicer.importing.conversion import ONE_TOOL, Conversion
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.macros import read_template

__all__ = ["convert_material"]

_USUAL_LAYER: Final = 0.2  # mm: layer height that is assumed when layer counts are converted to heights
_HIGHEST_FLOW: Final = 200.0  # mm³/s
_PLA_DENSITY: Final = 1.24  # g/cm³
_MIN_FLOW_RATIO: Final = 0.1
_MAX_FLOW_RATIO: Final = 2.0  # the limit of other slicers
_ADVANCE_COMMAND: Final = re.compile(
    r"^\s*(?:M900\s.*?K(\d*\.?\d+)|M572\s.*?S(\d*\.?\d+)|SET_PRESSURE_ADVANCE\s.*?\bADVANCE=(\d*\.?\d+))",
    re.IGNORECASE,
)
_MAX_ADVANCE: Final = 5.0  # s; greater numbers have another unit, such as those of Linear Advance 1.0
_FAN_SETTINGS: Final = ("min_fan_speed", "max_fan_speed", "fan_always_on", "cooling")


def convert_material(preset: Preset) -> ImportedProfile:
    """Convert a material.

    Args:
        preset: its settings under PrusaSlicer's names; `context` has those of the printer if it is known.

    Raises:
        ProfileError: a value is not a number; with place and remedy.
    """
    conversion = Conversion(preset)
    conversion.put("name", preset.name)
    kind, *others = preset.read_items("filament_type")
    conversion.put("type", kind or preset.name, "filament_type")
    if others:
        conversion.warn("filament_type", f"{ONE_TOOL}: {kind} is imported, {', '.join(others)} is not")
    conversion.copy_number("filament_diameter", "filament_diameter")
    density = preset.read_number("filament_density")
    conversion.put(
        "density",
        density or _PLA_DENSITY,
        "filament_density",
        "" if density else "not in the source: the density of PLA",
    )
    conversion.copy_number("cost", "filament_cost")
    _convert_flow_ratio(conversion)
    for ours, theirs in (
        ("nozzle_temperature", "temperature"),
        ("first_layer_nozzle_temperature", "first_layer_temperature"),
        ("bed_temperature", "bed_temperature"),
        ("first_layer_bed_temperature", "first_layer_bed_temperature"),
    ):
        conversion.copy_number(ours, theirs)
    _convert_max_flow(conversion)
    _convert_cooling(conversion)
    _convert_pressure_advance(conversion)
    return conversion.finish(_explain_unsupported)


def _convert_flow_ratio(conversion: Conversion) -> None:
    """Convert the flow ratio; reject values that look like percentages.

    Raises:
        ProfileError: it is far from 1, as if it were a percentage.
    """
    flow = conversion.preset.read_number("extrusion_multiplier")
    if not _MIN_FLOW_RATIO <= flow <= _MAX_FLOW_RATIO:
        raise conversion.make_error(
            "extrusion_multiplier", f"a flow ratio of {flow:g} is out of range", "Write a number near 1"
        )
    conversion.clamp("flow_ratio", flow, 0.5, 1.5, "extrusion_multiplier")


def _convert_max_flow(conversion: Conversion) -> None:
    """Convert the maximum flow; 0 in the source means no limit."""
    flow = conversion.preset.read_number("filament_max_volumetric_speed")
    if flow:
        conversion.clamp("max_flow", flow, 0.1, _HIGHEST_FLOW, "filament_max_volumetric_speed")
    else:
        how = "unlimited in the source; here 0 means printer.hotend_max_flow, or 12 mm³/s if that is 0"
        is_set = conversion.preset.has("filament_max_volumetric_speed")
        conversion.put("max_flow", 0, "filament_max_volumetric_speed", how, differs=is_set)


def _convert_cooling(conversion: Conversion) -> None:
    """Convert fan speeds and cooling times; if cooling is off, the fan speed is constant."""
    preset = conversion.preset
    usual, most = (_read_fan_ratio(preset, name) for name in _FAN_SETTINGS[:2])
    always, cooling = preset.is_on("fan_always_on"), preset.is_on("cooling")
    low, how = usual if always else 0.0, "" if cooling else "cooling is off"
    names: tuple[str, ...] = ("min_fan_speed", "fan_always_on")
    if low > most and preset.typed.intersection(_FAN_SETTINGS[:2]) == {"max_fan_speed"}:
        low, names = most, (*names, "max_fan_speed")  # the minimum comes from the profile that is changed
    conversion.clamp("fan_ratio", low, 0, 1, names, "" if always else "fan_always_on is off")
    conversion.clamp("fan_ratio_max", most if cooling else low, 0, 1, ("max_fan_speed", "cooling"), how)
    _convert_role_fans(conversion)
    conversion.clamp(
        "fan_layer_time", preset.read_number("fan_below_layer_time"), 0, 600, "fan_below_layer_time"
    )
    conversion.clamp(
        "min_layer_time",
        preset.read_number("slowdown_below_layer_time") if cooling else 0.0,
        0,
        600,
        ("slowdown_below_layer_time", "cooling"),
        how,
    )
    conversion.clamp("min_speed", preset.read_number("min_print_speed"), 1, 100, "min_print_speed")
    _convert_fan_heights(conversion)
    _convert_overhang_fan(conversion)


def _convert_role_fans(conversion: Conversion) -> None:
    """Convert the fan speeds on bridges and on the interface of supports."""
    preset = conversion.preset
    bridge = _read_fan_ratio(preset, "bridge_fan_speed")
    if preset.dialect == "orca" and not preset.is_on("enable_overhang_bridge_fan"):
        names = ("enable_overhang_bridge_fan", "bridge_fan_speed")
        conversion.put("fan_ratio_bridge", 0, names, "as on other extrusions")
    else:
        conversion.clamp("fan_ratio_bridge", bridge, 0, 1, ("bridge_fan_speed", "enable_overhang_bridge_fan"))
    interface = "support_material_interface_fan_speed"  # -1: as on other extrusions
    if preset.has(interface) and preset.read_number(interface) >= 0:
        conversion.clamp("support_fan", _read_fan_ratio(preset, interface), 0, 1, interface)


def _convert_fan_heights(conversion: Conversion) -> None:
    """Convert the layers on which the fan starts and reaches its speed."""
    preset = conversion.preset
    for ours, theirs, count in (
        ("fan_off_below", "disable_fan_first_layers", off := preset.read_number("disable_fan_first_layers")),
        ("fan_full_above", "full_fan_speed_layer", max(preset.read_number("full_fan_speed_layer"), off)),
    ):
        conversion.clamp(
            ours,
            _compute_height_of_layers(preset, count),
            0,
            100,
            theirs,
            _describe_layers(preset) if count else "",
        )


def _read_fan_ratio(preset: Preset, name: str) -> float:
    """Return a fan speed as a ratio; the source gives it in percent, with or without %."""
    return preset.read_quantity(name).value / 100


def _compute_height_of_layers(preset: Preset, count: float) -> float:
    """Return the total height of a number of layers, mm."""
    first, height = preset.heights if all(preset.heights) else (_USUAL_LAYER, _USUAL_LAYER)
    return first + (count - 1) * height if count >= 1 else 0.0


def _describe_layers(preset: Preset) -> str:
    """Describe the layer heights that were assumed to convert a layer count."""
    first, height = preset.heights
    if not all(preset.heights):
        return f"layers of {_USUAL_LAYER:g} mm each"
    return f"layers of {height:g} mm" + (f", the first of {first:g} mm" if first != height else "")


def _convert_overhang_fan(conversion: Conversion) -> None:
    """Convert the fan speed on overhangs, which is that of bridges or depends on the overhang."""
    preset = conversion.preset
    if preset.dialect == "orca":
        _convert_overhang_threshold(conversion, conversion.resolve("overhang_fan_threshold", 1.0))
        return
    bridge = float(conversion.values["fan_ratio_bridge"]) or 1.0
    switch = "enable_dynamic_fan_speeds"
    is_graded = preset.has(switch) and preset.is_on(switch)
    for number, share in enumerate((0, 25, 50, 75)):
        ours, theirs = f"fan_overhang_{share}_ratio", f"overhang_fan_speed_{number}"
        if is_graded and preset.has(theirs):
            speed = _read_fan_ratio(preset, theirs)
            how = "as a ratio of the bridge fan speed"
            conversion.clamp(ours, speed / bridge, 0, 1, (theirs, switch), how)
        else:
            conversion.put(ours, 1 if share == 0 else 0, (theirs, switch))


def _convert_overhang_threshold(conversion: Conversion, least: float) -> None:
    """Use the bridge fan speed on overhangs beyond a threshold.

    Args:
        conversion: conversion of a material.
        least: the threshold, as a ratio of the extrusion width that is unsupported, 0 to 1.
    """
    for share in (0, 25, 50, 75):
        on = share <= 100 - 100 * least or share == 0
        how = "as on bridges; the fan speed rises gradually up to the threshold" if on else ""
        conversion.put(
            f"fan_overhang_{share}_ratio", int(on), "overhang_fan_threshold", how, differs=bool(how)
        )


def _convert_pressure_advance(conversion: Conversion) -> None:
    """Convert pressure advance from its setting, or from a command in the material's G-code."""
    preset = conversion.preset
    if preset.is_on("enable_pressure_advance") and preset.has("pressure_advance"):
        _put_pressure_advance(conversion, "pressure_advance", [(preset.read_number("pressure_advance"), "")])
    conversion.mark_used(["enable_pressure_advance", "pressure_advance"])
    name = "start_filament_gcode"
    text = preset.read_first_macro(name)
    conversion.used.add(name)
    try:
        lines = read_template(text, name).render(SettingValues(preset.context))
    except ProfileError as error:
        why = str(error.args[0]).removeprefix(f"{name}: ").splitlines()[0]
        conversion.used.discard(name)
        if "M900" in text or "M572" in text or "PRESSURE_ADVANCE" in text:
            conversion.warn(name, f"pressure advance depends on the printer ({why}): import both together")
        return
    commands = [line for line in lines if line.partition(";")[0].strip()]
    found = [match for match in map(_ADVANCE_COMMAND.match, commands) if match]
    if found and not conversion.values.get("pressure_advance"):
        advances = [(float(next(filter(None, one.groups()))), one[0].strip()) for one in found]
        _put_pressure_advance(conversion, name, advances)
    others = [line.strip() for line in commands if not _ADVANCE_COMMAND.match(line)]
    if others:
        shown = "; ".join(line.partition(";")[0].strip() for line in others[:3])
        conversion.warn(name, f"materials have no G-code here: add {shown} to the printer's start_gcode")


def _put_pressure_advance(conversion: Conversion, name: str, advances: Sequence[tuple[float, str]]) -> None:
    """Set pressure advance to the last value that is in seconds; firmware ignores commands with another unit.

    Args:
        conversion: conversion of a material.
        name: name of the setting with the values.
        advances: values, each with its command; an empty command if the value is a setting.
    """
    fitting = [one for one in advances if 0 <= one[0] <= _MAX_ADVANCE]
    others = ", ".join(
        repr(command or f"{value:g}") for value, command in advances if (value, command) not in fitting
    )
    if not fitting:
        conversion.used.add(name)
        conversion.warn(
            name,
            f"{others} is not in seconds (0 to {_MAX_ADVANCE:g}) and is not imported; measure pressure advance",
        )
        return
    value, command = fitting[-1]
    how = f"from the command {command!r}" if command else ""
    conversion.put("pressure_advance", value, name, f"{how}; {others} has another unit" if others else how)


def _explain_unsupported(name: str) -> str:
    """Return the reason why a material setting has no equivalent."""
    if name.startswith(("filament_retract", "filament_deretract", "filament_wipe")):
        return "retraction is a printer setting: set it there"
    if re.match(r"filament_(ramming|load|unload|cooling|toolchange|minimal_purge|multitool)", name):
        return ONE_TOOL
    if name.endswith("_gcode"):
        return "materials have no G-code here: add it to the printer's"
    return "no equivalent"
