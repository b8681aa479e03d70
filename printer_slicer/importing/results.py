"""Results of an import: converted settings, settings without equivalent, warnings, rejected profiles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.values import Struct, field

__all__ = [
    "KINDS",
    "ConvertedSetting",
    "ImportNote",
    "ImportedProfile",
    "NoSettingsError",
    "RejectedProfile",
    "UnsupportedSetting",
]

KINDS: Final = ("printer", "material", "quality")


class NoSettingsError(ProfileError):
    """An error: a G-code file contains no settings of a slicer."""


class ConvertedSetting(Struct, frozen=True):
    """A setting that was imported, unchanged or converted.

    Attributes:
        theirs: its name in the source; empty if the source does not set it.
        text: its value in the source.
        ours: its name here, without the kind of profile.
        value: its value here.
        how: how it was converted, where that is not obvious; empty: the value is the same.
        differs: whether this makes the print differ from the source's.
        sources: PrusaSlicer's names of all settings that the value depends on.
    """

    theirs: str
    text: str
    ours: str
    value: Any
    how: str = ""
    differs: bool = False
    sources: tuple[str, ...] = ()


class UnsupportedSetting(Struct, frozen=True):
    """A setting that was not imported.

    Attributes:
        theirs: its name in the source.
        text: its value in the source.
        why: the reason.
        off: whether it has no effect, because it is switched off or only for machines with several tools.
    """

    theirs: str
    text: str
    why: str
    off: bool = False


class ImportNote(Struct, frozen=True):
    """A warning: the file, line and setting that it is about, and its text."""

    place: str
    text: str


class ImportedProfile(Struct, frozen=True):
    """A converted profile.

    Attributes:
        kind: `printer`, `material` or `quality`.
        name: its name in the source.
        source: file and line.
        values: setting -> value here; tables are nested.
        taken: settings that were imported, unchanged or converted.
        left: settings without an equivalent.
        notes: warnings.
        settings: settings of the source under PrusaSlicer's names.
    """

    kind: str
    name: str
    source: str
    values: Mapping[str, Any]
    taken: tuple[ConvertedSetting, ...] = ()
    left: tuple[UnsupportedSetting, ...] = ()
    notes: tuple[ImportNote, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def converted_settings(self) -> tuple[ConvertedSetting, ...]:
        """Settings whose values were converted, not copied."""
        return tuple(one for one in self.taken if one.how)


class RejectedProfile(Struct, frozen=True):
    """A preset that was not imported, with the problem and the remedy."""

    kind: str
    name: str
    source: str
    problem: str
    remedy: str
