"""Facets that share no edges: what is near is found as if all were compared, and what cannot be closed is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import MeshError
from printer_slicer.geometry.connectivity import group_close_points
from printer_slicer.healing import repair
from printer_slicer.healing.duplicates import join_corners
from printer_slicer.healing.facets import Facets
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.slicing import cut
from tests.effort import few_of


def loose_facets(n: int, size: float, seed: int) -> Mesh:
    """Anywhere in a cube of 20 mm."""
    rng = np.random.default_rng(seed)
    return Mesh(rng.uniform(0, 20, (n, 1, 3)) + rng.uniform(-size, size, (n, 3, 3)) + [0, 0, 5])


@given(seed=st.integers(0, 2**32 - 1), far=st.sampled_from([0.0, -500.0, 3e4]))
def test_corners_are_joined_as_if_all_were_compared(seed: int, far: float) -> None:
    rng = np.random.default_rng(seed)
    triangles = np.array(loose_facets(60, 3.0, seed).triangles) + far
    flat = triangles.reshape(-1, 3)
    reach = max(0.001, 4 * 2.0**-24 * (abs(far) + 30))
    some, others = rng.permutation(np.arange(3, 90))[:30], rng.permutation(np.arange(90, 180))[:30]
    flat[some] = flat[others] + rng.uniform(-2 * reach, 2 * reach, (30, 3))
    # A short edge, for which nothing farther away is joined after that.
    flat[1] = flat[0] + [4 * reach, 0, 0]
    reach = max(0.001, 4 * 2.0**-24 * float(np.abs(flat).max()))

    joined, _ = join_corners(Facets.from_triangles(triangles))

    assert len(np.unique(joined.corners)) == group_close_points(flat, reach).max() + 1


def test_facets_rounded_on_their_own_are_one_surface_again() -> None:
    rng = np.random.default_rng(4)
    whole = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0, 1.0], indexing="ij"), axis=-1)
    a, b, c = whole[:-1, :-1, 0], whole[1:, :-1, 0], whole[1:, 1:, 0]
    sheet = np.stack([a, b, c], axis=2).reshape(-1, 3, 3)

    joined, done = join_corners(Facets.from_triangles(sheet + rng.uniform(-2e-4, 2e-4, sheet.shape)))

    assert len(np.unique(joined.corners)) == len(np.unique(sheet.reshape(-1, 3), axis=0))
    assert [one.kind for one in done] == ["corners joined"]


@pytest.mark.parametrize("size", few_of([1.0, 3.0], 1))
def test_thousands_of_loose_facets_are_refused_with_a_remedy(size: float) -> None:
    heights = np.arange(0.5, 29.5, 4.0)
    with pytest.raises(MeshError, match=r"the surface is open: the .* at x .* y .* z ") as caught:
        cut(repair(loose_facets(3000, size, 1))[0], LayerPlan(heights + 0.2, heights), 0.0125)

    assert caught.value.remedy
