"""Imported profiles as TOML files of ours."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from printer_slicer.importing.report import Imported
from printer_slicer.profile.template import toml_value

__all__ = ["names_of_files", "profile_text"]

_LONGEST: Final = 80
_WORDS: Final = re.compile(r"[^a-z0-9]+")
_RESERVED: Final = re.compile(r"con|prn|aux|nul|com\d|lpt\d")  # names of devices on Windows


def names_of_files(made: Sequence[Imported]) -> list[str]:
    """A name for the file of each profile, without ending; of one kind none twice.

    Args:
        made: the profiles.
    """
    taken: set[tuple[str, str]] = set()
    names = []
    for one in made:
        base = _file_name(one.name) or one.kind
        name, number = base, 2
        while (one.kind, name) in taken:
            name, number = f"{base}_{number}", number + 1
        taken.add((one.kind, name))
        names.append(name)
    return names


def _file_name(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    made = _WORDS.sub("_", plain.replace("+", " plus ").replace(".", "_")).strip("_")[:_LONGEST].strip("_")
    return f"{made}_" if _RESERVED.fullmatch(made) else made


def profile_text(made: Imported) -> str:
    """The file of a profile; what was approximated stands behind its key.

    Args:
        made: the profile.
    """
    remarks = {taken.ours: taken.how for taken in made.taken if taken.how}
    source = made.source.replace("\\", "/").rpartition("/")[2]
    lines = [f"# {_one_line(made.name)}, imported from {_one_line(source)}"]
    lines += [f"# look at: {_one_line(note.text)}" for note in made.notes]
    lines += _table(made.values, "", remarks)
    return "\n".join(lines) + "\n"


def _table(values: Mapping[str, Any], prefix: str, remarks: Mapping[str, str]) -> Iterator[str]:
    """Keys first, then the tables in it."""
    for key, value in values.items():
        if not isinstance(value, dict):
            remark = remarks.get(prefix + key, "")
            behind = f" # {_one_line(remark)}" if remark and "\n" not in str(value) else ""
            yield from _lines(key, value, behind)
    for key, value in values.items():
        if isinstance(value, dict):
            yield ""
            yield f"[{prefix}{key}]"
            yield from _table(value, f"{prefix}{key}.", remarks)


def _lines(key: str, value: Any, behind: str) -> Iterator[str]:
    """A key and its value; a list of tables has a line for each."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        yield f"{key} = [{behind}"
        yield from (f"  {toml_value(one)}," for one in value)
        yield "]"
    else:
        yield f"{key} = {_value(value)}{behind}"


def _value(value: Any) -> str:
    """A value as it stands in the file; a text of several lines as it looks in G-code."""
    return toml_value(value.strip("\n") + "\n" if isinstance(value, str) and "\n" in value else value)


def _one_line(text: str) -> str:
    return "".join(letter if letter.isprintable() else " " for letter in text)
