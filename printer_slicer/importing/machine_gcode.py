"""Convert a machine's start, end, layer and pause G-code, without changing it.

If the G-code uses settings of the source that do not exist here, they are defined as variables before it:
`{local z_offset = 0.1}`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from math import ceil, hypot
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.commands import find_heater
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.gcode.state import MachineState
from printer_slicer.importing.bed_shapes import BedRectangle
from printer_slicer.importing.conditions import SettingValues
from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.prusaslicer_names import find_setting_kind
from printer_slicer.macros import (
    UnknownName,
    Value,
    escape_braces,
    format_literal,
    get_placeholder_names,
    read_template,
)
from printer_slicer.profile.tables import list_setting_definitions

__all__ = ["convert_macros"]

_MACROS: Final = {
    "start_gcode": "start_gcode",
    "end_gcode": "end_gcode",
    "before_layer_gcode": "before_layer_gcode",
    "layer_gcode": "layer_gcode",
    "pause_print_gcode": "pause_gcode",
}
_STOPS_SLICING: Final = "slicing will stop at it with an error; replace it"
_CURA_SYNTAX: Final = re.compile(r"\{\s*(\w+)\s*,\s*(\w+)\s*\}|\{[^{}]*\}|\[", re.ASCII)
_PLACEHOLDER: Final = re.compile(r"\S*(?:\{[^}]*\}|\[[^\]]*\])\S*")
_MAX_REACH: Final = 100.0  # mm: distance that G-code may move beyond the bed without a warning


def convert_macros(conversion: Conversion, bed: BedRectangle) -> None:
    """Convert the G-code, add missing heating commands, and set `reach` and `probe` from it.

    Args:
        conversion: conversion of a printer, with its flavour.
        bed: the bed.
    """
    preset = conversion.preset
    known = SettingValues(
        dict(preset.defaults)
        | {name: entry.text for name, entry in preset.entries.items() if find_setting_kind(name) == "printer"}
    )
    for theirs, ours in _MACROS.items():
        conversion.used.add(theirs)
        text = preset.read_text(theirs).replace("\x00", "")
        if not text.strip():
            continue
        text = _convert_cura_macro(text) if preset.dialect == "cura" else text
        variables = _define_variables(conversion, theirs, text, known)
        how = f"with the variables {variables.strip()}" if variables else ""
        conversion.put(ours, variables + text, theirs, how)
    _add_heating_commands(conversion)
    _set_reach_and_probe(conversion, bed)


def _convert_cura_macro(text: str) -> str:
    """Convert a macro of Cura, in which `[` is an ordinary character and `{name, extruder}` a value of one extruder."""
    return _CURA_SYNTAX.sub(
        lambda one: (
            f"{{{one[1]}[{one[2]}]}}" if one[1] else escape_braces(one[0]) if one[0] == "[" else one[0]
        ),
        text,
    )


@cache
def _list_setting_names() -> frozenset[str]:
    """Return the names of our settings, with and without their section."""
    keys = [row.key for row in list_setting_definitions() if not row.key.endswith(("_gcode", ".name"))]
    return frozenset(keys) | {key.partition(".")[2] for key in keys}


def _define_variables(conversion: Conversion, theirs: str, text: str, known: Mapping[str, Value]) -> str:
    """Return a line that defines the settings of the source that a macro uses; warn about unknown names."""
    place = conversion.preset.format_place(theirs)
    try:
        template = read_template(text, place)
    except ProfileError as error:
        problem = str(error.args[0]).removeprefix(f"{place}: ").splitlines()[0]
        conversion.warn(theirs, f"{problem}: {_STOPS_SLICING}")
        return ""
    wanted: dict[str, str] = {}
    unknown: dict[str, str] = {}
    for fault in template.find_faults(get_placeholder_names(_MACROS[theirs], _list_setting_names())):
        name = fault.name if isinstance(fault, UnknownName) else ""
        if name in known:
            wanted[name] = format_literal(known[name])
        else:
            unknown.setdefault(
                fault.problem, f"line {template.line_of(fault)}: {fault.problem}: {_STOPS_SLICING}"
            )
    for note in unknown.values():
        conversion.warn(theirs, note)
    return f"{{{'; '.join(f'local {name} = {value}' for name, value in wanted.items())}}}\n" if wanted else ""


def _set_reach_and_probe(conversion: Conversion, bed: BedRectangle) -> None:
    """Set `reach` if the start or end G-code moves beyond the bed, and `probe` if it uses a probe."""
    shape = {"min": bed.low, "max": bed.high, "size": (bed.high[0] - bed.low[0], bed.high[1] - bed.low[1])}
    known: dict[str, Value] = {f"print_bed_{name}": values for name, values in shape.items()}
    lines = []
    for name in ("start_gcode", "end_gcode"):
        with suppress(ProfileError):  # already reported
            macro = read_template(str(conversion.values.get(name, "")), name)
            lines += macro.list_possible_lines(known, unknown="?")
    far = _measure_reach(lines, bed)
    if far > _MAX_REACH:
        conversion.warn(
            "start_gcode",
            f"moves {far:g} mm beyond the bed: check that bed and G-code belong to the same machine",
        )
    elif far:
        conversion.put(
            "reach",
            far,
            how="not in the source: the distance that its start and end G-code moves beyond the bed",
        )
    if any(parse(line.encode())[0] in {b"G29", b"G80"} for line in lines):
        conversion.put("probe", True, how="not in the source: its start G-code measures the bed")


def _measure_reach(lines: Sequence[str], bed: BedRectangle) -> float:
    """Return the distance that lines of G-code move beyond the bed, mm; arcs count as full circles."""
    far, machine = 0.0, MachineState()
    for line in lines:
        command = strip(_PLACEHOLDER.sub("", line).encode())
        word, values = parse(command)
        before, unit = machine.position, machine.unit
        if machine.apply(word, values, command) is None or machine.counting.has_relative_axes:
            continue
        centre_offset = {b"X": values.get(b"I", 0.0) * unit, b"Y": values.get(b"J", 0.0) * unit}
        radius = hypot(*centre_offset.values())
        for axis, letter in enumerate(centre_offset):
            ends = [machine.position[axis] or 0.0] if letter in values else []
            centre = (before[axis] or 0.0) + centre_offset[letter]
            ends += [centre - radius, centre + radius] if radius else []
            far = max(far, *(max(bed.low[axis] - end, end - bed.high[axis]) for end in ends), 0.0)
    return ceil(far * 10) / 10


def _add_heating_commands(conversion: Conversion) -> None:
    """Add the heating commands that the other slicer adds to start G-code without them."""
    if conversion.preset.has("autoemit_temperature_commands") and not conversion.preset.is_on(
        "autoemit_temperature_commands"
    ):
        conversion.mark_used(["autoemit_temperature_commands"])
        return
    start = str(conversion.values.get("start_gcode", ""))
    heated = {find_heater(parse(strip(line.encode()))[0].decode()) for line in start.splitlines()}
    bed, nozzle = "bed" in heated, "nozzle" in heated
    if bed and nozzle:
        return
    before = ["M140 S{first_layer_bed_temperature[0]}"] if not bed else []
    before += ["M104 S{first_layer_temperature[0]}"] if not nozzle else []
    before += ["M190 S{first_layer_bed_temperature[0]}"] if not bed else []
    after = [] if nozzle else ["M109 S{first_layer_temperature[0]}"]
    if conversion.preset.dialect == "cura":  # Cura waits for both before the start G-code
        before, after = [*before, *after], []
    conversion.put(
        "start_gcode",
        "\n".join([*before, start.strip("\n"), *after]) + "\n",
        "start_gcode",
        f"{', '.join([*before, *after])} added, as the other slicer does",
    )
