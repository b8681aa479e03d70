"""What must hold before a profile is written: bounds, heat, sense."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.commands import TABLE
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.report import Imported
from printer_slicer.macros import read_template
from printer_slicer.profile.faults import find_value_fault

__all__ = ["CEILINGS", "Ceilings", "check_safe"]

_MACHINE: Final = "look at the value in the other slicer: no machine should be driven by it"


_MACROS: Final = ("start_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode", "end_gcode")
_HEATERS: Final = {
    code.decode(): row.heater for code, row in TABLE.items() if row.heater in {"nozzle", "bed"}
}
_HEATING: Final = re.compile(rf"(?i)(?<![A-Z0-9])({'|'.join(_HEATERS)})(?!\d)([^{{\n]*)")
_NUMBER: Final = re.compile(r"(?i)[RS] *(\d+\.?\d*|\.\d+)")


class Ceilings(NamedTuple):
    """The greatest temperatures that an import lets through, °C."""

    nozzle: float = 300.0
    bed: float = 120.0


CEILINGS: Final = Ceilings()


def check_safe(made: Imported, preset: Preset, ceilings: Ceilings) -> None:
    """Refuse a profile that would not be one of a safe machine.

    Args:
        made: the profile.
        preset: what it was made from, for places.
        ceilings: of temperatures.

    Raises:
        ProfileError: with place, value and remedy.
    """
    fault = find_value_fault(made.kind, made.values)
    if fault:
        key, problem = fault
        raise ProfileError(f"{_where(made, preset, key)}: {problem}{_given(made, key)}", remedy=_MACHINE)
    if made.kind == "printer":
        _check_machine(made, preset)
    for heater, most in zip(("nozzle", "bed"), ceilings, strict=True):
        for key in (
            f"first_layer_{heater}_temperature",
            f"{heater}_temperature",
            f"max_{heater}_temperature",
        ):
            wanted = made.values.get(key, 0.0)
            if wanted > most:
                raise ProfileError(
                    f"{_where(made, preset, key)}: {wanted:g} °C, but an import lets {heater}s go up to {most:g} °C",
                    remedy=f"if your machine stands it: --max-{heater}-temperature {wanted:g}",
                )
    _check_macros(made, preset, ceilings)


def _check_macros(made: Imported, preset: Preset, ceilings: Ceilings) -> None:
    """Commands that heat to a number over the ceilings, in any branch of a macro."""
    for name in _MACROS:
        for line in _lines(str(made.values.get(name, ""))):
            for code, letters in _HEATING.findall(line.partition(";")[0]):
                heater, most = _HEATERS[code.upper()], getattr(ceilings, str(_HEATERS[code.upper()]))
                wanted = max((float(one) for one in _NUMBER.findall(letters)), default=0.0)
                if wanted > most:
                    raise ProfileError(
                        f"{_where(made, preset, name)}: {line.strip()[:60]}: an import lets {heater}s go up to "
                        f"{most:g} °C",
                        remedy=f"if your machine stands it: --max-{heater}-temperature {wanted:g}",
                    )


def _lines(macro: str) -> list[str]:
    """The lines of all branches of a macro, with values that hang on nothing; as written where it cannot be read."""
    try:
        return [*read_template(macro, "").possible_lines({}), *macro.splitlines()]
    except ProfileError:
        return macro.splitlines()


def _check_machine(made: Imported, preset: Preset) -> None:
    values = made.values
    if values["max_layer"] > values["nozzle_diameter"]:
        raise ProfileError(
            f"{_where(made, preset, 'max_layer')}: layers of {values['max_layer']:g} mm from a nozzle of "
            f"{values['nozzle_diameter']:g} mm",
            remedy="at most eight tenths of the nozzle can be pressed flat: lower it in the other slicer",
        )


def _where(made: Imported, preset: Preset, key: str) -> str:
    """Where the source says what became a setting."""
    for taken in made.taken:
        if taken.ours == key or taken.ours.startswith(f"{key}."):
            if not taken.theirs:
                break
            entry = next((one for one in preset.entries.values() if one.name == taken.theirs), None)
            return f"{entry.place if entry else preset.place}: {taken.theirs} ({made.kind}.{key})"
    return f"{preset.place}: {made.kind}.{key}"


def _given(made: Imported, key: str) -> str:
    found = made.values
    for part in key.split("."):
        if not isinstance(found, dict) or part not in found:
            return ""
        found = found[part]
    return f"; it is {found!r}" if not isinstance(found, dict) else ""
