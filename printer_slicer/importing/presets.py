"""One preset of another slicer under common names: those of PrusaSlicer, whose settings nearly all others have too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.ini import Entry, split_texts, unescaped
from printer_slicer.importing.report import ImportNote

__all__ = ["Own", "Preset", "Quantity", "number_in"]

_NOTHING: Final = ("", "nil", '""')
_REMARK: Final = re.compile(r"(?<!\s)\s+[#;].*")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number, or a percentage of something that the setting's meaning says."""

    value: float
    percent: bool = False

    def of(self, whole: float) -> float:
        """The number, with a percentage of this."""
        return self.value / 100 * whole if self.percent else self.value


@dataclass(frozen=True, slots=True)
class Own:
    """Settings that one object has of its own.

    Attributes:
        object: its name.
        low, high: between which heights over the bed, mm; both 0: everywhere.
        entries: as those of `Preset`.
        alone: whether there is no other object.
    """

    object: str
    low: float
    high: float
    entries: Mapping[str, Entry]
    alone: bool

    @property
    def where(self) -> str:
        """Object and heights, for people."""
        return f"{self.object}, z {self.low:g} to {self.high:g}" if self.high else self.object


@dataclass(frozen=True, slots=True)
class Preset:
    """The settings of a printer, a material or a quality as another slicer has them.

    Attributes:
        kind: `printer`, `material` or `quality`.
        name: of the preset.
        dialect: `prusaslicer`, `superslicer`, `slic3r`, `orca`: what percentages and words mean.
        place: file and line where it begins.
        entries: PrusaSlicer's name of a setting -> as the source has it.
        defaults: of settings that are not there.
        mixed: whether its entries hold settings of other kinds, too.
        together: settings of the printer (for the others) or of the quality (for the printer), where they are known.
        heights: for a material, first and other layer heights of the quality that it comes with, mm; 0: unknown.
        own: of a quality, what objects have of their own.
        notes: what a person should look at.
    """

    kind: str
    name: str
    dialect: str
    place: str
    entries: Mapping[str, Entry]
    defaults: Mapping[str, str] = field(default_factory=dict)
    mixed: bool = False
    together: Mapping[str, str] = field(default_factory=dict)
    heights: tuple[float, float] = (0.0, 0.0)
    own: tuple[Own, ...] = ()
    notes: tuple[ImportNote, ...] = ()

    def has(self, key: str) -> bool:
        """Whether the source says anything about a setting."""
        return key in self.entries and self.entries[key].text.strip() not in _NOTHING

    def raw(self, key: str) -> str:
        """A value as written, or the default of the slicer that it comes from."""
        entry = self.entries.get(key)
        return self.defaults.get(key, "") if entry is None else entry.text

    def text(self, key: str) -> str:
        """A value as plain text; of a list the first."""
        return unescaped(self.raw(key))

    def first_text(self, key: str) -> str:
        """The first of a list of texts."""
        return next(iter(split_texts(self.raw(key))), "")

    def first_macro(self, key: str) -> str:
        """The first of a list of macros; without quotes it is one, with whatever semicolons begin its remarks."""
        raw = self.raw(key).strip()
        return self.first_text(key) if raw.startswith('"') else unescaped(raw)

    def items(self, key: str) -> list[str]:
        """The items of a list of numbers or words."""
        return [part.strip().strip('"') for part in self.raw(key).replace(";", ",").split(",")]

    def number(self, key: str) -> float:
        """The first number of a setting; a percentage as a share.

        Raises:
            ProfileError: it is none, with place and remedy.
        """
        found = self.quantity(key)
        return found.value / 100 if found.percent else found.value

    def quantity(self, key: str) -> Quantity:
        """The first number or percentage of a setting.

        Raises:
            ProfileError: it is none.
        """
        word = _REMARK.sub("", self.items(key)[0])
        if word in _NOTHING:
            word = self.defaults.get(key, "0").split(",")[0] or "0"
        found = number_in(word)
        if found is None:
            raise ProfileError(
                f"{self.where(key)}: {word!r} is no number", remedy="write a number, such as 0.2 or 50%"
            )
        return found

    def on(self, key: str) -> bool:
        """Whether a switch is on."""
        return self.items(key)[0].lower() in ("1", "true", "yes", "on")

    def where(self, key: str) -> str:
        """Place and name of a setting, for messages."""
        entry = self.entries.get(key)
        return f"{self.place}: {key}" if entry is None else f"{entry.place}: {entry.name}"

    def theirs(self, key: str) -> str:
        """What the source calls a setting; empty where it says nothing about it."""
        entry = self.entries.get(key)
        return entry.name if entry else ""


def number_in(word: str) -> Quantity | None:
    """The number or percentage that a word is; None for anything else, such as `nan`."""
    word = word.strip()
    percent = word.endswith("%")
    try:
        value = float(word.removesuffix("%"))
    except ValueError:
        return None
    return Quantity(value, percent) if isfinite(value) else None
