"""No file of a batch has the name of another one, and there are not too many."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.batching.tasks import Combination, ModelOptions, list_tasks, make_unique

NAME = st.lists(st.sampled_from(["lid", "Lid", "-", "_", "1", "2", "12"]), min_size=1, max_size=4)


@given(st.lists(NAME.map("".join), max_size=12), st.booleans())
def test_names_are_unique(names: list[str], has_plates: bool) -> None:
    unique = make_unique(names, has_plates=has_plates)

    assert len(unique) == len(names)
    assert len({one.casefold() for one in unique}) == len(names)
    assert all(one == name or one.startswith(f"{name}_") for one, name in zip(unique, names, strict=True))
    if len({name.casefold() for name in names}) == len(names) and not has_plates:
        assert unique == names


@pytest.mark.parametrize("first", ["lid", "lid-1"])
def test_a_plate_does_not_replace_the_file_of_another_model(first: str) -> None:
    names = ["lid", "lid-1"] if first == "lid" else ["lid-1", "lid"]
    unique = dict(zip(names, make_unique(names, has_plates=True), strict=True))
    assert unique == {"lid": "lid", "lid-1": "lid-1_2"}


def list_names(paths: list[Path], *choices: dict[str, str], copies: int = 1) -> list[str]:
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"")
    combinations = [Combination(one, ps.load_profile()) for one in choices or ({},)]
    return [task.name for task in list_tasks(paths, combinations, ModelOptions(copies=copies))]


def test_values_with_the_same_letters_have_files_of_their_own(tmp_path: Path) -> None:
    names = list_names([tmp_path / "lid.stl"], {"start_gcode": "G28;"}, {"start_gcode": "G28\n"})
    assert names == ["lid-start_gcode-G28_", "lid-start_gcode-G28__2"]


def test_case_alone_does_not_distinguish_files(tmp_path: Path) -> None:
    names = list_names([tmp_path / "a" / "Lid.stl", tmp_path / "a" / "lid.3mf"])
    assert names == ["a-Lid", "a-lid_2"]


def test_long_names_are_shortened(tmp_path: Path) -> None:
    path = tmp_path / f"{'long' * 60}.stl"
    names = list_names([path], {"perimeters": "2"}, {"perimeters": "3"})
    assert len(set(names)) == 2
    assert all(len(name) == 200 and name.startswith("longlong") for name in names)


def test_names_that_could_be_those_of_plates_stay_if_there_are_none(tmp_path: Path) -> None:
    paths = [tmp_path / "lid.stl", tmp_path / "lid-2.stl"]
    assert list_names(paths) == ["lid", "lid-2"]
    assert list_names(paths, copies=2) == ["lid", "lid-2_2"]


def test_too_many_tasks_are_rejected_before_a_model_is_read() -> None:
    combinations = [Combination({}, ps.load_profile())] * 1000
    with pytest.raises(ps.PrinterSlicerError, match="101000 tasks; the most are 100000"):
        list_tasks([Path(f"{number}.stl") for number in range(101)], combinations)
