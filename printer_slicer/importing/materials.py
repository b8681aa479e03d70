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

_LAYER: Final = 0.2  # mm: layer height for converting layer counts to heights if it is unknown
_HIGHEST_FLOW: Final = 200.0  # mm³/s
_PLA_DENSITY: Final = 1.24  # g/cm³
_LEAST_FLOW_RATIO: Final = 0.1
_MOST_FLOW_RATIO: Final = 2.0  # the limit of other slicers
_ADVANCE: Final = re.compile(
    r"^\s*(?:M900\s.*?K(\d*\.?\d+)|M572\s.*?S(\d*\.?\d+)|SET_PRESSURE_ADVANCE\s.*?\bADVANCE=(\d*\.?\d+))",
    re.IGNORECASE,
)
_MOST_ADVANCE: Final = 5.0  # s; greater numbers have another unit, such as those of Linear Advance 1.0
_FANS: Final = ("min_fan_speed", "max_fan_speed", "fan_always_on", "cooling")


def convert_material(preset: Preset) -> ImportedProfile:
    """Convert a material.

    Args:
        preset: its settings under PrusaSlicer's names; `context` has the printer's, if it is known.

    Raises:
        ProfileError: a value is not a number; with place and remedy.
    """
    made = Conversion(preset)
    made.put("name", preset.name)
    kind, *others = preset.items("filament_type")
    made.put("type", kind or preset.name, "filament_type")
    if others:
        made.warn("filament_type", f"{ONE_TOOL}: {kind} is imported, {', '.join(others)} is not")
    made.number("filament_diameter", "filament_diameter")
    density = preset.number("filament_density")
    made.put(
        "density",
        density or _PLA_DENSITY,
        "filament_density",
        "" if density else "not in the source: density of PLA",
    )
    made.number("cost", "filament_cost")
    flow = preset.number("extrusion_multiplier")
    if not _LEAST_FLOW_RATIO <= flow <= _MOST_FLOW_RATIO:
        raise made.error("extrusion_multiplier", f"a flow ratio of {flow:g}", "Write a number near 1")
    made.clamp("flow_ratio", flow, 0.5, 1.5, "extrusion_multiplier")
    for ours, theirs in (
        ("nozzle_temperature", "temperature"),
        ("first_layer_nozzle_temperature", "first_layer_temperature"),
        ("bed_temperature", "bed_temperature"),
        ("first_layer_bed_temperature", "first_layer_bed_temperature"),
    ):
        made.number(ours, theirs)
    _flow(made)
    _fan(made)
    _advance(made)
    return made.finish(_reason)


def _flow(made: Conversion) -> None:
    flow = made.preset.number("filament_max_volumetric_speed")
    if flow:
        made.clamp("max_flow", flow, 0.1, _HIGHEST_FLOW, "filament_max_volumetric_speed")
    else:
        how = "unlimited in the source; here 0 means printer.hotend_max_flow, or 12 mm³/s if that is 0"
        made.put("max_flow", 0, "filament_max_volumetric_speed", how, differs=True)


def _fan(made: Conversion) -> None:
    """Convert fan speeds and cooling times; without cooling the fan speed is constant."""
    preset = made.preset
    usual, most = (
        made.resolve(name, 1.0) / (1 if made.quantity(name).percent else 100) for name in _FANS[:2]
    )
    always, cooling = preset.is_on("fan_always_on"), preset.is_on("cooling")
    low = usual if always else 0.0
    made.clamp(
        "fan_ratio", low, 0, 1, ("min_fan_speed", "fan_always_on"), "" if always else "fan_always_on is off"
    )
    made.clamp(
        "fan_ratio_max",
        most if cooling else low,
        0,
        1,
        ("max_fan_speed", "cooling"),
        "" if cooling else "cooling is off",
    )
    bridge = preset.number("bridge_fan_speed") / 100
    if preset.dialect == "orca" and not preset.is_on("enable_overhang_bridge_fan"):
        made.put("fan_ratio_bridge", 0, ("enable_overhang_bridge_fan", "bridge_fan_speed"), "as elsewhere")
    else:
        made.clamp("fan_ratio_bridge", bridge, 0, 1, ("bridge_fan_speed", "enable_overhang_bridge_fan"))
    made.clamp("fan_layer_time", preset.number("fan_below_layer_time"), 0, 600, "fan_below_layer_time")
    made.clamp(
        "min_layer_time",
        preset.number("slowdown_below_layer_time") if cooling else 0.0,
        0,
        600,
        ("slowdown_below_layer_time", "cooling"),
        "" if cooling else "cooling is off",
    )
    made.clamp("min_speed", preset.number("min_print_speed"), 1, 100, "min_print_speed")
    for ours, theirs, count in (
        ("fan_off_below", "disable_fan_first_layers", off := preset.number("disable_fan_first_layers")),
        ("fan_full_above", "full_fan_speed_layer", max(preset.number("full_fan_speed_layer"), off)),
    ):
        made.clamp(
            ours, _height_of_layers(preset, count), 0, 100, theirs, _layers_text(preset) if count else ""
        )
    _overhangs(made)


def _height_of_layers(preset: Preset, count: float) -> float:
    """Return the height of this number of layers, mm."""
    first, height = preset.heights if all(preset.heights) else (_LAYER, _LAYER)
    return first + (count - 1) * height if count >= 1 else 0.0


def _layers_text(preset: Preset) -> str:
    """Return a text about the layer heights behind a converted layer count."""
    first, height = preset.heights
    if not all(preset.heights):
        return f"layers of {_LAYER:g} mm each"
    return f"layers of {height:g} mm" + (f", the first of {first:g} mm" if first != height else "")


def _overhangs(made: Conversion) -> None:
    """Convert the fan speed on overhangs: as on bridges, or graded by overhang."""
    preset = made.preset
    if preset.dialect == "orca":
        _overhangs_above(made, made.resolve("overhang_fan_threshold", 1.0))
        return
    bridge = float(made.values["fan_ratio_bridge"]) or 1.0
    graded = preset.is_on("enable_dynamic_fan_speeds") if preset.has("enable_dynamic_fan_speeds") else False
    for number, share in enumerate((0, 25, 50, 75)):
        ours, theirs = f"fan_overhang_{share}_ratio", f"overhang_fan_speed_{number}"
        if graded and preset.has(theirs):
            speed = preset.number(theirs) / 100
            made.clamp(ours, speed / bridge, 0, 1, theirs, "as a ratio of the bridge fan speed")
        else:
            made.put(ours, 1 if share == 0 else 0, theirs)
    made.mark_used(["enable_dynamic_fan_speeds"])


def _overhangs_above(made: Conversion, least: float) -> None:
    """Set the bridge fan speed for overhangs from a threshold on.

    Args:
        made: conversion of a material.
        least: unsupported ratio of the extrusion width, 0 to 1.
    """
    for share in (0, 25, 50, 75):
        on = share <= 100 - 100 * least or share == 0
        how = "as on bridges; rises gradually up to the threshold" if on else ""
        made.put(f"fan_overhang_{share}_ratio", int(on), "overhang_fan_threshold", how, differs=bool(how))


def _advance(made: Conversion) -> None:
    """Convert pressure advance, from its setting or from a command in the material's G-code."""
    preset = made.preset
    if preset.is_on("enable_pressure_advance") and preset.has("pressure_advance"):
        _put_advance(made, "pressure_advance", [(preset.number("pressure_advance"), "")])
    made.mark_used(["enable_pressure_advance", "pressure_advance"])
    name = "start_filament_gcode"
    text = preset.first_macro(name)
    made.used.add(name)
    try:
        lines = read_template(text, name).render(SettingValues(preset.context))
    except ProfileError as error:
        why = str(error.args[0]).removeprefix(f"{name}: ").splitlines()[0]
        made.used.discard(name)
        if "M900" in text or "M572" in text or "PRESSURE_ADVANCE" in text:
            made.warn(name, f"pressure advance depends on the printer ({why}): import both together")
        return
    commands = [line for line in lines if line.partition(";")[0].strip()]
    found = [match for match in map(_ADVANCE.match, commands) if match]
    if found and not made.values.get("pressure_advance"):
        said = [(float(next(filter(None, one.groups()))), one[0].strip()) for one in found]
        _put_advance(made, name, said)
    others = [line.strip() for line in commands if not _ADVANCE.match(line)]
    if others:
        shown = "; ".join(line.partition(";")[0].strip() for line in others[:3])
        made.warn(name, f"materials have no G-code here: add {shown} to the printer's start_gcode")


def _put_advance(made: Conversion, name: str, said: Sequence[tuple[float, str]]) -> None:
    """Set pressure advance to the last value in seconds; firmware ignores commands with another unit.

    Args:
        made: conversion of a material.
        name: name of the setting with the values.
        said: values, each with its command.
    """
    fitting = [one for one in said if 0 <= one[0] <= _MOST_ADVANCE]
    others = ", ".join(
        repr(command or f"{value:g}") for value, command in said if (value, command) not in fitting
    )
    if not fitting:
        made.used.add(name)
        made.warn(
            name, f"{others} is not in seconds (0 to {_MOST_ADVANCE:g}) and is not imported; measure it"
        )
        return
    value, command = fitting[-1]
    how = f"from the command {command!r}" if command else ""
    made.put("pressure_advance", value, name, f"{how}; {others} has another unit" if others else how)


def _reason(name: str) -> str:
    """Return the reason why a material setting has no equivalent."""
    if name.startswith(("filament_retract", "filament_deretract", "filament_wipe")):
        return "retraction is a printer setting: set it there"
    if re.match(r"filament_(ramming|load|unload|cooling|toolchange|minimal_purge|multitool)", name):
        return ONE_TOOL
    if name.endswith("_gcode"):
        return "materials have no G-code here: add it to the printer's"
    return "no equivalent"
