"""Lines joined along outlines: all of every line once, ways within reach, as many joints as can be."""

# mypy: allow-untyped-calls

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, Polylines, anchor, hatch
from tests.parts import shape
from tests.strategies import box, clean_areas


def hatched(areas: Areas, spacing: float, *angles: float) -> Polylines:
    return Polylines.joined([Polylines.hatched(hatch(areas, angle=a, spacing=spacing)) for a in angles])


def path(lines: Polylines, i: int) -> Float:
    return np.asarray(lines.xy[lines.start[i] : lines.start[i + 1]])


@given(
    areas=clean_areas(2),
    longest=st.sampled_from([0.0, 0.5, 2.0, 8.0, 1000.0]),
    hook=st.sampled_from([0.0, 0.7, 3.0]),
    spacing=st.sampled_from([0.9, 2.3, 7.1]),
)
def test_every_line_is_laid_once_and_the_rest_runs_along_the_outline(
    areas: Areas, longest: float, hook: float, spacing: float
) -> None:
    lines = hatched(areas, spacing, 0.3, 1.4)
    joined = anchor(areas, lines, longest=longest, hook=hook)

    assert joined.length().sum() >= lines.length().sum() - 1e-6
    assert (np.diff(joined.layer) >= 0).all()
    for layer in range(2):
        border = shape(areas, layer).boundary.buffer(1e-4)
        before = [path(lines, int(i)) for i in np.flatnonzero(lines.layer == layer)]
        after = [path(joined, int(i)) for i in np.flatnonzero(joined.layer == layer)]
        steps = [
            tuple(np.round(step, 6).ravel().tolist())
            for xy in after
            for step in np.stack([xy[:-1], xy[1:]], axis=1)
        ]
        steps += [(c, d, a, b) for a, b, c, d in steps]
        for xy in before:
            assert steps.count(tuple(np.round(xy, 6).ravel().tolist())) == 1
        whole = shapely.MultiLineString(after)
        bare = shapely.MultiLineString(before).buffer(1e-4)
        assert whole.difference(bare).difference(border).length < 1e-6


@given(areas=clean_areas(1), longest=st.sampled_from([1.0, 4.0, 50.0]))
def test_ways_are_no_longer_than_asked_for(areas: Areas, longest: float) -> None:
    lines = hatched(areas, 1.7, 0.3)

    joined = anchor(areas, lines, longest=longest, hook=0)

    joints = lines.n_lines - joined.n_lines
    loops = sum(np.allclose(path(joined, i)[0], path(joined, i)[-1]) for i in range(joined.n_lines))
    assert joined.length().sum() - lines.length().sum() <= longest * (joints + loops) + 1e-6


def ring_of_ends(gaps: list[float]) -> tuple[Areas, Polylines]:
    """A round area, and short lines that end on its outline, with these gaps between them in degrees."""
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    areas = Areas.from_rings([[10 * np.stack([np.cos(turn), np.sin(turn)], axis=1)]])
    step = np.cumsum([0, *gaps[:-1]]) * 2
    at = areas.xy[step.astype(np.int64)]
    xy = np.stack([at / 2, at], axis=1).reshape(-1, 2)
    edge = np.stack([np.full(len(at), -1), step.astype(np.int64)], axis=1)
    return areas, Polylines.of(xy, np.full(len(at), 2), np.zeros(len(at), np.int64), edge)


@given(st.lists(st.integers(5, 120), min_size=2, max_size=9))
def test_there_is_no_way_to_join_more_ends_nor_as_many_by_less(parts: list[int]) -> None:
    """Against all sets of ways that share no end; where all may be taken and are odd, those without the longest way."""
    gaps = [max(1.0, round(720 * part / sum(parts)) / 2) for part in parts]
    gaps[-1] = 360 - sum(gaps[:-1])
    if gaps[-1] < 1:
        return
    areas, lines = ring_of_ends(gaps)
    n, longest = len(gaps), 10.0
    degree = areas.ring_length()[0] / 360
    allowed = [i for i in range(n) if gaps[i] * degree <= longest]
    sets = [
        chosen
        for size in range(n // 2 + 1)
        for chosen in combinations(allowed, size)
        if len({i for one in chosen for i in (one, (one + 1) % n)}) == 2 * size
    ]
    most = max(map(len, sets))
    barred = [i for i in range(n) if gaps[i] == max(gaps)] if n % 2 and len(allowed) == n else [n]
    least = [
        min(sum(gaps[i] for i in chosen) for chosen in sets if len(chosen) == most and one not in chosen)
        * degree
        for one in barred
    ]

    joined = anchor(areas, lines, longest=longest, hook=0)

    assert lines.n_lines - joined.n_lines == most
    assert np.abs(joined.length().sum() - lines.length().sum() - np.array(least)).min() < 1e-6


def test_hooks_turn_to_the_side_with_more_room_and_leave_half_of_it() -> None:
    areas, lines = ring_of_ends([10, 350])

    joined = anchor(areas, lines, longest=1, hook=1000)

    added = joined.length() - lines.length()
    assert added == pytest.approx(175 / 360 * areas.ring_length()[0], rel=1e-3)


SPUR = [
    [4.69612, -2.47451], [5.82667, -1.00496], [6.59691, 1.06055], [9.76361, 7.49421], [10.70513, 7.85823],
    [9.92657, 7.82529], [11.53658, 11.09626], [8.03801, 7.74539], [-1.14396, 7.35693], [-3.0932, 7.99855],
    [-4.99883, 7.23712], [-5.96918, 5.42891], [-5.55022, 3.42001], [-3.93798, 2.15041], [-1.88685, 2.21416],
    [-0.35658, 3.58144], [6.43014, 6.20539], [3.08229, 2.99887], [1.30388, 2.47451], [0.17333, 1.00496],
    [0.12248, -0.84844], [1.17073, -2.37777], [2.91771, -2.99887],
]  # fmt: skip
"""An area with a thin spur, at the root of which the outline turns into the area."""


@example(areas=Areas(np.array(SPUR), np.array([0, len(SPUR)]), np.array([1]), 2), longest=0.5, apart=1.2)
@given(areas=clean_areas(2), longest=st.sampled_from([0.5, 8.0]), apart=st.sampled_from([0.3, 1.2]))
def test_cut_corners_stay_inside_and_make_nothing_longer(areas: Areas, longest: float, apart: float) -> None:
    lines = hatched(areas, 2.3, 0.3, 1.4)

    joined = anchor(areas, lines, longest=longest, hook=1.0, apart=apart)

    assert (np.diff(joined.layer) >= 0).all()
    assert (joined.size >= 2).all()
    for i in range(joined.n_lines):
        room = shape(areas, int(joined.layer[i])).buffer(1e-4)
        assert shapely.LineString(path(joined, i)).difference(room).length < 1e-3
    # However sharp a corner is, the way past it is shorter than the way around it.
    ends = lines.n_lines * 2
    assert joined.length().sum() <= lines.length().sum() + ends * max(longest, 1.0) + 1e-6


def slanting(x: float, *, up: bool) -> list[tuple[float, float]]:
    """A line from 5 mm above the lower side of a square to it, at 45°."""
    return [(x - 5 if up else x + 5, 5.0), (x, 0.0)]


def square_with(*lines: list[tuple[float, float]]) -> tuple[Areas, Polylines]:
    """A square of 20 mm, and lines that end on its lower side."""
    areas = Areas.from_rings([[box(0, 0, 20, 20)]])
    edge, n = np.tile([-1, 0], (len(lines), 1)), len(lines)
    return areas, Polylines.of(np.concatenate(lines), np.full(n, 2), np.zeros(n, np.int64), edge)


def test_a_corner_is_cut_where_its_legs_are_a_bead_apart() -> None:
    areas, lines = square_with(slanting(6, up=False), slanting(14, up=True))  # they lean over what is between

    sharp, blunt = (anchor(areas, lines, longest=10, hook=0, apart=apart) for apart in (0, 0.4))

    far = 0.2 / np.sin(np.pi / 8)
    assert path(sharp, 0).tolist() == [[11, 5], [6, 0], [14, 0], [9, 5]]
    slant = far / np.sqrt(2)
    wanted = [(11, 5), (6 + slant, slant), (6 + far, 0), (14 - far, 0), (14 - slant, slant), (9, 5)]
    assert path(blunt, 0) == pytest.approx(np.array(wanted))
    assert np.hypot(*(path(blunt, 0)[1] - path(blunt, 0)[2])) == pytest.approx(0.4)


def test_lines_that_cross_just_before_the_outline_are_not_joined_there() -> None:
    areas, lines = square_with(slanting(9.5, up=False), slanting(10.5, up=True))

    assert anchor(areas, lines, longest=10, hook=0).n_lines == 1
    assert anchor(areas, lines, longest=10, hook=0, apart=0.4).n_lines == 2


def test_a_hook_turns_away_from_its_line() -> None:
    areas, lines = square_with(slanting(12, up=True))  # there is as much room on both sides

    for line, tip in ((slanting(12, up=True), 14.0), (slanting(12, up=False), 10.0)):
        areas, lines = square_with(line)
        hooked = anchor(areas, lines, longest=1, hook=2, apart=0.4)
        assert path(hooked, 0)[-1].tolist() == pytest.approx([tip, 0])


def test_corners_around_a_wall_are_not_cut() -> None:
    """A way along a thin spike that stands into the area is as sharp as the spike."""
    spike = np.array([(0, 0), (9.8, 0), (10, 6), (10.2, 0), (20, 0), (20, 9), (0, 9)], np.float64)
    areas = Areas.from_rings([[spike]])
    xy = np.array([(8, 9), (8, 0), (12, 0), (12, 9)], np.float64)
    edge = np.array([(-1, 0), (3, -1)])
    lines = Polylines.of(xy, np.array([2, 2]), np.zeros(2, np.int64), edge)

    joined = anchor(areas, lines, longest=20, hook=0, apart=0.4)

    assert joined.n_lines == 1
    assert [10, 6] in path(joined, 0).tolist()
    assert shapely.LineString(path(joined, 0)).difference(shape(areas, 0).buffer(1e-6)).length < 1e-6


def test_a_loop_ends_where_it_begins() -> None:
    areas = Areas.from_rings([[box(0, 0, 9, 2)]])
    lines = Polylines.hatched(hatch(areas, angle=np.pi / 2, spacing=4, phase=0.5))  # at x = 2 and 6

    joined = anchor(areas, lines, longest=100, hook=1)

    assert joined.n_lines == 1
    assert path(joined, 0)[0].tolist() == pytest.approx(path(joined, 0)[-1].tolist())
    assert joined.length().tolist() == pytest.approx([2 + 4 + 2 + 4])


def test_no_line_is_joined_to_itself() -> None:
    areas = Areas.from_rings([[box(0, 0, 4, 2)]])
    line = Polylines.hatched(hatch(areas, angle=np.pi / 2, spacing=20, phase=-0.1))

    bare, hooked = (anchor(areas, line, longest=100, hook=hook) for hook in (0, 0.5))

    assert bare.xy.tolist() == line.xy.tolist()
    assert hooked.length().tolist() == pytest.approx([3.0])


def test_ends_on_no_outline_stay_as_they_are() -> None:
    areas = Areas.from_rings([[box(0, 0, 10, 10)]])
    lines = Polylines.of(np.array([[1.0, 1], [2, 2]]), np.array([2]), np.array([0]))

    assert anchor(areas, lines, longest=5, hook=5).xy.tolist() == [[1, 1], [2, 2]]
