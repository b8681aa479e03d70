"""Which branches become one: none that would close a ring around the part."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.model import Sections
from printer_slicer.slicing import cut
from printer_slicer.supports.branch_merging import encloses_part, match_nearest
from printer_slicer.supports.reach_fields import ReachFields, build_fields
from printer_slicer.supports.tree_settings import read_tree_settings
from tests.parts import box, joined, layers, plain
from tests.supports.shapes import sphere_on_bed

BED = np.array([-100.0, -100.0]), np.array([100.0, 100.0])


def fields_of(sections: Sections) -> ReachFields:
    return build_fields(sections, 30.0, BED, read_tree_settings(plain(), 0.2, 30.0))


def around(bar_at: float) -> bool:
    """Whether branches from tips at x = -8 and 8 under a plate enclose a bar along y at this x, meeting at z = 5."""
    plate, bar = (
        box((40.0, 20.0, 3.0), (-20.0, -10.0, 31.0)),
        box((4.0, 20.0, 4.0), (bar_at - 2, -10.0, 15.0)),
    )
    fields = fields_of(cut(joined([plate, bar]), layers(170, 0.2), 0.01))
    one, other, meeting = (
        np.array([place]) for place in ([-8.0, 0.0, 30.8], [8.0, 0.0, 30.8], [0.0, 0.0, 5.0])
    )
    return bool(encloses_part(one, other, meeting, fields)[0])


@pytest.mark.parametrize(("bar_at", "enclosed"), [(0.0, True), (2.0, True), (14.0, False), (-14.0, False)])
def test_two_branches_do_not_meet_under_a_bar_between_them(bar_at: float, enclosed: bool) -> None:
    assert around(bar_at) is enclosed


def test_a_part_that_hangs_down_between_two_tips_is_not_enclosed() -> None:
    ball = sphere_on_bed(10.0).moved((0.0, 0.0, 12.0))
    fields = fields_of(cut(joined([ball, box((2.0, 2.0, 1.0), (60.0, 0.0, 0.0))]), layers(160, 0.2), 0.01))
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    tips: Float = np.column_stack([5 * np.cos(turn), 5 * np.sin(turn), np.full(8, 22 - np.sqrt(75) - 0.2)])
    meeting = np.tile([0.0, 0.0, 4.0], (8, 1))

    assert not encloses_part(tips, np.roll(tips, 4, axis=0), meeting, fields).any()


def test_branches_in_a_row_meet_in_pairs() -> None:
    """Otherwise each follows the one before it, and only the first two meet."""
    one, other = np.array([1, 2, 3, 3, 2, 1, 0]), np.array([0, 1, 2, 4, 3, 2, 1])

    mate = match_nearest(one, other, np.full(7, 2.5), 5)

    assert mate.tolist() == [1, 0, 3, 2, -1]
