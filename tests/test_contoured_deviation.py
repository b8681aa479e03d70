"""The distance from a surface to contoured layers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.contouring import main, sample
from printer_slicer.deviation import LocalTops, measure_deviation
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.values import replace
from tests.contoured_gcode import HEIGHT, LEAST, Part, example, wedge
from tests.parts import box, plain

# Mean distance of the tops, µm: less than a quarter of the layer height, and of the step from bead to bead.
LEVEL = {5: 45.3, 10: 42.5, 15: 39.5, 20: 36.8}
CONTOURED = {5: 7.0, 10: 13.5, 15: 19.5, 20: 23.0}


def test_pressing_adds_to_the_distance_where_higher_walls_are_laid_first() -> None:
    part, text = example("wedge 10", "lowered")  # walls from inside out
    free, pressed = (sample(text.encode(), part.mesh, 4000, pressed=one).tops for one in (0.0, 1.0))
    level = example("wedge 10", "level")[1]

    assert 1.15 * free < pressed < 2.5 * free
    assert sample(level.encode(), part.mesh, 4000, pressed=1.0).tops == pytest.approx(0.0429, abs=0.002)


def ascii_stl(part: Part) -> str:
    facets = (
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in part.mesh.triangles.tolist()
    )
    return f"solid part\n{''.join(facets)}endsolid part\n"


@pytest.mark.parametrize("degrees", LEVEL)
def test_contoured_wedges_are_nearer_to_their_model(degrees: int) -> None:
    tops = {}
    for kind in ("level", "lowered"):
        part, text = example(f"wedge {degrees}", kind)
        tops[kind] = 1000 * sample(text.encode(), part.mesh, 8000).tops

    assert tops["level"] == pytest.approx(LEVEL[degrees], abs=1.5)
    assert tops["lowered"] == pytest.approx(CONTOURED[degrees], abs=1.0)


def test_a_file_gives_what_its_extrusions_give(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part, text = example("wedge 10", "lowered")
    (tmp_path / "part.gcode").write_text(text)
    (tmp_path / "part.stl").write_text(ascii_stl(part))

    assert main(["sample", str(tmp_path / "part.gcode"), str(tmp_path / "part.stl"), "--points", "4000"]) == 0
    assert "tops 13." in capsys.readouterr().out


def lower(paths: Toolpaths, part: Part) -> Toolpaths:
    """Paths at the height of the surface."""
    top = np.repeat(paths.z_top, np.diff(paths.start))
    offset = np.clip(part.surface(paths.xy), top - HEIGHT + LEAST, top) - top
    offset[np.repeat(paths.layer, np.diff(paths.start)) == 0] = 0.0
    return replace(paths, z_offset=offset, flow_ratio=1 + offset / HEIGHT)


def test_lowered_paths_count() -> None:
    part = wedge(10)
    top = np.arange(1, round(part.mesh.height / HEIGHT) + 1) * HEIGHT
    stages = slice_stages(part.mesh, plain(), plan=LayerPlan(top, top - HEIGHT / 2))
    tops = LocalTops.of_paths(lower(stages.toolpaths, part))
    level, lowered = (measure_deviation(stages.part, stages.sections, 4000, tops=one) for one in (None, tops))

    assert lowered.mean < 0.8 * level.mean
    assert np.array_equal(lowered.points, level.points)


def test_paths_that_are_lowered_evenly_count() -> None:
    """The top layer of this wedge is one extrusion along the slope's contour line."""
    paths = slice_stages(wedge(10).mesh, plain(z_contouring=True)).toolpaths
    even = replace(paths, z_offset=np.where(paths.layer[paths.path_of_point] == 2, -0.05, 0.0))

    assert np.unique(LocalTops.of_paths(even).layer).tolist() == [2]


def test_level_paths_and_scarf_seams_have_no_local_tops() -> None:
    for changes in ({}, {"scarf_length": 8.0}):
        stages = slice_stages(box((20.0, 15.0, 2.0)), plain(**changes))

        assert not len(LocalTops.of_paths(stages.toolpaths).layer)


def test_the_profile_of_level_layers_is_that_of_their_walls() -> None:
    part = wedge(15)
    stages = slice_stages(part.mesh, plain(layer_height=HEIGHT))
    paths = stages.toolpaths
    size = np.diff(paths.start)
    owner = np.repeat(np.arange(paths.n_paths), size)
    xyz = np.column_stack([paths.xy, paths.z_top[owner]])
    same = owner[:-1] == owner[1:]
    tops = LocalTops(xyz[:-1][same], xyz[1:][same], paths.layer[owner][1:][same])
    exact, profile = (measure_deviation(stages.part, stages.sections, 4000, tops=one) for one in (None, tops))

    assert profile.mean == pytest.approx(exact.mean, abs=0.0005)
    assert np.quantile(np.abs(profile.distance - exact.distance), 0.95) < 0.01


def test_a_flat_part_has_no_tops() -> None:
    profile = plain()
    mesh = box((20.0, 15.0, 2.0))
    found = sample(gcode_of(slice_part(mesh, profile), profile), mesh, 2000)

    assert np.isnan(found.tops)
    assert found.contoured == 0
    assert found.deviation.mean < 0.001
