"""Lines drawn with round pens: what both engines promise, and that they agree."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, difference, stroke_lines
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.geometry.polygons import ROUND_TOLERANCE

engines = pytest.mark.parametrize("engine", list(ENGINES))


def drawn(
    lines: list[list[tuple[float, float]]], radius: list[float], layer: list[int] | None = None
) -> Areas:
    xy = np.array([point for line in lines for point in line], np.float64)
    start = np.cumsum([0, *map(len, lines)])
    layers = np.array(layer or [0] * len(lines))
    return stroke_lines(xy, start, layers, np.array(radius), int(layers.max()) + 1)


def round_loss(radius: float) -> float:
    """How much a circle of chords may lack."""
    return 2 * pi * radius * ROUND_TOLERANCE


@engines
def test_a_straight_line_is_a_rectangle_with_half_circles_at_its_ends(engine: str) -> None:
    with using_engine(engine):
        area = float(drawn([[(0, 0), (10, 0)]], [0.5]).area()[0])

    full = 10 * 1 + pi * 0.25
    assert full - round_loss(0.5) <= area <= full + 1e-4


@engines
def test_lines_that_overlap_are_united(engine: str) -> None:
    with using_engine(engine):
        twice = drawn([[(0, 0), (10, 0)], [(2, 0), (8, 0)]], [0.5, 0.5]).area()
        once = drawn([[(0, 0), (10, 0)]], [0.5]).area()

    assert twice == pytest.approx(once, abs=1e-4)


@engines
def test_each_line_has_its_own_width_and_layer(engine: str) -> None:
    with using_engine(engine):
        areas = drawn([[(0, 0), (10, 0)], [(0, 5), (10, 5)], [(0, 9), (10, 9)]], [0.2, 0.4, 0.4], [2, 0, 0])

    assert areas.area()[1] == 0
    assert areas.area()[2] == pytest.approx(4 + pi * 0.04, abs=round_loss(0.2))
    assert areas.area()[0] == pytest.approx(2 * (8 + pi * 0.16), abs=2 * round_loss(0.4))


@engines
def test_a_closed_line_leaves_its_inside_open(engine: str) -> None:
    with using_engine(engine):
        areas = drawn([[(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)]], [0.25])

    # The outer corners are round, the inner ones sharp.
    assert areas.area()[0] == pytest.approx(10.5**2 - 9.5**2 - (4 - pi) * 0.25**2, abs=round_loss(0.25))
    assert areas.n_rings == 2


def test_no_lines_cover_nothing() -> None:
    nothing = np.zeros(0, np.int64)

    assert stroke_lines(np.zeros((0, 2)), np.zeros(1, np.int64), nothing, np.zeros(0), 3).area().tolist() == [
        0,
        0,
        0,
    ]


def test_lines_without_width_and_layers_that_are_not_there_are_refused() -> None:
    line, start = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0, 2])

    with pytest.raises(ValueError, match="greater than 0"):
        stroke_lines(line, start, np.array([0]), np.array([0.0]), 1)
    with pytest.raises(ValueError, match="outside the stack of 1 layers"):
        stroke_lines(line, start, np.array([1]), np.array([0.5]), 1)


place = st.tuples(st.integers(-40, 40), st.integers(-40, 40)).map(lambda p: (p[0] / 4, p[1] / 4))
line = st.lists(place, min_size=2, max_size=6, unique=True)


@given(
    st.lists(st.tuples(line, st.sampled_from([0.2, 0.225, 0.5]), st.integers(0, 1)), min_size=1, max_size=6)
)
def test_both_engines_draw_the_same(lines: list[tuple[list[tuple[float, float]], float, int]]) -> None:
    made = []
    for engine in ENGINES:
        with using_engine(engine):
            made.append(
                drawn([one for one, _, _ in lines], [by for _, by, _ in lines], [k for _, _, k in lines])
            )

    a, b = made
    # Both are within the tolerance of the same circles, and from within.
    room = ROUND_TOLERANCE * (a.ring_length().sum() + b.ring_length().sum()) + 1e-3
    assert difference(a, b).area().sum() <= room
    assert difference(b, a).area().sum() <= room
