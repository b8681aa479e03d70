"""List the settings of a profile that differ from their defaults, as rows, text and HTML."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from html import escape
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.profile.reading import flatten_tables
from printer_slicer.profile.tables import RATIO_UNITS, SettingRow, list_setting_definitions

__all__ = ["ChangedSetting", "format_differences_as_html", "format_differences_as_text", "list_differences"]

_MAX_CHANGES: Final = 24  # changes that are shown
_MAX_ROWS: Final = 6  # settings of each profile that are shown
_MAX_CHARACTERS: Final = 40  # characters of a value that are shown


class ChangedSetting(NamedTuple):
    """A setting that was changed, or that differs from its default.

    Attributes:
        key: such as `quality.perimeters`.
        value: the value with its unit; for G-code of several lines, the number of lines.
        default: the default with its unit; empty if every profile must set the setting.
        is_change: whether it was changed on top of the named profiles.
    """

    key: str
    value: str
    default: str
    is_change: bool


def list_differences(
    sections: Mapping[str, msgspec.Struct], changed: Collection[str]
) -> list[ChangedSetting]:
    """Return the changed settings, then all other settings that differ from their defaults; omit display names.

    Args:
        sections: `printer`, `material` and `quality` -> their settings, in the order of the rows.
        changed: keys of the changed settings.
    """
    rows = {row.key: row for row in list_setting_definitions()}
    found = [
        one
        for kind, section in sections.items()
        for one in _list_section_differences(kind, section, rows, changed)
    ]
    return sorted(found, key=lambda one: not one.is_change)


def _list_section_differences(
    kind: str, section: msgspec.Struct, rows: Mapping[str, SettingRow], changed: Collection[str]
) -> Iterator[ChangedSetting]:
    """Yield the settings of one section that were changed or that differ from their defaults."""
    values = msgspec.to_builtins(section)
    planner = values.get("planner", {}).get("kind", "")
    for path, value in flatten_tables(values):
        key = f"{kind}.{path}"
        row = rows.get(key) or rows.get(key.replace(".planner.", f".planner[{planner}]."))
        if row is None or path == "name":
            continue
        text = _format_value(value, row.unit)
        default = (
            ""
            if row.default in ("required", "empty")
            else _format_value(_parse_number(row.default), row.unit)
        )
        if text != default or key in changed:
            yield ChangedSetting(key, text, default, key in changed)


def _parse_number(text: str) -> object:
    """Convert a text to a number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _format_value(value: object, unit: str) -> str:
    """Format a value with its unit as one short line; ratios as percentages."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value * 100:.10g}%" if unit in RATIO_UNITS else f"{value:.10g} {unit}".rstrip()
    lines = str(value).strip().splitlines()
    text = lines[0] if lines else ""
    if len(lines) > 1:
        return f"{len(lines)} lines"
    return text if len(text) <= _MAX_CHARACTERS else f"{text[: _MAX_CHARACTERS - 1]}…"


def _format_headline(sections: Sequence[Any], rows: Sequence[ChangedSetting]) -> str:
    """Format the names of the profiles and the number of changed settings as one line."""
    printer, material, quality = (one.name for one in sections)
    count = sum(one.is_change for one in rows)
    changed = f"{count} setting{'' if count == 1 else 's'} changed" if count else "nothing changed"
    return f"printer {printer}, material {material}, quality {quality}; {changed}"


def _group_rows(rows: Sequence[ChangedSetting]) -> Iterator[tuple[str, Sequence[ChangedSetting], int]]:
    """Group rows by changes, then by profile; yield the title, the rows to show and the number of hidden rows."""
    groups: dict[str, list[ChangedSetting]] = {}
    for row in rows:
        kind = row.key.partition(".")[0]
        groups.setdefault("changed" if row.is_change else f"set by the {kind} profile", []).append(row)
    for title, members in groups.items():
        most = _MAX_CHANGES if members[0].is_change else _MAX_ROWS
        yield title, members[:most], max(len(members) - most, 0)


def format_differences_as_text(sections: Sequence[Any], rows: Sequence[ChangedSetting]) -> str:
    """Format differences as text: a line for the profile, then a line for each of the first rows of each group.

    Args:
        sections: printer, material and quality.
        rows: from `list_differences`.
    """
    width = max((len(one.key) for _, shown, _ in _group_rows(rows) for one in shown), default=0)
    lines = [f"<Profile: {_format_headline(sections, rows)}"]
    for title, shown, more in _group_rows(rows):
        lines.append(f"  {title}:")
        for one in shown:
            default = f"  (default {one.default})" if one.default else ""
            lines.append(f"    {one.key:{width}}  {one.value or 'empty'}{default}")
        lines += [f"    and {more} more"] if more else []
    return "\n".join([*lines, ">"]) if len(lines) > 1 else f"{lines[0]}>"


def format_differences_as_html(sections: Sequence[Any], rows: Sequence[ChangedSetting]) -> str:
    """Format the first rows of each group as an HTML table; arguments as for `format_differences_as_text`."""
    body = [_format_html_row(("setting", "value", "default"), "th")]
    for title, shown, more in _group_rows(rows):
        body.append(f'<tr><th colspan="3">{escape(title)}</th></tr>')
        body += [_format_html_row((one.key, one.value, one.default)) for one in shown]
        body += [_format_html_row((f"and {more} more", "", ""))] if more else []
    return f"<p>{escape(_format_headline(sections, rows))}</p><table>{''.join(body)}</table>"


def _format_html_row(cells: Sequence[str], tag: str = "td") -> str:
    """Return a row of an HTML table."""
    return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
