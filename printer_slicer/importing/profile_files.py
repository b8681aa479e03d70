"""Write imported profiles as TOML files, and choose their names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, count
from typing import Any, Final

from printer_slicer.importing.results import ImportedProfile
from printer_slicer.profile.template import format_toml_value

__all__ = ["choose_file_names", "format_profile", "make_short_name"]

_LONGEST_NAME: Final = 40  # characters
_LONGEST_SHORT_NAME: Final = 32
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


def _is_never_taken(_kind: str, _file_name: str, _name: str) -> bool:
    """Return False, because no file name is taken by another profile."""
    return False


def choose_file_names(profiles: Sequence[ImportedProfile], is_taken: IsTaken = _is_never_taken) -> list[str]:
    """Return a short file name without suffix for each profile; names of one kind are unique.

    Args:
        profiles: the profiles.
        is_taken: function of kind, file name and display name that returns whether another profile has the file name.
    """
    used: set[tuple[str, str]] = set()
    names = []
    for one in profiles:
        short = make_short_name(one.name) or one.kind
        long = _make_slug(_USUAL_NOZZLE.sub("", _strip_folder(one.name)), _LONGEST_NAME) or one.kind
        if is_taken(one.kind, short, one.name) and long == short:
            short = f"{short}_imported"
        candidates = chain((short, long), (f"{short}_{number}" for number in count(2)))
        name = next(
            each
            for each in candidates
            if (one.kind, each) not in used and not is_taken(one.kind, each, one.name)
        )
        used.add((one.kind, name))
        names.append(name)
    return names


def make_short_name(name: str) -> str:
    """Return a short file name for a preset; empty if its name has no letters or digits.

    The text after `@` and a nozzle of 0.4 mm are omitted.
    """
    return _make_slug(_VENDOR.sub("", _USUAL_NOZZLE.sub("", _strip_folder(name))), _LONGEST_SHORT_NAME)


def _strip_folder(name: str) -> str:
    """Remove the file suffix from a name, and the folders if it is a path."""
    if _PATH.match(name):
        name = name.replace("\\", "/").rstrip("/").rpartition("/")[2]
    return _SUFFIX.sub("", name)


def _make_slug(name: str, longest: int) -> str:
    """Convert a text to lower-case letters, digits and underscores; long texts are cut after a whole word."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = _NOT_WORDS.sub("_", plain.replace("+", " plus ").replace(".", "_")).strip("_")
    if len(slug) > longest:
        slug = slug[: longest + 1].rpartition("_")[0] or slug[:longest]
    slug = slug.strip("_")
    return f"{slug}_" if _RESERVED.fullmatch(slug) else slug


def format_profile(profile: ImportedProfile) -> str:
    """Format a profile as the text of its file, with comments that explain converted settings.

    Args:
        profile: the profile.
    """
    remarks = {taken.ours: taken.how for taken in profile.taken if taken.how}
    source = profile.source.replace("\\", "/").rpartition("/")[2]
    lines = [
        f"# {_replace_control_characters(profile.name)}, imported from {_replace_control_characters(source)}"
    ]
    lines += [f"# warning: {_replace_control_characters(note.text)}" for note in profile.notes]
    lines += _format_table(profile.values, "", remarks)
    return "\n".join(lines) + "\n"


def _format_table(values: Mapping[str, Any], prefix: str, remarks: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a table: its values first, then the tables inside it."""
    for key, value in values.items():
        if not isinstance(value, dict):
            remark = remarks.get(prefix + key, "")
            comment = f" # {_replace_control_characters(remark)}" if remark and "\n" not in str(value) else ""
            yield from _format_setting(key, value, comment)
    for key, value in values.items():
        if isinstance(value, dict):
            yield ""
            yield f"[{prefix}{key}]"
            yield from _format_table(value, f"{prefix}{key}.", remarks)


def _format_setting(key: str, value: Any, comment: str) -> Iterator[str]:
    """Yield the lines of a key and its value; in a list of tables, each table has its own line."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        yield f"{key} = [{comment}"
        yield from (f"  {format_toml_value(one)}," for one in value)
        yield "]"
    else:
        yield f"{key} = {_format_value(value)}{comment}"


def _format_value(value: Any) -> str:
    """Format a value as TOML; texts of several lines keep their lines."""
    return format_toml_value(value.strip("\n") + "\n" if isinstance(value, str) and "\n" in value else value)


def _replace_control_characters(text: str) -> str:
    """Replace control characters, such as line breaks, by spaces."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
