"""Presets of other slicers, with all settings under PrusaSlicer's names."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from math import isfinite
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.ini import SourceSetting, split_texts, unescape
from printer_slicer.importing.percentages import takes_percentage
from printer_slicer.importing.results import ImportNote
from printer_slicer.values import Struct, field

__all__ = ["OFF_WORDS", "ON_WORDS", "ObjectSettings", "Preset", "Quantity", "parse_quantity"]

ON_WORDS: Final = ("1", "true", "yes", "on")
OFF_WORDS: Final = ("0", "false", "no", "off")
_EMPTY_VALUES: Final = ("", "nil", '""')
_COMMENT: Final = re.compile(r"(?<!\s)\s+[#;].*")


class Quantity(Struct, frozen=True):
    """A number or a percentage; the setting determines which value a percentage refers to."""

    value: float
    is_percent: bool = False

    def resolve(self, whole: float) -> float:
        """Return the number; a percentage is taken of `whole`."""
        return self.value / 100 * whole if self.is_percent else self.value


class ObjectSettings(Struct, frozen=True):
    """Settings of one object, or of one height range of an object.

    Attributes:
        object: name of the object or modifier.
        low, high: height range above the bed, mm; both 0: the whole object.
        entries: settings, as in `Preset`.
        is_only_object: whether the project has no other object.
        is_modifier: whether the settings are those of a modifier.
    """

    object: str
    low: float
    high: float
    entries: Mapping[str, SourceSetting]
    is_only_object: bool
    is_modifier: bool = False

    @property
    def place(self) -> str:
        """The object and the height range, as text for messages."""
        return f"{self.object}, z {self.low:g} to {self.high:g}" if self.high else self.object


class Preset(Struct, frozen=True):
    """A printer, material or quality of another slicer.

    Attributes:
        kind: `printer`, `material` or `quality`.
        name: name of the preset.
        dialect: `prusaslicer`, `superslicer`, `slic3r`, `orca` or `cura`; it determines the meaning of percentages
            and words.
        place: file and line where it begins.
        entries: PrusaSlicer's name of a setting -> the setting in the source.
        defaults: values of missing settings.
        mixed: whether the entries include settings of other kinds.
        context: for a material or quality, settings of the printer if it is known; for a printer, those of the quality.
        heights: for a material, heights of the first layer and of the other layers, mm; 0: unknown.
        object_settings: for a quality, settings of single objects and their height ranges.
        notes: warnings.
        typed: PrusaSlicer's names of settings that a user typed; unlike those in files, their values are errors if the
            other slicer would not accept them.
    """

    kind: str
    name: str
    dialect: str
    place: str
    entries: Mapping[str, SourceSetting]
    defaults: Mapping[str, str] = field(default_factory=dict)
    mixed: bool = False
    context: Mapping[str, str] = field(default_factory=dict)
    heights: tuple[float, float] = (0.0, 0.0)
    object_settings: tuple[ObjectSettings, ...] = ()
    notes: tuple[ImportNote, ...] = ()
    typed: frozenset[str] = frozenset()

    def has(self, key: str) -> bool:
        """Return whether the source sets a setting."""
        return key in self.entries and self.entries[key].text.strip() not in _EMPTY_VALUES

    def read_raw(self, key: str) -> str:
        """Return the value of a setting as written in the source, or the default of the other slicer."""
        entry = self.entries.get(key)
        return self.defaults.get(key, "") if entry is None else entry.text

    def read_text(self, key: str) -> str:
        """Return the value of a setting as text, without quotes and escapes."""
        return unescape(self.read_raw(key))

    def read_word(self, key: str, known: Collection[str]) -> str:
        """Return the value of a setting as one word in lower case.

        Raises:
            ProfileError: the word was typed and is not one of the known words.
        """
        word = self.read_text(key).strip().lower()
        if key in self.typed and word not in known:
            near = get_close_matches(word, known, n=1)
            listed = f"Choose one of: {', '.join(one for one in known if one)}"
            raise ProfileError(
                f"{self.format_place(key)}: unknown value {word!r}",
                remedy=f"Did you mean {near[0]!r}?" if near else listed,
            )
        return word

    def read_first_text(self, key: str) -> str:
        """Return the first text of a setting that is a list of texts."""
        return next(iter(split_texts(self.read_raw(key))), "")

    def read_first_macro(self, key: str) -> str:
        """Return the first macro of a setting; a value without quotes is one macro, whose comments begin with ;."""
        raw = self.read_raw(key).strip()
        return self.read_first_text(key) if raw.startswith('"') else unescape(raw)

    def read_items(self, key: str) -> list[str]:
        """Return the items of a setting that is a list of numbers or words, separated by commas or semicolons."""
        return [part.strip().strip('"') for part in self.read_raw(key).replace(";", ",").split(",")]

    def read_number(self, key: str) -> float:
        """Return the first number of a setting; percentages are converted to ratios.

        Raises:
            ProfileError: it is not a number; with place and remedy.
        """
        found = self.read_quantity(key)
        return found.value / 100 if found.is_percent else found.value

    def read_quantity(self, key: str) -> Quantity:
        """Return the first number or percentage of a setting.

        Raises:
            ProfileError: it is neither; or it is a percentage that was typed, and the setting takes none.
        """
        word = _COMMENT.sub("", self.read_items(key)[0])
        if word in _EMPTY_VALUES:
            word = self.defaults.get(key, "0").split(",")[0] or "0"
        found = parse_quantity(word)
        if found is None:
            raise ProfileError(
                f"{self.format_place(key)}: {word!r} is not a number",
                remedy="Write a number such as 0.2 or 50%",
            )
        if found.is_percent and key in self.typed and not takes_percentage(key, self.dialect):
            raise ProfileError(
                f"{self.format_place(key)}: {self.entries[key].name} takes no percentage",
                remedy="Write a number without %",
            )
        return found

    def is_on(self, key: str) -> bool:
        """Return whether a switch is on.

        Raises:
            ProfileError: the value was typed, and is neither on nor off.
        """
        word = self.read_items(key)[0].lower()
        if key in self.typed and word not in (*ON_WORDS, *OFF_WORDS):
            raise ProfileError(
                f"{self.format_place(key)}: expected 1 or 0", remedy="Write 1 for on, or 0 for off"
            )
        return word in ON_WORDS

    def format_place(self, key: str) -> str:
        """Format the place and name of a setting, for messages."""
        entry = self.entries.get(key)
        if entry is not None and key in self.typed:
            return entry.place
        return f"{self.place}: {key}" if entry is None else f"{entry.place}: {entry.name}"

    def source_name(self, key: str) -> str:
        """Return the name of a setting in the source; empty if the source does not set it."""
        entry = self.entries.get(key)
        return entry.name if entry else ""


def parse_quantity(word: str) -> Quantity | None:
    """Parse a number or percentage; return None for other texts, such as `nan`."""
    word = word.strip()
    is_percent = word.endswith("%")
    try:
        value = float(word.removesuffix("%"))
    except ValueError:
        return None
    return Quantity(value, is_percent) if isfinite(value) else None
