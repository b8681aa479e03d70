"""Write imported profiles as TOML files, and choose their names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, count
from typing import Any, Final

from printer_slicer.importing.results import ImportedProfile
from printer_slicer.profile.template import toml_value

__all__ = ["file_names", "profile_text", "short_name"]

_LONGEST: Final = 40
_SHORT: Final = 32
_NOT_WORDS: Final = re.compile(r"[^a-z0-9]+")
_RESERVED: Final = re.compile(r"con|prn|aux|nul|com\d|lpt\d")  # names of devices on Windows
_PATH: Final = re.compile(
    r"[~/.]*/|[a-z]:[\\/]|.*[\\/].*[\\/]|.*\.(ini|json|3mf|gcode|toml|cfg)$", re.IGNORECASE
)
_SUFFIX: Final = re.compile(
    r"\.(def\.json|inst\.cfg|ini|json|3mf|gcode|toml|cfg|curaprofile)$", re.IGNORECASE
)
_VENDOR: Final = re.compile(r"(?<=.)\s*@.*")
_USUAL_NOZZLE: Final = re.compile(r"\(?\b0\.40?\s*(mm)?\s*nozzle\)?", re.IGNORECASE)

IsTaken = Callable[[str, str, str], bool]


def _never(_kind: str, _file_name: str, _name: str) -> bool:
    return False


def file_names(made: Sequence[ImportedProfile], is_taken: IsTaken = _never) -> list[str]:
    """Return a short name for the file of each profile, without suffix; unique for each kind.

    Args:
        made: the profiles.
        is_taken: whether another profile has a file name, by kind, file name and the name of the profile.
    """
    used: set[tuple[str, str]] = set()
    names = []
    for one in made:
        short = short_name(one.name) or one.kind
        candidates = chain(
            (short, _slug(_without_folder(one.name), _LONGEST) or one.kind),
            (f"{short}_{number}" for number in count(2)),
        )
        name = next(
            each
            for each in candidates
            if (one.kind, each) not in used and not is_taken(one.kind, each, one.name)
        )
        used.add((one.kind, name))
        names.append(name)
    return names


def short_name(name: str) -> str:
    """Return a short file name for a preset; empty if its name has no letters or digits.

    The text after `@` and a nozzle of 0.4 mm are omitted.
    """
    return _slug(_VENDOR.sub("", _USUAL_NOZZLE.sub("", _without_folder(name))), _SHORT)


def _without_folder(name: str) -> str:
    """Return a name without folders and file suffix, if it is a path."""
    if _PATH.match(name):
        name = name.replace("\\", "/").rstrip("/").rpartition("/")[2]
    return _SUFFIX.sub("", name)


def _slug(name: str, longest: int) -> str:
    """Return a text as lower-case letters, digits and underscores; longer texts end after a whole word."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = _NOT_WORDS.sub("_", plain.replace("+", " plus ").replace(".", "_")).strip("_")
    if len(slug) > longest:
        slug = slug[: longest + 1].rpartition("_")[0] or slug[:longest]
    slug = slug.strip("_")
    return f"{slug}_" if _RESERVED.fullmatch(slug) else slug


def profile_text(made: ImportedProfile) -> str:
    """Return the text of a profile file; comments explain converted settings.

    Args:
        made: the profile.
    """
    remarks = {taken.ours: taken.how for taken in made.taken if taken.how}
    source = made.source.replace("\\", "/").rpartition("/")[2]
    lines = [f"# {_one_line(made.name)}, imported from {_one_line(source)}"]
    lines += [f"# warning: {_one_line(note.text)}" for note in made.notes]
    lines += _table(made.values, "", remarks)
    return "\n".join(lines) + "\n"


def _table(values: Mapping[str, Any], prefix: str, remarks: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a table: its keys first, then the tables in it."""
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
    """Yield the lines of a key and its value; in a list of tables, each table has its own line."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        yield f"{key} = [{behind}"
        yield from (f"  {toml_value(one)}," for one in value)
        yield "]"
    else:
        yield f"{key} = {_value(value)}{behind}"


def _value(value: Any) -> str:
    """Return a value as TOML; texts of several lines keep their lines."""
    return toml_value(value.strip("\n") + "\n" if isinstance(value, str) and "\n" in value else value)


def _one_line(text: str) -> str:
    return "".join(letter if letter.isprintable() else " " for letter in text)
