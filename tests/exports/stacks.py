"""Stacks of contours with known areas, and functions to compare exported files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.model import LayerPlan, Sections
from tests.strategies import box, clean_areas

__all__ = ["closed_area", "frame", "heights", "islands", "of", "sections", "signed_area", "uneven"]


def of(rings: list[list[Float]], tops: Sequence[float]) -> Sections:
    """Sections with these rings in each layer and these tops of layers."""
    return Sections(LayerPlan.from_tops(np.array(tops)), Areas.from_rings(rings))


def frame(x: float = 0.0, y: float = 0.0) -> list[Float]:
    """A square of 10 mm with a hole of 4 mm and an island of 2 mm in it: 100 - 16 + 4 mm²."""
    return [box(x, y, x + 10, y + 10), box(x + 3, y + 3, x + 7, y + 7)[::-1], box(x + 4, y + 4, x + 6, y + 6)]


def islands() -> list[Float]:
    """Two separate rectangles left of and below the origin: 2 + 6 mm²."""
    return [box(-8, -5, -7, -3), box(-3, -9, -1, -6)]


def uneven() -> Sections:
    """Five layers of three thicknesses; the second is empty."""
    return of([frame(), [], islands(), frame(-20, -30), [box(0, 0, 1, 1)]], [0.3, 0.5, 0.7, 0.8, 0.9])


def heights(n_layers: int) -> st.SearchStrategy[list[float]]:
    """Tops of layers of 0.05 to 0.4 mm, in steps of 0.01 mm."""
    steps = st.lists(st.integers(5, 40), min_size=n_layers, max_size=n_layers)
    return steps.map(lambda each: (np.cumsum(each) / 100).tolist())


def sections(n_layers: int = 3) -> st.SearchStrategy[Sections]:
    """Stacks of any clean areas in layers of any heights; some layers are empty."""
    plans = heights(n_layers).map(lambda tops: LayerPlan.from_tops(np.array(tops)))
    return st.builds(Sections, plans, clean_areas(n_layers))


def signed_area(ring: Float) -> float:
    """mm²; positive counter-clockwise, whether or not the first point is repeated."""
    x, y = (ring - ring[0]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def closed_area(rings: Iterable[Float]) -> float:
    """mm² of closed polylines, each of which must end where it begins."""
    total = 0.0
    for ring in rings:
        assert (ring[0] == ring[-1]).all()
        total += signed_area(ring[:-1])
    return total
