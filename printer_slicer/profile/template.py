"""Write a new profile that inherits from another one and lists all settings as comments."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import msgspec

from printer_slicer.profile.conversion import convert_section
from printer_slicer.profile.reading import SettingsSource
from printer_slicer.profile.tables import SettingRow, list_setting_rows

__all__ = ["format_new_profile", "format_toml_value"]

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")


def format_new_profile(kind: str, name: str, parent: str, source: SettingsSource, directive: str) -> str:
    """Format a profile that inherits from `parent` and changes only the name.

    Args:
        kind: `printer`, `material` or `quality`.
        name: display name.
        parent: name or path of the parent profile.
        source: the parent profile, whose values are shown.
        directive: the line with the schema for editors.
    """
    values = convert_section(kind, source)
    lines = [
        directive,
        f"# {name}: describe this profile here; `printer-slicer profiles` shows this line.",
        f"inherits = {format_toml_value(parent)}",
        f"name = {format_toml_value(name)}",
        "",
        "# All settings with their current values. Remove the # from the settings that you change.",
        f"# `printer-slicer profiles check FILE` checks this file; `profiles diff {parent} FILE` shows the changes.",
    ]
    return "\n".join([*lines, *_format_settings(values)]) + "\n"


def _format_settings(values: msgspec.Struct) -> Iterator[str]:
    """Yield commented lines for every setting of a group, with tables at the end."""
    rows = {
        row.key: row
        for row in list_setting_rows(type(values), "")
        if "." not in row.key and "[" not in row.key
    }
    tables = []
    for key in values.__struct_fields__:
        value = getattr(values, key)
        if isinstance(value, msgspec.Struct):
            tables.append((key, value))
        elif key != "name":
            yield from _format_setting(rows[key], value)
    for key, value in tables:
        yield from ("", f"# [{key}]")
        if kind := value.__struct_config__.tag:
            shown = format_toml_value(kind)
            yield f"# kind = {shown} # other kinds have other settings: see `profiles settings planner`"
        for row in list_setting_rows(type(value), ""):
            yield from _format_setting(row, getattr(value, row.key))


def _format_setting(row: SettingRow, value: object) -> Iterator[str]:
    """Yield commented lines with the meaning and the value of a setting."""
    unit = f" [{row.unit}]" if row.unit else ""
    bounds = f" ({row.bounds})" if row.bounds else ""
    yield ""
    yield f"# {row.meaning}{unit}{bounds}"
    yield from (
        f"# {line}" for line in f"{row.key} = {format_toml_value(msgspec.to_builtins(value))}".split("\n")
    )


def format_toml_value(value: object) -> str:
    """Format a value as TOML; a text of several lines keeps its lines."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return (
            "{ "
            + ", ".join(f"{_format_key(str(key))} = {format_toml_value(one)}" for key, one in value.items())
            + " }"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(format_toml_value(item) for item in value) + "]"
    if isinstance(value, str) and "\n" in value and not _CONTROL.search(value):
        plain = value.replace("\\", "\\\\").replace('"""', '""\\"')
        return f'"""\n{plain}"""'
    if isinstance(value, str):
        return _quote(value)
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def _format_key(key: str) -> str:
    """Format a key as TOML, in quotes if necessary."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quote(key)


def _quote(text: str) -> str:
    """Format a text as a TOML string on one line."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
