"""List the settings of a profile that differ from their defaults, as rows, text and HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Final, NamedTuple

import msgspec

from printer_slicer.profile.reading import flatten
from printer_slicer.profile.tables import SettingRow, settings_table

__all__ = ["ChangedSetting", "differences_as_html", "differences_as_text", "list_differences"]

_MOST_ROWS: Final = 24  # rows that are shown
_MOST_CHARACTERS: Final = 40  # characters of a value that are shown


class ChangedSetting(NamedTuple):
    """A setting that differs from its default.

    Attributes:
        key: such as `quality.perimeters`.
        value: text of the value; for G-code of several lines, the number of lines.
        unit: unit of both; empty if the setting has none.
        default: text of the default; empty if every profile must set the setting.
    """

    key: str
    value: str
    unit: str
    default: str


def list_differences(sections: Mapping[str, msgspec.Struct]) -> list[ChangedSetting]:
    """Return the settings that differ from their defaults, without display names.

    Args:
        sections: `printer`, `material` and `quality` -> their settings, in the order of the rows.
    """
    rows = {row.key: row for row in settings_table()}
    return [
        one for kind, section in sections.items() for one in _list_section_differences(kind, section, rows)
    ]


def _list_section_differences(
    kind: str, section: msgspec.Struct, rows: Mapping[str, SettingRow]
) -> Iterator[ChangedSetting]:
    """Yield the differences of one section."""
    values = msgspec.to_builtins(section)
    planner = values.get("planner", {}).get("kind", "")
    for path, value in flatten(values):
        key = f"{kind}.{path}"
        row = rows.get(key) or rows.get(key.replace(".planner.", f".planner[{planner}]."))
        if row is None or path == "name":
            continue
        text = _format_value(value)
        default = "" if row.default in ("required", "empty") else _format_value(_parse_number(row.default))
        if text != default:
            yield ChangedSetting(key, text, row.unit, default)


def _parse_number(text: str) -> object:
    """Convert a text to a number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _format_value(value: object) -> str:
    """Format a value as one short line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.10g}"
    lines = str(value).strip().splitlines()
    text = lines[0] if lines else ""
    if len(lines) > 1:
        return f"{len(lines)} lines"
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 1]}…"


def _format_headline(names: Sequence[str], count: int) -> str:
    """Return a line with the names of the profile and the number of changed settings."""
    printer, material, quality = names
    return (
        f"printer {printer}, material {material}, quality {quality}; "
        f"{count} setting{'' if count == 1 else 's'} differ{'s' if count == 1 else ''} from the defaults"
    )


def differences_as_text(names: Sequence[str], rows: Sequence[ChangedSetting]) -> str:
    """Return a text with one line for the profile and one line for each of the first rows.

    Args:
        names: display names of printer, material and quality.
        rows: from `list_differences`.
    """
    shown = rows[:_MOST_ROWS]
    width = max((len(one.key) for one in shown), default=0)
    lines = [f"<Profile: {_format_headline(names, len(rows))}"]
    for one in shown:
        value = f"{one.value} {one.unit}".rstrip() or "empty"
        lines.append(f"  {one.key:{width}}  {value}" + (f"  (default {one.default})" if one.default else ""))
    lines += [f"  and {len(rows) - len(shown)} more"] if len(shown) < len(rows) else []
    return "\n".join([*lines, ">"]) if len(lines) > 1 else f"{lines[0]}>"


def differences_as_html(names: Sequence[str], rows: Sequence[ChangedSetting]) -> str:
    """Return an HTML table of the first rows; arguments as for `differences_as_text`."""
    head = "".join(f"<th>{title}</th>" for title in ("setting", "value", "unit", "default"))
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in one) + "</tr>" for one in rows[:_MOST_ROWS]
    )
    more = f"<p>and {len(rows) - _MOST_ROWS} more</p>" if len(rows) > _MOST_ROWS else ""
    title = escape(_format_headline(names, len(rows)))
    return f"<p>{title}</p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"
