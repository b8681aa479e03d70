"""What can be seen in a picture of the part."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from printer_slicer.rendering import (
    Picture,
    _downscale,
    _halve,
    _measure_projected_extent,
    _project,
    _rasterize_facets,
    _render_large,
    _scale_to_fit,
    render_facets,
)
from printer_slicer.thumbnails import _list_facets, render
from tests.parts import box, joined, sphere


def differing(one: Picture, other: Picture) -> float:
    """Share of the pixels that are not nearly the same."""
    return float((np.abs(one.astype(int) - other.astype(int)).max(axis=2) > 24).mean())


@pytest.mark.parametrize(("width", "height"), [(100, 100), (200, 60), (60, 200), (16, 16), (333, 77)])
def test_the_part_fills_the_picture_but_for_a_margin_and_stands_in_its_middle(
    width: int, height: int
) -> None:
    picture = render(sphere(10), width, height)
    rows, columns = (np.flatnonzero(picture[..., 3].any(axis=1 - axis)) for axis in (0, 1))
    free = [rows[0], height - 1 - rows[-1], columns[0], width - 1 - columns[-1]]

    assert picture.shape == (height, width, 4)
    assert abs(free[0] - free[1]) <= 1
    assert abs(free[2] - free[3]) <= 1
    assert 0.02 * min(width, height) - 1 <= min(free) <= 0.06 * min(width, height) + 1


def test_a_sphere_is_a_disk() -> None:
    picture = render(sphere(10), 200, 200)
    seen = (picture[..., 3] / 255).sum()
    edges = ((picture[..., 3] > 0) & (picture[..., 3] < 255)).sum()

    assert seen == pytest.approx(np.pi * (100 - 8) ** 2, rel=0.02)
    assert 200 < edges < 2000  # smooth at its rim, whole inside


def test_nothing_is_seen_through_a_closed_part() -> None:
    picture = render(joined([sphere(9), box((10, 10, 10), (-5, -5, 4))]), 150, 150)
    opaque = picture[..., 3] == 255
    rows = [np.flatnonzero(row) for row in opaque]

    assert all(len(row) == row[-1] - row[0] + 1 for row in rows if len(row))


def test_top_front_and_side_of_a_box_are_lit_differently_the_top_most() -> None:
    picture = render(box((10, 10, 10)), 200, 200)[..., :3].sum(axis=2, dtype=int)
    top, front, side = picture[50, 100], picture[130, 50], picture[130, 150]

    assert top > front + 60 > side + 120


def test_what_is_in_front_hides_what_is_behind() -> None:
    front = box((10, 1, 10), (0, -30, 0))
    alone, both = (render(part, 120, 120) for part in (front, joined([front, box((4, 1, 4), (-16, 7, 3))])))

    assert differing(alone, both) < 0.6
    behind = joined([front, box((2, 0.5, 2), (4 - 0.78 * 1.5, -30 + 1.5, 4))])  # in the line of sight, behind
    assert differing(alone, render(behind, 120, 120)) < 0.12


@given(
    turn=st.randoms(use_true_random=False),
    shift=st.tuples(*[st.floats(-500, 500)] * 3),
    scale=st.sampled_from([0.01, 1.0, 30.0]),
)
def test_place_size_and_order_of_facets_do_not_matter(
    turn: object, shift: tuple[float, float, float], scale: float
) -> None:
    part = joined([box((20, 6, 4)), sphere(4).moved((3, 0, 4))]).triangles
    order = np.random.default_rng(abs(hash(shift)) % 2**32).permutation(len(part))
    other = Mesh(part[order] * scale + np.array(shift))

    assert differing(render(Mesh(part), 80, 60), render(other, 80, 60)) < 0.02


def test_pictures_of_several_sizes_show_the_same() -> None:
    large, small = render_facets(_list_facets(sphere(10)), [(200, 200), (50, 50)])
    means = large.reshape(50, 4, 50, 4, 4).mean(axis=(1, 3))
    solid = small[..., 3] == 255

    assert np.abs(means - small)[solid].mean() < 4
    assert render_facets(_list_facets(sphere(10)), []) == []


@given(st.tuples(*[st.integers(1, 90)] * 2), st.tuples(*[st.integers(1, 30)] * 3))
def test_half_the_scale_is_the_mean_of_the_pixels_below(
    size: tuple[int, int], part: tuple[float, float, float]
) -> None:
    facets = _list_facets(box(part))
    low, extent = _measure_projected_extent(facets)
    scale = _scale_to_fit(extent, *size)
    large = _render_large(facets, low, extent, 2 * scale)

    assert np.abs(_halve(large, extent, size).colours - _downscale(large, extent, scale, size)).max() < 0.1


@pytest.mark.parametrize("size", [(50, 0.001, 0.001), (0.001, 0.001, 50), (1000, 1000, 0.01)])
def test_parts_thin_as_a_hair_can_be_drawn(size: tuple[float, float, float]) -> None:
    assert render(box(size), 64, 64).shape == (64, 64, 4)


# Against every facet and every pixel one by one


def covering(corner: Float, shape: tuple[int, int], slack: float) -> dict[tuple[int, int], float]:
    """Row and column of each pixel whose middle a facet (3 corners of x, y, depth) holds -> its depth there.

    With `slack` the facet is so much larger, as a share of itself.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corner.tolist()
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    found = {}
    for row in range(shape[0]):
        for column in range(shape[1]):
            x, y = column + 0.5, row + 0.5
            a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / twice
            b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / twice
            c = 1 - a - b
            if min(a, b, c) >= -slack:
                found[row, column] = a * az + b * bz + c * cz
    return found


@given(arrays(np.float64, (3, 3), elements=st.integers(0, 120).map(lambda n: n / 10 + 0.013)))
def test_a_facet_covers_the_pixels_whose_middle_it_holds(corner: Float) -> None:
    shape = (13, 13)
    x, y, depth = corner
    twice = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    if abs(twice) < 1e-6:
        return
    _, pixel, deep = _rasterize_facets(x[:, None], y[:, None], depth[:, None], shape)
    got = {divmod(int(one), shape[1]): float(z) for one, z in zip(pixel, deep, strict=True)}
    held, touched = (covering(corner.T, shape, slack) if twice > 0 else {} for slack in (-1e-9, 1e-9))

    assert set(held) <= set(got) <= set(touched)
    assert all(got[place] == pytest.approx(touched[place], abs=1e-3) for place in got)


def test_the_eye_looks_from_the_front_right_and_above() -> None:
    ends: Float = np.zeros((3, 3, 3))
    ends[0, 0], ends[1, 0], ends[2, 0] = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    seen = _project(ends)[:, 0]
    (right_of_x, up_of_x, near_of_x), (right_of_y, up_of_y, near_of_y), (right_of_z, up_of_z, near_of_z) = (
        seen.T
    )

    assert right_of_x > 0.5 > right_of_z == pytest.approx(0)
    assert near_of_x > 0 > near_of_y
    assert up_of_z > 0.8
    assert up_of_y > 0 > up_of_x
    assert near_of_z > 0
    assert right_of_y > 0
