"""Shapes that strain numbers, not rules: thousands of facets in one layer, needles, layers that end where facets lie.

Sections are compared with areas known from the outline, or summed facet by facet without joining any.
"""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.healing import repair
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.slicing import cut
from tests.parts import box, joined, prism, profile

NEAR = 1e-7
"""Relative: polygons are united on a lattice of a millionth of a millimetre."""
FAR = pytest.mark.parametrize("far", [0.0, 1e5], ids=["near", "at 100 m"])


def relief(n_rings: int, n_sectors: int, radius: float = 40.0) -> Mesh:
    """A disc of 0.2 mm, its bottom flat, its top in waves of 0.05 mm; all of its sides are in one layer."""
    r = np.linspace(0, radius, n_rings + 1)[:, None]
    turn = 2 * np.pi * np.arange(n_sectors) / n_sectors
    top = 0.175 + 0.025 * np.cos(3 * turn) * np.sin(r)
    flat = np.stack([r * np.cos(turn), r * np.sin(turn)], axis=-1)
    upper = np.concatenate([flat, top[:, :, None]], axis=-1)
    lower = np.concatenate([flat, np.zeros_like(upper[:, :, :1])], axis=-1)
    rim = np.stack([upper[-1], lower[-1]])
    sheets = [_sheet(upper), _sheet(lower)[:, ::-1], _sheet(rim)]
    triangles = np.concatenate(sheets)
    a, b, c = triangles.transpose(1, 0, 2)
    return Mesh(triangles[(a != b).any(1) & (b != c).any(1) & (c != a).any(1)])


def _sheet(grid: Float) -> Float:
    """Facets between the rows of a grid that is closed along its rows."""
    a, b = grid[:-1], grid[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)


def needles(n: int, step: float, height: float) -> Mesh:
    """A bar of 10 x 10 mm, one of its sides cut into strips of `step` mm."""
    strips = [(k * step, 0.0) for k in range(n + 1)]
    return prism([*strips, (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)], height)


def areas(mesh: Mesh, *cuts: float) -> Float:
    heights = np.array(cuts)
    return cut(repair(mesh)[0], LayerPlan(heights + 1e-4, heights), 0.0).solid.area()


@FAR
def test_a_relief_of_one_layer_has_its_area_at_every_height(far: float) -> None:
    part, n = relief(20, 1200), 1200
    disc = n / 2 * 40.0**2 * np.sin(2 * np.pi / n)
    moved = part.moved((far, -far, 0))

    assert areas(moved, 0.05, 0.1, 0.149) == pytest.approx([disc] * 3, rel=NEAR)
    waves = np.array([0.155, 0.17, 0.19])
    assert areas(moved, *waves) == pytest.approx(section_areas(part.triangles, waves), abs=1e-3)


def test_a_relief_of_one_layer_is_sliced_to_the_end() -> None:
    stages = slice_stages(relief(10, 600), profile())

    assert stages.repairs.sound
    assert stages.sections.solid.area()[0] == pytest.approx(np.pi * 40**2, rel=1e-3)
    assert stages.program.filament_used > 0


@FAR
def test_needles_a_million_times_as_long_as_wide_change_no_area(far: float) -> None:
    part = needles(500, 1e-4, 100.0).moved((far, far, 0))

    assert areas(part, 0.1, 33.3, 99.9) == pytest.approx([100.0] * 3, rel=1e-6 if far else 1e-9)


def test_needles_lying_in_a_flat_change_no_area() -> None:
    """The lid is a fan from one corner of an outline with 3000 corners: facets 20 mm long and 0.00001 mm high."""
    turn = 2 * np.pi * np.arange(3000) / 3000
    part = prism([(10 * np.cos(a), 10 * np.sin(a)) for a in turn.tolist()], 0.3)

    assert areas(part, 0.15, 0.3) == pytest.approx([1500 * 100 * np.sin(2 * np.pi / 3000)] * 2, rel=NEAR)


@FAR
def test_bodies_that_end_where_layers_are_cut_are_whole_below_and_gone_above(far: float) -> None:
    """A plane in which two facets lie one on the other sees what is below it."""
    tower = joined([box((10, 10, 5)), box((6, 6, 5), (2, 2, 5)), box((2, 2, 5), (4, 4, 10))]).moved(
        (far, 0, 0)
    )

    assert areas(tower, 5.0, 5.0001, 10.0, 10.0001, 15.0) == pytest.approx([100, 36, 36, 4, 4], rel=1e-9)


def test_layers_that_end_in_the_same_flat_many_times_have_the_same_area() -> None:
    plates = joined([box((10, 10, 0.25), (0, 0, 0.25 * k)) for k in range(40)])
    cuts = 0.25 * np.arange(1, 40)

    assert areas(plates, *cuts) == pytest.approx([100.0] * 39)
    assert areas(plates, *(cuts - 0.1)) == pytest.approx([100.0] * 39)
