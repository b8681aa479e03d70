"""Replace arguments of Python functions in messages by options of the command line.

Messages of the library name arguments in backticks: `scale=0.5`, `units="inch"`, `drop=False`. The function
`ps.find_settings()` becomes the command `printer-slicer profiles settings`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

__all__ = ["replace_arguments_by_options"]

_FLAGS: Final[Mapping[str, str]] = {
    "arrange": "--arrange",
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
    "strict_supports": "--strict-supports",
    "units": "--units",
}
"""Argument, or argument with a value -> option."""

_ARGUMENT: Final = re.compile(r"`([a-z_.]+)(?:=([^`\n]*))?`")
_ALLOWING: Final = re.compile(r"`job\.allowing\(\[([^`\n]*)\]\)`")


def replace_arguments_by_options(text: str) -> str:
    """Replace the arguments that a message names in backticks by options of the command line."""
    if "`" not in text:
        return text
    text = text.replace("`ps.find_settings()`", "`printer-slicer profiles settings`")
    return _ARGUMENT.sub(_format_option, _ALLOWING.sub(_format_allow_options, text))


def _format_option(match: re.Match[str]) -> str:
    name, value = match.groups()
    if f"{name}={value}" in _FLAGS:
        return _FLAGS[f"{name}={value}"]
    if name not in _FLAGS:
        return match[0]
    return f"{_FLAGS[name]} {value.strip(chr(34))}" if value else _FLAGS[name]


def _format_allow_options(match: re.Match[str]) -> str:
    return " ".join(f"--allow {name}" for name in re.findall(r'"(\w+)"', match[1]))
