"""The reference of all settings, as a document in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.tables import SettingRow, settings_table

__all__ = ["own_markdown", "settings_markdown"]

_HEADING = """\
# Settings

Every setting, as `printer-slicer profiles settings --markdown` writes it: this file is made from the code, and a test
tells when it is not. `KEY` is what stands in profile files and behind `--set`, with its section where two have the
same: `--set infill_density=0.3`, `--set material.name=mine`. [profiles.md](../profiles.md) tells how profiles are
found, inherited and checked.
"""


def settings_markdown() -> str:
    """The text of docs/reference/settings.md."""
    parts = [_HEADING]
    for table, rows in groupby(settings_table(), key=lambda row: row.key.rpartition(".")[0]):
        parts.append("\n".join([f"## {_title(table)}", "", *_table(table, list(rows))]) + "\n")
    return "\n".join(parts)


def own_markdown() -> str:
    """The table of docs/profiles.md: which settings objects and heights may have of their own."""
    own = {row.key.partition(".")[2]: row.own for row in settings_table() if row.own}
    groups = {
        "objects and heights": {OBJECT, HEIGHT},
        "objects": {OBJECT},
        "heights": {HEIGHT},
    }
    lines = ["| of | settings |", "|---|---|"]
    for name, places in groups.items():
        keys = ", ".join(f"`{key}`" for key, where in own.items() if set(where) == places)
        lines.append(f"| {name} | {keys} |")
    return "\n".join(lines) + "\n"


def _title(table: str) -> str:
    found = re.fullmatch(r"(.+)\.planner\[(\w+)\]", table)
    if found:
        return f'`[planner]` with `kind = "{found[2]}"`, of a {found[1]}'
    kind, _, inner = table.partition(".")
    if not inner:
        return kind.capitalize()
    return "Planner, of a quality" if inner == "planner" else f"`[{inner}]`, of a {kind}"


def _table(table: str, rows: list[SettingRow]) -> Iterator[str]:
    yield "| key | default | unit | bounds | meaning |"
    yield "|---|---|---|---|---|"
    for row in rows:
        key = row.key.removeprefix(f"{table}.")
        bounds = row.bounds.replace("|", "/")
        default = f"`{row.default}`" if row.default not in ("empty", "required") else row.default
        yield f"| `{key}` | {default} | {row.unit} | {bounds} | {row.meaning.replace('|', '/')} |"
