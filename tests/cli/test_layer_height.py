"""A layer height that is typed: uniform layers of that height, or an error that says why not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command_line import BOX, Outcome, typed

QUALITY = """
name = "own"
layer_height = 0.1
[planner]
kind = "optimal"
max_step = 0.05
"""


def heights(outcome: Outcome) -> tuple[str, list[list[float]]]:
    """The planner, and its runs of equal heights."""
    assert outcome.code == 0, outcome.err
    facts = json.loads(outcome.out)
    return facts["planner"], facts["heights"]


@pytest.mark.parametrize(
    "flags",
    [
        ("--layer-height", "0.25"),
        ("--set", "layer_height=0.25"),
        ("--set", "quality.layer_height=0.25"),
        ("--layer-height", "0.25", "--planner", "uniform"),
        ("--set", "layer_height=0.25", "--set", "planner.kind=uniform"),
        ("--quality", "own.toml", "--layer-height", "0.25"),
    ],
)
def test_a_layer_height_that_is_typed_is_the_height_of_all_layers(
    flags: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "own.toml").write_text(QUALITY)
    done = typed("slice", BOX, "-o", "box.gcode", "--first-layer", "0.25", "--json", *flags, cwd=tmp_path)
    planner, runs = heights(done)

    assert planner == "uniform"
    assert [height for _, height in runs] == [0.25]


@pytest.mark.parametrize("height", [("--layer-height", "0.25"), ("--set", "layer_height=0.25")])
@pytest.mark.parametrize("planner", [("--planner", "cusp"), ("--set", "quality.planner.kind=cusp")])
@pytest.mark.parametrize("command", ["slice", "plan", "dry-run"])
def test_another_planner_and_a_layer_height_contradict_each_other(
    command: str, height: tuple[str, str], planner: tuple[str, str]
) -> None:
    refused = typed(command, BOX, *height, *planner)

    assert refused.code == 2
    assert "layer height 0.25: the cusp planner chooses heights itself" in refused.err


def test_without_a_layer_height_the_default_planner_chooses() -> None:
    assert heights(typed("slice", BOX, "-o", "/dev/null", "--json"))[0] == "optimal"


def test_a_layer_height_beside_a_list_of_heights_is_an_error(tmp_path: Path) -> None:
    outcome = typed(
        "slice", BOX, "--layer-height", "0.2", "--heights", "0.1,0.15", "-o", tmp_path / "x.gcode"
    )

    assert outcome.code == 2
    assert "layer height 0.2" in outcome.err
    assert "--heights 0.1,0.15" in outcome.err
