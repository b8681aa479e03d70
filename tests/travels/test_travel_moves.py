"""Ways become moves."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.parts import box_with_hole, profile


@pytest.mark.parametrize("printer", ["marlin_220", "corexy_klipper"])
def test_travels_pass_the_points_of_their_ways(printer: str) -> None:
    """A frame, inside which the nozzle goes around the corners of the window."""
    frame = box_with_hole((40, 40, 2.2))
    wanted = profile(printer, skirt_loops=0, infill_density=0.4, infill_anchor_max=0)
    stages = slice_stages(frame, wanted)
    program, travels = stages.program, stages.travels
    passed = program.xyz[:, :2].tolist()

    assert len(travels.xy)
    place = 0
    for point in travels.xy.tolist():
        place = passed.index(point, place) + 1
        assert program.role[place - 1] == Role.TRAVEL
        assert program.filament[place - 1] == 0
    # What is not pulled back on the way is not lifted, and what is, all the way.
    lift = program.xyz[:, 2] - stages.sections.plan.top[program.layer]
    assert set(np.round(lift[1:], 9).tolist()) <= {0.0, wanted.printer.z_hop, 2.0}
