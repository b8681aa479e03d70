"""Infill holds on to the perimeters with its ends, by a share of the spacing; no line lies on top of a perimeter."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.infill import PATTERNS
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.effort import crossed
from tests.parts import box_with_hole, plain, shapely

WIDTH = 0.45
GAP = float(bead.spacing(WIDTH, 0.2))
MESH = box_with_hole((30, 30, 4), (10, 10))
SLACK = 1e-3


def lines(stages: Stages, role: Role, layer: int = 10) -> list[shapely.LineString]:
    paths = stages.toolpaths
    found = np.flatnonzero((paths.layer == layer) & (paths.role == role))
    made = [np.asarray(paths.path(int(i))) for i in found]
    return [
        shapely.LineString(np.concatenate([xy, xy[:1]]) if paths.closed[i] else xy)
        for i, xy in zip(found.tolist(), made, strict=True)
    ]


def test_ends_of_all_infill_reach_a_quarter_into_the_perimeter_by_default() -> None:
    quality = load_profile().quality

    assert (quality.infill_overlap, quality.internal_infill_overlap) == (0.25, 0.25)


@pytest.mark.parametrize(
    ("pattern", "share"),
    crossed([name for name in PATTERNS if name not in ("concentric", "lightning")], [0.0, 0.25, 0.5]),
)
def test_only_ends_reach_into_the_perimeter(pattern: str, share: float) -> None:
    stages = slice_stages(MESH, plain(infill=pattern, internal_infill_overlap=share, layer_height=0.2))

    inner = shapely.union_all(lines(stages, Role.PERIMETER))
    sparse = lines(stages, Role.INTERNAL_INFILL)
    nearest = min(inner.distance(line) for line in sparse)
    assert nearest == pytest.approx((1 - share) * GAP, abs=SLACK)
    # What joins the ends runs beside the perimeter; it needs a bead's length to get there.
    on_top = shapely.intersection(shapely.union_all(sparse), inner.buffer(GAP - SLACK)).length
    beside = shapely.intersection(shapely.union_all(sparse), inner.buffer(GAP + SLACK)).length
    assert beside > 20
    assert on_top < 0.4 * beside if share else on_top == 0


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5])
def test_overlap_of_solid_infill_moves_ends_and_not_the_volume(share: float) -> None:
    wanted = plain(infill_density=1, infill_overlap=share, layer_height=0.3, infill_angle_deg=0)
    stages = slice_stages(MESH, wanted)

    paths = stages.toolpaths
    laid = (paths.area() * paths.height).sum()
    assert laid == pytest.approx(MESH.volume, rel=0.01)
    inner = shapely.union_all(lines(stages, Role.PERIMETER))
    gap = float(bead.spacing(WIDTH, 0.3))
    ends = [shapely.Point(line.coords[k]) for line in lines(stages, Role.SOLID_INFILL) for k in (0, -1)]
    assert min(inner.distance(end) for end in ends) <= (1 - share) * gap + 0.02
