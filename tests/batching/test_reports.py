"""Names of files cannot change the report."""

from __future__ import annotations

import csv
from html.parser import HTMLParser

import pytest

from printer_slicer.batching.reports import make_csv, make_page
from printer_slicer.batching.tasks import BatchResult

NAMES = ["<script>alert(1)</script>.stl", '"><img src=x onerror=alert(1)>.stl', "<!--body-->.stl", "a&b'.stl"]


class Reader(HTMLParser):
    """Collects tags, and the values of the cells."""

    def __init__(self) -> None:
        super().__init__()
        self.tags, self.values = list[str](), list[str | None]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.values += [value for name, value in attrs if name == "data-value"]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_shows_names_as_they_are(name: str) -> None:
    result = BatchResult(name, "key", name, "hash", {"start_gcode": name}, problem=f"{name}: not a file")
    reader = Reader()
    reader.feed(make_page([result], name).decode())
    assert reader.tags.count("script") == 1
    assert "img" not in reader.tags
    assert reader.tags.count("tr") == 2
    assert reader.values[1:3] == [name, name]


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "+1", "-1", "@sum"])
def test_a_table_has_no_formulas(name: str) -> None:
    result = BatchResult(name, "key", f"{name}.stl", "hash", problem=f"{name}.stl: not a file")
    (row,) = csv.DictReader(make_csv([result]).decode().splitlines())
    assert row["part"] == f"'{name}.stl"
    assert row["problem"].startswith("'")
