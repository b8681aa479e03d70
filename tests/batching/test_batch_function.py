"""`ps.batch` slices many parts with many settings, with any executor."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import printer_slicer as ps
from tests.parts import box


@pytest.fixture
def parts(tmp_path: Path) -> list[Path]:
    for size in (4, 6):
        ps.export_stl(box((size, 5, 2)), tmp_path / f"box{size}.stl")
    return [tmp_path / "box4.stl", tmp_path / "box6.stl"]


def test_each_part_is_sliced_with_each_combination(parts: list[Path], tmp_path: Path) -> None:
    settings = {"layer_height": [0.2, 0.3], "walls": 3}
    with ThreadPoolExecutor(1) as executor:
        results = ps.batch(parts, settings, executor=executor)
        stored = ps.batch(parts, settings, executor=executor, output_dir=tmp_path / "out")

    assert [(one.model, one.choices) for one in results] == [
        (path.name, {"layer_height": height}) for path in parts for height in ("0.2", "0.3")
    ]
    for one, other in zip(results, stored, strict=True):
        (file,), (same,) = one.files, other.files
        assert file.read() == (tmp_path / "out" / same.name).read_bytes()
    job = ps.slice(parts[0], layer_height=0.3, walls=3)
    moves = [
        [line for line in text.splitlines() if line.startswith(b"G1")]
        for text in (results[1].files[0].read(), job.text)
    ]
    assert moves[0] == moves[1]


def test_a_part_that_cannot_be_sliced_has_a_problem(parts: list[Path], tmp_path: Path) -> None:
    ps.export_stl(box((4000, 5, 2)), tmp_path / "long.stl")
    with ThreadPoolExecutor(1) as executor:
        good, bad = ps.batch([parts[0], tmp_path / "long.stl"], executor=executor)
    assert not good.problem
    assert "long" in bad.problem
    assert not bad.files


def test_wrong_settings_are_rejected_before_anything_is_sliced(parts: list[Path]) -> None:
    with pytest.raises(ps.PrinterSlicerError, match="no_such"):
        ps.batch(parts, {"no_such": [1, 2]})
    with pytest.raises(ps.PrinterSlicerError, match="no values"):
        ps.batch(parts, {"walls": []})
    for jobs in (0, -1):
        with pytest.raises(ps.PrinterSlicerError, match="at least 1"):
            ps.batch(parts, jobs=jobs)
    with pytest.raises(ps.PrinterSlicerError, match="resume needs an output_dir"):
        ps.batch(parts, resume=True)
    with pytest.raises(ps.PrinterSlicerError, match="missing"):
        ps.batch([parts[0].with_name("missing.stl")])
