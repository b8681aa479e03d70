"""Outlines that are cut lie where they lay, inside, and nothing inside is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from printer_slicer.geometry import Areas, clip_outlines, normalize
from tests.parts import shape, shapely
from tests.strategies import box, clean_areas


def lines_of(xy: Any, size: Any, closed: Any) -> list[Any]:
    paths = np.split(xy, np.cumsum(size)[:-1]) if len(size) else []
    return [
        shapely.LinearRing(path) if whole else shapely.LineString(path)
        for path, whole in zip(paths, closed.tolist(), strict=True)
    ]


@given(clean_areas(1), clean_areas(1))
@settings(deadline=None)
def test_what_is_left_is_what_another_library_leaves(outlines: Areas, within: Areas) -> None:
    assert_left(outlines, within)


def assert_left(outlines: Areas, within: Areas) -> None:
    """What is left of outlines within areas is what shapely leaves of them."""
    xy, size, ring, closed = clip_outlines(outlines, within)
    lines = lines_of(xy, size, closed)
    area = shape(within, 0)
    drawn = [shapely.LinearRing(outlines.ring(i)) for i in range(outlines.n_rings)]

    assert (np.diff(ring) >= 0).all()
    for line, index in zip(lines, ring.tolist(), strict=True):
        assert (
            shapely.hausdorff_distance(shapely.intersection(line, shapely.buffer(drawn[index], 1e-6)), line)
            < 1e-5
        )
    border = shapely.buffer(
        shapely.boundary(area), 3e-5
    )  # what runs along it, on the grid, may be taken or not
    mine = shapely.length(shapely.difference(shapely.union_all(lines), border))
    theirs = shapely.length(shapely.difference(shapely.intersection(shapely.union_all(drawn), area), border))
    assert mine == pytest.approx(theirs, abs=1e-4)


def test_a_ring_that_stays_inside_stays_closed() -> None:
    inner, outer = (Areas.from_rings([[box(*corners)]]) for corners in ((1, 1, 2, 2), (0, 0, 3, 3)))

    xy, size, _, closed = clip_outlines(inner, outer)
    assert closed.tolist() == [True]
    assert size.tolist() == [4]
    assert np.array_equal(xy, inner.xy)


def test_a_stretch_over_the_beginning_of_a_ring_is_one() -> None:
    ring = Areas.from_rings([[box(0, 0, 4, 4)]])
    corner = Areas.from_rings([[box(-1, -1, 2, 2)]])

    xy, size, _, closed = clip_outlines(ring, corner)
    assert (size.tolist(), closed.tolist()) == ([3], [False])
    assert xy.tolist() == [[0, 2], [0, 0], [2, 0]]


def test_outlines_that_meet_in_a_corner_leave_no_crumbs() -> None:
    """An octagon, and a pentagon of some of its corners: rounding finds crossings in the corners they share."""
    corners = [(-4.52459, -1.61212), (-3.271, -0.24603), (-3.0598, 1.59601), (-3.97165, 3.21039)]
    corners += [(-5.65827, 3.98047), (-7.47541, 3.61212), (-8.729, 2.24603), (-8.9402, 0.40399)]
    corners += [(-8.02835, -1.21039), (-6.34173, -1.98047)]
    ring = np.array(corners)
    xy, size, _, closed = clip_outlines(
        Areas.from_rings([[ring]]), Areas.from_rings([[ring[[2, 4, 6, 8, 0]]]])
    )

    assert all(line.length > 0.1 for line in lines_of(xy, size, closed))


def test_nothing_is_left_where_there_is_no_area() -> None:
    ring = Areas.from_rings([[box(0, 0, 4, 4)], []])
    other = Areas.from_rings([[], [box(0, 0, 4, 4)]])

    assert clip_outlines(ring, other)[1].tolist() == []
    with pytest.raises(ValueError, match="different numbers of layers: 2 and 1"):
        clip_outlines(ring, Areas.empty(1))


def test_edges_that_nearly_lie_on_each_other_do_not_lose_what_follows() -> None:
    """Two crossings at one place, which rounding puts in the wrong order: out of the area before into it."""
    ten = [(4, 0), (3.42705098, 1.76335576), (1.92705098, 2.85316955), (0.0729490169, 2.85316955)]
    ten += [(-1.42705098, 1.76335576), (-2, 0), (-1.42705098, -1.76335576), (0.0729490169, -2.85316955)]
    ten += [(2.00430523, -3.09093368), (3.42705098, -1.76335576)]
    hole = [(1.97082039, -0.705342303), (1.40172209, -1.23637347), (0.629179607, -1.14126782)]
    hole += [(0.0291796068, -0.705342303), (-0.2, 0), (0.0291796068, 0.705342303), (0.629179607, 1.14126782)]
    hole += [(1.37082039, 1.14126782), (1.97082039, 0.705342303), (2.2, 0)]
    outlines, within = (
        normalize(
            Areas.from_rings(
                [[np.array([(3, 0), (-1.5, 2.59807621), corner]), np.array(ten), np.array(hole)]]
            )
        )
        for corner in ((-1.5, -2.59807621), (-1.625, -2.81458256))
    )

    assert_left(outlines, within)
