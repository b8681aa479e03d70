"""Find the settings in G-code and 3MF files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive
from printer_slicer.importing.results import NoSettingsError

__all__ = ["OBJECTS_IN_3MF", "SETTINGS_IN_3MF", "read_3mf_settings", "read_gcode_settings"]

SETTINGS_IN_3MF: Final = (
    "Metadata/Slic3r_PE.config",
    "Metadata/SuperSlicer.config",
    "Metadata/Slic3r.config",
    "Metadata/project_settings.config",
)
OBJECTS_IN_3MF: Final = ("Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config")
"""Object settings files: those of PrusaSlicer, and those of OrcaSlicer and BambuStudio."""
_TAIL_BYTES: Final = 4_000_000  # size of the end of G-code that is searched for settings
_HEAD_BYTES: Final = 1_000_000  # size of the beginning that is searched
_BEGIN: Final = re.compile(r";\s*(?:\w+_config = begin|CONFIG_BLOCK_START)\s*")
_END: Final = re.compile(r";\s*(?:\w+_config = end|CONFIG_BLOCK_END)\s*")
_SETTING: Final = re.compile(r";\s*([a-z][a-z0-9_]*) = ?(.*)")
_FEWEST_SETTINGS: Final = 20  # so many settings in sequence count as a block without begin and end marks


def read_gcode_settings(path: Path) -> list[tuple[int, str]]:
    """Read the settings in the comments of G-code; return line numbers and lines.

    Raises:
        NoSettingsError: the file has no settings.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        skipped = max(size - _TAIL_BYTES, 0)
        file.seek(skipped)
        tail = file.read()
    for begin, data in ((skipped, tail), (0, head)):
        found = list(_find_settings_block(data.decode("utf-8", "replace").splitlines(), 1))
        if found:
            # Lines before the tail are only counted, for line numbers in messages.
            before = _count_newlines(path, begin)
            return [(before + number, text) for number, text in found]
    raise NoSettingsError(
        f"{path}: this G-code has no settings of PrusaSlicer, SuperSlicer, OrcaSlicer, BambuStudio or Slic3r",
        remedy="Use G-code that one of these programs wrote, or a file of exported settings",
    )


def _count_newlines(path: Path, until: int) -> int:
    """Count the line ends before a byte of a file."""
    count, left = 0, until
    with path.open("rb") as file:
        while left > 0 and (piece := file.read(min(left, 1 << 20))):
            count += piece.count(b"\n")
            left -= len(piece)
    return count


def _find_settings_block(lines: list[str], first: int) -> Iterator[tuple[int, str]]:
    """Yield the settings between begin and end marks, or the last long series of comments that look like settings."""
    marked: list[tuple[int, str]] = []
    inside = False
    run: list[tuple[int, str]] = []
    runs: list[tuple[int, str]] = []
    for number, line in enumerate(lines, first):
        text = line.strip()
        if _BEGIN.fullmatch(text):
            inside, marked = True, []
            continue
        if _END.fullmatch(text):
            inside = False
            continue
        match = _SETTING.fullmatch(text)
        if match:
            (marked if inside else run).append((number, f"{match[1]} = {match[2]}"))
        elif not inside and text and not text.startswith(";"):
            runs, run = (run if len(run) >= _FEWEST_SETTINGS else runs), []
    runs = run if len(run) >= _FEWEST_SETTINGS else runs
    yield from marked or runs


def read_3mf_settings(path: Path) -> tuple[str, str]:
    """Read the settings file inside a 3MF file; return its name and text.

    Raises:
        ProfileError: there is none, or it is damaged or too large.
    """
    texts = read_archive(path, set(SETTINGS_IN_3MF))
    for name in SETTINGS_IN_3MF:
        if name in texts:
            return name, texts[name]
    if read_archive(path, set(OBJECTS_IN_3MF)):
        raise ProfileError(
            f"{path}: has only object settings, no print settings",
            remedy=f"`printer-slicer slice {path}` applies object settings; "
            "to import profiles, save a project instead of exporting a 3MF",
        )
    raise ProfileError(
        f"{path}: has no settings",
        remedy="Save it as a project with PrusaSlicer, OrcaSlicer or BambuStudio",
    )
