"""A program as the text of a file: header, start, moves with the comments that previewers read, end, settings."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Final

import numpy as np

from printer_slicer.gcode.dialect import Dialect, number
from printer_slicer.gcode.placeholders import fill_in, values
from printer_slicer.gcode.rows import rows_of
from printer_slicer.model import Fan, Float, Program, Role
from printer_slicer.profile import Profile, settings_text

__all__ = ["spoken", "write_program"]

# The names that PrusaSlicer's and OrcaSlicer's viewers know.
TYPE_NAMES: Final = {
    Role.SKIRT: "Skirt/Brim",
    Role.BRIM: "Skirt/Brim",
    Role.RAFT: "Support material",
    Role.INNER_PERIMETER: "Perimeter",
    Role.OUTER_PERIMETER: "External perimeter",
    Role.OVERHANG_PERIMETER: "Overhang perimeter",
    Role.BRIDGE: "Bridge infill",
    Role.INTERNAL_BRIDGE: "Bridge infill",
    Role.BOTTOM_SKIN: "Solid infill",
    Role.SOLID: "Solid infill",
    Role.TOP_SKIN: "Top solid infill",
    Role.IRONING: "Ironing",
    Role.SPARSE: "Internal infill",
}


def write_program(
    program: Program, profile: Profile, dialect: Dialect, seconds: float | None, facts: Sequence[str] = ()
) -> bytes:
    """The whole file; nothing in it depends on when or where it was made."""
    known = values(program, profile)
    start = fill_in(profile.printer.start_gcode, known, f"printer {profile.printer.name!r}: start_gcode")
    end = fill_in(profile.printer.end_gcode, known, f"printer {profile.printer.name!r}: end_gcode")
    relative = profile.printer.relative_extrusion
    before = [
        *_header(program, profile, seconds),
        *(f"; {fact}" for fact in facts),
        "G21 ; mm",
        "G90",
        "M83",
        dialect.fan(0.0),
    ]
    before += [*dialect.limits(profile.printer), *start]
    before += ["G90", "M83" if relative else "M82", "G92 E0"]
    after = [*end, *_settings(profile)]
    return b"".join([_lines(before), *_body(program, dialect, relative=relative), _lines(after)])


def _lines(lines: list[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode("ascii", "replace")


def _body(program: Program, dialect: Dialect, *, relative: bool) -> list[bytes]:
    """The rows of the moves with comments and events between them."""
    rows = rows_of(program, relative=relative)
    notes = _notes(program, dialect)
    pieces, done = [], 0
    for index in sorted(notes):
        place = int(rows.start[index])
        pieces += [rows.text[done:place], _lines(notes[index])]
        done = place
    return [*pieces, rows.text[done:]]


def _notes(program: Program, dialect: Dialect) -> dict[int, list[str]]:
    """What stands before which move: layer changes first, then events, then role and width of the bead."""
    notes: dict[int, list[str]] = {}
    plan = program.plan
    height = _layer_heights(program)
    for move in np.flatnonzero(np.diff(program.layer, prepend=-1) > 0).tolist():
        layer = int(program.layer[move])
        notes[move] = [
            ";LAYER_CHANGE",
            f";Z:{number(float(plan.top[layer]))}",
            f";HEIGHT:{number(float(height[layer]))}",
        ]
    for event in program.events:
        lines = notes.setdefault(event.index, [])
        if isinstance(event, Fan):
            lines.append(dialect.fan(event.ratio))
        else:
            lines += [dialect.nozzle(event.nozzle)] if event.nozzle is not None else []
            lines += [dialect.bed(event.bed)] if event.bed is not None else []
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    role, width, thick = program.role[beads], program.width[beads], program.height[beads]
    new_role = np.diff(role, prepend=-1) != 0
    new_width = np.diff(width, prepend=-1.0) != 0
    of_layer = program.layer[beads]
    usual = np.where(np.diff(of_layer, prepend=-1) > 0, height[of_layer], np.append(0.0, thick[:-1]))
    new_height = thick != usual  # a new layer has told its own
    for i in np.flatnonzero(new_role | new_width | new_height).tolist():
        lines = notes.setdefault(int(beads[i]), [])
        lines += [f";HEIGHT:{number(float(thick[i]))}"] if new_height[i] else []
        lines += [f";TYPE:{TYPE_NAMES[Role(int(role[i]))]}"] if new_role[i] else []
        lines += [f";WIDTH:{number(float(width[i]))}"] if new_width[i] else []
    return notes


def _layer_heights(program: Program) -> Float:
    """(L,) how high the first bead of each layer is: over the air of a raft less than the layer."""
    height = program.plan.height
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    layer, first = np.unique(program.layer[beads], return_index=True)
    height[layer] = program.height[beads[first]]
    return height


def _header(program: Program, profile: Profile, seconds: float | None) -> list[str]:
    """What people and print servers look for at the top."""
    material = profile.material
    used = program.filament_used
    volume = used * pi * material.filament_diameter**2 / 4
    lines = ["; generated by printer_slicer"]
    if seconds is not None:
        lines.append(f"; estimated printing time (normal mode) = {spoken(seconds)}")
    return [
        *lines,
        f"; filament used [mm] = {used:.2f}",
        f"; filament used [cm3] = {volume / 1000:.3f}",
        f"; filament used [g] = {volume / 1000 * material.density:.2f}",
        f"; layers = {program.plan.n_layers}",
        f"; planner = {program.plan.planner}",
    ]


def _settings(profile: Profile) -> list[str]:
    """All settings, so that the file tells how it was made."""
    lines = ["; settings"]
    for key, value in settings_text(profile):
        text = str(value).replace("\n", "\\n") if isinstance(value, str) else str(value)
        lines.append(f"; {key} = {text}")
    return lines


def spoken(seconds: float) -> str:
    """A duration as `1d 2h 3m 4s`, without leading zeros."""
    total = round(seconds)
    parts = [(total // 86400, "d"), (total // 3600 % 24, "h"), (total // 60 % 60, "m"), (total % 60, "s")]
    while len(parts) > 1 and parts[0][0] == 0:
        parts.pop(0)
    return " ".join(f"{count}{unit}" for count, unit in parts)
