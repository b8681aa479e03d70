"""Settings of other slicers as values of expressions, and conditions on them: which presets suit which printer."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Final

from printer_slicer.importing.ini import split_texts, unescaped
from printer_slicer.importing.presets import number_in
from printer_slicer.importing.vocabulary import ABOUT_FILES
from printer_slicer.macros import Items, MacroFault, Value, evaluate, is_true, parse_expression

__all__ = ["SettingValues", "holds", "setting_value"]

_TOOLS: Final = ("initial_tool", "initial_extruder", "current_extruder")
_SWITCHES: Final = ("silent_mode", "variable_layer_height", "gcode_comments", "gcode_label_objects")


def holds(condition: str, known: Mapping[str, str]) -> bool | None:
    """Whether a condition holds for these settings; None where that cannot be said.

    Args:
        condition: as `compatible_printers_condition` has it.
        known: settings as written.
    """
    with suppress(MacroFault):
        return is_true(parse_expression(condition), SettingValues(known))
    return None


def setting_value(name: str, known: Mapping[str, str]) -> Value:
    """The value of a setting, of several the first.

    Raises:
        Fault: the settings do not hold it.
    """
    return evaluate(parse_expression(name), SettingValues(known))


class SettingValues(Mapping[str, Value]):
    """The values of settings as written; percentages, which hang on others, are none."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = texts

    def __getitem__(self, name: str) -> Value:
        """The value of a setting."""
        if name in _TOOLS:
            return 0
        if name == "num_extruders":
            return len(self._texts.get("nozzle_diameter", "0").split(","))
        text = self._texts[name]
        is_text = ABOUT_FILES.fullmatch(name) and name not in _SWITCHES
        if is_text or name.endswith("_gcode"):
            return unescaped(text)
        items = text.split(",") if ";" not in text else split_texts(text)
        return Items(_item(word.strip().strip('"'), name) for word in items)

    def __contains__(self, name: object) -> bool:
        """Whether it is there and no percentage."""
        try:
            return isinstance(name, str) and self[name] is not None
        except KeyError:
            return False

    def __iter__(self) -> Iterator[str]:
        """The names of settings."""
        return iter(self._texts)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._texts)


def _item(word: str, name: str) -> float | str:
    """A word as a number where it is one."""
    found = number_in(word)
    if found is None:
        return word
    if found.percent:
        raise KeyError(name)
    return int(word) if re.fullmatch(r"-?\d{1,15}", word) else found.value
