"""Awkward heights and places: corners and flats in the plane, planes in one place, parts far from the origin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.healing import repair
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.slicing import cut
from tests.parts import box, box_with_hole, case_study, cone, pyramid, sheared_prism, sphere, step_pyramid
from tests.torture.bodies import ball, turned_body

BODIES = [
    box(),
    ball(),
    box_with_hole(),
    case_study(),
    cone(),
    pyramid(),
    sheared_prism(),
    sphere(),
    step_pyramid([20, 12, 5], [3, 2, 4]),
]
bodies = st.sampled_from(range(len(BODIES)))
seeds = st.integers(0, 2**32 - 1)


def areas_at(mesh: Mesh, cuts: Float) -> Float:
    mended, repairs = repair(mesh)
    sections = cut(mended, LayerPlan(cuts + np.linspace(1e-9, 2e-9, len(cuts)), cuts), 0.0)

    assert repairs.count == 0
    assert sections.gaps == ()
    assert sections.inverted is None
    return sections.solid.area()


@given(body=bodies, seed=seeds, turn=st.booleans(), rounded=st.booleans())
def test_planes_through_corners_have_the_section_just_below(
    body: int, seed: int, turn: bool, rounded: bool
) -> None:
    """Each plane goes through a corner, or a flat; nothing is lost or doubled there."""
    mesh = turned_body(BODIES[body], seed) if turn else BODIES[body]
    mesh = Mesh(mesh.triangles.astype(np.float32).astype(np.float64)) if rounded else mesh
    levels = np.unique(mesh.triangles[:, :, 2])[1:]
    levels = np.append(levels[0] / 2, levels)  # a tip alone has no section

    below = section_areas(mesh.triangles, levels - 1e-7)

    assert areas_at(mesh, levels) == pytest.approx(below, abs=2e-3)


@given(body=bodies, seed=seeds, far=st.tuples(*[st.floats(-1e5, 1e5)] * 2))
def test_parts_far_from_the_origin_have_the_same_sections(
    body: int, seed: int, far: tuple[float, float]
) -> None:
    mesh = turned_body(BODIES[body], seed)
    cuts = np.sort(np.random.default_rng(seed).uniform(0.03, 0.97, 5)) * mesh.height

    assert areas_at(mesh.moved((*far, 0.0)), cuts) == pytest.approx(areas_at(mesh, cuts), abs=2e-3)


def test_planes_in_one_place_have_one_section() -> None:
    assert areas_at(pyramid(), np.array([5.0, 5.0, 5.0, 12.0])) == pytest.approx([225, 225, 225, 64])


def test_planes_a_nanometre_apart_have_the_same_section() -> None:
    heights = 5.0 + 1e-6 * np.arange(40)

    assert areas_at(ball(), heights) == pytest.approx(
        [section_areas(ball().triangles, heights)[0]] * 40, abs=1e-3
    )


@pytest.mark.parametrize("width", [1e-4, 1e-3, 0.01])
def test_slivers_keep_their_area(width: float) -> None:
    """Walls nearer to each other than any bead is wide; down to ten steps of the lattice of 0.01 µm."""
    assert areas_at(box((width, 50.0, 4.0)), np.array([0.5, 3.9])) == pytest.approx(
        [50 * width] * 2, rel=1e-6
    )


def test_a_facet_as_long_as_a_part_and_as_thin_as_nothing_changes_no_section() -> None:
    whole = box((100.0, 10.0, 10.0))
    a, b = np.array([0.0, 0.0, 0.0]), np.array([100.0, 0.0, 0.0])
    thin = a + 1e-9 * np.array([1.0, 0.0, 0.0])
    needles = np.array([[a, thin, b], [b, thin, a]])

    section = cut(
        repair(Mesh(np.concatenate([whole.triangles, needles])))[0],
        LayerPlan(np.array([5.0]), np.array([4.0])),
        0.0,
    )

    assert section.solid.area() == pytest.approx([1000])


def test_a_fine_body_in_one_layer_has_the_area_of_its_outline() -> None:
    """Twenty thousand walls, all cut by one plane."""
    n = 20_000
    turn = 2 * np.pi * np.arange(n) / n
    radius = 50 + np.random.default_rng(1).uniform(-0.01, 0.01, n)
    ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    low, high = np.column_stack([ring, np.zeros(n)]), np.column_stack([ring, np.ones(n)])
    after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    foot, lid = np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1))
    facets = [
        (low, after_low, after_high),
        (low, after_high, high),
        (foot, after_low, low),
        (lid, high, after_high),
    ]
    disc = Mesh(np.concatenate([np.stack(corners, axis=1) for corners in facets]))
    x, y = ring.T

    exact = float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)

    assert areas_at(disc, np.array([0.5])) == pytest.approx([exact], rel=1e-6)
