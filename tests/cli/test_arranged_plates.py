"""Parts on one command line are arranged on plates: copies, overlaps, several plates, one of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import QUICK, Outcome, is_message, typed

from printer_slicer.cli.inputs import _expand_model
from printer_slicer.errors import UsageError
from tests.mesh_io.tiny_files import binary_stl, item, mesh_xml, model_xml, three_mf
from tests.parts import box


def part(folder: Path, name: str, size: tuple[float, float, float]) -> Path:
    """A file with a box whose corner is at the origin."""
    path = folder / name
    path.write_bytes(binary_stl(box(size).triangles))
    return path


def facts(outcome: Outcome) -> list[dict[str, Any]]:
    assert outcome.code == 0, outcome.err
    return [json.loads(line) for line in outcome.out.splitlines()]


def centres(parts: Sequence[dict[str, Any]]) -> np.ndarray[Any, Any]:
    return np.array([(one["x"], one["y"]) for one in parts])


# Names of copies


def test_a_number_of_copies_stands_behind_the_name(tmp_path: Path) -> None:
    path = part(tmp_path, "a.stl", (9, 9, 3))
    other = part(tmp_path, "b.stl", (9, 9, 3))

    assert _expand_model(Path(f"{path}*3")) == [path] * 3
    assert _expand_model(Path(f"{path}*1")) == [path]
    assert _expand_model(tmp_path / "*.stl*2") == [path, path, other, other]
    assert _expand_model(tmp_path / "*.stl") == [path, other]
    assert _expand_model(Path(f"{path}*")) == [path]
    assert _expand_model(Path("none.stl*2")) == [Path("none.stl")] * 2


@pytest.mark.parametrize("count", ["0", "x", "-2", "1.5", "1001"])
def test_a_wrong_number_of_copies_is_named(tmp_path: Path, count: str) -> None:
    path = part(tmp_path, "a.stl", (9, 9, 3))

    with pytest.raises(UsageError, match=rf"'{count}' is not a number of copies from 1 to 1000") as caught:
        _expand_model(Path(f"{path}*{count}"))
    assert f"{path}*3" in str(caught.value)


def test_a_file_whose_name_has_a_star_is_that_file(tmp_path: Path) -> None:
    part(tmp_path, "a.stl", (9, 9, 3))
    path = part(tmp_path, "a.stl*12", (9, 9, 3))

    assert _expand_model(path) == [path]
    outcome = typed("slice", path, "-o", tmp_path / "a.gcode", "--json", *QUICK)
    assert facts(outcome)[0]["parts"] == []


# One plate


@pytest.mark.parametrize("command", ["slice", "plan", "dry-run"])
def test_parts_that_overlap_in_their_files_are_arranged(tmp_path: Path, command: str) -> None:
    names = ("one", "two", "three", "four")
    paths = [part(tmp_path, f"{name}.stl", (20, 10 + 2 * at, 3)) for at, name in enumerate(names)]

    outcome = typed(command, *paths, "--json", *QUICK)
    (found,) = facts(outcome)
    assert "two.stl overlaps one.stl by 20 x 10 mm" in outcome.err
    assert (
        "others overlap as well, at the positions in their files: arranged 4 parts on 1 plate, at least 6 mm apart"
        in outcome.err
    )
    assert found["plates"] == 1
    assert [one["name"] for one in found["parts"]] == list(names)
    for one, other in combinations(centres(found["parts"]), 2):
        assert np.abs(one - other).max() >= 16


def test_parts_that_stand_apart_keep_their_positions_unless_asked(tmp_path: Path) -> None:
    one = part(tmp_path, "one.stl", (10, 10, 3))
    two = tmp_path / "two.stl"
    two.write_bytes(binary_stl(box((10, 10, 3), at=(150, 0, 0)).triangles))

    (kept,) = facts(typed("slice", one, two, "--json", *QUICK))
    (arranged,) = facts(typed("slice", one, two, "--json", "--arrange", *QUICK))
    assert kept["parts"] == []
    assert np.ptp(centres(arranged["parts"]), axis=0).max() < 30


def test_parts_too_far_apart_for_the_bed_are_arranged(tmp_path: Path) -> None:
    one = part(tmp_path, "one.stl", (10, 10, 3))
    two = tmp_path / "two.stl"
    two.write_bytes(binary_stl(box((10, 10, 3), at=(500, 0, 0)).triangles))

    outcome = typed("slice", one, two, *QUICK)
    assert outcome.code == 0
    assert "do not fit the bed: arranged 2 parts on 1 plate" in outcome.err


@pytest.mark.parametrize("flags", [("--as-placed",), ("--center", "100,100")])
def test_given_positions_of_parts_that_overlap_are_rejected(tmp_path: Path, flags: tuple[str, ...]) -> None:
    paths = [part(tmp_path, name, (20, 10, 3)) for name in ("one.stl", "two.stl")]

    outcome = typed("slice", *paths, *flags, *QUICK)
    assert outcome.code == 3
    assert is_message(outcome, "two.stl overlaps one.stl by 20 x 10 mm", f"Leave out {flags[0]}", "--fuse")


def test_options_that_contradict_each_other_are_rejected(tmp_path: Path) -> None:
    path = part(tmp_path, "a.stl", (20, 10, 3))

    assert typed("slice", path, "--arrange", "--as-placed").code == 2
    assert typed("slice", path, "--arrange", "--center", "50,50").code == 2
    assert is_message(typed("slice", f"{path}*2", "--as-placed", *QUICK), "several copies of a model")
    assert is_message(typed("slice", path, "--as-placed", "--gap", "3", *QUICK), "--gap")


def test_copies_have_the_gap_that_is_given(tmp_path: Path) -> None:
    path = part(tmp_path, "a.stl", (20, 20, 3))

    for flags, gap in ((("--copies", "2"), 6), (("--copies", "2", "--gap", "20"), 20)):
        (found,) = facts(typed("slice", path, "--json", *flags, *QUICK))
        near = np.abs(np.diff(centres(found["parts"]), axis=0)).max()
        assert 20 + gap <= near <= 20 + gap + 2.5
        assert found["models"] == [{**found["models"][0], "file": str(path)}]


def test_fused_models_are_copied_together(tmp_path: Path) -> None:
    one, two = part(tmp_path, "one.stl", (20, 20, 3)), part(tmp_path, "two.stl", (30, 10, 3))

    (twice,) = facts(typed("slice", f"{one}*2", f"{two}*2", "--fuse", "--json", *QUICK))
    assert len(twice["parts"]) == 2
    (kept,) = facts(typed("slice", one, two, "--fuse", "--json", *QUICK))
    assert kept["parts"] == []
    assert "different numbers of copies" in typed("slice", f"{one}*2", two, "--fuse", *QUICK).err


def test_copies_may_have_a_common_centre(tmp_path: Path) -> None:
    path = part(tmp_path, "a.stl", (20, 20, 3))
    flags = ("--copies", "2", "--center", "50,60", "-o", tmp_path / "a.svg", "--json")

    low, high = np.array(facts(typed("contours", path, *flags, *QUICK))[0]["bounds"])
    assert ((low + high) / 2)[:2] == pytest.approx((50, 60))
    assert max((high - low)[:2]) > 46


def test_objects_of_a_project_are_arranged_one_by_one(tmp_path: Path) -> None:
    shift = (1, 0, 0, 0, 1, 0, 0, 0, 1, 60, 0, 0)
    path = tmp_path / "plate.3mf"
    path.write_bytes(three_mf(model_xml({1: mesh_xml(), 2: mesh_xml()}, item(1) + item(2, shift))))

    (kept,) = facts(typed("slice", path, "--json", *QUICK))
    (whole,) = facts(typed("slice", f"{path}*2", "--json", *QUICK))
    (split,) = facts(typed("slice", path, "--json", "--arrange", *QUICK))
    assert kept["parts"] == []
    assert len(whole["parts"]) == 2
    assert len(split["parts"]) == 2
    assert np.ptp(centres(split["parts"]), axis=0).max() < 20


def test_settings_of_an_object_apply_to_its_copies(tmp_path: Path) -> None:
    one, two = (part(tmp_path, name, (30, 30, 3)) for name in ("one.stl", "two.stl"))
    flags = (one, f"{two}*2", "--json", *QUICK)

    (plain,) = facts(typed("slice", *flags))
    (solid,) = facts(typed("slice", *flags, "--set-for", "two:infill_density=1"))
    (single,) = facts(typed("slice", *flags, "--set-for", "two_2:infill_density=1"))
    assert plain["filament_mm"] < single["filament_mm"] < solid["filament_mm"]


# Several plates


def test_several_plates_become_several_files(tmp_path: Path) -> None:
    big, small = part(tmp_path, "big.stl", (150, 150, 1)), part(tmp_path, "small.stl", (20, 20, 1))
    output = tmp_path / "out.gcode"

    outcome = typed("slice", f"{big}*2", small, "-o", output, *QUICK)
    assert outcome.code == 0
    assert [line.partition(":")[0] for line in outcome.out.splitlines() if ".gcode:" in line] == [
        str(tmp_path / "out-1.gcode"),
        str(tmp_path / "out-2.gcode"),
    ]
    assert not output.exists()
    found = facts(typed("slice", f"{big}*2", small, "-o", output, "--json", *QUICK))
    assert [one["output"] for one in found] == [str(tmp_path / f"out-{number}.gcode") for number in (1, 2)]
    assert [(one["plate"], one["plates"]) for one in found] == [(1, 2), (2, 2)]
    assert sorted((one["name"], one["plate"]) for one in found[0]["parts"])[:2] == [("big", 1), ("big", 2)]


def test_one_of_several_plates_can_be_chosen(tmp_path: Path) -> None:
    big = part(tmp_path, "big.stl", (150, 150, 1))
    output = tmp_path / "out.gcode"

    for command in ("plan", "dry-run", "print"):
        more = ("--port", "sim:") if command == "print" else ()
        outcome = typed(command, f"{big}*3", *more, *QUICK)
        assert outcome.code == 2
        assert is_message(outcome, "the parts need 3 plates", "plate 2: big; plate 3: big", "--plate N")
    assert typed("plan", f"{big}*3", "--plate", "3", *QUICK).code == 0
    assert typed("slice", f"{big}*3", "--plate", "2", "-o", output, *QUICK).code == 0
    assert output.exists()
    assert is_message(typed("slice", f"{big}*3", "--plate", "4", *QUICK), "the parts need 3 plates")
    assert is_message(typed("slice", big, "--plate", "2", *QUICK), "all parts are on 1 plate")
    assert "the parts need 2 plates; plate 2: big" in typed("slice", f"{big}*2", "-o", "-", *QUICK).err


def test_settings_of_objects_that_are_on_one_plate_only(tmp_path: Path) -> None:
    one, two = part(tmp_path, "one.stl", (150, 150, 1)), part(tmp_path, "two.stl", (150, 150, 1))
    output = tmp_path / "out.gcode"

    flags = ("--set-for", "one:perimeters=4", "--set-for", "two:perimeters=5", "-o", output, *QUICK)
    assert typed("slice", one, two, *flags).code == 0
    wrong = typed("slice", one, two, "--set-for", "three:perimeters=4", "-o", output, *QUICK)
    assert is_message(wrong, "no object named 'three'")


def test_each_model_gets_a_file_with_its_copies(tmp_path: Path) -> None:
    one, two = part(tmp_path, "one.stl", (20, 20, 1)), part(tmp_path, "two.stl", (20, 20, 1))

    assert typed("slice", f"{one}*2", two, "-o", f"{tmp_path}/gcode/", *QUICK).code == 0
    assert sorted(path.name for path in (tmp_path / "gcode").iterdir()) == ["one.gcode", "two.gcode"]


def test_a_part_that_does_not_fit_is_named(tmp_path: Path) -> None:
    long, high = part(tmp_path, "long.stl", (500, 10, 3)), part(tmp_path, "high.stl", (10, 10, 600))
    small = part(tmp_path, "small.stl", (10, 10, 3))

    assert is_message(
        typed("slice", small, long, *QUICK), "long: the part is 141 mm in x and 141 mm in y too large"
    )
    assert is_message(typed("slice", small, high, *QUICK), "high: the part is", "mm too high")


def test_a_model_is_compared_with_arranged_parts(tmp_path: Path) -> None:
    one, two = part(tmp_path, "one.stl", (30, 30, 3)), part(tmp_path, "two.stl", (50, 20, 3))
    output = tmp_path / "out.gcode"

    assert typed("slice", one, f"{two}*2", "-o", output, *QUICK).code == 0
    assert typed("check", output, "--model", one, f"{two}*2").code == 0
    assert typed("draw", output, "--model", one, f"{two}*2", "-o", tmp_path / "a.svg").code == 0


# Everything together


def test_time_and_filament_of_each_object_are_told(tmp_path: Path) -> None:
    big, small = part(tmp_path, "big.stl", (40, 40, 6)), part(tmp_path, "small.stl", (20, 20, 3))
    flags = (big, f"{small}*2", "-o", tmp_path / "out.gcode", *QUICK)

    (found,) = facts(typed("slice", *flags, "--json"))
    objects = found["objects"]
    assert [one["name"] for one in objects] == ["big", "small", "small_2"]
    assert objects[1]["filament_mm"] == pytest.approx(objects[2]["filament_mm"], rel=0.02)
    assert objects[0]["filament_mm"] > 3 * objects[1]["filament_mm"]
    assert 0.9 * found["filament_mm"] < sum(one["filament_mm"] for one in objects) <= found["filament_mm"]
    assert 0.7 * found["seconds"] < sum(one["seconds"] for one in objects) < found["seconds"]
    assert "  Objects: big " in typed("slice", *flags).out
    assert "Objects" not in typed("slice", big, "-o", tmp_path / "out.gcode", *QUICK).out


@pytest.mark.parametrize("printer", ["marlin_220", "corexy_klipper"])
def test_objects_of_arranged_plates_are_labelled_and_can_be_cancelled(tmp_path: Path, printer: str) -> None:
    shift = (1, 0, 0, 0, 1, 0, 0, 0, 1, 60, 0, 0)
    project = tmp_path / "both.3mf"
    project.write_bytes(three_mf(model_xml({1: mesh_xml(), 2: mesh_xml()}, item(1) + item(2, shift))))
    lid = part(tmp_path, "lid.stl", (20, 20, 2))
    output = tmp_path / "out.gcode"
    flags = ("--printer", printer, "--quality", "standard", "--set-for", "lid_2:infill_density=1")

    (found,) = facts(typed("slice", project, f"{lid}*2", "--copies", "2", "--json", "-o", output, *flags))
    text = output.read_text()
    names = [one["name"] for one in found["objects"]]
    assert len(found["parts"]) == 6
    assert len(names) == len(set(names)) == 8
    assert all(text.count(name) > 1 for name in names)
    if printer == "corexy_klipper":
        assert text.count("EXCLUDE_OBJECT_DEFINE NAME=") == 8
        assert text.count("EXCLUDE_OBJECT_START") == text.count("EXCLUDE_OBJECT_END") > 8
    lids = [one["filament_mm"] for one in found["objects"] if one["name"].startswith("lid")]
    assert sorted(lids)[-1] > 1.2 * sorted(lids)[-2]
    assert typed("dry-run", output, "--printer", printer).code == 0
