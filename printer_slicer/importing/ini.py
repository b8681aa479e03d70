"""The INI dialect of PrusaSlicer, SuperSlicer and Slic3r: sections, escaped values, lists in one line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from printer_slicer.errors import ProfileError

__all__ = ["GIVE", "Entry", "Section", "read_sections", "split_texts", "unescaped"]

GIVE: Final = "give an exported config.ini, a bundle, G-code, a 3MF file or a JSON preset"
"""The remedy for files that are something else."""

_HEADING: Final = re.compile(r"\[(.+)\]\s*(?:[;#].*)?")
_MOST: Final = 200_000  # lines
# Possessive: what cannot be read differently is not tried again, so that the time grows with the length only.
_ITEM: Final = re.compile(r'\s*+("(?:[^"\\]|\\.)*+"(?=\s*+(?:;|\Z))|[^;]*+)\s*+(?:;|\Z)', re.DOTALL)
_ESCAPES: Final = {"n": "\n", "r": "\r", "t": "\t"}


@dataclass(frozen=True, slots=True)
class Entry:
    """One setting as the source has it.

    Attributes:
        name: what the source calls it.
        text: its value, as written.
        place: file and line, for messages.
    """

    name: str
    text: str
    place: str


@dataclass(frozen=True, slots=True)
class Section:
    """A section of an INI file; what stands before the first heading has the title ``."""

    title: str
    place: str
    entries: dict[str, Entry] = field(default_factory=dict)

    @property
    def texts(self) -> Mapping[str, str]:
        """The values alone."""
        return {key: entry.text for key, entry in self.entries.items()}


def read_sections(lines: Iterable[str], place: str, first: int = 1) -> list[Section]:
    """The sections of a file; in a section the last of two equal keys counts.

    Args:
        lines: of the file.
        place: its name, for messages.
        first: number of its first line.

    Raises:
        ProfileError: a line that is neither heading, setting nor comment.
    """
    sections = [Section("", f"{place}:{first}")]
    for number, line in enumerate(lines, first):
        text = line.strip().lstrip("\ufeff")
        if number - first > _MOST:
            raise ProfileError(f"{place}: over {_MOST} lines, too large for a settings file", remedy=GIVE)
        if not text or text[0] in ";#":
            continue
        heading = _HEADING.fullmatch(text)
        if heading:
            sections.append(Section(heading[1].strip(), f"{place}:{number}"))
            continue
        name, sign, value = text.partition("=")
        if not sign or not name.strip():
            shown = text if len(text) <= 60 else f"{text[:57]}..."
            raise ProfileError(
                f"{place}:{number}: {shown!r} is neither [section], setting nor comment",
                remedy=GIVE,
            )
        entry = Entry(name.strip(), value.strip(), f"{place}:{number}")
        sections[-1].entries[entry.name] = entry
    return sections


def unescaped(text: str) -> str:
    r"""A text with `\n`, `\"` and `\\` as what they stand for, without quotes around it."""
    if len(text) >= 2 and text[0] == text[-1] == '"':
        text = text[1:-1]
    return re.sub(r"\\(.)", lambda found: _ESCAPES.get(found[1], found[1]), text, flags=re.DOTALL)


def split_texts(text: str) -> list[str]:
    """The texts of a list: quoted or not, separated by `;`."""
    found, place = [], 0
    while place < len(text):
        match = _ITEM.match(text, place)
        if match is None:  # something behind a closing quote: no list after all
            return [unescaped(text)]
        found.append(unescaped(match[1].strip()))
        place = max(match.end(), place + 1)
    return found
