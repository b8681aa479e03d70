"""The lists of infill patterns agree: the table, the setting, and the import rule."""

from __future__ import annotations

import tomllib
from pathlib import Path

from printer_slicer.infill import PATTERNS
from printer_slicer.profile.tables import list_setting_definitions

ROOT = Path(__file__).parents[2]


def test_the_setting_has_the_names_of_the_table() -> None:
    known = next(row[3] for row in list_setting_definitions() if row[0] == "quality.infill")

    assert sorted(PATTERNS) == sorted(known.split(" | ")), "profile/quality.py lists the names, too"


def test_the_import_rule_names_the_file_of_every_pattern() -> None:
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    ruled = next(rule["modules"] for rule in rules if rule["id"] == "patterns")

    assert {pattern.__module__ for pattern in PATTERNS.values()} == set(ruled)


def test_the_documents_have_a_row_for_every_pattern() -> None:
    text = (ROOT / "docs" / "infill.md").read_text()

    assert [name for name in PATTERNS if f"| `{name}` |" not in text] == []
