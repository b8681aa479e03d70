"""The account of moves as a printer made them: what comes out of which nozzle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printer_slicer.inspection.deposition.marks import Marks
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.deposition.recorder import DepositionRecorder

AREA = 2.405  # mm²
NO_MARKS = Marks()


def account(
    *moves: tuple[float, float, float], clogged_share: float = 0.0, marks: Marks = NO_MARKS
) -> Deposition:
    """Moves to x at z that feed so much, each 1 s long, over a large plate."""
    keeper = DepositionRecorder(((0.0, 0.0), (200.0, 200.0)), AREA, 100.0, marks)
    rows, at = [], (0.0, 0.2)
    for command, (x, z, fed) in enumerate(moves, 1):
        rows.append((command, at[0], 50.0, at[1], x, 50.0, z, fed, 10.0))
        at = x, z
    keeper.add_moves(np.array(rows), np.ones(len(rows)), clogged_share)
    return keeper.close()


def test_each_tool_has_its_own_filament() -> None:
    """What the first pulled back before the change is not what the second one lays."""
    moves = ((20.0, 0.2, 1.0), (20.0, 0.2, -10.0), (60.0, 0.2, 2.0), (60.0, 0.2, 10.0), (80.0, 0.2, 1.0))
    marks = replace(NO_MARKS, changes=np.array([3, 4]), tools=np.array([1, 0]))

    assert account(*moves, marks=marks).volume == pytest.approx(4.0 * AREA)
    assert account(*moves).volume == pytest.approx(2.0 * AREA)


def test_what_is_kept_back_is_not_laid() -> None:
    whole = account((20.0, 0.2, 1.0), (60.0, 0.2, 2.0))
    part = account((20.0, 0.2, 1.0), (60.0, 0.2, 2.0), clogged_share=0.75)

    assert (whole.first_missing, part.first_missing) == (None, 1)
    assert part.volume == pytest.approx(0.25 * whole.volume)
    assert part.length == whole.length


def test_a_way_on_which_filament_is_pushed_in_vain_is_counted() -> None:
    (layer,) = account((20.0, 0.2, 1.0), (20.0, 0.2, -9.0), (50.0, 0.2, 3.0), (40.0, 0.2, -1.0)).layers

    assert (layer.length, layer.empty_length, layer.retracted_length) == (20.0, 30.0, 10.0)
    assert layer.first_empty == 3


def test_a_drought_is_where_the_nozzle_climbs_and_lays_nothing() -> None:
    climb = [(x, 0.2 * z, 0.0) for z in range(2, 8) for x in (60.0, 20.0) * 6]
    found = account((20.0, 0.2, 1.0), *climb).missing_extrusion
    assert found is not None

    assert (found.command, found.low, found.high) == (2, 0.2, pytest.approx(1.4))
    assert account((20.0, 0.2, 1.0), *climb, (40.0, 1.4, 1.0), *climb[:5]).missing_extrusion == found
    assert account((20.0, 0.2, 1.0), *((x, 50.0, 0.0) for x in (60.0, 20.0) * 20)).missing_extrusion is None
    assert account(*climb).missing_extrusion is None
