"""Evaluate conditions on settings of other slicers, such as those for compatible printers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Final

from printer_slicer.importing.ini import split_texts, unescape
from printer_slicer.importing.presets import parse_quantity
from printer_slicer.importing.prusaslicer_names import METADATA
from printer_slicer.macros import Items, MacroFault, Value, evaluate, is_true, parse_expression

__all__ = ["SettingValues", "evaluate_condition", "evaluate_setting"]

_TOOL_NUMBERS: Final = ("initial_tool", "initial_extruder", "current_extruder")
_SWITCHES: Final = ("silent_mode", "variable_layer_height", "gcode_comments", "gcode_label_objects")


def evaluate_condition(condition: str, known: Mapping[str, str]) -> bool | None:
    """Return whether settings meet a condition; None if the condition cannot be evaluated.

    Args:
        condition: as in `compatible_printers_condition`.
        known: settings as written in the file.
    """
    with suppress(MacroFault):
        return is_true(parse_expression(condition), SettingValues(known))
    return None


def evaluate_setting(name: str, known: Mapping[str, str]) -> Value:
    """Return the value of a setting; of a list, return the first item.

    Raises:
        MacroFault: the setting is missing.
    """
    return evaluate(parse_expression(name), SettingValues(known))


class SettingValues(Mapping[str, Value]):
    """Values of settings by name, without percentages, because these depend on other settings."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = texts

    def __getitem__(self, name: str) -> Value:
        """Return the value of a setting."""
        if name in _TOOL_NUMBERS:
            return 0
        if name == "num_extruders":
            return len(self._texts.get("nozzle_diameter", "0").split(","))
        text = self._texts[name]
        is_text = METADATA.fullmatch(name) and name not in _SWITCHES
        if is_text or name.endswith("_gcode"):
            return unescape(text)
        items = text.split(",") if ";" not in text else split_texts(text)
        return Items(_parse_item(word.strip().strip('"'), name) for word in items)

    def __contains__(self, name: object) -> bool:
        """Return whether a setting is present and not a percentage."""
        try:
            return isinstance(name, str) and self[name] is not None
        except KeyError:
            return False

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the settings."""
        return iter(self._texts)

    def __len__(self) -> int:
        """Return the number of settings."""
        return len(self._texts)


def _parse_item(word: str, name: str) -> float | str:
    """Convert a word to a number if it is one.

    Raises:
        KeyError: it is a percentage.
    """
    found = parse_quantity(word)
    if found is None:
        return word
    if found.is_percent:
        raise KeyError(name)
    return int(word) if re.fullmatch(r"-?\d{1,15}", word) else found.value
