"""What settings become, and an account of it, while one preset is converted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.presets import Preset, Quantity, number_in
from printer_slicer.importing.report import Imported, ImportNote, Left, Taken
from printer_slicer.importing.vocabulary import ABOUT_FILES, kind_of_setting

__all__ = ["Conversion"]

_OFF: Final = ("", "0", "0%", "nil", "none", "false", "no", "0,0", "disabled", '""')


@dataclass(slots=True)
class Conversion:
    """The settings made so far, and where they come from."""

    preset: Preset
    values: dict[str, Any] = field(default_factory=dict)
    taken: list[Taken] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    notes: list[ImportNote] = field(default_factory=list)

    def put(self, ours: str, value: Any, theirs: str | Sequence[str] = (), how: str = "") -> None:
        """One of our settings.

        Args:
            ours: its name; a dot leads into a table.
            value: in our unit.
            theirs: PrusaSlicer's names of the settings it was made from, the most important first.
            how: what was made of them, where it is not the same.
        """
        names = [theirs] if isinstance(theirs, str) else list(theirs)
        self.used.update(names)
        table = self.values
        *outer, leaf = ours.split(".")
        for name in outer:
            table = table.setdefault(name, {})
        table[leaf] = _tidy(value)
        there = [name for name in names if name in self.preset.entries]
        label = ", ".join(self.preset.theirs(name) for name in there[:1])
        text = self.preset.raw(there[0]) if there else self.preset.raw(names[0]) if names else ""
        self.taken.append(Taken(label, text, ours, _tidy(value), how))

    def number(self, ours: str, theirs: str, how: str = "") -> float:
        """A number taken over as it is."""
        value = self.preset.number(theirs)
        self.put(ours, value, theirs, how)
        return value

    def switch(self, ours: str, theirs: str) -> bool:
        """A switch taken over as it is."""
        value = self.preset.on(theirs)
        self.put(ours, value, theirs)
        return value

    def choice(
        self, ours: str, theirs: str, same: Mapping[str, str], near: Mapping[str, str], other: str
    ) -> None:
        """One of a few words: those that mean the same, those that are near, any other."""
        word = self.preset.text(theirs).strip().lower()
        value = same.get(word) or near.get(word, other)
        self.put(ours, value, theirs, "" if word in same else f"{word or 'nothing'} is nearest to {value}")

    def held(  # noqa: PLR0917 - calls read as rows of a table
        self, ours: str, value: float, low: float, high: float, theirs: str | Sequence[str], how: str = ""
    ) -> float:
        """A harmless number, moved to the nearest that is allowed here, which is told."""
        kept = min(max(value, low), high)
        if abs(kept - value) > 1e-12:
            bound = f"the {'least' if kept > value else 'most'} here"
            how = f"{how}; {kept:g} is {bound}" if how else f"{kept:g} is {bound}"
            self.warn(
                theirs if isinstance(theirs, str) else theirs[0], f"{value:g} becomes {kept:g}, {bound}"
            )
        self.put(ours, kept, theirs, how)
        return kept

    def of(self, theirs: str, whole: float) -> float:
        """A number, or that percentage of something."""
        return self.preset.quantity(theirs).of(whole)

    def quantity(self, theirs: str) -> Quantity:
        """A number or percentage."""
        return self.preset.quantity(theirs)

    def beside(self, theirs: str) -> float:
        """A number of the printer that the preset is for, or the other program's usual one."""
        entry, told = self.preset.entries.get(theirs), self.preset.together.get(theirs, "")
        found = number_in(told.split(",")[0]) if entry is None and told else None
        return found.value if found else self.preset.number(theirs)

    def refuse(self, theirs: str, problem: str, remedy: str) -> ProfileError:
        """The error for a value that must not be taken over."""
        return ProfileError(f"{self.preset.where(theirs)}: {problem}", remedy=remedy)

    def warn(self, theirs: str, text: str) -> None:
        """Something a person should look at."""
        self.notes.append(ImportNote(self.preset.where(theirs), text))

    def skip(self, names: Iterable[str]) -> None:
        """Settings that are accounted for elsewhere."""
        self.used.update(names)

    def done(self, why: Callable[[str], str]) -> Imported:
        """The profile, and what is left of the source; `why` says why a setting has no counterpart."""
        preset = self.preset
        left = [
            Left(entry.name, entry.text, why(name), off=entry.text.strip().lower() in _OFF)
            for name, entry in preset.entries.items()
            if name not in self.used
            and not ABOUT_FILES.fullmatch(name)
            and (not preset.mixed or kind_of_setting(name) == preset.kind)
        ]
        settings = {name: entry.text for name, entry in preset.entries.items()}
        return Imported(
            preset.kind,
            preset.name,
            preset.place,
            self.values,
            tuple(self.taken),
            tuple(left),
            (*preset.notes, *self.notes),
            settings,
        )


def _tidy(value: Any) -> Any:
    """Numbers without what binary fractions add to them."""
    if isinstance(value, float) and isfinite(value):
        rounded = round(value, 6)
        return int(rounded) if rounded.is_integer() and abs(rounded) < 1e15 else rounded
    return value
