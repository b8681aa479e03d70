"""Several windows of layers at once."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.geometry import Areas, window_intersection, window_intersections
from printer_slicer.geometry.engine import ENGINES, using_engine
from tests.strategies import box

engines = pytest.mark.parametrize("engine", list(ENGINES))


@engines
def test_several_windows_at_once_are_what_each_is_alone(engine: str) -> None:
    stack = Areas.from_rings([[box(k / 2, 0, 12 - k / 2, 5), box(20, k, 30, 20)] for k in range(9)])
    k = np.arange(9)
    windows = [
        (k, k + 1),
        (k - 1, k),
        (k - 2, k + 2),
        (k, np.minimum(k + 4, 9)),
        (np.maximum(k - 1, 0), k + 1),
    ]
    with using_engine(engine):
        together = window_intersections(stack, windows)

        for found, (first, last) in zip(together, windows, strict=True):
            alone = window_intersection(stack, first, last)
            assert np.array_equal(found.xy, alone.xy)
            assert np.array_equal(found.ring_layer, alone.ring_layer)
            assert np.array_equal(found.ring_start, alone.ring_start)
