"""What was read as settings with types and bounds; what is wrong with it, by file, line, key and bound."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import date, time
from difflib import get_close_matches
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.profile.keys import ENTRIES, keys_of, nearest
from printer_slicer.profile.lists import LISTS
from printer_slicer.profile.reading import KINDS, SettingsSource
from printer_slicer.profile.settings import PLANNER_SETTINGS

__all__ = ["SettingFault", "converted", "fault_of"]

_TELLS = "`printer-slicer profiles settings` tells type, unit and bounds"
_LONG: Final = 60  # letters of a value in a message


class SettingFault(NamedTuple):
    """What is wrong with one setting.

    Attributes:
        place: the file with the line, or what was typed.
        path: the key within its section; empty for all of it.
        problem: what is wrong, with key and value.
        remedy: what to do.
    """

    place: str
    path: str
    problem: str
    remedy: str

    def error(self) -> ProfileError:
        """The same as an error."""
        return ProfileError(f"{self.place}: {self.problem}", remedy=self.remedy)


def converted(kind: str, source: SettingsSource) -> Any:
    """One section as a struct.

    Raises:
        ProfileError: naming place, key and bound.
    """
    made = _attempt(kind, source.values)
    if isinstance(made, msgspec.ValidationError):
        raise _fault(kind, source, made).error() from None
    return made


def _attempt(kind: str, values: Mapping[str, Any]) -> Any:
    """The struct, or what the library says is wrong."""
    try:
        return msgspec.convert(values, KINDS[kind], strict=False)
    except msgspec.ValidationError as error:
        return error


def fault_of(kind: str, source: SettingsSource) -> SettingFault | None:
    """What is wrong with a section first; None where nothing is."""
    made = _attempt(kind, source.values)
    return _fault(kind, source, made) if isinstance(made, msgspec.ValidationError) else None


def _fault(kind: str, source: SettingsSource, error: msgspec.ValidationError) -> SettingFault:
    problem, _, where = str(error).partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    if "unknown field" in problem:
        return _unknown(kind, source, f"{path}.{problem.split('`')[1]}".lstrip("."))
    if "missing required field" in problem:
        path = f"{path}.{problem.split('`')[1]}".lstrip(".")
        remedy = f'set it, such as {path} = "..."' if path == "name" else _TELLS
        return SettingFault(source.place(path), path, f"{kind}.{path}: is missing", remedy)
    path, value = _found(source.values, path)
    listed = path.partition("[")[0]
    if listed in LISTS and path == listed and isinstance(value, str):
        remedy = f'write it like this: {listed} = "{LISTS[listed].example}"'
        return SettingFault(
            source.place(path), path, f"{kind}.{path}: {value!r} cannot be read as a list", remedy
        )
    from printer_slicer.profile.tables import choices_of  # noqa: PLC0415 - for errors only

    choices = [*PLANNER_SETTINGS] if path == "planner.kind" else choices_of(KINDS[kind], path).split(", ")
    remedy = f"{_hint(value, choices)}choose one of: {', '.join(choices)}" if any(choices) else _TELLS
    if path == "planner":
        remedy = 'write it like this: planner = { kind = "optimal" }'
    what = f"{kind}.{path}" if path else kind
    return SettingFault(source.place(path), path, f"{what}: {_in_words(problem, listed, value)}", remedy)


def _hint(value: object, choices: Sequence[str]) -> str:
    near = get_close_matches(str(value), choices, n=1)
    return f"did you mean {near[0]!r}? " if near else ""


_WORDS: Final[Mapping[str, str]] = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


def _in_words(problem: str, key: str, value: object) -> str:
    """What the library says is wrong with a value, without words of programmers."""
    found = re.fullmatch(r"Expected `([\w |]+)`(.*?)(, got `\w+`)?", problem)
    if "value '" in problem:
        return f"there is no {value!r}"
    if not found:
        return f"{problem.replace('`', '')}; it is {_shown(value)}"
    *others, last = (_WORDS.get(name, name) for name in found[1].split(" | "))
    expected = f"{', '.join(others)} or {last}" if others else last
    bounds = re.sub(r"(?<=\d)\.0$", "", found[2])
    if "regex" in bounds:
        bounds = f" such as {LISTS[key].example}" if key in LISTS else ""
    return f"expected {expected}{bounds}; it is {_shown(value)}"


def _shown(value: object) -> str:
    """A value for a message."""
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a table"
    text = str(value) if isinstance(value, date | time) else repr(value)
    return text if len(text) <= _LONG else f"{text[:_LONG]}..."


def _unknown(kind: str, source: SettingsSource, path: str) -> SettingFault:
    """A key that there is not: what is like it, or what there is."""
    known: Sequence[str] = keys_of(kind, source.values)
    key, table = path, path.rpartition("[")[0]
    if table in ENTRIES:
        known, key = ENTRIES[table].__struct_fields__, path.rpartition("].")[2]
    near = nearest(key, known)
    elsewhere = [other for other in KINDS if other != kind and path in keys_of(other, {})]
    remedy = f"did you mean {near!r}?" if near else f"known: {', '.join(known)}"
    if elsewhere:
        remedy = f"it belongs into a {elsewhere[0]} profile"
    return SettingFault(source.place(path), path, f"{kind}.{path}: no such setting", remedy)


def _found(values: Any, path: str) -> tuple[str, Any]:
    """Where the offending value is, and what it is: of a table of any keys the first that is no plain value."""
    for key in re.findall(r"[^.\[\]]+", path.removesuffix("[...]")):
        values = values[int(key) if isinstance(values, list | tuple) else key]
    if path.endswith("[...]"):
        key, values = next(
            (one for one in values.items() if not isinstance(one[1], str | int | float)), ("", "")
        )
        path = f"{path.removesuffix('[...]')}.{key}"
    return path, values
