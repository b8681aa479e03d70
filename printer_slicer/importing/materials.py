"""Materials of other slicers as ours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.conditions import SettingValues
from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.report import Imported
from printer_slicer.macros import read_template

__all__ = ["material_from"]

_LAYER: Final = 0.2  # mm: assumed where layer counts become heights and the layer height is unknown
_MOST_FLOW_HERE: Final = 200.0  # mm³/s
_WATER: Final = 1.24  # g/cm³, of PLA
_LEAST_FLOW: Final = 0.1
_MOST_FLOW: Final = 2.0  # over which the source's own slicers take none
_ADVANCE: Final = re.compile(
    r"^\s*(?:M900\s.*?K(\d*\.?\d+)|M572\s.*?S(\d*\.?\d+)|SET_PRESSURE_ADVANCE\s.*?\bADVANCE=(\d*\.?\d+))",
    re.IGNORECASE,
)
_MOST_ADVANCE: Final = 5.0  # s; over this a number is of another scale, such as Linear Advance 1.0
_FANS: Final = ("min_fan_speed", "max_fan_speed", "fan_always_on", "cooling")


def material_from(preset: Preset) -> Imported:
    """Our material for another slicer's.

    Args:
        preset: its settings under PrusaSlicer's names; `together` holds the printer's, where it is known.

    Raises:
        ProfileError: a value that is no number, with place and remedy.
    """
    made = Conversion(preset)
    made.put("name", preset.name)
    kind, *others = preset.items("filament_type")
    made.put("type", kind or preset.name, "filament_type")
    if others:
        made.warn("filament_type", f"one tool prints: {kind} is taken, {', '.join(others)} left out")
    made.number("filament_diameter", "filament_diameter")
    density = preset.number("filament_density")
    made.put(
        "density", density or _WATER, "filament_density", "" if density else "not in the source: that of PLA"
    )
    made.number("cost", "filament_cost")
    flow = preset.number("extrusion_multiplier")
    if not _LEAST_FLOW <= flow <= _MOST_FLOW:
        raise made.refuse("extrusion_multiplier", f"{flow:g} times the plastic", "write a number near 1")
    made.held("flow_ratio", flow, 0.5, 1.5, "extrusion_multiplier")
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
    return made.done(_why)


def _flow(made: Conversion) -> None:
    flow = made.preset.number("filament_max_volumetric_speed")
    if flow:
        made.held("max_flow", flow, 0.1, _MOST_FLOW_HERE, "filament_max_volumetric_speed")
    else:
        how = "0 means no limit; here printer.hotend_max_flow, or 12 mm³/s if that is not set: set your hotend's limit"
        made.put("max_flow", 0, "filament_max_volumetric_speed", how)


def _fan(made: Conversion) -> None:
    """Fan and slowing down: by layer time where cooling is on, else always the same."""
    preset = made.preset
    usual, most = (made.of(name, 1.0) / (1 if made.quantity(name).percent else 100) for name in _FANS[:2])
    always, cooling = preset.on("fan_always_on"), preset.on("cooling")
    low = usual if always else 0.0
    made.held(
        "fan_ratio", low, 0, 1, ("min_fan_speed", "fan_always_on"), "" if always else "fan_always_on is off"
    )
    made.held(
        "fan_ratio_max",
        most if cooling else low,
        0,
        1,
        ("max_fan_speed", "cooling"),
        "" if cooling else "cooling is off",
    )
    bridge = preset.number("bridge_fan_speed") / 100
    if preset.dialect == "orca" and not preset.on("enable_overhang_bridge_fan"):
        made.put("fan_ratio_bridge", 0, ("enable_overhang_bridge_fan", "bridge_fan_speed"), "as elsewhere")
    else:
        made.held("fan_ratio_bridge", bridge, 0, 1, ("bridge_fan_speed", "enable_overhang_bridge_fan"))
    made.held("fan_layer_time", preset.number("fan_below_layer_time"), 0, 600, "fan_below_layer_time")
    made.held(
        "min_layer_time",
        preset.number("slowdown_below_layer_time") if cooling else 0.0,
        0,
        600,
        ("slowdown_below_layer_time", "cooling"),
        "" if cooling else "cooling is off",
    )
    made.held("min_speed", preset.number("min_print_speed"), 1, 100, "min_print_speed")
    for ours, theirs, count in (
        ("fan_off_below", "disable_fan_first_layers", off := preset.number("disable_fan_first_layers")),
        ("fan_full_above", "full_fan_speed_layer", max(preset.number("full_fan_speed_layer"), off)),
    ):
        made.held(ours, _top_of(preset, count), 0, 100, theirs, _counted(preset) if count else "")
    _overhangs(made)


def _top_of(preset: Preset, count: float) -> float:
    """Return the height of this number of layers, mm."""
    first, height = preset.heights if all(preset.heights) else (_LAYER, _LAYER)
    return first + (count - 1) * height if count >= 1 else 0.0


def _counted(preset: Preset) -> str:
    """Describe how layers became a height."""
    first, height = preset.heights
    if not all(preset.heights):
        return f"layers of {_LAYER:g} mm each"
    return f"layers of {height:g} mm" + (f", the first of {first:g} mm" if first != height else "")


def _overhangs(made: Conversion) -> None:
    """The fan on overhangs: as on bridges over nothing but air, or as the source grades it."""
    preset = made.preset
    if preset.dialect == "orca":
        _overhangs_from(made, made.of("overhang_fan_threshold", 1.0))
        return
    bridge = float(made.values["fan_ratio_bridge"]) or 1.0
    graded = preset.on("enable_dynamic_fan_speeds") if preset.has("enable_dynamic_fan_speeds") else False
    for number, share in enumerate((0, 25, 50, 75)):
        ours, theirs = f"fan_overhang_{share}_ratio", f"overhang_fan_speed_{number}"
        if graded and preset.has(theirs):
            speed = preset.number(theirs) / 100
            made.held(ours, speed / bridge, 0, 1, theirs, "as a share of the fan on bridges")
        else:
            made.put(ours, 1 if share == 0 else 0, theirs)
    made.skip(["enable_dynamic_fan_speeds"])


def _overhangs_from(made: Conversion, least: float) -> None:
    """The fan on overhangs of which at least this share hangs free: as on bridges."""
    for share in (0, 25, 50, 75):
        on = share <= 100 - 100 * least or share == 0
        how = "as on bridges from there on; ramped up to it" if on else ""
        made.put(f"fan_overhang_{share}_ratio", int(on), "overhang_fan_threshold", how)


def _advance(made: Conversion) -> None:
    """Pressure advance: a setting of its own, or a command among the material's G-code."""
    preset = made.preset
    if preset.on("enable_pressure_advance") and preset.has("pressure_advance"):
        _put_advance(made, "pressure_advance", [(preset.number("pressure_advance"), "")])
    made.skip(["enable_pressure_advance", "pressure_advance"])
    name = "start_filament_gcode"
    text = preset.first_macro(name)
    made.used.add(name)
    try:
        lines = read_template(text, name).render(SettingValues(preset.together))
    except ProfileError as error:
        why = str(error.args[0]).removeprefix(f"{name}: ").splitlines()[0]
        made.used.discard(name)
        if "M900" in text or "M572" in text or "PRESSURE_ADVANCE" in text:
            made.warn(name, f"pressure advance depends on the printer ({why}): import it together with one")
        return
    commands = [line for line in lines if line.partition(";")[0].strip()]
    found = [match for match in map(_ADVANCE.match, commands) if match]
    if found and not made.values.get("pressure_advance"):
        said = [(float(next(filter(None, one.groups()))), one[0].strip()) for one in found]
        _put_advance(made, name, said)
    others = [line.strip() for line in commands if not _ADVANCE.match(line)]
    if others:
        shown = "; ".join(line.partition(";")[0].strip() for line in others[:3])
        made.warn(
            name, f"materials have no G-code here: {shown} is left out; put it into the printer's start_gcode"
        )


def _put_advance(made: Conversion, name: str, said: Sequence[tuple[float, str]]) -> None:
    """The last value that is one in seconds: firmware that knows one scale ignores commands of the other.

    Args:
        made: of a material.
        name: where it stands.
        said: values, each with the command that sets it.
    """
    fitting = [one for one in said if 0 <= one[0] <= _MOST_ADVANCE]
    others = ", ".join(
        repr(command or f"{value:g}") for value, command in said if (value, command) not in fitting
    )
    if not fitting:
        made.used.add(name)
        made.warn(
            name, f"{others} is no pressure advance in seconds (0 to {_MOST_ADVANCE:g}): left out; measure it"
        )
        return
    value, command = fitting[-1]
    how = f"its command {command!r}" if command else ""
    made.put("pressure_advance", value, name, f"{how}; {others} is of another scale" if others else how)


def _why(name: str) -> str:
    """Why a setting of the material has no counterpart."""
    if name.startswith(("filament_retract", "filament_deretract", "filament_wipe")):
        return "retraction is the printer's: set it there"
    if re.match(r"filament_(ramming|load|unload|cooling|toolchange|minimal_purge|multitool)", name):
        return "one tool prints"
    if name.endswith("_gcode"):
        return "materials have no G-code here: put it into the printer's"
    return "no counterpart"
