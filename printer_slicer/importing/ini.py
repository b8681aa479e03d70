"""Read the INI files of PrusaSlicer, SuperSlicer and Slic3r: sections, escaped values, lists in one line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.values import Struct, field

__all__ = ["FILE_REMEDY", "IniSection", "SourceSetting", "read_sections", "split_texts", "unescape"]

FILE_REMEDY: Final = "Give an exported config.ini, a bundle, G-code, a 3MF file or a JSON preset"
"""Remedy for files that have no settings."""

_HEADING: Final = re.compile(r"\[(.+)\]\s*(?:[;#].*)?")
_MAX_LINES: Final = 200_000  # lines
# Possessive quantifiers prevent backtracking: the time stays proportional to the length.
_ITEM: Final = re.compile(r'\s*+("(?:[^"\\]|\\.)*+"(?=\s*+(?:;|\Z))|[^;]*+)\s*+(?:;|\Z)', re.DOTALL)
_ESCAPES: Final = {"n": "\n", "r": "\r", "t": "\t"}


class SourceSetting(Struct, frozen=True):
    """A setting as written in the source.

    Attributes:
        name: its name in the source.
        text: its value.
        place: file and line, for messages.
    """

    name: str
    text: str
    place: str


class IniSection(Struct, frozen=True):
    """A section of an INI file; settings before the first heading form a section without a title."""

    title: str
    place: str
    entries: dict[str, SourceSetting] = field(default_factory=dict)

    @property
    def texts(self) -> Mapping[str, str]:
        """Values of the settings, by name."""
        return {key: entry.text for key, entry in self.entries.items()}


def read_sections(lines: Iterable[str], place: str, first: int = 1) -> list[IniSection]:
    """Read the sections of a file; if a key occurs several times, the last value counts.

    Args:
        lines: lines of the file.
        place: name of the file, for messages.
        first: number of the first line.

    Raises:
        ProfileError: a line is not a heading, a setting or a comment.
    """
    sections = [IniSection("", f"{place}:{first}")]
    for number, line in enumerate(lines, first):
        text = line.strip().lstrip("\ufeff")
        if number - first > _MAX_LINES:
            raise ProfileError(
                f"{place}: over {_MAX_LINES} lines, too large for a settings file", remedy=FILE_REMEDY
            )
        if not text or text[0] in ";#":
            continue
        heading = _HEADING.fullmatch(text)
        if heading:
            sections.append(IniSection(heading[1].strip(), f"{place}:{number}"))
            continue
        name, sign, value = text.partition("=")
        if not sign or not name.strip():
            shown = text if len(text) <= 60 else f"{text[:57]}..."
            raise ProfileError(
                f"{place}:{number}: {shown!r} is not a [section], a setting or a comment",
                remedy=FILE_REMEDY,
            )
        entry = SourceSetting(name.strip(), value.strip(), f"{place}:{number}")
        sections[-1].entries[entry.name] = entry
    return sections


def unescape(text: str) -> str:
    r"""Return a text without quotes around it and without escapes (`\n`, `\"`, `\\`)."""
    if len(text) >= 2 and text[0] == text[-1] == '"':
        text = text[1:-1]
    return re.sub(r"\\(.)", lambda found: _ESCAPES.get(found[1], found[1]), text, flags=re.DOTALL)


def split_texts(text: str) -> list[str]:
    """Split a list of texts, quoted or not, separated by `;`."""
    found, place = [], 0
    while place < len(text):
        match = _ITEM.match(text, place)
        if match is None:  # text after a closing quote: not a list
            return [unescape(text)]
        found.append(unescape(match[1].strip()))
        place = max(match.end(), place + 1)
    return found
