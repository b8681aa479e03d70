"""The documents say what the code does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from benchmarks.readme import BLOCKS, written
from printer_slicer.diagnostics import CODES
from printer_slicer.importing.familiar import load_profile
from printer_slicer.planning import PLANNERS
from printer_slicer.stream.events import Accepted, Event, LineSent, get_event_kind
from printer_slicer.stream.states import TRANSITIONS

DOCS = Path(__file__).parent.parent / "docs"


def test_the_table_of_states_is_the_one_in_the_code() -> None:
    written = (
        DOCS.joinpath("wire.md").read_text().partition("<!-- states -->\n")[2].partition("<!-- end -->")[0]
    )
    coded = [
        f"| {state.value} | {trigger.value} | {after.value} |"
        for state, ways in TRANSITIONS.items()
        for trigger, after in ways.items()
    ]

    assert written.splitlines()[2:] == coded


def test_the_table_of_events_is_the_one_in_the_code() -> None:
    text = DOCS.joinpath("reference", "events.md").read_text()
    kinds = [kind for kind in get_args(Event) if kind not in {Accepted, LineSent}]
    coded = {(get_event_kind(kind(*[None] * len(kind.__struct_fields__))), kind.__name__) for kind in kinds}

    assert set(re.findall(r"^\| `(\w+)` \| `(\w+)` \|$", text, re.MULTILINE)) == coded


def test_every_planner_has_a_row_in_the_table_of_planners() -> None:
    text = DOCS.joinpath("layer-planning.md").read_text()

    assert [name for name in PLANNERS if f"| `{name}` |" not in text] == []


def test_the_table_of_diagnostics_is_the_one_in_the_code() -> None:
    written = (
        DOCS.joinpath("diagnostics.md")
        .read_text()
        .partition("<!-- codes -->\n")[2]
        .partition("<!-- end -->")[0]
    )

    assert written.splitlines()[2:] == [
        f"| `{name}` | {row.found_by} | {row.meaning} | {row.remedy} | {'yes' if row.allowed else ''} |"
        for name, row in CODES.items()
    ]


def changes_shown() -> list[tuple[str, str]]:
    """(key, value) of every `--set KEY=VALUE` in the documents, placeholders apart."""
    texts = [path.read_text() for path in [*sorted(DOCS.rglob("*.md")), DOCS.parent / "README.md"]]
    shown = re.findall(r"--set ([\w.]+)=([^`\s\"']+)", "\n".join(texts))
    return sorted({(key, value) for key, value in shown if not value.isupper()})


@pytest.mark.parametrize(("key", "value"), changes_shown())
def test_settings_that_the_documents_change_can_be_changed_so(key: str, value: str) -> None:
    load_profile(changes={key: value})


# The dry run is of a large part; the pictures of the gallery are as exact, and of small ones.
@pytest.mark.parametrize("name", BLOCKS)
def test_results_show_what_the_commands_print(name: str) -> None:
    assert written(name) == BLOCKS[name](), "`just readme` updates it"


def test_contributing_names_files_that_there_are_and_that_know_the_firmwares() -> None:
    root = DOCS.parent
    table = root.joinpath("CONTRIBUTING.md").read_text()
    rows = [
        line for line in table.splitlines() if line.startswith(("| a firmware |", "| a simulated printer"))
    ]
    named = set(re.findall(r"`([\w/]+\.py)`", "".join(rows)))
    files = [root / path if path.startswith("tests/") else root / "printer_slicer" / path for path in named]

    assert len(rows) == 2
    assert len(named) >= 6
    assert [path for path in files if "klipper" not in path.read_text().lower()] == []
