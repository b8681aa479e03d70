"""Paths can be rebuilt a slab at a time."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Int
from printer_slicer.model import LayerPlan, Toolpaths
from tests.effort import examples


@given(st.integers(0, 1000), st.booleans())
@settings(max_examples=examples(10))
def test_paths_rebuilt_in_slabs_are_those_of_all_points_at_once(seed: int, has_support_ratio: bool) -> None:
    rng = np.random.default_rng(seed)
    size = rng.integers(1, 40_000, 9)
    n = int(size.sum())
    paths = Toolpaths.gathered(
        LayerPlan.from_tops(np.array([0.2])),
        xy=rng.uniform(0, 9, (n, 2)),
        size=size,
        layer=np.zeros(9, np.int64),
        role=rng.integers(1, 4, 9),
        width=rng.uniform(0, 1, n),
        closed=True,
        support_ratio=rng.uniform(0, 1, n) if has_support_ratio else None,
    )
    path = rng.permutation(9)
    start = np.append(0, np.cumsum(size[path]))
    point = rng.integers(0, n, n)
    whole = paths.of_points(point, start, path)
    slabs = []

    def find_points(some: slice) -> tuple[Int, Int]:
        slabs.append(some)
        own = point[start[some.start] : start[some.stop]]
        return own, own

    rebuilt, columns = paths.rebuild(find_points, start, path)
    assert len(slabs) > 1 or n < 1 << 17
    assert set(columns) == {"xy", "width"} | ({"support_ratio"} if has_support_ratio else set())
    for name in Toolpaths.__struct_fields__[1:]:
        np.testing.assert_array_equal(getattr(rebuilt, name), getattr(whole, name))


def test_joining_with_an_empty_part_stores_no_columns_of_defaults() -> None:
    plan = LayerPlan.from_tops(np.array([0.2]))
    square = Toolpaths.gathered(
        plan,
        xy=np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
        size=np.array([4]),
        layer=np.array([0]),
        role=np.array([1]),
        width=np.array([0.4]),
        closed=True,
    )
    joined = Toolpaths.joined(plan, [square, square.take(np.zeros(0, np.int64))])
    assert (joined.z_offset.tolist(), joined.flow_ratio.tolist()) == ([0.0] * 4, [1.0] * 4)
    assert joined.z_offset.strides == joined.flow_ratio.strides == (0,)
