"""Connected pieces of areas, and the parts of outlines within areas."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given

from printer_slicer.geometry import Areas, ConnectedAreas, outlines_within, split_connected
from printer_slicer.geometry.engine import ENGINES, using_engine
from tests.parts import shape, shapely
from tests.strategies import clean_areas

engines = pytest.mark.parametrize("engine", list(ENGINES))


@given(areas=clean_areas(3))
def test_pieces_are_the_polygons_of_each_layer(areas: Areas) -> None:
    pieces = split_connected(areas)

    parts = [[one for one in shapely.get_parts(shape(areas, k)) if not one.is_empty] for k in range(3)]
    assert np.bincount(pieces.layer, minlength=3).tolist() == [len(some) for some in parts]
    for k in range(3):
        ours = sorted(pieces.areas.area()[pieces.layer == k].tolist())
        assert ours == pytest.approx(sorted(shapely.area(part) for part in parts[k]), abs=1e-6)


@given(areas=clean_areas(3))
def test_pieces_put_back_are_what_they_were_taken_from(areas: Areas) -> None:
    pieces = split_connected(areas)

    assert pieces.on_layers(3, np.arange(pieces.count)).area() == pytest.approx(areas.area(), abs=1e-9)
    some = pieces.take(np.arange(0, pieces.count, 2))
    assert some.areas.area() == pytest.approx(pieces.areas.area()[::2])
    assert np.array_equal(some.layer, pieces.layer[::2])


def test_a_strip_is_as_wide_as_twice_its_area_over_its_outline() -> None:
    strip = np.array([(0, 0), (100, 0), (100, 1), (0, 1)], dtype=np.float64)

    assert split_connected(Areas.from_rings([[strip]])).mean_width() == pytest.approx(1, rel=0.02)


@engines
@given(outlines=clean_areas(2), areas=clean_areas(2))
def test_the_parts_of_outlines_within_areas_are_as_long_as_they_should_be(
    engine: str, outlines: Areas, areas: Areas
) -> None:
    with using_engine(engine):
        xy, size, layer = outlines_within(outlines, areas)

    start = np.append(0, np.cumsum(size))
    lines = [xy[a:b] for a, b in pairwise(start)]
    for k in range(2):
        length = sum(float(np.hypot(*np.diff(lines[i], axis=0).T).sum()) for i in np.flatnonzero(layer == k))
        around, area = shape(outlines, k).boundary, shape(areas, k)
        # What runs along an outline may be taken for inside or not.
        low = shapely.length(shapely.intersection(around, shapely.buffer(area, -1e-3)))
        high = shapely.length(shapely.intersection(around, shapely.buffer(area, 1e-3)))
        assert low - 0.01 * (1 + len(lines)) <= length <= high + 0.01 * (1 + len(lines))


@given(one=clean_areas(3), other=clean_areas(3))
def test_pieces_of_several_stacks_are_those_of_each_by_layer(one: Areas, other: Areas) -> None:
    stacks = [split_connected(one), split_connected(other)]
    joined, source = ConnectedAreas.joined(stacks)

    assert (np.diff(joined.layer) >= 0).all()
    for number, pieces in enumerate(stacks):
        own = joined.take(np.flatnonzero(source == number))
        assert np.array_equal(own.layer, pieces.layer)
        assert np.array_equal(own.areas.xy, pieces.areas.xy)
        assert np.array_equal(own.areas.ring_start, pieces.areas.ring_start)
    first = one.n_rings
    for rings, areas in ((joined.of_ring[:first], one), (joined.of_ring[first:], other)):
        for ring, piece in enumerate(rings.tolist()):
            if piece >= 0:
                assert areas.ring_layer[ring] == joined.layer[piece]


@engines
def test_a_ring_within_comes_back_whole_wherever_it_begins(engine: str) -> None:
    square = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], dtype=np.float64)
    ring, half = Areas.from_rings([[square + 1]]), Areas.from_rings([[square * (1, 0.75)]])
    with using_engine(engine):
        whole = outlines_within(ring, Areas.from_rings([[square * 2]]))
        cut = outlines_within(ring, half)

    assert whole[1].tolist() == [5]
    assert np.array_equal(whole[0][0], whole[0][-1])
    # From (4, 1) around the corner of (1, 1), where the ring begins, to (1, 3): one line.
    assert cut[1].tolist() == [3]


def test_stacks_of_different_numbers_of_layers_are_refused() -> None:
    with pytest.raises(ValueError, match="different numbers of layers: 1 and 2"):
        outlines_within(Areas.empty(1), Areas.empty(2))
