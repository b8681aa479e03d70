"""Outlines from above: the union of all upward facets, whatever the facets share."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import Mesh
from printer_slicer.surface import top_view
from printer_slicer.surface.top_view import project_from_above
from tests.parts import box, joined


def covered(mesh: Mesh) -> shapely.Geometry:
    """The union of the facets that face up, by shapely."""
    faces = [shapely.Polygon(one) for one in mesh.triangles[:, :, :2]]
    up = [one for one in faces if one.exterior.is_ccw and one.area > 0]
    return shapely.union_all(up)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(2, 9))
def test_the_outline_is_the_union_of_the_upward_facets(seed: int, facets: int, corners: int) -> None:
    """Facets between a few corners share edges in all ways: twice, in opposite directions, or folded over."""
    random = np.random.default_rng(seed)
    points = np.round(random.uniform(0, 20, (corners + 2, 3)), 1)
    mesh = Mesh(points[random.integers(0, len(points), (facets, 3))])

    assert project_from_above(mesh).area().sum() == pytest.approx(covered(mesh).area, abs=0.02)


def test_facets_that_share_no_edges_are_united_in_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    both = Mesh(joined([box((20, 20, 3)), box((20, 20, 3), at=(10, 10, 5))]).triangles)

    expected = project_from_above(both).area().sum()
    monkeypatch.setattr(top_view, "_MAX_BORDER", 3)
    assert expected == pytest.approx(700)
    assert project_from_above(both).area().sum() == pytest.approx(expected)
