"""Convert the settings of one preset, and record how each of them was converted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import floor, isfinite
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.presets import Preset, Quantity, parse_quantity
from printer_slicer.importing.prusaslicer_names import METADATA, find_setting_kind
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile, ImportNote, UnsupportedSetting
from printer_slicer.profile.profile import HIGHEST_BEAD
from printer_slicer.values import Struct, field, replace

__all__ = ["ONE_TOOL", "SUPPORTS_OFF", "Conversion", "find_highest_layer"]

ONE_TOOL: Final = "only one tool is supported"
SUPPORTS_OFF: Final = "supports are off"
_NOT_APPLICABLE: Final = (ONE_TOOL, SUPPORTS_OFF)

_OFF_VALUES: Final = ("", "0", "0%", "nil", "none", "false", "no", "0,0", "disabled", '""')


class Conversion(Struct):
    """Converts a preset setting by setting, and records where each value comes from."""

    preset: Preset
    values: dict[str, Any] = field(default_factory=dict)
    taken: list[ConvertedSetting] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    notes: list[ImportNote] = field(default_factory=list)

    def put(
        self,
        ours: str,
        value: Any,
        theirs: str | Sequence[str] = (),
        how: str = "",
        *,
        differs: bool = False,
    ) -> None:
        """Set one of our settings to a value, and record the settings of the source that it comes from.

        Args:
            ours: its name; a dot separates table and key.
            value: its value, in our unit.
            theirs: PrusaSlicer's names of the settings that it comes from, the most important first.
            how: how the value was converted, where that is not obvious.
            differs: whether this makes the print differ from the source's.
        """
        names = [theirs] if isinstance(theirs, str) else list(theirs)
        self.used.update(names)
        table = self.values
        *outer, leaf = ours.split(".")
        for name in outer:
            table = table.setdefault(name, {})
        table[leaf] = _round_number(value)
        first = next((name for name in names if name in self.preset.entries), "")
        label = self.preset.source_name(first)
        text = self.preset.read_raw(first or names[0]) if names else ""
        value = _round_number(value)
        self.taken = [one for one in self.taken if (one.theirs, one.ours) != (label, ours)]
        self.taken.append(ConvertedSetting(label, text, ours, value, how, differs, tuple(names)))

    def copy_number(self, ours: str, theirs: str, how: str = "", *, differs: bool = False) -> float:
        """Set one of our settings to a number of the source, and return the number."""
        value = self.preset.read_number(theirs)
        self.put(ours, value, theirs, how, differs=differs)
        return value

    def copy_switch(self, ours: str, theirs: str) -> bool:
        """Set one of our settings to a switch of the source, and return whether it is on."""
        value = self.preset.is_on(theirs)
        self.put(ours, value, theirs)
        return value

    def convert_choice(
        self, ours: str, theirs: str, same: Mapping[str, str], near: Mapping[str, str], other: str
    ) -> None:
        """Set one of our settings to the word that corresponds to a word of the source.

        Args:
            ours: name of our setting.
            theirs: name of the source's setting.
            same: words of the source -> our words with the same meaning.
            near: words of the source -> our words with a similar meaning.
            other: our word for all other words of the source.
        """
        word = self.preset.read_word(theirs, [*same, *near])
        value = same.get(word) or near.get(word, other)
        how = "" if word in same else f"{value} is the most similar choice for {word or 'nothing'}"
        self.put(ours, value, theirs, how, differs=word not in same)

    def clamp(  # noqa: PLR0913, PLR0917 - calls read as rows of a table
        self,
        ours: str,
        value: float,
        low: float,
        high: float,
        theirs: str | Sequence[str],
        how: str = "",
        *,
        is_derived: bool = False,
    ) -> float:
        """Set one of our settings to a number within `low` and `high`; warn if the number has to be changed.

        Raises:
            ProfileError: the number has to be changed, and was typed; with `is_derived`, it was not typed itself.
        """
        clamped = min(max(value, low), high)
        is_outside = abs(clamped - value) > 1e-12
        if is_outside:
            bound = f"the {'minimum' if clamped > value else 'maximum'} here"
            names = [theirs] if isinstance(theirs, str) else theirs
            for name in () if is_derived else self.preset.typed.intersection(names):
                raise self.make_error(name, f"{clamped:g} is {bound}", "Write a value within the bounds")
            how = f"{how}; {clamped:g} is {bound}" if how else f"{clamped:g} is {bound}"
            self.warn(
                theirs if isinstance(theirs, str) else theirs[0], f"{value:g} becomes {clamped:g}, {bound}"
            )
        self.put(ours, clamped, theirs, how, differs=is_outside)
        return clamped

    def switch_off(self, ours: str, value: Any, *theirs: str) -> None:
        """Set one of our settings to `value`, which means off, if the setting of the source was typed by a user.

        In files this is not necessary, because the value is the default.
        """
        self.mark_used(theirs)
        if self.preset.typed.intersection(theirs):
            self.put(ours, value, theirs)

    def resolve(self, theirs: str, whole: float) -> float:
        """Return a setting of the source as a number; a percentage refers to `whole`."""
        return self.preset.read_quantity(theirs).resolve(whole)

    def read_quantity(self, theirs: str) -> Quantity:
        """Return a setting of the source as a number or percentage."""
        return self.preset.read_quantity(theirs)

    def read_printer_number(self, theirs: str) -> float:
        """Return a number from the settings of the preset's printer, or the other slicer's default."""
        entry, in_context = self.preset.entries.get(theirs), self.preset.context.get(theirs, "")
        found = parse_quantity(in_context.split(",")[0]) if entry is None and in_context else None
        return found.value if found else self.preset.read_number(theirs)

    def make_error(self, theirs: str, problem: str, remedy: str) -> ProfileError:
        """Make an error about a setting of the source; the caller raises it."""
        return ProfileError(f"{self.preset.format_place(theirs)}: {problem}", remedy=remedy)

    def warn(self, theirs: str, text: str) -> None:
        """Add a warning about a setting of the source."""
        self.notes.append(ImportNote(self.preset.format_place(theirs), text))

    def mark_different(self) -> None:
        """Record that the last converted setting makes the print differ from the source's."""
        self.taken[-1] = replace(self.taken[-1], differs=True)

    def mark_used(self, names: Iterable[str]) -> None:
        """Mark settings of the source as used, so that they are not reported as unsupported."""
        self.used.update(names)

    def finish(self, explain: Callable[[str], str]) -> ImportedProfile:
        """Return the converted profile.

        Args:
            explain: function that returns the reason why a setting of the source has no equivalent.
        """
        preset = self.preset
        unsupported = [
            UnsupportedSetting(
                entry.name,
                entry.text,
                reason := explain(name),
                off=_is_off(entry.text) or reason in _NOT_APPLICABLE,
            )
            for name, entry in preset.entries.items()
            if name not in self.used
            and not METADATA.fullmatch(name)
            and (not preset.mixed or find_setting_kind(name) == preset.kind)
        ]
        settings = {name: entry.text for name, entry in preset.entries.items()}
        return ImportedProfile(
            preset.kind,
            preset.name,
            preset.place,
            self.values,
            tuple(self.taken),
            tuple(unsupported),
            (*preset.notes, *self.notes),
            settings,
        )


def _is_off(text: str) -> bool:
    """Return whether a value switches its setting off."""
    return text.strip().lower() in _OFF_VALUES


def _round_number(value: Any) -> Any:
    """Round a number to six decimals, and return whole numbers as integers."""
    if isinstance(value, float) and isfinite(value):
        rounded = round(value, 6)
        return int(rounded) if rounded.is_integer() and abs(rounded) < 1e15 else rounded
    return value


def find_highest_layer(nozzle: float) -> float:
    """Return the greatest layer height that a nozzle can print, mm, rounded down to 0.01 mm.

    Args:
        nozzle: its diameter, mm; 100 at most is used.
    """
    return floor(HIGHEST_BEAD * min(nozzle, 100.0) * 100 + 1e-6) / 100
