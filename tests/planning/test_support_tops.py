"""Plans with layers that end below flats at the gap of supports."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.support_tops import find_support_contacts
from printer_slicer.profile import Profile, load_profile
from printer_slicer.surface import find_downward_flats, find_flats, layer_bounds, read_surface
from tests.parts import box, joined

STEP = 0.0025
STEM = 8.0


def profile(kind: str = "optimal", gap: float = 0.2, **changes: object) -> Profile:
    """A profile whose supports have the layers of the part."""
    own = {
        "quality.support": "columns",
        "quality.support_synchronize_layers": True,
        "quality.support_gap": gap,
    }
    given = {f"quality.{key}": value for key, value in changes.items()}
    return load_profile(quality="fine", changes={"quality.planner.kind": kind, **own, **given})


def shelves(*heights: float) -> Mesh:
    """A stem with a shelf, 1.3 mm thick, at each height."""
    plates = [box((16.0, STEM, 1.3), (STEM - 0.5, 0.0, z)) for z in heights]
    return joined([box((STEM, STEM, max(heights) + 4.7)), *plates], "shelves")


def has_top(top: np.ndarray, z: float) -> bool:
    """Whether a layer ends at a height."""
    return bool(np.abs(top - z).min() < 1e-6)


@pytest.mark.parametrize("kind", ["optimal", "cusp", "stepwise", "genetic"])
def test_a_layer_ends_at_the_gap_below_a_flat(kind: str) -> None:
    part = shelves(7.3)
    for gap in (0.13, 0.2, 0.27):
        top = plan_layers(part, profile(kind, gap)).top
        assert has_top(top, 7.3)
        assert has_top(top, 7.3 - gap)


@given(st.lists(st.integers(800, 8000), min_size=1, max_size=3), st.integers(40, 120))
def test_all_flats_that_are_far_apart_get_their_gap(places: list[int], gap: int) -> None:
    heights = [z * STEP for z in sorted(places)]
    ends = np.sort([end for z in heights for end in (z, z + 1.3)])
    if np.diff(ends).min() < 1.0:
        return
    plan = plan_layers(shelves(*heights), profile(gap=gap * STEP))

    for z in heights:
        assert has_top(plan.top, z)
        assert has_top(plan.top, z - gap * STEP)


def test_the_tolerance_and_the_flats_come_first() -> None:
    # The upper side of the lower shelf lies where a layer of 0.05 mm would have to begin.
    part = shelves(5.0, 5.0 + 1.3 + 0.25)
    plan = plan_layers(part, profile())
    surface = read_surface(part)

    for z in find_flats(part)[0]:
        assert has_top(np.append(0.0, plan.top), round(float(z), 6))
    assert layer_bounds(surface, plan).max() <= profile().quality.tolerance + 1e-9


@pytest.mark.parametrize("changes", [{"support": "off"}, {"support_synchronize_layers": False}])
def test_without_such_supports_plans_stay_as_they_are(changes: dict[str, object]) -> None:
    one = profile(**changes)
    plain = profile(support="off", support_synchronize_layers=False)
    part = shelves(7.3)

    assert (plan_layers(part, one).top == plan_layers(part, plain).top).all()


def test_flats_that_are_low_or_small_and_the_bed_do_not_count() -> None:
    low, small, high = 0.3, 5.0, 9.0
    plates = [
        box((size, size, 1.0), (STEM - 0.1, 1.0, z)) for size, z in ((4.0, low), (1.9, small), (4.0, high))
    ]
    part = joined([box((STEM, STEM, 12.0)), *plates], "plates")

    assert find_downward_flats(part)[0] == pytest.approx([low, small, high])
    contact, top = find_support_contacts(part, profile(), STEP)
    assert contact * STEP == pytest.approx([high])
    assert top * STEP == pytest.approx([high - 0.2])
