"""Start and end G-code: {names} filled in."""

from __future__ import annotations

import re
from difflib import get_close_matches

import numpy as np

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.dialect import number
from printer_slicer.model import Program, Role
from printer_slicer.profile import Profile, settings_text

__all__ = ["fill_in", "values"]

_NAME = re.compile(r"\{([^{}\n]*)\}")


def values(program: Program, profile: Profile) -> dict[str, str]:
    """What can stand between braces: settings of printer, material and quality, and facts about the part."""
    known: dict[str, str] = {}
    for key, value in settings_text(profile):
        owner, _, name = key.partition(".")
        if name.endswith("_gcode"):
            continue
        text = (
            number(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
        )
        known[key] = text
        if name != "name":
            known.setdefault(name, text)
        else:
            known[f"{owner}_name"] = text
    printer = profile.printer
    (left, _), (right, back) = printer.corners
    first = (program.role != Role.TRAVEL) & (program.layer == 0)
    beads = np.concatenate([program.start[first], program.xyz[first]])[:, :2]
    low, high = (beads.min(axis=0), beads.max(axis=0)) if len(beads) else (np.zeros(2), np.zeros(2))
    facts = {
        "bed_x_middle": (left + right) / 2,
        "bed_y_end": back - 5,
        "first_layer_min_x": low[0],
        "first_layer_min_y": low[1],
        "first_layer_max_x": high[0],
        "first_layer_max_y": high[1],
        "layer_count": program.plan.n_layers,
        "part_height": program.plan.top[-1],
        "filament_used": program.filament_used,
    }
    return known | {name: number(float(value)) for name, value in facts.items()}


def fill_in(text: str, known: dict[str, str], place: str) -> list[str]:
    """The lines of a macro with its placeholders filled in.

    Raises:
        ProfileError: a name that is not known; `place` says which setting holds the macro.
    """

    def one(match: re.Match[str]) -> str:
        """What stands for one placeholder."""
        name = match.group(1).strip()
        if name in known:
            return known[name]
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean {{{near[0]}}}?" if near else f"known: {', '.join(sorted(known))}"
        raise ProfileError(f"{place}: unknown placeholder {{{name}}}", remedy=hint)

    filled = _NAME.sub(one, text)
    if "{" in filled or "}" in filled:
        line = next(line for line in filled.splitlines() if "{" in line or "}" in line)
        raise ProfileError(f"{place}: a brace without its partner: {line.strip()}", remedy="write {name}")
    return filled.strip("\n").splitlines()
