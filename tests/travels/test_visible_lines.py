"""Lines of top surfaces are searched by short pieces; the result is that of a comparison with every whole line."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.ring_queries import crossing_shares
from printer_slicer.geometry.segment_index import distance_to_segments
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.roles import Role
from printer_slicer.travels.top_surface import _select_visible_lines
from tests.effort import examples

PLAN = LayerPlan.from_tops(np.array([0.2, 0.4]))


def lines_on_layers(ends: Float, width: Float) -> Toolpaths:
    """Open lines (n, 2, 2) of top solid infill, the first half on the first layer."""
    n = len(ends)
    return Toolpaths.gathered(
        PLAN,
        xy=ends.reshape(-1, 2),
        size=np.full(n, 2),
        layer=np.arange(n) * 2 // n,
        role=np.full(n, Role.TOP_SOLID_INFILL),
        width=width,
        closed=False,
    )


def pairs(one: Int, other: Int) -> set[tuple[int, int]]:
    """The pairs as a set, without an order."""
    return set(zip(one.tolist(), other.tolist(), strict=True))


@settings(max_examples=examples(30))
@given(st.integers(0, 10_000), st.integers(2, 60), st.sampled_from([2.0, 40.0, 250.0]))
def test_pieces_find_what_whole_lines_find(seed: int, n: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    ends, width = rng.uniform(0, size, (n, 2, 2)), rng.uniform(0.3, 0.6, n)
    ends[::3, 1, 1] = ends[::3, 0, 1]  # some are parallel to an axis
    visible = _select_visible_lines(lines_on_layers(ends, width), np.arange(2))
    begin, end = rng.uniform(0, size, (2, 20, 2))
    begin[5:10] = ends[rng.integers(0, n, 5), 0]  # some start on a line
    layer = rng.integers(0, 2, 20)
    leg, line = (a.ravel() for a in np.indices((20, n)))
    same = layer[leg] == (line * 2 // n)
    leg, line = leg[same], line[same]
    shares = crossing_shares(begin[leg], end[leg], ends[line, 0], ends[line, 1])
    crossed = ~np.isnan(shares)
    assert pairs(*visible.find_crossings(begin, end, layer)) == pairs(leg[crossed], line[crossed])
    near = distance_to_segments(begin[leg], ends[line, 0], ends[line, 1]) < width[line] / 2
    assert pairs(*visible.find_around(begin, layer)) == pairs(leg[near], line[near])
