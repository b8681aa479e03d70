"""What lies over sparse infill lies across its lines, however many layers of it are printed together."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.model import Toolpaths
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.effort import crossed
from tests.parts import box, plain


def direction(paths: Toolpaths, role: Role, layer: int) -> Float:
    """Unit vector along the longest line of a role on a layer."""
    here = np.flatnonzero((paths.role == role) & (paths.layer == layer))
    steps = np.concatenate([np.diff(paths.path(int(i)), axis=0) for i in here])
    longest = steps[np.argmax(np.hypot(*steps.T))]
    return np.asarray(longest / np.hypot(*longest))


@pytest.mark.parametrize(("every", "height"), crossed([0.0, 0.2, 0.3], [3.0, 3.1, 3.2, 3.3, 3.4]))
def test_beads_over_parallel_lines_cross_them(every: float, height: float) -> None:
    wanted = plain(
        layer_height=0.1, first_layer_height=0.1, infill="rectilinear", internal_infill_every=every
    )
    paths = slice_stages(box((30, 30, height)), wanted).toolpaths

    (bridge,) = np.unique(paths.layer[paths.role == Role.INTERNAL_BRIDGE]).tolist()
    below = int(paths.layer[paths.role == Role.INTERNAL_INFILL].max())
    assert below == bridge - 1
    across = direction(paths, Role.INTERNAL_BRIDGE, bridge) @ direction(paths, Role.INTERNAL_INFILL, below)
    assert abs(across) < 0.05


@pytest.mark.parametrize("every", [0.2, 0.3])
def test_parallel_lines_turn_from_each_bead_to_the_next_above_it(every: float) -> None:
    wanted = plain(
        layer_height=0.1, first_layer_height=0.1, infill="rectilinear", internal_infill_every=every
    )
    paths = slice_stages(box((30, 30, 4.1)), wanted).toolpaths

    used = np.unique(paths.layer[paths.role == Role.INTERNAL_INFILL]).tolist()
    assert len(used) < 20
    for low, high in pairwise(used):
        assert (
            abs(direction(paths, Role.INTERNAL_INFILL, low) @ direction(paths, Role.INTERNAL_INFILL, high))
            < 0.05
        )
