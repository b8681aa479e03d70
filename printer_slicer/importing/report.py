"""What an import made of what it was given: taken, approximated, without counterpart, refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from printer_slicer.errors import ProfileError

__all__ = ["KINDS", "ImportNote", "Imported", "Left", "NoSettingsError", "Refused", "Taken"]

KINDS: Final = ("printer", "material", "quality")


class NoSettingsError(ProfileError):
    """A G-code file has no settings of a slicer."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A setting that was taken over.

    Attributes:
        theirs: its name and value in the source; the name is empty where the source says nothing.
        text: that value.
        ours: the name here, within its kind of profile.
        value: the value here.
        how: what was made of it, where that is not the same; empty: the same.
    """

    theirs: str
    text: str
    ours: str
    value: Any
    how: str = ""


@dataclass(frozen=True, slots=True)
class Left:
    """A setting without counterpart; `off` where it asks for nothing."""

    theirs: str
    text: str
    why: str
    off: bool = False


@dataclass(frozen=True, slots=True)
class ImportNote:
    """Something a person should look at, and where."""

    place: str
    text: str


@dataclass(frozen=True, slots=True)
class Imported:
    """A profile that was made.

    Attributes:
        kind: `printer`, `material` or `quality`.
        name: what the source calls it.
        source: file and line.
        values: ours, key -> value; tables of tables are nested.
        taken: what was taken over, in the order of `values` where it is of this program.
        left: what has no counterpart.
        notes: warnings.
        settings: the source's own, under PrusaSlicer's names.
    """

    kind: str
    name: str
    source: str
    values: Mapping[str, Any]
    taken: tuple[Taken, ...] = ()
    left: tuple[Left, ...] = ()
    notes: tuple[ImportNote, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict, repr=False)

    @property
    def approximated(self) -> tuple[Taken, ...]:
        """What is not quite the same."""
        return tuple(one for one in self.taken if one.how)


@dataclass(frozen=True, slots=True)
class Refused:
    """A profile that was not made: the reason, with place and remedy."""

    kind: str
    name: str
    source: str
    problem: str
    remedy: str
