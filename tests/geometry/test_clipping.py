"""Parts of lines within areas: as shapely and Clipper find them, and exact where lines and outlines meet."""

# mypy: allow-untyped-calls

from __future__ import annotations

import clipper2
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, Polylines, clip_lines
from printer_slicer.geometry.clipper import load
from printer_slicer.geometry.clipping import clip_to_spans, clip_with_sources
from tests.parts import shape
from tests.strategies import box, clean_areas

# Halves of millimetres, as the corners of areas: lines pass through corners and along sides all the time.
lattice = st.tuples(st.integers(-40, 40), st.integers(-40, 40)).map(lambda p: (p[0] / 2, p[1] / 2))
anywhere = st.tuples(st.floats(-20, 20), st.floats(-20, 20))


def polylines(lines: list[tuple[int, list[tuple[float, float]]]]) -> Polylines:
    lines = sorted(lines, key=lambda line: line[0])
    points = [np.array(points, dtype=np.float64) for _, points in lines]
    xy = np.concatenate([np.zeros((0, 2)), *points])
    return Polylines.of(
        xy, np.array([len(one) for one in points], np.int64), np.array([k for k, _ in lines], np.int64)
    )


def some_lines(n_layers: int) -> st.SearchStrategy[Polylines]:
    one = st.tuples(st.integers(0, n_layers - 1), st.lists(lattice | anywhere, min_size=2, max_size=8))
    return st.lists(one, min_size=1, max_size=6).map(polylines)


def paths(lines: Polylines, layer: int) -> list[Float]:
    return [lines.xy[lines.start[i] : lines.start[i + 1]] for i in np.flatnonzero(lines.layer == layer)]


@given(areas=clean_areas(3), lines=some_lines(3))
def test_spans_lie_along_their_lines_where_the_parts_do(areas: Areas, lines: Polylines) -> None:
    parts, line = clip_with_sources(areas, lines)
    on, low, high = clip_to_spans(areas, lines)

    assert on.tolist() == line.tolist()
    assert high - low == pytest.approx(parts.length(), abs=1e-6)
    for i, k in enumerate(on.tolist()):
        xy = lines.xy[lines.start[k] : lines.start[k + 1]]
        reached = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
        begin = [np.interp(low[i], reached, xy[:, axis]) for axis in (0, 1)]
        assert begin == pytest.approx(parts.xy[parts.start[i]].tolist(), abs=1e-4)


@given(areas=clean_areas(3), lines=some_lines(3))
def test_shapely_finds_parts_of_the_same_length(areas: Areas, lines: Polylines) -> None:
    """A line along an outline counts as inside for one and as outside for the other: the difference is its length."""
    parts = clip_lines(areas, lines)

    for layer in range(3):
        whole = shape(areas, layer)
        expected = along = 0.0
        for xy in paths(lines, layer):
            steps = [
                shapely.LineString(xy[i : i + 2]) for i in range(len(xy) - 1) if (xy[i] != xy[i + 1]).any()
            ]
            expected += sum(step.intersection(whole.buffer(1e-4)).length for step in steps)
            along += sum(step.intersection(whole.boundary.buffer(1e-4)).length for step in steps)
        found = float(parts.length()[parts.layer == layer].sum())
        assert found <= expected + 1e-3
        assert found >= expected - along - 1e-3


@given(areas=clean_areas(2), lines=some_lines(2))
def test_every_part_lies_inside_and_ends_on_the_edge_it_names(areas: Areas, lines: Polylines) -> None:
    parts = clip_lines(areas, lines)

    ends = np.stack([parts.xy[parts.start[:-1]], parts.xy[parts.start[1:] - 1]], axis=1)
    for i in range(parts.n_lines):
        room = shape(areas, int(parts.layer[i])).buffer(1e-4)
        assert (
            shapely.LineString(parts.xy[parts.start[i] : parts.start[i + 1]]).difference(room).length < 1e-9
        )
        for end, edge in zip(ends[i], parts.edge[i], strict=True):
            if edge >= 0:
                side = shapely.LineString([areas.xy[edge], areas.xy[areas.following[edge]]])
                assert side.distance(shapely.Point(end)) < 1e-4
            else:
                assert (lines.xy == end).all(axis=1).any()


def test_clipper_finds_as_many_parts_of_as_much_length() -> None:
    rng = np.random.default_rng(3)
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    ring = (10 + 4 * np.sin(7 * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    areas = Areas.from_rings([[ring, box(-2, -2, 2, 2)[::-1]]])
    lines = polylines([(0, rng.uniform(-15, 15, (40, 2)).tolist()) for _ in range(20)])

    engine = clipper2.Clipper64()
    engine.add_open_subject([np.rint(xy * 1e5).astype(np.int64) for xy in paths(lines, 0)])
    engine.add_clip(load(areas)[0])
    expected = engine.execute(clipper2.ClipType.INTERSECTION, clipper2.FillRule.POSITIVE)[1]
    parts = clip_lines(areas, lines)

    assert parts.n_lines == len(expected)
    length = sum(float(np.hypot(*np.diff(xy, axis=0).T).sum()) for xy in expected) / 1e5
    assert parts.length().sum() == pytest.approx(length, abs=1e-2)


def test_a_line_through_a_corner_of_a_box_is_cut_once() -> None:
    areas = Areas.from_rings([[box(0, 0, 2, 2)]])

    through = clip_lines(areas, polylines([(0, [(-1, -1), (1, 1), (3, 3)])]))
    past = clip_lines(areas, polylines([(0, [(-1, 1), (1, -1)]), (0, [(-1, 3), (0, 2), (1, 3)])]))

    assert through.xy.tolist() == [[0, 0], [1, 1], [2, 2]]
    assert past.n_lines == 0


def test_of_two_lines_along_opposite_sides_one_lies_inside() -> None:
    areas = Areas.from_rings([[box(0, 0, 2, 1)]])

    low, high = (clip_lines(areas, polylines([(0, [(-1, y), (3, y)])])) for y in (0.0, 1.0))

    assert low.n_lines + high.n_lines == 1


def test_lines_that_touch_no_outline_are_kept_inside_and_dropped_outside_and_in_holes() -> None:
    areas = Areas.from_rings([[box(0, 0, 9, 9), box(3, 3, 6, 6)[::-1]]])
    inside, hole, aside = [(1.0, 1.0), (2.0, 1.5)], [(4.0, 4.0), (5.0, 5.0)], [(20.0, 1.0), (21.0, 1.0)]

    parts = clip_lines(areas, polylines([(0, inside), (0, hole), (0, aside)]))

    assert parts.xy.tolist() == [list(point) for point in inside]
    assert parts.edge.tolist() == [[-1, -1]]


def test_layers_do_not_cut_each_other() -> None:
    areas = Areas.from_rings([[box(0, 0, 1, 1)], [], [box(5, 0, 6, 1)]])

    parts = clip_lines(areas, polylines([(k, [(-1, 0.5), (9, 0.5)]) for k in range(3)]))

    assert parts.layer.tolist() == [0, 2]
    assert parts.xy.tolist() == [[0, 0.5], [1, 0.5], [5, 0.5], [6, 0.5]]


def test_no_lines_and_no_areas_leave_nothing() -> None:
    line = polylines([(0, [(0, 0), (1, 1)])])

    assert clip_lines(Areas.empty(1), line).n_lines == 0
    assert clip_lines(Areas.from_rings([[box(0, 0, 1, 1)]]), line.take(np.zeros(0, np.int64))).n_lines == 0


def test_a_corner_given_twice_is_still_a_corner() -> None:
    areas = Areas.from_rings([[box(0, 0, 9, 9)]])

    parts = clip_lines(areas, polylines([(0, [(-1, 1), (3, 1), (3, 1), (3, 5)])]))

    assert parts.xy.tolist() == [[0, 1], [3, 1], [3, 5]]
