"""The table of slopes against every facet looked at one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.slopes import Slopes, cusp_height, find_thickest_layers, nearest_step
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile
from tests.parts import box, cone, profile, pyramid, sphere, step_pyramid
from tests.planning.plans import slopes_of


def table(mesh: Mesh, wanted: Profile | None = None, *, flats: bool = True) -> tuple[Slopes, ZSteps]:
    steps = ZSteps(mesh, wanted or profile())
    return Slopes(mesh, steps, flats=flats), steps


def one_by_one(mesh: Mesh, bottom: Int, top: Int, size: float) -> Float:
    """The largest |n_z| strictly between pairs of z steps."""
    z, slope = mesh.triangles[:, :, 2] / size, slopes_of(mesh)
    low, high = z.min(axis=1), z.max(axis=1)
    inside = (low[:, None] < top - 0.02) & (high[:, None] > bottom + 0.02)
    return np.asarray(np.where(inside, slope[:, None], 0.0).max(axis=0))


@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), coarse=st.booleans())
def test_the_largest_slope_of_any_interval_is_that_of_its_steepest_facet(
    seed: int, count: int, coarse: bool
) -> None:
    chance = np.random.default_rng(seed)
    corners = chance.uniform(0, 3, size=(count, 3, 3)) * (1, 1, 0.4)
    # On the grid, facets end where intervals do; that is where tables go wrong.
    corners[:, :, 2] = np.round(corners[:, :, 2], 1 if coarse else 2)
    z = corners[:, :, 2]
    mesh = Mesh(np.concatenate([corners[z.max(axis=1) > z.min(axis=1) + 0.005], box((1, 1, 1.5)).triangles]))
    slopes, steps = table(mesh)
    bottom = chance.integers(0, steps.part, size=200)
    top = np.minimum(bottom + chance.integers(1, 60, size=200), steps.part)

    found = slopes.largest_slope(bottom, top)

    assert found == pytest.approx(one_by_one(mesh, bottom, top, steps.size), abs=1e-9)


def test_a_flat_is_seen_only_by_what_has_it_strictly_inside() -> None:
    slopes, _ = table(step_pyramid([20, 10], [1.0, 1.0]))
    bottom, top = np.array([80, 100, 90, 99, 0, 150]), np.array([100, 120, 110, 101, 200, 200])

    assert slopes.largest_slope(bottom, top).tolist() == [0, 0, 1, 1, 1, 0]


def test_a_flat_between_two_steps_stands_on_the_nearer_one() -> None:
    slopes, _ = table(step_pyramid([20, 10], [1.003, 1.0]))

    assert slopes.largest_slope(np.array([90, 100, 99]), np.array([100, 110, 101])).tolist() == [0, 0, 1]


def test_flats_can_be_left_out() -> None:
    slopes, steps = table(step_pyramid([20, 10], [1.0, 1.0]), flats=False)

    assert slopes.largest_slope(np.array([0]), np.array([steps.part])).tolist() == [0]


@pytest.mark.parametrize("containment", ["mid", "positive", "negative"])
def test_the_top_of_the_part_is_never_inside_its_last_layer(containment: str) -> None:
    for height in (2.0, 1.995, 2.001, 2.004, 1.9951, 2.005, 2.009, 2.015):
        slopes, steps = table(box((5, 5, height)), profile(containment=containment))

        assert slopes.largest_slope(np.array([0]), np.array([steps.part])).tolist() == [0]


def test_over_the_part_there_is_no_slope() -> None:
    slopes, steps = table(cone())

    assert slopes.largest_slope(
        np.array([steps.part, steps.part + 5]), np.array([steps.part + 9] * 2)
    ).tolist() == [
        0,
        0,
    ]


def test_the_table_does_not_depend_on_the_order_of_the_facets() -> None:
    mesh = sphere()
    other = Mesh(mesh.triangles[np.random.default_rng(1).permutation(mesh.n_facets)])
    (slopes, steps), (shuffled, _) = table(mesh), table(other)
    bottom = np.arange(steps.part - 20)

    assert np.array_equal(
        slopes.largest_slope(bottom, bottom + 20), shuffled.largest_slope(bottom, bottom + 20)
    )


def test_facets_in_many_blocks_are_all_seen() -> None:
    many = np.concatenate([box((5, 5, 2)).triangles] * 9000)
    mesh = Mesh(np.concatenate([many, pyramid(10, 2).triangles]))  # 108 000 walls and flats first

    assert table(mesh)[0].largest_slope(np.array([50]), np.array([60])) == pytest.approx(5 / np.hypot(5, 2))


@pytest.mark.parametrize(("containment", "cusp"), [("mid", 0.1), ("positive", 0.05), ("negative", 0.05)])
def test_half_of_the_cusp_counts_only_for_layers_cut_in_the_middle(containment: str, cusp: float) -> None:
    assert cusp_height(profile(tolerance=0.05, containment=containment)) == pytest.approx(cusp)


def test_the_nearest_step_does_not_hang_on_the_dust_of_a_sum() -> None:
    dust = np.array([-1e-7, 0.0, 1e-7])

    assert set(nearest_step(0.125 + dust, 0.01).tolist()) == {12}
    assert nearest_step(np.array([0.1249, 0.1262]), 0.01).tolist() == [12, 13]


@pytest.mark.parametrize("seen", [1.0, 0.5])
def test_the_thickest_layer_is_the_last_one_that_a_limit_lets_grow(seen: float) -> None:
    mesh = sphere(3)
    slopes, steps = table(mesh)

    def limit(slope: Float) -> Float:
        return np.asarray(0.2 / np.maximum(slope, 1e-9))

    found = find_thickest_layers(slopes, steps, limit, considered=seen)

    for bottom in range(0, steps.part, 7):
        height = steps.lowest
        while height < steps.highest:
            window = int(np.ceil((height + 1) * seen))
            slope = slopes.largest_slope(np.array([bottom]), np.array([bottom + window]))
            if (height + 1) * steps.size > limit(slope)[0] + 1e-6:
                break
            height += 1
        assert found[bottom] == height
