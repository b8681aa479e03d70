"""Values once each, and the place of each among them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import unique_inverse


@given(st.lists(st.integers(-9, 9)))
def test_places_lead_back_to_the_values(values: list[int]) -> None:
    given_values = np.array(values, np.int64)
    once, place = unique_inverse(given_values)

    assert once.tolist() == sorted(set(values))
    assert np.array_equal(once[place], given_values)
