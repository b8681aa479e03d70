"""Convert our profile to settings of CuraEngine, and evaluate the formulas in Cura's definitions.

CuraEngine only reads the defaults of a definition file. Cura's window program evaluates the formulas by which one
setting follows from others. This module evaluates them from the same file, so that the engine gets the same settings as
from Cura.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["Definitions", "cura_settings", "find_definitions"]

_FOLDER = "CURA_DEFINITIONS"
_USUAL = Path("/usr/share/cura/resources/definitions")
_MACHINE, _EXTRUDER = "fdmprinter.def.json", "fdmextruder.def.json"


def find_definitions() -> Definitions | None:
    """Return the settings of the installed Cura; None if $CURA_DEFINITIONS and the usual folder have none."""
    folder = Path(os.environ.get(_FOLDER) or _USUAL)
    complete = all((folder / name).is_file() for name in (_MACHINE, _EXTRUDER))
    return Definitions(folder) if complete else None


class Definitions:
    """All settings of a machine with one extruder, with their defaults and formulas.

    Attributes:
        machine: the file that the engine reads; it finds the extruder's file in the same folder.
    """

    def __init__(self, folder: Path) -> None:
        self.machine = folder / _MACHINE
        self._known: dict[str, Mapping[str, Any]] = {}
        for name in (_EXTRUDER, _MACHINE):
            self._known.update(_flatten_settings(json.loads((folder / name).read_text("utf-8"))["settings"]))

    def settings(self, wanted: Mapping[str, object]) -> dict[str, str]:
        """Return every setting that differs from its default, under its name in CuraEngine.

        Args:
            wanted: settings with given values; the others follow from them.

        Raises:
            KeyError: the definitions do not contain a name.
        """
        unknown = wanted.keys() - self._known.keys()
        if unknown:
            raise KeyError(f"not in {self.machine.name}: {', '.join(sorted(unknown))}")
        values = _Values(self._known, wanted)
        return {
            name: _format_value(values[name])
            for name, known in self._known.items()
            if "default_value" in known and values[name] != known["default_value"]
        }


class _Values(dict[str, Any]):
    """Settings by name, evaluated when they are first read."""

    def __init__(self, known: Mapping[str, Mapping[str, Any]], wanted: Mapping[str, object]) -> None:
        super().__init__(wanted)
        self._known = known
        # With one extruder, all of these return the same value.
        self._helpers: dict[str, Any] = {
            "__builtins__": {},
            **{f.__name__: f for f in (abs, all, any, int, len, map, max, min, round, sum)},
            "math": math,
            "resolveOrValue": lambda name: self[name],
            "extruderValue": lambda _extruder, name: self[name],
            "extruderValues": lambda name: [self[name]],
            "defaultExtruderPosition": lambda: "0",
        }

    def __missing__(self, name: str) -> Any:
        if name not in self._known:
            raise KeyError(name)
        known = self._known[name]
        formula = known.get("value")
        # The formulas come with the installed program and use only a few functions.
        value = eval(formula, self._helpers, self) if isinstance(formula, str) else known.get("default_value")
        self[name] = value
        return value


def _flatten_settings(settings: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for name, known in settings.items():
        yield name, known
        yield from _flatten_settings(known.get("children", {}))


def _format_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def cura_settings(profile: Profile) -> dict[str, object]:
    """Return the settings (name -> value), without layer heights, which the caller sets.

    A setting that both programs have gets our value; a setting that only Cura has keeps its default. Shells are given
    in mm, but the engine counts layers of the nominal height.
    """
    return _machine(profile) | _shape(profile) | _speeds(profile)


def _machine(profile: Profile) -> dict[str, object]:
    printer, material = profile.printer, profile.material
    return {
        "machine_width": printer.bed_x,
        "machine_depth": printer.bed_y,
        "machine_height": printer.bed_z,
        "machine_center_is_zero": printer.origin == "centre",
        "machine_heated_bed": True,
        "machine_nozzle_size": printer.nozzle_diameter,
        "machine_start_gcode": "G28",  # priming and presenting the part are not compared
        "machine_end_gcode": "M84",
        "material_diameter": material.filament_diameter,
        "material_flow": 100 * material.flow_ratio,
        "material_print_temperature": material.nozzle_temperature,
        "material_print_temperature_layer_0": material.first_layer_nozzle_temperature,
        "material_bed_temperature": material.bed_temperature,
        "material_bed_temperature_layer_0": material.first_layer_bed_temperature,
        "retraction_amount": printer.retract_length,
        "retraction_retract_speed": printer.retract_speed,
        "retraction_prime_speed": printer.deretract_speed,
        "retraction_min_travel": printer.retract_before_travel,
        "retraction_hop_enabled": printer.z_hop > 0,
        "retraction_hop": printer.z_hop,
        "cool_min_layer_time": material.min_layer_time,
        "cool_min_speed": material.min_speed,
    }


def _shape(profile: Profile) -> dict[str, object]:
    quality, width = profile.quality, profile.extrusion_width
    return {
        "line_width": width,
        "wall_line_count": quality.perimeters,
        "outer_inset_first": quality.external_perimeter_first,
        "top_thickness": quality.top_thickness,
        "bottom_thickness": quality.bottom_thickness,
        "min_infill_area": quality.solid_infill_below_area,
        "infill_sparse_density": 100 * quality.infill_density,
        "infill_pattern": {"rectilinear": "lines"}.get(quality.infill, quality.infill),
        "adhesion_type": "brim" if quality.brim_width else "skirt" if quality.skirt_loops else "none",
        "brim_width": quality.brim_width,
        "skirt_line_count": quality.skirt_loops,
        "skirt_gap": quality.skirt_distance,
        "skirt_brim_minimal_length": 0,
        "meshfix_maximum_deviation": quality.resolution,
    }


def _speeds(profile: Profile) -> dict[str, object]:
    speeds = profile.speeds
    return {
        "speed_wall_0": speeds.external_perimeter,
        "speed_wall_x": speeds.perimeter,
        "speed_infill": speeds.internal_infill,
        "speed_topbottom": speeds.solid_infill,
        "speed_roofing": speeds.top_solid_infill,
        "speed_print": speeds.internal_infill,
        "speed_layer_0": speeds.first_layer,
        "speed_travel": speeds.travel,
        "speed_travel_layer_0": speeds.travel,
        "speed_slowdown_layers": 1,
    }
