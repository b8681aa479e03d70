"""Interpolation of many rows at once agrees with numpy's of one row."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from printer_slicer.arrays import interpolate_rows

NUMBERS = st.floats(-1e6, 1e6)


@given(st.data())
def test_rows_are_interpolated_as_numpy_does(data: st.DataObject) -> None:
    known = np.array(sorted(data.draw(st.sets(st.integers(-50, 50), min_size=1, max_size=8))), np.float64)
    n_rows = data.draw(st.integers(0, 3))
    values = data.draw(arrays(np.float64, (n_rows, len(known)), elements=NUMBERS))
    x = data.draw(arrays(np.float64, st.integers(0, 9), elements=st.floats(-60, 60)))

    found = interpolate_rows(x, known, values)

    assert found.shape == (n_rows, len(x))
    for row, one in zip(found, values, strict=True):
        assert np.array_equal(row, np.interp(x, known, one))
