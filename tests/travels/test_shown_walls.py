"""Ways inside the part do not lie on the outer bead, which is seen."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.model import LayerPlan, Mesh, find_travel_ends
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.parts import box_with_hole, plain, prism, shapely


def wavy() -> Mesh:
    """A convex outline whose sides bend, so that straight ways beside it come near it."""
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    ring = np.column_stack([20 * np.cos(angle), 14 * np.sin(angle)])
    return prism(ring, 2.0)


def over_outer_beads(stages: Stages) -> tuple[int, int]:
    """How many ways without retraction cross the middle of an outer bead, away from their ends; of how many."""
    paths, travels = stages.toolpaths, stages.travels
    begin, end = find_travel_ends(paths)
    over = long = 0
    for way in range(1, paths.n_paths):
        if travels.retract[way] or paths.layer[way] != paths.layer[way - 1]:
            continue
        passed = travels.xy[travels.start[way] : travels.start[way + 1]]
        line = shapely.LineString(np.concatenate([begin[way : way + 1], passed, end[way : way + 1]]))
        ends = shapely.buffer(shapely.MultiPoint([begin[way], end[way]]), 0.6)
        outer = np.flatnonzero(
            (paths.layer == paths.layer[way]) & (paths.role == Role.EXTERNAL_PERIMETER) & paths.closed
        )
        rings = shapely.union_all([shapely.linearrings(paths.path(i)) for i in outer.tolist()])
        long += line.length > 2
        over += line.length > 2 and shapely.intersects(shapely.difference(line, ends), rings)
    return over, long


@pytest.mark.parametrize("mesh", [wavy(), box_with_hole((24, 24, 2), (12, 10))], ids=["wavy", "frame"])
@pytest.mark.parametrize("seam", ["aligned", "random"])
def test_ways_keep_off_outer_beads(mesh: Mesh, seam: str) -> None:
    plan = LayerPlan.from_tops(np.arange(1, 9) * 0.25)
    stages = slice_stages(mesh, plain(seam=seam, infill="rectilinear", infill_density=0.2), plan=plan)

    over, long = over_outer_beads(stages)
    assert long >= 8
    assert over == 0
