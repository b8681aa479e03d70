"""A layer height that is typed: uniform layers of that height, or an error that says why not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command_line import BOX, Outcome, typed
from tests.effort import crossed

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


@pytest.mark.parametrize(
    ("command", "height", "planner"),
    crossed(
        ["slice", "plan", "dry-run"],
        [("--layer-height", "0.25"), ("--set", "layer_height=0.25")],
        [("--planner", "cusp"), ("--set", "quality.planner.kind=cusp")],
        laps=2,
    ),
)
def test_another_planner_and_a_layer_height_contradict_each_other(
    command: str, height: tuple[str, str], planner: tuple[str, str]
) -> None:
    refused = typed(command, BOX, *height, *planner)

    assert refused.code == 2
    assert "layer height 0.25: the cusp planner chooses the layer heights" in refused.err


def test_without_a_layer_height_the_default_planner_chooses() -> None:
    assert heights(typed("slice", BOX, "-o", "/dev/null", "--json"))[0] == "optimal"


def test_a_layer_height_beside_a_list_of_heights_is_an_error(tmp_path: Path) -> None:
    outcome = typed(
        "slice", BOX, "--layer-height", "0.2", "--heights", "0.1,0.15", "-o", tmp_path / "x.gcode"
    )

    assert outcome.code == 2
    assert "layer height 0.2" in outcome.err
    assert "--heights 0.1,0.15" in outcome.err


CHOOSING = {
    "--objective": ("--objective", "time"),
    "--time-budget": ("--time-budget", "45m"),
    "--range 1:3:tolerance=0.03": ("--range", "1:3:tolerance=0.03"),
    "--set planner.max_step": ("--set", "planner.max_step=0.05"),
    "--set smooth": ("--set", "smooth=false"),
}


@pytest.mark.parametrize(
    ("height", "name"),
    crossed([("--layer-height", "0.2"), ("--set", "quality.layer_height=0.2")], CHOOSING),
)
def test_a_layer_height_and_a_setting_of_planners_that_choose_heights_are_both_named(
    height: tuple[str, str], name: str
) -> None:
    flags = CHOOSING[name]
    refused = typed("plan", BOX, *height, *flags)
    also = typed("plan", BOX, *height, *flags, "--planner", "optimal")

    assert refused.code == also.code == 2
    assert f"layer height 0.2 and {name} contradict each other" in refused.err
    assert f"Leave out {name} or the layer height" in refused.err
    assert f"layer height 0.2 and --planner optimal, {name} contradict each other" in also.err
    assert "Leave out the layer height or the other options" in also.err


@pytest.mark.parametrize(
    ("flag", "planner", "between"),
    crossed(
        [("--layer-height", "0.2"), ("--set", "layer_height=0.2")],
        [(), ("--planner", "optimal")],
        [("--range", "1:3:layer_height=0.1"), ("--set", "planner.ranges=1:3:layer_height=0.1")],
        laps=2,
    ),
)
def test_a_layer_height_holds_but_where_a_range_has_another(
    flag: tuple[str, str], planner: tuple[str, ...], between: tuple[str, str], tmp_path: Path
) -> None:
    done = typed("slice", BOX, "-o", tmp_path / "x.gcode", "--json", *flag, *planner, *between)
    named, (first, second, third) = heights(done)

    assert named == "optimal"
    assert first == [5, 0.2]
    assert second == [20, 0.1]
    assert third[1] == 0.2


@pytest.mark.parametrize("planner", ["cusp", "uniform"])
def test_a_range_with_a_height_needs_a_planner_that_has_ranges(planner: str) -> None:
    refused = typed(
        "plan", BOX, "--layer-height", "0.2", "--range", "1:3:layer_height=0.1", "--planner", planner
    )

    assert refused.code == 2
    assert f"the {planner} planner does not support ranges" in refused.err
    assert f"Leave out --planner {planner}" in refused.err
