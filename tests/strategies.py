"""Hypothesis strategies shared by the tests."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, normalize

__all__ = ["areas", "box", "clean_areas", "rectilinear_areas", "rectilinear_rings", "star_rings"]


def box(x0: float, y0: float, x1: float, y1: float) -> Float:
    """(4, 2) a rectangle, counter-clockwise; turn it with [::-1] to make a hole."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64)


def _star(center: tuple[float, float], radii: list[float], turn: float) -> Float:
    angles = turn + np.arange(len(radii)) * (2 * np.pi / len(radii))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(radii)[:, None] + np.array(center)


@st.composite
def star_rings(draw: st.DrawFn) -> list[Float]:
    """A star-shaped outline, often concave, with or without a hole of the same shape inside."""
    center = draw(st.tuples(st.integers(-8, 8), st.integers(-8, 8)))
    radii = [r / 4 for r in draw(st.lists(st.integers(12, 60), min_size=3, max_size=10))]
    turn = draw(st.integers(0, 62)) / 10
    outline = _star(center, radii, turn)
    hole = _star(center, [r * 0.4 for r in radii], turn)[::-1]
    return [outline, hole] if draw(st.booleans()) else [outline]


@st.composite
def rectilinear_rings(draw: st.DrawFn) -> list[Float]:
    """Rectangles on a half-millimetre lattice that overlap and touch as they like, some of them holes."""
    rings = []
    for _ in range(draw(st.integers(1, 5))):
        x, y = draw(st.tuples(st.integers(-20, 20), st.integers(-20, 20)))
        wide, high = draw(st.tuples(st.integers(2, 30), st.integers(2, 30)))
        ring = box(x / 2, y / 2, (x + wide) / 2, (y + high) / 2)
        rings.append(ring[::-1] if draw(st.integers(0, 3)) == 0 else ring)
    return rings


def areas(n_layers: int) -> st.SearchStrategy[Areas]:
    """Stacks of any rings: overlapping, touching, crossing; some layers are empty."""
    several = st.lists(star_rings(), min_size=1, max_size=2).map(
        lambda many: [ring for rings in many for ring in rings]
    )
    layer = st.one_of(st.just([]), star_rings(), rectilinear_rings(), several)
    return st.lists(layer, min_size=n_layers, max_size=n_layers).map(Areas.from_rings)


def clean_areas(n_layers: int) -> st.SearchStrategy[Areas]:
    """Stacks of clean areas; some layers are empty."""
    return areas(n_layers).map(normalize)


def rectilinear_areas(n_layers: int) -> st.SearchStrategy[Areas]:
    """Stacks of clean areas with right angles only."""
    layers = st.lists(rectilinear_rings(), min_size=n_layers, max_size=n_layers)
    return layers.map(Areas.from_rings).map(normalize)
