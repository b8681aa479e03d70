"""What `slice`, `plan` and `dry-run` tell about skirts, brims and rafts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import BOX, QUICK, typed


def facts(tmp_path: Path, *flags: object) -> dict[str, Any]:
    outcome = typed("slice", BOX, "-o", tmp_path / "box.gcode", "--json", *QUICK, *flags)
    assert (outcome.code, outcome.err) == (0, "")
    result: dict[str, Any] = json.loads(outcome.out)
    return result


def sets(**changes: object) -> list[str]:
    return [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]


def test_what_is_told_of_the_part_does_not_depend_on_a_raft(tmp_path: Path) -> None:
    bare, raised = facts(tmp_path), facts(tmp_path, *sets(raft_height=0.8, raft_gap=0.2))
    same = ("layers", "heights", "planner", "volume_mm3", "lost_mm3", "empty_layers", "begins_at")

    assert {key: bare[key] for key in same} == {key: raised[key] for key in same}
    assert bare["certificate"] == raised["certificate"]
    assert bare["raft"] is None
    assert raised["raft"]["gap_mm"] == 0.2
    assert sum(raised["raft"]["heights"]) == pytest.approx(0.8)
    assert raised["filament_mm"] > bare["filament_mm"]


def test_people_are_told_what_the_part_stands_on(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", *QUICK, *sets(raft_height=0.8))

    assert " on a raft of 0.8 mm (3 layers) with a gap of 0.16 mm" in outcome.out.splitlines()[1]


def test_the_layers_of_a_raft_can_be_drawn_and_rehearsed(tmp_path: Path) -> None:
    flags = ("--picture", tmp_path / "raft.svg", "--layer", 1)
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", *QUICK, *sets(raft_height=0.8), *flags)
    verdict = json.loads(typed("dry-run", BOX, "--json", *QUICK, *sets(raft_height=0.8)).out)

    assert outcome.code == 0
    assert "Support material</text>" in (tmp_path / "raft.svg").read_text(encoding="utf-8")
    assert verdict["heights_equal_plan"]
    assert verdict["planned"][:4] == pytest.approx([0.32, 0.56, 0.8, 0.8 + 0.16 + 0.2])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bed_x": 28, "bed_y": 28}, "The skirt is left out"),
        ({"bed_x": 33, "bed_y": 33, "skirt_loops": 9}, "the bed has no room: 6"),
        ({"bed_x": 33, "bed_y": 33, "skirt_min_length": 500}, "mm of filament short"),
    ],
)
def test_what_of_the_skirt_has_no_room_is_told(changes: dict[str, float], said: str, tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", *QUICK, *sets(**changes))

    assert outcome.code == 0
    assert said in outcome.out


@pytest.mark.parametrize(("model", "kind"), [("box.stl", "inner"), ("cone.stl", "ears")])
def test_a_brim_that_has_no_place_is_told(model: str, kind: str, tmp_path: Path) -> None:
    wanted = sets(brim_width=4, brim_type=kind)
    outcome = typed("slice", BOX.with_name(model), "-o", tmp_path / "b.gcode", *QUICK, *wanted)

    assert outcome.code == 0
    assert "No brim was made" in outcome.out
    assert (
        "No brim was made"
        not in typed("slice", BOX, "-o", tmp_path / "c.gcode", *QUICK, *sets(brim_width=4)).out
    )


def test_layers_that_hold_only_the_draft_shield_are_empty(tmp_path: Path) -> None:
    """The tip of a cone is narrower than a bead; the shield around it is no part of it."""
    cone = BOX.with_name("cone.stl")
    told = [
        json.loads(
            typed(
                "slice",
                cone,
                "-o",
                tmp_path / "c.gcode",
                "--json",
                *QUICK,
                *sets(skirt_height=h, min_feature=1),
            ).out
        )
        for h in (0, 10000)
    ]

    assert told[0]["empty_layers"] == told[1]["empty_layers"] > 0


def test_a_raft_beside_the_bed_is_refused_with_exit_code_3(tmp_path: Path) -> None:
    outcome = typed(
        "slice",
        BOX,
        "-o",
        tmp_path / "b.gcode",
        *QUICK,
        *sets(raft_height=0.8, raft_margin=50, bed_x=40, bed_y=40),
    )

    assert outcome.code == 3
    assert "Lower quality.raft_margin" in outcome.err
    assert list(tmp_path.iterdir()) == []
