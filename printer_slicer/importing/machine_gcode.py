"""Convert a machine's start, end, layer and pause G-code, without changing it.

Settings of the source that it uses and that do not exist here become variables in front: `{local z_offset = 0.1}`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from math import ceil, hypot
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.commands import heater_of
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.gcode.state import MachineState
from printer_slicer.importing.bed_shapes import BedRectangle
from printer_slicer.importing.conditions import SettingValues
from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.prusaslicer_names import setting_kind
from printer_slicer.macros import UnknownName, Value, escape_braces, known_names, literal, read_template
from printer_slicer.profile.tables import settings_table

__all__ = ["convert_macros"]

_MACROS: Final = {
    "start_gcode": "start_gcode",
    "end_gcode": "end_gcode",
    "before_layer_gcode": "before_layer_gcode",
    "layer_gcode": "layer_gcode",
    "pause_print_gcode": "pause_gcode",
}
_STOPS: Final = "slicing stops there with an error; replace it"
_CURA: Final = re.compile(r"\{\s*(\w+)\s*,\s*(\w+)\s*\}|\{[^{}]*\}|\[", re.ASCII)
_PLACEHOLDER: Final = re.compile(r"\S*(?:\{[^}]*\}|\[[^\]]*\])\S*")
_FARTHEST: Final = 100.0  # mm: how far G-code may move beyond the bed without a warning


def convert_macros(made: Conversion, bed: BedRectangle) -> None:
    """Convert the G-code, add missing heating commands, and set `reach` and `probe` from it.

    Args:
        made: conversion of a printer, with its flavour.
        bed: the bed.
    """
    preset = made.preset
    known = SettingValues(
        dict(preset.defaults)
        | {name: entry.text for name, entry in preset.entries.items() if setting_kind(name) == "printer"}
    )
    for theirs, ours in _MACROS.items():
        made.used.add(theirs)
        text = preset.text(theirs).replace("\x00", "")
        if not text.strip():
            continue
        text = _convert_cura_macro(text) if preset.dialect == "cura" else text
        variables = _variables(made, theirs, text, known)
        how = f"after {variables.strip()}" if variables else ""
        made.put(ours, variables + text, theirs, how)
    _heating(made)
    _reach_and_probe(made, bed)


def _convert_cura_macro(text: str) -> str:
    """Convert a macro of Cura, where `[` is an ordinary character and `{name, extruder}` a value of an extruder."""
    return _CURA.sub(
        lambda one: (
            f"{{{one[1]}[{one[2]}]}}" if one[1] else escape_braces(one[0]) if one[0] == "[" else one[0]
        ),
        text,
    )


@cache
def _setting_names() -> frozenset[str]:
    """Return the names of our settings, with and without their section."""
    keys = [row.key for row in settings_table() if not row.key.endswith(("_gcode", ".name"))]
    return frozenset(keys) | {key.partition(".")[2] for key in keys}


def _variables(made: Conversion, theirs: str, text: str, known: Mapping[str, Value]) -> str:
    """Return a line that defines the source's settings in a macro; warn about unknown names."""
    place = made.preset.where(theirs)
    try:
        template = read_template(text, place)
    except ProfileError as error:
        problem = str(error.args[0]).removeprefix(f"{place}: ").splitlines()[0]
        made.warn(theirs, f"{problem}: {_STOPS}")
        return ""
    wanted: dict[str, str] = {}
    unknown: dict[str, str] = {}
    for fault in template.faults(known_names(_MACROS[theirs], _setting_names())):
        name = fault.name if isinstance(fault, UnknownName) else ""
        if name in known:
            wanted[name] = literal(known[name])
        else:
            unknown.setdefault(fault.problem, f"line {template.line_of(fault)}: {fault.problem}: {_STOPS}")
    for note in unknown.values():
        made.warn(theirs, note)
    return f"{{{'; '.join(f'local {name} = {value}' for name, value in wanted.items())}}}\n" if wanted else ""


def _reach_and_probe(made: Conversion, bed: BedRectangle) -> None:
    """Find how far the start and end G-code moves beyond the bed, and whether it uses a probe."""
    shape = {"min": bed.low, "max": bed.high, "size": (bed.high[0] - bed.low[0], bed.high[1] - bed.low[1])}
    known: dict[str, Value] = {f"print_bed_{name}": values for name, values in shape.items()}
    lines = []
    for name in ("start_gcode", "end_gcode"):
        with suppress(ProfileError):  # already reported
            macro = read_template(str(made.values.get(name, "")), name)
            lines += macro.possible_lines(known, unknown="?")
    far = _reach_beyond_bed(lines, bed)
    if far > _FARTHEST:
        made.warn(
            "start_gcode",
            f"moves {far:g} mm beyond the bed: check that bed and G-code are of the same machine",
        )
    elif far:
        made.put("reach", far, how="not in the source: as far as its start and end G-code moves")
    if any(parse(line.encode())[0] in {b"G29", b"G80"} for line in lines):
        made.put("probe", True, how="not in the source: its start G-code measures the bed")


def _reach_beyond_bed(lines: Sequence[str], bed: BedRectangle) -> float:
    """Return how far lines of G-code move beyond the bed, mm; arcs count as whole circles."""
    far, machine = 0.0, MachineState()
    for line in lines:
        command = strip(_PLACEHOLDER.sub("", line).encode())
        word, values = parse(command)
        before, unit = machine.position, machine.unit
        if machine.apply(word, values, command) is None or machine.counting.axes:
            continue
        arm = {b"X": values.get(b"I", 0.0) * unit, b"Y": values.get(b"J", 0.0) * unit}
        radius = hypot(*arm.values())
        for axis, letter in enumerate(arm):
            ends = [machine.position[axis] or 0.0] if letter in values else []
            centre = (before[axis] or 0.0) + arm[letter]
            ends += [centre - radius, centre + radius] if radius else []
            far = max(far, *(max(bed.low[axis] - end, end - bed.high[axis]) for end in ends), 0.0)
    return ceil(far * 10) / 10


def _heating(made: Conversion) -> None:
    """Add the heating commands that the source adds to start G-code without them."""
    if made.preset.has("autoemit_temperature_commands") and not made.preset.is_on(
        "autoemit_temperature_commands"
    ):
        made.mark_used(["autoemit_temperature_commands"])
        return
    start = str(made.values.get("start_gcode", ""))
    heated = {heater_of(parse(strip(line.encode()))[0].decode()) for line in start.splitlines()}
    bed, nozzle = "bed" in heated, "nozzle" in heated
    if bed and nozzle:
        return
    before = ["M140 S{first_layer_bed_temperature[0]}"] if not bed else []
    before += ["M104 S{first_layer_temperature[0]}"] if not nozzle else []
    before += ["M190 S{first_layer_bed_temperature[0]}"] if not bed else []
    after = [] if nozzle else ["M109 S{first_layer_temperature[0]}"]
    if made.preset.dialect == "cura":  # Cura waits for both before the start G-code
        before, after = [*before, *after], []
    made.put(
        "start_gcode",
        "\n".join([*before, start.strip("\n"), *after]) + "\n",
        "start_gcode",
        f"{', '.join([*before, *after])} added, as the source's slicer does",
    )
