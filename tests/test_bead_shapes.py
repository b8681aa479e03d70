"""Beads that are not as wide at their end as at their begin, or not as high as their layer."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from printer_slicer.extrusion import extrude
from printer_slicer.model import Areas, LayerPlan, Sections, Toolpaths
from printer_slicer.roles import Role
from printer_slicer.travels import travel
from tests.parts import plain


def test_beads_of_changing_width_and_own_height_get_the_volume_of_their_own_shape() -> None:
    """A wedge 6 mm long, from 0.4 to 1 mm wide, 0.3 mm high though its layer has 0.2 mm."""
    plan = LayerPlan.from_tops(np.array([0.2]))
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20)], dtype=float)
    paths = Toolpaths.gathered(
        plan,
        xy=np.array([(2, 2), (5, 2), (8, 2), (2, 9), (2, 5)], dtype=float),
        size=np.array([3, 2]),
        layer=np.zeros(2, np.int64),
        role=np.full(2, int(Role.INTERNAL_INFILL)),
        width=np.array([0.4, 0.7, 1.0, 0.5, 0.5]),
        height=np.array([0.3, 0.2]),
        closed=False,
    )
    wanted = plain()

    program = extrude(paths, travel(paths, Sections(plan, Areas.from_rings([[square]])), wanted), wanted)

    beads = program.role != Role.TRAVEL
    fed = program.filament[beads] * pi * wanted.material.filament_diameter**2 / 4
    # Straight sides and round ends of a cross-section grow evenly with the width: the volume is that of the mean.
    shape = [(w - h) * h + pi * h**2 / 4 for w, h in ((0.55, 0.3), (0.85, 0.3), (0.5, 0.2))]
    assert fed == pytest.approx([3 * shape[0], 3 * shape[1], 4 * shape[2]])
    assert program.width[beads] == pytest.approx([0.55, 0.85, 0.5])
    assert program.height[beads] == pytest.approx([0.3, 0.3, 0.2])
    flow = fed / 3 * program.speed[beads]
    assert (flow[:2] <= wanted.max_flow + 1e-9).all()
