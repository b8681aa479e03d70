"""The kernel finds the same facets, edges and corners that a ball can touch as the Python code."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.model import Mesh
from printer_slicer.surface import contacts
from printer_slicer.surface.contacts import Contacts, find_contacts
from tests.kernels import needs_kernel
from tests.parts import box_with_hole, case_study

pytestmark = needs_kernel


def contacts_with(kernel: str, mesh: Mesh) -> tuple[Contacts, float]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return find_contacts(mesh)


def assert_same_contacts(mesh: Mesh) -> None:
    (one, area), (other, other_area) = contacts_with("required", mesh), contacts_with("off", mesh)

    assert area == other_area
    for name in ("low", "high", "rise", "source"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def random_facets(seed: int, n_facets: int, n_points: int, steps: int) -> Mesh:
    """Facets between few points on a coarse grid: shared, crossing, level, upright and without area."""
    rng = np.random.default_rng(seed)
    points = rng.integers(-steps, steps + 1, (n_points, 3)) * 0.7
    points[rng.random(points.shape) < 0.1] = -0.0
    return Mesh(points[rng.integers(0, n_points, (n_facets, 3))])


@given(
    seed=st.integers(0, 2**32 - 1),
    n_facets=st.integers(1, 60),
    n_points=st.integers(3, 30),
    steps=st.integers(1, 5),
)
def test_contacts_of_random_facets_are_the_same(seed: int, n_facets: int, n_points: int, steps: int) -> None:
    assert_same_contacts(random_facets(seed, n_facets, n_points, steps))


@pytest.mark.parametrize("part", [box_with_hole(), case_study()], ids=["box", "case study"])
def test_contacts_of_parts_are_the_same(part: Mesh) -> None:
    assert_same_contacts(part)


def test_contacts_of_several_blocks_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges and corners lie in two blocks, one of which may rule them out."""
    monkeypatch.setattr(contacts, "_AT_ONCE", 7)

    assert_same_contacts(case_study())
    assert_same_contacts(random_facets(3, 200, 40, 6))


def test_half_a_facet_is_an_error() -> None:
    kernel = load_kernel()
    assert kernel is not None

    with pytest.raises(ValueError, match="a facet does not have nine coordinates"):
        kernel.facet_contacts(np.zeros(10), 0)
