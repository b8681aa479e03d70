"""The words of docs/glossary.md: roles, settings and JSON use its terms, and none of the words that it excludes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.roles import ROLES
from tests.cli.command_line import PARTS, typed

TEXT: Final = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")
BOX: Final = str(PARTS / "box.stl")
COMMANDS: Final = {
    "slice": ("slice", BOX, "-o", "box.gcode", "--quality", "standard"),
    "plan": ("plan", BOX),
    "dry-run": ("dry-run", "box.gcode"),
    "check": ("check", "box.gcode"),
    "check --model": ("check", "box.gcode", "--model", BOX),
    "draw": ("draw", "box.gcode", "--layer", "2", "-o", "layer.svg"),
    "contours": ("contours", BOX, "-o", "box.svg"),
    "profiles": ("profiles", "list"),
    "profiles show": ("profiles", "show"),
}
# Settings that PrusaSlicer and OrcaSlicer have under these names.
KEPT_SETTINGS: Final = ("quality.min_bead_width", "quality.max_bead_width")


def rows() -> Iterator[list[str]]:
    """Yield the cells of each row of the glossary's tables, without their headings."""
    for table in re.findall(r"(?m)(?:^\|.*\n)+", TEXT):
        for line in table.splitlines()[2:]:
            yield [cell.strip() for cell in line.strip("|").split("|")]


def excluded_words() -> list[str]:
    return sorted({plain(word) for *_, cell in rows() for word in re.findall(r"`([^`]+)`", cell)})


def plain(text: str) -> str:
    """Return the words of a text or name, in lower case with single spaces."""
    return " ".join(re.findall(r"[a-z0-9]+", text.lower()))


def find_excluded(texts: Iterator[str]) -> list[tuple[str, str]]:
    """Return (text, excluded word) for each excluded word in a text."""
    return [(text, word) for text in texts for word in excluded_words() if f" {word} " in f" {plain(text)} "]


def former_keys() -> set[str]:
    """Return the former JSON keys that the page on renamed keys lists; the next release removes them."""
    page = (Path(__file__).parents[1] / "docs" / "reference" / "renamed.md").read_text(encoding="utf-8")
    tables = re.findall(r"(?m)^\| (?:in|command) \| former \| now \|\n((?:^\|.*\n)+)", page)
    cells = [line.split("|")[2] for table in tables for line in table.splitlines()[1:]]
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


def strings_of(value: Any) -> Iterator[str]:
    """Yield the keys and the text values of a JSON document, without former keys and their values."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in former_keys():
                continue
            yield key
            yield from strings_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from strings_of(inner)
    elif isinstance(value, str):
        yield value


def numbers_of_layers(value: Any) -> Iterator[object]:
    """Yield the values under the key `layer` in a JSON document."""
    if isinstance(value, dict):
        if "layer" in value:
            yield value["layer"]
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from numbers_of_layers(inner)


def test_the_glossary_excludes_words() -> None:
    assert len(excluded_words()) > 20
    assert {"skin", "sparse", "outer perimeter", "rehearsal"} <= set(excluded_words())


def test_every_role_is_in_the_glossary() -> None:
    terms = {term for term, *_ in rows()}

    assert {row.type_comment for row in ROLES if row.type_comment} <= terms
    assert {purpose.label for purpose in Purpose} <= terms


def test_names_of_roles_have_no_excluded_words() -> None:
    names = [*(row.type_comment for row in ROLES), *(purpose.label for purpose in Purpose)]

    assert find_excluded(iter(names)) == []


def test_settings_have_no_excluded_words() -> None:
    settings = json.loads(typed("profiles", "settings", "--json").out)
    texts = [row["key"] for row in settings if row["key"] not in KEPT_SETTINGS]
    texts += [row["meaning"] for row in settings]

    assert len(settings) > 100
    assert find_excluded(iter(texts)) == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the G-code of a box."""
    made = tmp_path_factory.mktemp("glossary")
    assert typed(*COMMANDS["slice"], cwd=made).code == 0
    return made


@pytest.mark.parametrize("command", COMMANDS)
def test_json_has_no_excluded_words(command: str, folder: Path) -> None:
    outcome = typed(*COMMANDS[command], "--json", cwd=folder)

    assert outcome.code == 0, outcome.err
    texts = (text for text in strings_of(json.loads(outcome.out)) if text not in KEPT_SETTINGS)
    assert find_excluded(texts) == []


def test_diagnostics_have_the_documented_keys_and_the_former_lists_remain(folder: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "diagnostics.md").read_text(encoding="utf-8")
    table = page.partition("| key | value |\n")[2].partition("\n\n")[0]
    documented = {key for line in table.splitlines() for key in re.findall(r"`(\w+)`", line.split("|")[1])}
    (folder / "bad.gcode").write_text("G28\nG90\nM83\nG1 Z0.2 F600\nG1 X500 F900\nM303 E0\nFOO\n")
    for command, former in (("check", ["lint"]), ("dry-run", ["faults", "findings"])):
        facts = json.loads(typed(command, "bad.gcode", "--json", cwd=folder).out)
        found = [(one["code"], one["line"]) for one in facts["diagnostics"]]

        assert all(set(one) == documented for one in facts["diagnostics"])
        assert len(set(found)) == len(found)
        assert {("box", 5), ("autotune", 6), ("unknown", 7), ("feed", 4)} <= set(found)
        assert all({"what", "kind", "harmless"} <= set(one) for name in former for one in facts[name])
        assert {"what", "kind", "harmless", *former} <= former_keys()


@pytest.mark.parametrize("command", COMMANDS)
def test_json_counts_layers_from_1(command: str, folder: Path) -> None:
    found = list(numbers_of_layers(json.loads(typed(*COMMANDS[command], "--json", cwd=folder).out)))

    assert 0 not in found
    if command in ("dry-run", "draw"):
        assert found


@pytest.mark.parametrize(
    ("command", "key"), [("check --model", "volume_by_role"), ("dry-run", "seconds_by_role")]
)
def test_json_names_roles_as_the_glossary_does(command: str, key: str, folder: Path) -> None:
    facts = json.loads(typed(*COMMANDS[command], "--json", cwd=folder).out)
    roles = set((facts["material"] if command == "dry-run" else facts)[key])

    assert "External perimeter" in roles
    assert roles <= {term for term, *_ in rows()}
