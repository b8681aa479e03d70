"""A machine's own G-code: start, end, layers, pause. It is kept as it is written.

What it asks of settings that have no counterpart here stands in front of it, as variables: `{local z_offset = 0.1}`.
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
from printer_slicer.importing.beds import Bed
from printer_slicer.importing.conditions import SettingValues
from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.vocabulary import kind_of_setting
from printer_slicer.macros import UnknownName, Value, escape_braces, known_names, literal, read_template
from printer_slicer.profile.tables import settings_table

__all__ = ["put_macros"]

_MACROS: Final = {
    "start_gcode": "start_gcode",
    "end_gcode": "end_gcode",
    "before_layer_gcode": "before_layer_gcode",
    "layer_gcode": "layer_gcode",
    "pause_print_gcode": "pause_gcode",
}
_STOPS: Final = "it is kept as it is, but slicing stops there; write what this machine needs"
_CURA: Final = re.compile(r"\{\s*(\w+)\s*,\s*(\w+)\s*\}|\{[^{}]*\}|\[", re.ASCII)
_PLACEHOLDER: Final = re.compile(r"\S*(?:\{[^}]*\}|\[[^\]]*\])\S*")
_FARTHEST: Final = 100.0  # mm that a machine's own G-code may lead beside its bed


def put_macros(made: Conversion, bed: Bed) -> None:
    """Start, end, layers, pause; what the source heats on its own account; what they show of the machine.

    Args:
        made: of a printer, with its flavour.
        bed: where it is.
    """
    preset = made.preset
    known = SettingValues(
        dict(preset.defaults)
        | {name: entry.text for name, entry in preset.entries.items() if kind_of_setting(name) == "printer"}
    )
    for theirs, ours in _MACROS.items():
        made.used.add(theirs)
        text = preset.text(theirs).replace("\x00", "")
        if not text.strip():
            continue
        text = _from_cura(text) if preset.dialect == "cura" else text
        variables = _variables(made, theirs, text, known)
        how = f"{variables.strip()} in front of it" if variables else ""
        made.put(ours, variables + text, theirs, how)
    _heating(made)
    _seen_in_macros(made, bed)


def _from_cura(text: str) -> str:
    """A macro of Cura's: there `[` stands for itself, and `{name, extruder}` is a value of an extruder."""
    return _CURA.sub(
        lambda one: (
            f"{{{one[1]}[{one[2]}]}}" if one[1] else escape_braces(one[0]) if one[0] == "[" else one[0]
        ),
        text,
    )


@cache
def _settings_names() -> frozenset[str]:
    """Names of settings, with and without the section."""
    keys = [row.key for row in settings_table() if not row.key.endswith(("_gcode", ".name"))]
    return frozenset(keys) | {key.partition(".")[2] for key in keys}


def _variables(made: Conversion, theirs: str, text: str, known: Mapping[str, Value]) -> str:
    """A line with the settings that a macro asks for and that have no name here; what is not known either is told."""
    place = made.preset.where(theirs)
    try:
        template = read_template(text, place)
    except ProfileError as error:
        problem = str(error.args[0]).removeprefix(f"{place}: ").splitlines()[0]
        made.warn(theirs, f"{problem}: {_STOPS}")
        return ""
    wanted: dict[str, str] = {}
    unknown: dict[str, str] = {}
    for fault in template.faults(known_names(_MACROS[theirs], _settings_names())):
        name = fault.name if isinstance(fault, UnknownName) else ""
        if name in known:
            wanted[name] = literal(known[name])
        else:
            unknown.setdefault(fault.problem, f"line {template.line_of(fault)}: {fault.problem}: {_STOPS}")
    for note in unknown.values():
        made.warn(theirs, note)
    return f"{{{'; '.join(f'local {name} = {value}' for name, value in wanted.items())}}}\n" if wanted else ""


def _seen_in_macros(made: Conversion, bed: Bed) -> None:
    """What the machine's own G-code shows of it: how far it reaches beside its bed, and whether it has a probe."""
    shape = {"min": bed.low, "max": bed.high, "size": (bed.high[0] - bed.low[0], bed.high[1] - bed.low[1])}
    known: dict[str, Value] = {f"print_bed_{name}": values for name, values in shape.items()}
    lines = []
    for name in ("start_gcode", "end_gcode"):
        with suppress(ProfileError):  # which has been told
            macro = read_template(str(made.values.get(name, "")), name)
            lines += macro.possible_lines(known, unknown="?")
    far = _farthest(lines, bed)
    if far > _FARTHEST:
        made.warn(
            "start_gcode", f"goes {far:g} mm beside the bed: look whether bed and G-code are of one machine"
        )
    elif far:
        made.put("reach", far, how="not in the source: as far as its start and end G-code go")
    if any(parse(line.encode())[0] in {b"G29", b"G80"} for line in lines):
        made.put("probe", True, how="not in the source: its start G-code measures the bed")


def _farthest(lines: Sequence[str], bed: Bed) -> float:
    """How far beside the bed these lines go, mm; of arcs the whole circle."""
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
    """Commands that the source adds where start G-code does not heat."""
    if made.preset.has("autoemit_temperature_commands") and not made.preset.on(
        "autoemit_temperature_commands"
    ):
        made.skip(["autoemit_temperature_commands"])
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
    if made.preset.dialect == "cura":  # which waits for both first
        before, after = [*before, *after], []
    made.put(
        "start_gcode",
        "\n".join([*before, start.strip("\n"), *after]) + "\n",
        "start_gcode",
        f"{', '.join([*before, *after])} added, as the source's slicer does",
    )
