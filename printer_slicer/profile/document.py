"""Write the reference of all settings in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.tables import SettingRow, list_setting_definitions

__all__ = ["format_overrides_markdown", "format_settings_markdown"]

_HEADING = """\
# Settings

All settings. This file is the output of `printer-slicer profiles settings --markdown`.

Use the keys in profile files and with `--set`: `--set infill_density=0.3`. If two sections have the same key, write the
section too: `--set material.name=mine`. [profiles.md](../profiles.md) explains how profiles are found, inherited and
checked.
"""


def format_settings_markdown() -> str:
    """Format all settings as the text of docs/reference/settings.md."""
    parts = [_HEADING]
    for table, rows in groupby(list_setting_definitions(), key=lambda row: row.key.rpartition(".")[0]):
        parts.append("\n".join([f"## {_format_title(table)}", "", *_format_table(table, list(rows))]) + "\n")
    return "\n".join(parts)


def format_overrides_markdown() -> str:
    """Format the table of docs/profiles.md: settings that can be overridden for objects and height ranges."""
    own = {row.key.partition(".")[2]: row.own for row in list_setting_definitions() if row.own}
    groups = {
        "objects and height ranges": {OBJECT, HEIGHT},
        "objects": {OBJECT},
        "height ranges": {HEIGHT},
    }
    lines = ["| for | settings |", "|---|---|"]
    for name, places in groups.items():
        keys = ", ".join(f"`{key}`" for key, where in own.items() if set(where) == places)
        lines.append(f"| {name} | {keys} |")
    return "\n".join(lines) + "\n"


def _format_title(table: str) -> str:
    """Return the heading of a group of settings."""
    found = re.fullmatch(r"(.+)\.planner\[(\w+)\]", table)
    if found:
        return f'Quality: `[planner]` with `kind = "{found[2]}"`'
    kind, _, inner = table.partition(".")
    if not inner:
        return kind.capitalize()
    return f"{kind.capitalize()}: `[{inner}]`"


def _format_table(table: str, rows: list[SettingRow]) -> Iterator[str]:
    """Yield the lines of a Markdown table."""
    yield "| key | default | unit | bounds | meaning |"
    yield "|---|---|---|---|---|"
    for row in rows:
        key = row.key.removeprefix(f"{table}.")
        bounds = row.bounds.replace("|", "/")
        default = f"`{row.default}`" if row.default not in ("empty", "required") else row.default
        yield f"| `{key}` | {default} | {row.unit} | {bounds} | {row.meaning.replace('|', '/')} |"
