"""Options of the command line in messages that name arguments of Python functions.

Messages from below the command line name arguments in backticks: `scale=0.5`, `units="inch"`, `drop=False`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

__all__ = ["name_flags"]

_FLAGS: Final[Mapping[str, str]] = {
    "as_placed": "--as-placed",
    "center": "--center",
    "drop=False": "--no-drop",
    "extruders": "--extruders",
    "filament_diameter": "--filament",
    "layer_heights": "--heights",
    "material": "--material",
    "planner.kind": "--planner",
    "printer": "--printer",
    "scale": "--scale",
    "shell": "--shell",
    "strict": "--strict",
    "units": "--units",
}
"""Argument, or argument with its value -> option."""

_ARGUMENT: Final = re.compile(r"`([a-z_.]+)(?:=([^`\n]*))?`")
_ALLOWING: Final = re.compile(r"`job\.allowing\(\[([^`\n]*)\]\)`")


def name_flags(text: str) -> str:
    """Return a message with options in place of the arguments that it names."""
    return _ARGUMENT.sub(_flag, _ALLOWING.sub(_allow, text)) if "`" in text else text


def _flag(found: re.Match[str]) -> str:
    name, value = found.groups()
    if f"{name}={value}" in _FLAGS:
        return _FLAGS[f"{name}={value}"]
    if name not in _FLAGS:
        return found[0]
    return f"{_FLAGS[name]} {value.strip(chr(34))}" if value else _FLAGS[name]


def _allow(found: re.Match[str]) -> str:
    return " ".join(f"--allow {name}" for name in re.findall(r'"(\w+)"', found[1]))
