"""What rows cover: the union of their rectangles."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, difference, hatch, normalize, offset
from printer_slicer.geometry.staircases import unite_row_rectangles
from tests.strategies import clean_areas


@given(
    areas=clean_areas(2),
    spacing=st.floats(0.3, 4.0),
    angle=st.floats(0.0, 3.1),
    longer=st.floats(0.0, 1.0),
    wide=st.floats(0.5, 1.0),
)
def test_staircases_are_the_union_of_rectangles(
    areas: Areas, spacing: float, angle: float, longer: float, wide: float
) -> None:
    rows = hatch(areas, angle=angle, spacing=spacing)
    u = rows.u + np.array([-longer, longer])

    made = unite_row_rectangles(rows, u, angle=angle, half=wide * spacing, n_layers=2)

    along, aside = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    v = (rows.ends[:, 0] @ aside)[:, None]
    corners = [
        u[:, side, None] * along + (v + by * wide * spacing) * aside
        for side, by in ((0, -1), (1, -1), (1, 1), (0, 1))
    ]
    each = Areas(
        np.stack(corners, axis=1).reshape(-1, 2), 4 * np.arange(rows.n_lines + 1), rows.layer, areas.n_layers
    )
    # At both ends of a column they reach on by a thousandth.
    wanted, off = normalize(each), 0.002 * spacing + 1e-4
    assert difference(made, offset(wanted, off)).area().sum() < 1e-6
    assert difference(wanted, offset(made, off)).area().sum() < 1e-6


def test_without_rows_there_is_nothing() -> None:
    rows = hatch(Areas.empty(3), angle=0.0, spacing=1.0)

    assert unite_row_rectangles(rows, rows.u, angle=0.0, half=0.5, n_layers=3).n_rings == 0
