"""Rings of supports around the part, and supports that are slim for their height."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.model import Areas, LayerPlan, SupportPlan, Supports
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.findings import find_grips, find_slim_pieces
from printer_slicer.supports.trees import grow_trees
from tests.parts import plain
from tests.supports.by_hand import prepared as by_hand
from tests.supports.by_stages import columns_of
from tests.supports.shapes import mushroom, tee


def block(side: float, n_layers: int) -> Supports:
    """A square column."""
    ring = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * side
    area, none = Areas.from_rings([[ring]] * n_layers), Areas.empty(n_layers)
    plan = SupportPlan(
        LayerPlan.from_tops(np.arange(1, n_layers + 1) * 0.2), np.zeros(0, np.int64), np.zeros(0)
    )
    return Supports(plan, area, none, none, none, none)


def test_columns_around_a_stalk_grip_it() -> None:
    supports, sections, _ = columns_of(mushroom())
    (grip,) = find_grips(supports, sections)

    middle = sections.solid.xy.mean(axis=0)
    assert np.hypot(grip.x - middle[0], grip.y - middle[1]) < 5.0
    assert grip.low == 0
    assert grip.high == pytest.approx(29.2, abs=0.5)


def test_columns_beside_a_stem_do_not_grip_it() -> None:
    supports, sections, _ = columns_of(tee())

    assert find_grips(supports, sections) == ()


def test_trees_of_a_mushroom_do_not_grip_it() -> None:
    overhangs, plan, sections = by_hand(mushroom())

    assert find_grips(grow_trees(overhangs, plan, sections, plain()), sections) == ()


@pytest.mark.parametrize(
    ("side", "n_layers", "is_slim"), [(2.0, 140, False), (2.0, 160, True), (10.0, 300, False)]
)
def test_slim_columns_are_found(side: float, n_layers: int, is_slim: bool) -> None:
    found = find_slim_pieces(block(side, n_layers))

    assert bool(found) == is_slim
    for piece in found:
        assert piece.slimness == pytest.approx(n_layers * 0.2 / side)
        assert (piece.x, piece.y) == pytest.approx((side / 2, side / 2))
        assert piece.foot == pytest.approx(side**2)


def test_the_foot_decides() -> None:
    overhangs, plan, sections = by_hand(tee(10.0, 60.0))
    slim = [
        find_slim_pieces(make_columns(overhangs, plan, sections, plain(support_first_layer_expansion=foot)))
        for foot in (0.0, 10.0)
    ]
    trees = find_slim_pieces(grow_trees(overhangs, plan, sections, plain()))

    assert not slim[1]
    assert all(piece.height > 50 for piece in trees)


def test_a_low_piece_is_not_slim_on_the_smallest_foot() -> None:
    assert not find_slim_pieces(block(0.01, 10))


@pytest.mark.filterwarnings("error")
def test_feet_count_as_a_whole_where_an_interface_fills_a_hole() -> None:
    whole = block(2.0, 160)
    square = whole.base.ring(0)
    hole, filling = 1.0 + 0.4 * (square[::-1] - 1.0), 1.0 + 0.40001 * (square - 1.0)
    base, interface = Areas.from_rings([[square, hole]] * 160), Areas.from_rings([[filling]] * 160)
    none = Areas.empty(160)

    (piece,) = find_slim_pieces(Supports(whole.plan, base, interface, none, none, none))

    assert piece.foot == pytest.approx(4.0)
