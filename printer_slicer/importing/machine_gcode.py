"""A machine's own G-code: start, end, layers, pause."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import ceil, hypot
from typing import Final

from printer_slicer.importing.beds import Bed
from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.macros import translated
from printer_slicer.importing.translation import Translator
from printer_slicer.importing.vocabulary import kind_of_setting

__all__ = ["put_macros"]

_MACROS: Final = {
    "start_gcode": "start_gcode",
    "end_gcode": "end_gcode",
    "before_layer_gcode": "before_layer_gcode",
    "layer_gcode": "layer_gcode",
    "pause_print_gcode": "pause_gcode",
}
_FARTHEST: Final = 100.0  # mm that a machine's own G-code may lead beside its bed


def put_macros(made: Conversion, bed: Bed) -> None:
    """Start, end, layers, pause; what the source heats on its own account; what they show of the machine.

    Args:
        made: of a printer, with its flavour.
        bed: where it is.
    """
    preset = made.preset
    known = dict(preset.defaults) | {
        name: entry.text for name, entry in preset.entries.items() if kind_of_setting(name) == "printer"
    }
    for theirs, ours in _MACROS.items():
        made.used.add(theirs)
        text = preset.text(theirs)
        if not text.strip():
            continue
        translator = Translator(
            known, preset.dialect, "start" not in theirs and "end" not in theirs, (bed.low, bed.high)
        )
        macro = translated(text, translator, preset.where(theirs), square=preset.dialect != "cura")
        made.notes += macro.notes
        kept = sum("kept as" in note.text for note in macro.notes)
        made.put(ours, macro.text, theirs, f"{kept} lines or blocks kept as comments" if kept else "")
    _heating(made)
    _seen_in_macros(made, bed)


def _seen_in_macros(made: Conversion, bed: Bed) -> None:
    """What the machine's own G-code shows of it: how far it reaches beside its bed, and whether it has a probe."""
    lines = [
        line for name in ("start_gcode", "end_gcode") for line in str(made.values.get(name, "")).splitlines()
    ]
    far = _farthest(lines, bed)
    if far > _FARTHEST:
        made.warn(
            "start_gcode", f"goes {far:g} mm beside the bed: look whether bed and G-code are of one machine"
        )
    elif far:
        made.put("reach", far, how="not in the source: as far as its start and end G-code go")
    if any(re.match(r"(G29|G80)\b", line) for line in lines):
        made.put("probe", True, how="not in the source: its start G-code measures the bed")


def _farthest(lines: Sequence[str], bed: Bed) -> float:
    """How far beside the bed these lines go, mm; of arcs the whole circle."""
    far, absolute = 0.0, True
    at = [0.0, 0.0]
    for line in lines:
        words = line.partition(";")[0].upper().split()
        if words and words[0] in ("G90", "G91"):
            absolute = words[0] == "G90"
        if not words or not absolute or not re.fullmatch(r"G0?[0-3]", words[0]):
            continue
        said = {
            word[0]: float(word[1:]) for word in words[1:] if re.fullmatch(r"[XYIJ]-?(\d+\.?\d*|\.\d+)", word)
        }
        round_about = [at[0] + said.get("I", 0.0), at[1] + said.get("J", 0.0)]
        radius = hypot(said.get("I", 0.0), said.get("J", 0.0))
        at = [said.get(letter, old) for letter, old in zip("XY", at, strict=True)]
        for axis, letter in enumerate("XY"):
            ends = [at[axis]] if letter in said else []
            ends += [round_about[axis] - radius, round_about[axis] + radius] if radius else []
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
    commands = [line.partition(";")[0].strip().upper() for line in start.splitlines()]
    bed = any(re.match(r"(M140|M190)\b", line) for line in commands)
    nozzle = any(re.match(r"(M104|M109)\b", line) for line in commands)
    if bed and nozzle:
        return
    before = ["M140 S{first_layer_bed_temperature}"] if not bed else []
    before += ["M104 S{first_layer_nozzle_temperature}"] if not nozzle else []
    before += ["M190 S{first_layer_bed_temperature}"] if not bed else []
    after = [] if nozzle else ["M109 S{first_layer_nozzle_temperature}"]
    if made.preset.dialect == "cura":  # which waits for both first
        before, after = [*before, *after], []
    made.put(
        "start_gcode",
        "\n".join([*before, start.strip("\n"), *after]) + "\n",
        "start_gcode",
        f"{', '.join([*before, *after])} added, as the source's slicer does",
    )
