"""Convert settings to their types, check bounds, and report errors with file, line, key and bound."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import date, time
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.profile.keys import TABLE_LISTS, find_nearest_key, list_section_keys
from printer_slicer.profile.lists import LISTS
from printer_slicer.profile.reading import KINDS, SettingsSource
from printer_slicer.profile.settings import PLANNER_SETTINGS
from printer_slicer.texts import find_similar_words

__all__ = ["SettingFault", "convert_section", "find_first_fault"]

_SETTINGS_HINT = "`ps.find_settings()` lists types, units and bounds"
_MAX_SHOWN: Final = 60  # characters of a value in a message


class SettingFault(NamedTuple):
    """An error in one setting.

    Attributes:
        place: file and line, or the option that was typed.
        path: key without its section; empty if the whole section is wrong.
        problem: what is wrong, with key and value.
        remedy: what to do.
    """

    place: str
    path: str
    problem: str
    remedy: str

    def make_error(self) -> ProfileError:
        """Make an exception that describes the fault."""
        key, colon, problem = self.problem.partition(": ")
        typed, equals, value = self.place.partition("=")
        if colon and equals and f".{key}".endswith(f".{typed}"):  # the place shows key and value
            return ProfileError(f"{key}={value}: {problem.partition('; got ')[0]}", remedy=self.remedy)
        return ProfileError(f"{self.place}: {self.problem}", remedy=self.remedy)


def convert_section(kind: str, source: SettingsSource) -> Any:
    """Convert one section to a struct.

    Raises:
        ProfileError: a setting is invalid; names place, key and bound.
    """
    result = _try_conversion(kind, source.values)
    if isinstance(result, msgspec.ValidationError):
        raise _describe_fault(kind, source, result).make_error() from None
    return result


def _try_conversion(kind: str, values: Mapping[str, Any]) -> Any:
    """Convert a section to a struct; return the error of msgspec if that fails."""
    try:
        return msgspec.convert(_resolve_percentages(values, f"{kind}."), KINDS[kind], strict=False)
    except msgspec.ValidationError as error:
        return error


def _resolve_percentages(values: Any, key: str) -> Any:
    """Replace percentages such as "20%" by numbers in settings that are ratios; return the new settings.

    Args:
        values: the value of a setting, or a table of settings.
        key: the key of the setting; of a table, the beginning of the keys in it.
    """
    if isinstance(values, dict):
        return {
            name: _resolve_percentages(value, f"{key}{name}" + "." * isinstance(value, dict))
            for name, value in values.items()
        }
    if key.endswith(".overrides") and isinstance(values, list | tuple):
        return [_resolve_in_override(one) for one in values]
    if isinstance(values, str) and values.endswith("%"):
        from printer_slicer.profile.tables import is_ratio  # noqa: PLC0415 - for percentages only

        with suppress(ValueError):
            return f"{float(values[:-1]) / 100:.10g}" if is_ratio(key) else values
    return values


def _resolve_in_override(table: Any) -> Any:
    """Replace percentages in an override by numbers; return the new override."""
    if isinstance(table, dict) and isinstance(changes := table.get("set"), dict):
        return {**table, "set": {key: _resolve_percentages(value, key) for key, value in changes.items()}}
    return table


def find_first_fault(kind: str, source: SettingsSource) -> SettingFault | None:
    """Return the first fault of a section; None if there is none."""
    result = _try_conversion(kind, source.values)
    return _describe_fault(kind, source, result) if isinstance(result, msgspec.ValidationError) else None


def _describe_fault(kind: str, source: SettingsSource, error: msgspec.ValidationError) -> SettingFault:
    """Describe an error of msgspec, with the place of the setting and a remedy."""
    problem, _, where = str(error).partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    if "unknown field" in problem:
        return _describe_unknown_key(kind, source, f"{path}.{problem.split('`')[1]}".lstrip("."))
    if "missing required field" in problem:
        path = f"{path}.{problem.split('`')[1]}".lstrip(".")
        remedy = f'Set it, such as {path} = "..."' if path == "name" else _SETTINGS_HINT
        return SettingFault(source.find_place_or_file(path), path, f"{kind}.{path}: is missing", remedy)
    path, value = _locate_value(source.values, path)
    list_key = path.partition("[")[0]
    if list_key in LISTS and path == list_key and isinstance(value, str):
        remedy = f'Write it like this: {list_key} = "{LISTS[list_key].example}"'
        return SettingFault(
            source.find_place_or_file(path), path, f"{kind}.{path}: {value!r} is not a valid list", remedy
        )
    what = f"{kind}.{path}" if path else kind
    problem = f"{what}: {_describe_problem(problem, list_key, value)}"
    return SettingFault(source.find_place_or_file(path), path, problem, _find_remedy(kind, path, value))


def _find_remedy(kind: str, path: str, value: object) -> str:
    """Return what to do about an invalid value: the value that was probably meant, or the choices."""
    from printer_slicer.profile.tables import find_choices  # noqa: PLC0415 - for errors only

    if path == "planner":
        return 'Write it like this: planner = { kind = "optimal" }'
    if hint := _suggest_percentage(kind, path, value):
        return hint
    choices = [*PLANNER_SETTINGS] if path == "planner.kind" else find_choices(KINDS[kind], path).split(", ")
    if not any(choices):
        return _SETTINGS_HINT
    return f"{_suggest_choice(value, choices)}Choose one of: {', '.join(choices)}"


def _suggest_percentage(kind: str, path: str, value: object) -> str:
    """Suggest a percentage, as a question, for a number such as 20 in a ratio or in `infill`; else return ""."""
    from printer_slicer.profile.tables import is_ratio  # noqa: PLC0415 - for errors only

    found = re.fullmatch(r"(\d{1,2}(?:\.\d+)?|100)(%?)", str(value))
    if not found or not (path == "infill" or (is_ratio(f"{kind}.{path}") and not found[2])):
        return ""
    key = "infill_density" if path == "infill" else path
    return f"Did you mean {key}={found[1]}%?"


def _suggest_choice(value: object, choices: Sequence[str]) -> str:
    """Suggest the most similar choice, as a question; return an empty text if no choice is similar."""
    near = find_similar_words(str(value), choices, most=1)
    return f"Did you mean {near[0]!r}? " if near else ""


_TYPE_NAMES: Final[Mapping[str, str]] = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


def _describe_problem(problem: str, key: str, value: object) -> str:
    """Describe an error of msgspec without programming terms."""
    found = re.fullmatch(r"Expected `([\w |]+)`(.*?)(, got `\w+`)?", problem)
    if "value '" in problem:
        return f"unknown value {value!r}"
    if not found:
        return f"{problem.replace('`', '')}; got {_format_value(value)}"
    *others, last = (_TYPE_NAMES.get(name, name) for name in found[1].split(" | "))
    expected = f"{', '.join(others)} or {last}" if others else last
    bounds = re.sub(r"(?<=\d)\.0$", "", found[2])
    if "regex" in bounds:
        bounds = f" such as {LISTS[key].example}" if key in LISTS else ""
    return f"expected {expected}{bounds}; got {_format_value(value)}"


def _format_value(value: object) -> str:
    """Format a value for a message."""
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a table"
    text = str(value) if isinstance(value, date | time) else repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def _describe_unknown_key(kind: str, source: SettingsSource, path: str) -> SettingFault:
    """Describe an unknown key, and suggest a similar key or list the known keys."""
    known: Sequence[str] = list_section_keys(kind, source.values)
    key, table = path, path.rpartition("[")[0]
    if table in TABLE_LISTS:
        known, key = TABLE_LISTS[table].__struct_fields__, path.rpartition("].")[2]
    near = find_nearest_key(key, known)
    elsewhere = [other for other in KINDS if other != kind and path in list_section_keys(other, {})]
    remedy = f"Did you mean {near!r}?" if near else f"Known settings: {', '.join(known)}"
    if elsewhere:
        remedy = f"Move it to a {elsewhere[0]} profile"
    return SettingFault(source.find_place_or_file(path), path, f"{kind}.{path}: no such setting", remedy)


def _locate_value(values: Any, path: str) -> tuple[str, Any]:
    """Return the key and the value of an invalid setting.

    If its table allows any keys, this is the first value that is not a number, a text or a boolean.
    """
    for key in re.findall(r"[^.\[\]]+", path.removesuffix("[...]")):
        values = values[int(key) if isinstance(values, list | tuple) else key]
    if path.endswith("[...]"):
        key, values = next(
            (one for one in values.items() if not isinstance(one[1], str | int | float)), ("", "")
        )
        path = f"{path.removesuffix('[...]')}.{key}"
    return path, values
