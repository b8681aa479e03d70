"""The sample parts are what their table says."""

from __future__ import annotations

import importlib.util
from collections import Counter
from itertools import pairwise
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.mesh_io import export_stl, load_mesh

FOLDER = Path(__file__).parents[1] / "sample_parts"
spec = importlib.util.spec_from_file_location("make_sample_parts", FOLDER / "make.py")
assert spec is not None
assert spec.loader is not None
make = importlib.util.module_from_spec(spec)
spec.loader.exec_module(make)


def polygon(corners: int, radius: float) -> float:
    """Area of a regular polygon."""
    return corners / 2 * radius**2 * sin(2 * pi / corners)


def frustum(height: float, bottom: float, top: float) -> float:
    return height / 3 * (bottom + top + sqrt(bottom * top))


def faceted_sphere() -> float:
    angles = [pi * i / 32 for i in range(33)]
    slices = [(10 - 10 * cos(angle), polygon(64, 10 * sin(angle))) for angle in angles]
    return sum(frustum(high - low, a, b) for (low, a), (high, b) in pairwise(slices))


EXPECTED = {
    "case_study": (28, (50, 50, 82.5), 50**2 * 30 + frustum(22.5, 50**2, 5**2) + 5**2 * 30),
    "box": (12, (20, 20, 10), 4000.0),
    "cylinder": (512, (20, 20, 20), 20 * polygon(128, 10)),
    "sphere": (3968, (20, 20, 20), faceted_sphere()),
    "cone": (256, (20, 20, 20), 20 / 3 * polygon(128, 10)),
    "sheared_prism": (12, (30, 10, 20), 2000.0),
    "thin_wall": (76, (40, 30, 20), 40 * 30 * 2 + (0.4 + 0.8 + 1.2 + 2.0) * 30 * 18),
    "bridge": (28, (30, 10, 18), 2 * 5 * 10 * 15 + 30 * 10 * 3),
    "tee": (28, (50, 10, 34), 10 * 10 * 30 + 50 * 10 * 4),
    "vase": (5904, (42.8591, 42.8591, 60), None),
}

each_part = pytest.mark.parametrize("name", EXPECTED)


def test_every_part_is_in_the_table_and_on_disk() -> None:
    assert set(make.PARTS) == set(EXPECTED)
    assert {path.stem for path in FOLDER.glob("*.stl")} == set(EXPECTED)

    table = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}.stl`" in table for name in EXPECTED)


@each_part
def test_the_file_is_what_the_script_makes(name: str, tmp_path: Path) -> None:
    export_stl(make.PARTS[name](), tmp_path / "made.stl")

    assert (tmp_path / "made.stl").read_bytes() == (FOLDER / f"{name}.stl").read_bytes()


@each_part
def test_facets_size_and_volume_are_known(name: str) -> None:
    n_facets, size, volume = EXPECTED[name]

    mesh = load_mesh(FOLDER / f"{name}.stl")

    assert mesh.n_facets == n_facets
    assert mesh.size == pytest.approx(size, abs=1e-4)
    assert mesh.bounds[0, 2] == 0.0
    if volume is not None:
        assert mesh.volume == pytest.approx(volume, rel=1e-6)


@each_part
def test_every_part_is_closed_and_faces_outward(name: str) -> None:
    mesh = load_mesh(FOLDER / f"{name}.stl")

    edges = Counter(
        (tuple(facet[i]), tuple(facet[i - 2])) for facet in mesh.triangles.tolist() for i in range(3)
    )

    assert all(count == 1 for count in edges.values())
    assert all((b, a) in edges for a, b in edges)
    assert mesh.volume > 0


@each_part
def test_no_facet_is_without_area(name: str) -> None:
    a, b, c = make.PARTS[name]().triangles.transpose(1, 0, 2)

    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-3).all()


def test_the_case_study_has_the_corners_of_the_paper() -> None:
    triangles = load_mesh(FOLDER / "case_study.stl").triangles.reshape(-1, 3)

    assert len(triangles) == 84
    assert len(np.unique(triangles, axis=0)) == 16
    assert np.unique(triangles[:, 2]).tolist() == [0.0, 30.0, 52.5, 82.5]


@pytest.mark.parametrize("side", [1.0, 12.5, 50.0])
def test_the_upper_prism_of_the_case_study_may_have_any_side(side: float) -> None:
    mesh = make.case_study(side)

    assert mesh.n_facets == 28
    assert mesh.volume == pytest.approx(50**2 * 30 + frustum(22.5, 50**2, side**2) + side**2 * 30)


def test_the_vase_is_nearly_the_smooth_body_it_stands_for() -> None:
    smooth = 60 * pi * (16**2 + 4**2 / 2) * (1 + 0.12**2 / 2)

    assert make.vase().volume == pytest.approx(smooth, rel=3e-3)
