"""Spikes of outlines, and rings without area, that rounding leaves."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.spikes import is_spike, remove_spikes
from tests.strategies import box

STEP = 1 / STEPS_PER_MM
SQUARE = box(0, 0, 10, 10)


def ring(*points: tuple[float, float]) -> Float:
    return np.array(points, dtype=np.float64)


def test_a_spike_goes_and_the_rest_of_the_outline_stays() -> None:
    spiked = ring((0, 0), (10, 0), (10, 5), (14, 5), (10, 5 + STEP), (10, 10), (0, 10))

    cleaned = remove_spikes(Areas.from_rings([[spiked], [SQUARE]]))

    assert cleaned.area() == pytest.approx([100, 100], abs=1e-3)
    assert cleaned.xy[:, 0].max() == 10
    assert not is_spike(cleaned).any()


def test_a_bent_spike_goes_from_its_tip_to_its_foot() -> None:
    out = [(10.0 + i, 5.0 + i % 2) for i in range(6)]
    back = [(x, y + STEP) for x, y in out[:-1]][::-1]
    spiked = ring((0, 0), (10, 0), *out, *back, (10, 10), (0, 10))

    cleaned = remove_spikes(Areas.from_rings([[spiked]]))

    assert cleaned.xy[:, 0].max() == 10
    assert cleaned.area() == pytest.approx([100], abs=1e-3)


@pytest.mark.parametrize(
    "flat",
    [
        ring((3, 3), (7, 3), (3, 3)),
        ring((3, 3), (7, 3), (7, 3), (3, 3)),
        ring((3, 3), (7, 3), (7, 3 + STEP), (3, 3 + STEP)),
        ring((3, 3), (5, 5), (7, 4), (5, 5 + STEP)),
        ring((3, 3), (3 + STEP, 3), (3, 3 + STEP)),
        ring((3, 3), (3 + STEP, 3), (3 + STEP, 3 + STEP), (3, 3 + STEP)),
    ],
    ids=["out and back", "with equal points", "a strip", "a bent strip", "a speck", "a square speck"],
)
@pytest.mark.parametrize("as_hole", [False, True], ids=["solid", "hole"])
def test_rings_without_area_go(flat: Float, as_hole: bool) -> None:
    cleaned = remove_spikes(Areas.from_rings([[], [SQUARE, flat[::-1] if as_hole else flat], [SQUARE]]))

    assert cleaned.xy.tolist() == [*SQUARE.tolist(), *SQUARE.tolist()]
    assert cleaned.ring_layer.tolist() == [1, 2]


def test_what_is_thin_but_wider_than_the_rounding_stays() -> None:
    needle = ring((0, 0), (30, -3 * STEP), (30, 3 * STEP))
    stack = Areas.from_rings([[needle], [SQUARE], [box(0, 0, 5, 4 * STEP)]])

    assert remove_spikes(stack) is stack


def test_nothing_is_made_of_nothing() -> None:
    assert remove_spikes(Areas.empty(3)).n_rings == 0
