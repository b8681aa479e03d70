"""Add default speeds and flow limits to an imported printer, taken from its print settings and materials.

Other slicers keep speeds in print settings. Here, a printer has default speeds for qualities that do not set them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from printer_slicer.importing.results import ConvertedSetting, ImportedProfile
from printer_slicer.profile.speeds import PrinterAccelerations, PrinterSpeeds
from printer_slicer.values import replace

__all__ = ["add_printer_defaults"]

_TABLES: Final = {"speeds": PrinterSpeeds, "accelerations": PrinterAccelerations}
_OVERHANGS: Final = ("75", "50", "25")
_PLA: Final = "PLA"


def add_printer_defaults(printer: ImportedProfile, companions: Sequence[ImportedProfile]) -> ImportedProfile:
    """Return a printer with speeds and accelerations of a quality, and with flow and pressure advance of materials.

    The maximum flow of the hotend is the highest of the materials, but only if one of them is PLA: the limits of other
    materials alone are too low.

    Args:
        printer: the printer without these settings.
        companions: materials and qualities that come with the printer, the defaults first.
    """
    quality = next((one for one in companions if one.kind == "quality"), None)
    materials = [one for one in companions if one.kind == "material"]
    taken = [*(_find_speeds(quality) if quality else ()), *_find_flow_limits(materials)]
    values: dict[str, Any] = dict(printer.values)
    for one in taken:
        table, _, leaf = one.ours.rpartition(".")
        target = values.setdefault(table, {}) if table else values
        target[leaf] = one.value
    return replace(printer, values=values, taken=(*printer.taken, *taken))


def _find_speeds(quality: ImportedProfile) -> list[ConvertedSetting]:
    """Return the converted speeds and accelerations of a quality for which printers have a setting."""
    known = {f"{table}.{name}" for table, owner in _TABLES.items() for name in owner.__struct_fields__}
    found = [one for one in quality.taken if one.ours in known]
    speeds = quality.values["speeds"]
    for share in _OVERHANGS:
        ratio = speeds.get(f"overhang_{share}_ratio", 1)
        graded = next((one for one in quality.taken if one.ours == f"speeds.overhang_{share}_ratio"), None)
        if graded and ratio < 1:
            value = round(ratio * speeds["external_perimeter"], 6)
            found.append(replace(graded, ours=f"speeds.overhang_{share}", value=value, how=""))
    return found


def _find_flow_limits(materials: Sequence[ImportedProfile]) -> list[ConvertedSetting]:
    """Return the maximum flow of the materials, and the pressure advance of the first PLA."""
    pla = [one for one in materials if str(one.values.get("type", "")).strip().upper() == _PLA]
    if not pla:
        return []
    found = [one for each in materials for one in each.taken if one.ours == "max_flow" and one.value > 0]
    advance = [one for one in pla[0].taken if one.ours == "pressure_advance" and one.value > 0]
    highest = sorted(found, key=lambda one: float(one.value))[-1:]
    return [
        *(replace(one, ours="hotend_max_flow") for one in highest),
        *(replace(one, ours="pla_pressure_advance") for one in advance),
    ]
