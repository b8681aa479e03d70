"""Parts are turned from the command line: --orient, its options, and the command `orient`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import QUICK, is_message, typed

import printer_slicer as ps
from tests.mesh_io.tiny_files import binary_stl
from tests.parts import box
from tests.supports.shapes import tee

TEE = tee(8.0, 12.0, 6.0, 3.0)


@pytest.fixture
def tee_file(tmp_path: Path) -> Path:
    path = tmp_path / "tee.stl"
    path.write_bytes(binary_stl(TEE.triangles))
    return path


def test_slice_turns_the_part_and_says_so_in_a_line_and_in_the_gcode(tee_file: Path, tmp_path: Path) -> None:
    output = tmp_path / "tee.gcode"
    outcome = typed("slice", str(tee_file), "-o", str(output), "--orient", "fast", *QUICK)

    assert outcome.code == 0, outcome.err
    line = next(line for line in outcome.err.splitlines() if "tee.stl: rotated by" in line)
    angles = line.partition("rotated by ")[2].partition(" ")[0]
    assert "g of support instead of" in line
    assert f"; tee.stl: rotated by {angles} degrees about x, y, z (orient: fast)" in output.read_text()

    again = tmp_path / "again.gcode"
    assert typed("slice", str(tee_file), "-o", str(again), f"--rotate={angles}", *QUICK).code == 0
    moves = [
        [one for one in path.read_text().splitlines() if one.startswith("G1")] for path in (output, again)
    ]
    assert moves[0] == moves[1]


def test_json_tells_the_rotation(tee_file: Path, tmp_path: Path) -> None:
    outcome = typed(
        "slice", str(tee_file), "-o", str(tmp_path / "x.gcode"), "--orient", "fast", "--json", *QUICK
    )
    (found,) = json.loads(outcome.out)["orientations"]

    assert found["file"] == str(tee_file)
    assert found["height_mm"] == pytest.approx(6)
    assert found["support_g"] == 0
    assert not found["original"]


def test_a_part_that_lies_well_is_not_turned(tmp_path: Path) -> None:
    path, output = tmp_path / "tile.stl", tmp_path / "tile.gcode"
    path.write_bytes(binary_stl(box((12, 9, 2)).triangles))
    outcome = typed("slice", str(path), "-o", str(output), "--orient", "fast", *QUICK)

    assert "tile.stl: not rotated" in outcome.err
    assert "; tile.stl: not rotated (orient: fast)" in output.read_text()


def test_several_parts_are_turned_one_by_one_and_then_arranged(tee_file: Path, tmp_path: Path) -> None:
    post = tmp_path / "post.stl"
    post.write_bytes(binary_stl(box((5, 6, 14)).triangles))
    outcome = typed(
        "slice",
        str(tee_file),
        str(post),
        "-o",
        str(tmp_path / "x.gcode"),
        "--orient",
        "fast",
        "--json",
        *QUICK,
    )
    facts = json.loads(outcome.out)

    assert outcome.code == 0, outcome.err
    assert [Path(one["file"]).name for one in facts["orientations"]] == ["tee.stl", "post.stl"]
    assert [one["height_mm"] for one in facts["orientations"]] == pytest.approx([6, 5])


def test_orient_lists_the_ways_and_marks_the_chosen_one(tee_file: Path) -> None:
    outcome = typed("orient", str(tee_file), "--quality", "standard")
    rows = [line for line in outcome.out.splitlines() if " mm²" in line]

    assert outcome.code == 0, outcome.err
    assert sum(line.startswith(" *") for line in rows) == 1
    assert sum("as in the file" in line for line in rows) == 1


def test_a_row_of_the_table_can_be_chosen(tee_file: Path, tmp_path: Path) -> None:
    table = json.loads(typed("orient", str(tee_file), "--json", *QUICK).out)["models"][0]
    outcome = typed(
        "slice",
        str(tee_file),
        "-o",
        str(tmp_path / "x.gcode"),
        "--orient",
        "fast",
        "--orient-row",
        "3",
        "--json",
        *QUICK,
    )

    assert table["chosen_row"] == 1
    assert json.loads(outcome.out)["orientations"][0]["rotate"] == table["rows"][2]["rotate"]


def test_the_careful_table_tells_what_was_sliced(tee_file: Path) -> None:
    table = json.loads(typed("orient", str(tee_file), "--careful", "--json", *QUICK).out)["models"][0]

    assert [row["sliced"] for row in table["rows"][:4]] == [True] * 4


def test_the_upper_side_can_be_kept_up(tee_file: Path) -> None:
    table = json.loads(typed("orient", str(tee_file), "--keep-up", "20", "--json", *QUICK).out)["models"][0]

    for row in table["rows"]:
        turned = ps.transform(TEE, rotate=tuple(row["rotate"]))
        assert turned.height == pytest.approx(TEE.height, rel=0.4)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--orient-row", "2"], "--orient-row 2: this option has no effect without --orient"),
        (["--orient-keep-up", "60"], "--orient-keep-up 60: this option has no effect without --orient"),
        (["--orient", "fast", "--orient-row", "99"], "--orient-row 99: there are "),
        (["--orient", "fast", "--support-blocker", "TEE"], "does not turn with the part"),
        (["--orient", "best"], "best"),
        (["--orient", "fast", "--orient-keep-up", "190"], "degrees from 0 to 180"),
    ],
    ids=lambda one: one if isinstance(one, str) else " ".join(one),
)
def test_options_that_do_not_go_together_are_refused(
    tee_file: Path, tmp_path: Path, flags: list[str], message: str
) -> None:
    flags = [str(tee_file) if flag == "TEE" else flag for flag in flags]
    outcome = typed("slice", str(tee_file), "-o", str(tmp_path / "x.gcode"), *flags, *QUICK)

    assert outcome.code == 2
    assert message in outcome.err
    assert is_message(outcome, message)


def test_rows_need_a_single_model(tee_file: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.stl"
    other.write_bytes(binary_stl(box((4, 4, 2)).triangles))
    outcome = typed(
        "slice",
        str(tee_file),
        str(other),
        "-o",
        str(tmp_path / "x.gcode"),
        "--orient",
        "fast",
        "--orient-row",
        "1",
    )

    assert outcome.code == 2
    assert "each with rows of its own" in outcome.err


@pytest.fixture
def plate_file(tmp_path: Path, tee_file: Path) -> Path:
    """A 3MF plate with a tee and a tile, side by side."""
    tile, path = tmp_path / "tile.stl", tmp_path / "plate.3mf"
    tile.write_bytes(binary_stl(box((12, 9, 2)).triangles))
    assert typed("arrange", str(tee_file), str(tile), "-o", str(path)).code == 0
    return path


def test_the_parts_of_a_plate_are_turned_one_by_one(plate_file: Path, tmp_path: Path) -> None:
    output = tmp_path / "plate.gcode"
    outcome = typed("slice", str(plate_file), "-o", str(output), "--orient", "fast", "--json", *QUICK)
    assert outcome.code == 0, outcome.err
    facts = json.loads(outcome.out)

    assert {one["part"]: one["height_mm"] for one in facts["orientations"]} == pytest.approx(
        {"tee": 6, "tile": 2}
    )
    assert "the parts of plate.3mf are oriented one by one: arranged 2 parts" in outcome.err
    assert "; plate.3mf, tile: not rotated (orient: fast)" in output.read_text()


@pytest.mark.parametrize("position", [["--as-placed"], ["--center", "100,100"]])
def test_parts_that_are_turned_one_by_one_cannot_keep_positions(
    plate_file: Path, tmp_path: Path, position: list[str]
) -> None:
    line = ["slice", str(plate_file), "-o", str(tmp_path / "x.gcode"), "--orient", "fast", *position, *QUICK]
    refused, fused = typed(*line), typed(*line, "--fuse")

    assert refused.code == 2
    assert f"{position[0]}: --orient turns each of the 2 parts of plate.3mf" in refused.err
    assert fused.code == 0, fused.err
    assert "plate.3mf: " in fused.err


def test_orient_has_a_table_for_each_part_of_a_plate(plate_file: Path) -> None:
    outcome = typed("orient", str(plate_file), *QUICK)
    assert "plate.3mf, tee: orientations" in outcome.out
    assert "plate.3mf, tile: orientations" in outcome.out
