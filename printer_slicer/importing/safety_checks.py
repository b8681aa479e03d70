"""Check imported profiles before they are written: bounds, temperatures and consistency."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.commands import TABLE
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.macros import read_template
from printer_slicer.profile.faults import find_value_fault

__all__ = ["DEFAULT_LIMITS", "TemperatureLimits", "check_safety"]

_REMEDY: Final = "Correct the value in the other slicer"


_MACROS: Final = ("start_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode", "end_gcode")
_HEATERS: Final = {
    code.decode(): row.heater for code, row in TABLE.items() if row.heater in {"nozzle", "bed"}
}
_HEATING: Final = re.compile(rf"(?i)(?<![A-Z0-9])({'|'.join(_HEATERS)})(?!\d)([^{{\n]*)")
_NUMBER: Final = re.compile(r"(?i)[RS] *(\d+\.?\d*|\.\d+)")


class TemperatureLimits(NamedTuple):
    """The highest temperatures that an import accepts, °C."""

    nozzle: float = 300.0
    bed: float = 120.0


DEFAULT_LIMITS: Final = TemperatureLimits()


def check_safety(profile: ImportedProfile, preset: Preset, limits: TemperatureLimits) -> None:
    """Check that a profile is safe for a machine.

    Args:
        profile: the profile.
        preset: its source, for places in messages.
        limits: temperature limits.

    Raises:
        ProfileError: it is not safe; with place, value and remedy.
    """
    fault = find_value_fault(profile.kind, profile.values)
    if fault:
        key, problem = fault
        raise ProfileError(
            f"{_find_place(profile, preset, key)}: {problem}{_describe_value(profile, key)}", remedy=_REMEDY
        )
    if profile.kind == "printer":
        _check_machine(profile, preset)
    for heater, most in zip(("nozzle", "bed"), limits, strict=True):
        for key in (
            f"first_layer_{heater}_temperature",
            f"{heater}_temperature",
            f"max_{heater}_temperature",
        ):
            wanted = profile.values.get(key, 0.0)
            if wanted > most:
                raise ProfileError(
                    f"{_find_place(profile, preset, key)}: {wanted:g} °C is over the {heater} limit of {most:g} °C",
                    remedy=f"If your machine is built for it, use --max-{heater}-temperature {wanted:g}",
                )
    _check_macros(profile, preset, limits)


def _check_macros(profile: ImportedProfile, preset: Preset, limits: TemperatureLimits) -> None:
    """Check the temperatures of heating commands in all branches of the macros."""
    for name in _MACROS:
        for line in _list_macro_lines(str(profile.values.get(name, ""))):
            for code, letters in _HEATING.findall(line.partition(";")[0]):
                heater, most = _HEATERS[code.upper()], getattr(limits, str(_HEATERS[code.upper()]))
                wanted = max((float(one) for one in _NUMBER.findall(letters)), default=0.0)
                if wanted > most:
                    raise ProfileError(
                        f"{_find_place(profile, preset, name)}: {line.strip()[:60]}: over the {heater} limit of "
                        f"{most:g} °C",
                        remedy=f"If your machine is built for it, use --max-{heater}-temperature {wanted:g}",
                    )


def _list_macro_lines(macro: str) -> list[str]:
    """Return the lines of all branches of a macro, and the macro as written."""
    try:
        return [*read_template(macro, "").list_possible_lines({}), *macro.splitlines()]
    except ProfileError:
        return macro.splitlines()


def _check_machine(profile: ImportedProfile, preset: Preset) -> None:
    """Check that the nozzle of a printer can print its maximum layer height."""
    values = profile.values
    if values["max_layer"] > values["nozzle_diameter"]:
        raise ProfileError(
            f"{_find_place(profile, preset, 'max_layer')}: layers of {values['max_layer']:g} mm are too high for a "
            f"nozzle of {values['nozzle_diameter']:g} mm",
            remedy="Lower it in the other slicer to at most 0.8 nozzle diameters",
        )


def _find_place(profile: ImportedProfile, preset: Preset, key: str) -> str:
    """Return the place, in the source, of the setting from which one of our settings was converted."""
    for taken in profile.taken:
        if taken.ours == key or taken.ours.startswith(f"{key}."):
            if not taken.theirs:
                break
            entry = next((one for one in preset.entries.values() if one.name == taken.theirs), None)
            return f"{entry.place if entry else preset.place}: {taken.theirs} ({profile.kind}.{key})"
    return f"{preset.place}: {profile.kind}.{key}"


def _describe_value(profile: ImportedProfile, key: str) -> str:
    """Format the value of a setting as the end of a message; return an empty text for tables."""
    found = profile.values
    for part in key.split("."):
        if not isinstance(found, dict) or part not in found:
            return ""
        found = found[part]
    return f"; it is {found!r}" if not isinstance(found, dict) else ""
