"""Diagrams as arrays against what the library says of each edge."""

from __future__ import annotations

import numpy as np
import pytest
import pyvoronoi

from printer_slicer.geometry.voronoi_diagram import compute_diagrams
from printer_slicer.kernel import VARIABLE
from tests.kernels import needs_kernel

_STAR = [(0.0, 0.0), (5.0, 0.0), (5.0, 1.5), (2.5, 1.0), (0.0, 2.5)]
_TOUCHING = [(0.0, 0.0), (2.0, 0.0), (1.0, 1.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0)]  # in one corner
_CASES = {
    "a ring": _STAR,
    "a ring that touches itself": _TOUCHING,
    "many sides": [(3 * np.cos(a) + 0.3 * np.cos(7 * a), 2 * np.sin(a)) for a in np.arange(0, 6.28, 0.1)],
}


@pytest.fixture(autouse=True, params=["off", pytest.param("required", marks=needs_kernel)])
def kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """All tests run with and without the compiled kernel."""
    monkeypatch.setenv(VARIABLE, request.param)


def _sides(points: list[tuple[float, float]]) -> np.ndarray:
    xy = np.round(np.array(points), 5)
    return np.stack([xy, np.roll(xy, -1, axis=0)], axis=1)


def _of_library(sides: np.ndarray) -> pyvoronoi.Pyvoronoi:
    """The same diagram, around the same place, by the library's own calls."""
    low, high = sides.reshape(-1, 2).min(axis=0), sides.reshape(-1, 2).max(axis=0)
    steps = np.rint((sides - np.rint((low + high) / 2)) * 100_000).astype(int) + 10_000_000
    built = pyvoronoi.Pyvoronoi(1)
    for side in steps.tolist():
        built.AddSegment(side)
    built.Construct()
    return built


@pytest.mark.parametrize("name", _CASES)
@pytest.mark.parametrize("taken", [slice(None), slice(0, 1), slice(0, 3, 2)], ids=["all", "one", "two apart"])
def test_edges_are_those_that_the_library_tells_one_by_one(name: str, taken: slice) -> None:
    sides = _sides(_CASES[name])[taken]
    found, built = compute_diagrams(sides, np.zeros(len(sides), np.int64)), _of_library(sides)
    edges = [built.GetEdge(i) for i in range(built.CountEdges())]
    assert found.start.tolist() == [edge.start for edge in edges]
    assert found.end.tolist() == [edge.end for edge in edges]
    assert found.cell.tolist() == [edge.cell for edge in edges]
    assert found.primary.tolist() == [bool(edge.is_primary) for edge in edges]


def test_areas_lie_side_by_side_in_one_diagram() -> None:
    one, other = _sides(_STAR), _sides(_STAR) + 7.0
    both = compute_diagrams(np.concatenate([one, other]), np.repeat([0, 1], [len(one), len(other)]))
    alone = compute_diagrams(one, np.zeros(len(one), np.int64))
    half = len(alone.start)
    assert len(both.start) == 2 * half
    assert both.primary.tolist() == alone.primary.tolist() * 2
    assert (both.side[both.cell[half:]] >= len(one)).all()
    assert np.allclose(both.vertex, np.concatenate([alone.vertex, alone.vertex + 7.0]), atol=1e-6)
