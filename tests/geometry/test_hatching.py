"""Hatches lie in the areas, in line and complete; zigzags hold every line once and take only short turns."""

# mypy: allow-untyped-calls

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, Lines, chain_rows, hatch
from printer_slicer.geometry.planar import load
from tests.strategies import box, clean_areas

# No side of the lattice lies along a row: there the last digit of a sine would decide.
angles = st.integers(0, 60).map(lambda n: 0.0123 + n / 10)
spacings = st.integers(2, 20).map(lambda n: n / 7.3)


def along_and_across(points: Float, angle: float) -> tuple[Float, Float]:
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([cos, sin]), points @ np.array([-sin, cos])


# --- hatch ---


def test_a_box_is_crossed_by_the_rows_from_its_lower_to_below_its_upper_side() -> None:
    lines = hatch(Areas.from_rings([[box(1, 0, 3, 1)]]), angle=0.0, spacing=0.25)

    assert lines.row.tolist() == [0, 1, 2, 3]
    assert lines.ends.tolist() == [[[1, v], [3, v]] for v in (0, 0.25, 0.5, 0.75)]
    assert lines.length().tolist() == [2, 2, 2, 2]


def test_the_phase_moves_the_rows_by_a_share_of_the_spacing() -> None:
    lines = hatch(Areas.from_rings([[box(1, 0, 3, 1)]]), angle=0.0, spacing=0.5, phase=0.5)

    assert lines.ends[:, 0, 1].tolist() == [0.25, 0.75]


def test_areas_one_above_the_other_share_no_row_of_the_common_side() -> None:
    lines = hatch(Areas.from_rings([[box(0, 0, 2, 1), box(0, 1, 2, 2)]]), angle=0.0, spacing=0.5)

    assert lines.row.tolist() == [0, 1, 2, 3]


def test_a_hole_interrupts_the_lines() -> None:
    lines = hatch(Areas.from_rings([[box(0, 0, 9, 3), box(3, 1, 5, 2)[::-1]]]), angle=0.0, spacing=1.0)

    assert lines.row.tolist() == [0, 1, 1, 2]
    assert lines.u.tolist() == [[0, 9], [0, 3], [5, 9], [0, 9]]


def test_rows_that_only_touch_a_point_leave_no_line() -> None:
    tip = np.array([[0, 0], [2, -1], [2, 1]], dtype=float)
    standing = np.array([[0, 0], [1, 1], [-1, 1]], dtype=float)

    assert hatch(Areas.from_rings([[standing]]), angle=0.0, spacing=1.0).n_lines == 0
    assert hatch(Areas.from_rings([[tip]]), angle=0.0, spacing=5.0).u.tolist() == [[0, 2]]


def test_every_layer_has_its_own_angle_spacing_and_phase() -> None:
    stack = Areas.from_rings([[box(0, 0, 2, 4)]] * 4)
    lines = hatch(
        stack,
        angle=np.array([0, np.pi / 2, 0, 0]),
        spacing=np.array([1.0, 0.5, np.inf, 1.0]),
        phase=np.array([0.5, 0.5, 0.5, 0.25]),
    )

    counts = np.bincount(lines.layer, minlength=4)
    assert counts.tolist() == [4, 4, 0, 4]
    assert lines.ends[lines.layer == 0, 0, 1] == pytest.approx([0.5, 1.5, 2.5, 3.5])
    assert lines.ends[lines.layer == 1, 0, 0] == pytest.approx([1.75, 1.25, 0.75, 0.25])
    assert lines.ends[lines.layer == 3, 0, 1] == pytest.approx([0.25, 1.25, 2.25, 3.25])


def test_fine_lines_times_their_spacing_are_the_area() -> None:
    angle = np.arange(0, 2 * np.pi, 0.01)[:, None]
    ring = (5 + np.sin(5 * angle)) * np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    stack = Areas.from_rings([[ring, box(-1, -1, 1, 1)[::-1]]] * 3)
    lines = hatch(stack, angle=np.array([0.0, 0.7, 2.0]), spacing=0.01)

    covered = np.bincount(lines.layer, weights=lines.length()) * 0.01
    assert covered == pytest.approx(stack.area(), rel=1e-4)


def test_nothing_is_hatched_with_nothing() -> None:
    assert hatch(Areas.empty(3), angle=0.0, spacing=1.0).n_lines == 0
    assert hatch(Areas.from_rings([[box(0, 0, 1, 1)]]), angle=0.0, spacing=np.inf).n_lines == 0


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan"), np.ones(3)])
def test_spacings_that_make_no_sense_are_refused(spacing: float | Float) -> None:
    with pytest.raises(ValueError, match=r"spacing|layer"):
        hatch(Areas.empty(2), angle=0.0, spacing=spacing)


@given(stack=clean_areas(3), angle=angles, spacing=spacings, phase=st.integers(-10, 10).map(lambda n: n / 9))
def test_lines_lie_on_their_rows_in_order(stack: Areas, angle: float, spacing: float, phase: float) -> None:
    lines = hatch(stack, angle=angle, spacing=spacing, phase=phase)
    along, across = along_and_across(lines.ends, angle)

    assert along == pytest.approx(lines.u, abs=1e-9)
    assert across == pytest.approx(np.repeat(((lines.row + phase) * spacing)[:, None], 2, axis=1), abs=1e-9)
    assert (lines.length() > 0).all()
    assert np.array_equal(np.lexsort((lines.u[:, 0], lines.row, lines.layer)), np.arange(lines.n_lines))


@given(stack=clean_areas(3), angle=angles, spacing=spacings)
def test_lines_are_what_the_areas_have_in_common_with_the_rows(
    stack: Areas, angle: float, spacing: float
) -> None:
    lines = hatch(stack, angle=angle, spacing=spacing)
    n = int(40 / spacing)
    v = np.arange(-n, n + 1)[:, None] * spacing * np.array([-np.sin(angle), np.cos(angle)])
    u = 100 * np.array([np.cos(angle), np.sin(angle)])
    rows = shapely.multilinestrings(shapely.linestrings(np.stack([v - u, v + u], axis=1)))

    for k, area in enumerate(load(stack)):
        mine = lines.layer == k
        whole = shapely.multilinestrings(shapely.linestrings(lines.ends[mine]))
        assert lines.length()[mine].sum() == pytest.approx(shapely.intersection(area, rows).length, abs=1e-6)
        assert shapely.difference(whole, shapely.buffer(area, 1e-6)).length == 0


# --- chain_rows ---


def rectangle_hatch(max_turn: float | Float = 1.0) -> tuple[Float, Int, Int]:
    stack = Areas.from_rings([[box(0, 0, 4, 2)]])
    return chain_rows(hatch(stack, angle=0.0, spacing=0.5, phase=0.5), max_turn=max_turn)


def test_the_rows_of_a_box_become_one_zigzag() -> None:
    xy, start, layer = rectangle_hatch()

    assert xy[:, 0].tolist() == [0, 4, 4, 0, 0, 4, 4, 0]
    assert xy[:, 1].tolist() == [0.25, 0.25, 0.75, 0.75, 1.25, 1.25, 1.75, 1.75]
    assert start.tolist() == [0, 8]
    assert layer.tolist() == [0]


def test_rows_farther_apart_than_a_turn_stay_alone() -> None:
    xy, start, layer = rectangle_hatch(max_turn=0.49)

    assert start.tolist() == [0, 2, 4, 6, 8]
    assert layer.tolist() == [0, 0, 0, 0]
    assert np.abs(np.diff(xy[:, 0])[::2]).tolist() == [4, 4, 4, 4]


def test_every_layer_has_its_own_longest_turn() -> None:
    stack = Areas.from_rings([[box(0, 0, 4, 2)]] * 3)
    lines = hatch(stack, angle=0.0, spacing=0.5, phase=0.5)
    _, start, layer = chain_rows(lines, max_turn=np.array([1.0, 0.1, 1.0]))

    assert layer.tolist() == [0, 1, 1, 1, 1, 2]
    assert np.diff(start).tolist() == [8, 2, 2, 2, 2, 8]


def test_zigzags_part_where_a_hole_begins_and_meet_nobody_where_it_ends() -> None:
    stack = Areas.from_rings([[box(0, 0, 9, 6), box(3, 2, 5, 4)[::-1]]])
    lines = hatch(stack, angle=0.0, spacing=1.0, phase=0.5)
    _, start, _ = chain_rows(lines, max_turn=2.0)

    # Two rows below, two on each side, two above.
    assert np.diff(start).tolist() == [4, 4, 4, 4]


def test_islands_side_by_side_have_a_zigzag_each() -> None:
    stack = Areas.from_rings([[box(0, 0, 2, 2), box(3, 0, 5, 2)]])
    lines = hatch(stack, angle=0.0, spacing=0.5, phase=0.5)
    xy, start, _ = chain_rows(lines, max_turn=1.0)

    assert np.diff(start).tolist() == [8, 8]
    assert xy[: start[1], 0].max() == 2
    assert xy[start[1] :, 0].min() == 3


def test_rows_that_another_row_separates_are_not_joined() -> None:
    stack = Areas.from_rings([[box(0, 0, 4, 0.5), box(0, 1, 4, 1.5)]])
    _, start, _ = chain_rows(hatch(stack, angle=0.0, spacing=0.5, phase=0.5), max_turn=9.0)

    assert np.diff(start).tolist() == [2, 2]


@pytest.mark.parametrize("mirror", [1, -1])
def test_zigzags_turn_on_the_side_where_turns_are_short(mirror: int) -> None:
    steep = np.array([[0, 0], [20, 0], [0, 5]], dtype=float)
    ring = steep if mirror == 1 else (steep * [-1, 1])[::-1]
    lines = hatch(Areas.from_rings([[ring]]), angle=0.0, spacing=0.5, phase=0.5)
    _, start, _ = chain_rows(lines, max_turn=0.6)

    # Ten rows, joined in pairs along the upright side.
    assert np.diff(start).tolist() == [4] * 5


def test_no_lines_make_no_zigzags() -> None:
    xy, start, layer = chain_rows(hatch(Areas.empty(2), angle=0.0, spacing=1.0), max_turn=1.0)

    assert xy.shape == (0, 2)
    assert start.tolist() == [0]
    assert layer.tolist() == []


def pieces(lines: Lines, xy: Float) -> tuple[set[tuple[float, ...]], set[tuple[float, ...]]]:
    """The lines of the hatch and those of the zigzags, whichever way they run."""
    back = {(*b, *a) for a, b in lines.ends.tolist()}
    forth = {(*a, *b) for a, b in lines.ends.tolist()}
    run = {(*a, *b) for a, b in xy.reshape(-1, 2, 2).tolist()}
    return forth, {piece if piece in forth else (*piece[2:], *piece[:2]) for piece in run & (forth | back)}


@given(stack=clean_areas(3), angle=angles, spacing=spacings, turn=st.integers(0, 40))
def test_zigzags_hold_every_line_once_and_their_steps_are_short(
    stack: Areas, angle: float, spacing: float, turn: int
) -> None:
    lines = hatch(stack, angle=angle, spacing=spacing)
    xy, start, layer = chain_rows(lines, max_turn=turn / 4)
    forth, run = pieces(lines, xy)

    assert forth == run
    assert len(xy) == 2 * lines.n_lines
    assert (np.diff(start) >= 2).all()
    assert start[-1] == len(xy)
    assert (np.diff(layer) >= 0).all()
    per_layer = np.bincount(layer, weights=np.diff(start), minlength=3)
    assert per_layer.tolist() == (2 * np.bincount(lines.layer, minlength=3)).tolist()
    joint = np.setdiff1d(np.arange(2, len(xy), 2), start)
    step = xy[joint] - xy[joint - 1]
    assert (np.hypot(*step.T) <= turn / 4 + 1e-9).all()
    assert np.abs(along_and_across(step, angle)[1]) == pytest.approx(np.full(len(joint), spacing), abs=1e-9)


@given(stack=clean_areas(3), angle=angles, spacing=spacings, turn=st.integers(0, 40))
def test_steps_of_zigzags_stay_close_to_the_area(
    stack: Areas, angle: float, spacing: float, turn: int
) -> None:
    xy, start, layer = chain_rows(hatch(stack, angle=angle, spacing=spacing), max_turn=turn / 4)
    solid = load(stack)

    for i, k in enumerate(layer.tolist()):
        path = xy[start[i] : start[i + 1]]
        steps = path[1:-1].reshape(-1, 2, 2)
        share = np.linspace(0, 1, 9)[:, None, None]
        samples = shapely.points(steps[:, 0] + share * (steps[:, 1] - steps[:, 0]))
        assert np.all(shapely.dwithin(solid[k], samples, turn / 8 + 1e-6))
