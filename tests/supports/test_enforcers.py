"""Enforcers, blockers and painted facets: what is added to overhangs, what is taken out, what is reported."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import Areas, difference, offset_open, union
from printer_slicer.model import LayerPlan, Mesh, Overhangs, Sections, Volumes, VolumeSections
from printer_slicer.slicing import cut, cut_volumes
from printer_slicer.supports.enforcers import apply_enforcers_and_blockers
from printer_slicer.values import replace
from tests.parts import box, joined, plain, prism

PLAN = LayerPlan.from_tops(np.arange(1, 151) * 0.2)
QUALITY = plain().quality
UNDER = 20.0
"""z of the lower sides of the arms of the tee, mm."""


def tee() -> Mesh:
    """A stem of 10 x 10 and 20 mm height, with an arm of 15 x 10 to either side at its top."""
    return joined([box((10, 10, 25), (-5, -5, 0)), box((40, 10, 5), (-20, -5, UNDER))], "tee")


def hangs(sections: Sections, area: Areas | None = None, **more: Areas) -> Overhangs:
    """What hangs, in one patch; by default nothing."""
    plan = sections.plan
    area = area or Areas.empty(plan.n_layers)
    empty = Areas.empty(plan.n_layers)
    patch, flat = np.zeros(area.n_rings, np.int64), np.zeros(plan.n_layers, np.bool_)
    return Overhangs(plan, area, patch, more.get("islands", empty), more.get("bridged", empty), flat)


def everything_that_hangs(sections: Sections) -> Areas:
    on_bed = np.arange(sections.plan.n_layers) == 0
    return difference(sections.solid, sections.solid.shift_layers(1)).of_layers(~on_bed)


def steered(part: Mesh, volumes: Volumes, plan: LayerPlan = PLAN, *, everything: bool = False) -> Overhangs:
    sections = cut(part, plan, 0.001)
    area = everything_that_hangs(sections) if everything else None
    return apply_enforcers_and_blockers(hangs(sections, area), sections, cut_volumes(volumes, plan), QUALITY)


def facets_facing_down(part: Mesh, low: float, high: float) -> Float:
    """The facets that face down and lie between two heights."""
    a, b, c = part.triangles.transpose(1, 0, 2)
    z = part.triangles[..., 2]
    down = (np.cross(b - a, c - a)[:, 2] < 0) & (z.min(axis=1) > low) & (z.max(axis=1) < high)
    return part.triangles[down]


def test_enforcers_add_what_hangs_within_them() -> None:
    result = steered(tee(), Volumes(enforce=Mesh(box((9, 40, 4), (8, -20, UNDER - 2)).triangles)))
    layer = int(np.flatnonzero(result.area.used)[0])

    assert result.area.area().sum() == pytest.approx(9 * 10)
    assert PLAN.bottom[layer] == pytest.approx(UNDER)
    assert result.area.xy[:, 0].min() == pytest.approx(8)
    assert result.n_patches == 1
    assert np.flatnonzero(result.is_flat).tolist() == [layer]


def test_blockers_take_out_what_hangs_within_them() -> None:
    blocker = Mesh(box((9, 40, 4), (8, -20, UNDER - 2)).triangles)
    result = steered(tee(), Volumes(block=blocker), everything=True)

    # A blocker is 0.01 mm larger on all sides.
    assert result.area.area().sum() == pytest.approx(2 * 15 * 10 - 9.02 * 10)
    assert result.n_patches == 3
    assert result.blocked == ()


def test_a_place_that_is_enforced_and_blocked_is_blocked() -> None:
    both = Mesh(box((9, 40, 4), (8, -20, UNDER - 2)).triangles)
    result = steered(tee(), Volumes(enforce=both, block=both))

    assert result.area.n_rings == 0
    assert result.n_patches == 0


def test_enforced_bridges_are_no_bridges() -> None:
    sections = cut(tee(), PLAN, 0.001)
    everything = everything_that_hangs(sections)
    enforce = cut_volumes(Volumes(enforce=Mesh(box((30, 40, 4), (0, -20, UNDER - 2)).triangles)), PLAN)
    overhangs = apply_enforcers_and_blockers(hangs(sections, bridged=everything), sections, enforce, QUALITY)

    assert overhangs.area.area().sum() == pytest.approx(15 * 10)
    assert overhangs.bridged.area().sum() == pytest.approx(15 * 10)
    assert overhangs.bridged.xy[:, 0].max() == pytest.approx(-5)


def test_surfaces_that_are_steeper_than_the_threshold_are_enforced() -> None:
    """A wall at 75 degrees from the horizontal, whose strips are 0.05 mm wide, becomes one patch of many layers."""
    lean = np.array([20 / np.tan(np.radians(75)), 0.0])
    ring = np.array([[0.0, 0.0], [10, 0], [10, 10], [0, 10]])
    part = Mesh(_loft(ring, ring + lean, 20.0))
    result = steered(part, Volumes(enforce=Mesh(box((60, 60, 60), (-20, -20, -20)).triangles)))

    assert result.area.used.sum() == 99
    assert result.n_patches == 1
    assert not result.is_flat.any()


def _loft(low: Float, high: Float, height: float) -> Float:
    """A body between two rings (4, 2)."""
    body = prism(low, height).triangles.copy()
    top = body[..., 2] > height / 2
    body[top, :2] += high[0] - low[0]
    return body


def test_without_places_nothing_changes() -> None:
    sections = cut(tee(), PLAN, 0.001)
    overhangs = hangs(sections, everything_that_hangs(sections))

    assert (
        apply_enforcers_and_blockers(overhangs, sections, cut_volumes(Volumes(), PLAN), QUALITY) is overhangs
    )
    outside = Volumes(block=Mesh(box((4, 4, 4), (30, 30, 5)).triangles))
    kept = apply_enforcers_and_blockers(overhangs, sections, cut_volumes(outside, PLAN), QUALITY)
    assert np.array_equal(kept.area.area(), overhangs.area.area())


def test_blocked_islands_are_reported() -> None:
    sections = cut(tee(), PLAN, 0.001)
    islands = everything_that_hangs(sections)
    block = cut_volumes(Volumes(block=Mesh(box((30, 40, 4), (0, -20, UNDER - 2)).triangles)), PLAN)
    result = apply_enforcers_and_blockers(hangs(sections, islands, islands=islands), sections, block, QUALITY)
    (island,) = result.blocked

    assert (island.x, island.y, island.z) == pytest.approx((12.5, 0, UNDER))
    assert island.area == pytest.approx(150)
    assert island.is_island
    assert result.islands.area().sum() == pytest.approx(150)


def test_enforcers_in_which_nothing_hangs_are_listed() -> None:
    under = box((9, 40, 4), (8, -20, UNDER - 2)).triangles
    inside, outside = box((4, 4, 6), (-2, -2, 3)).triangles, box((4, 4, 4), (30, 30, 5)).triangles
    result = steered(tee(), Volumes(enforce=Mesh(np.concatenate([under, inside, outside]))))
    places = sorted((place.x, place.y, place.z) for place in result.idle_enforcers)

    assert np.array(places) == pytest.approx(np.array([(0.0, 0.0, 3.0), (32.0, 32.0, 5.0)]), abs=0.21)
    assert result.area.area().sum() == pytest.approx(90)
    assert steered(tee(), Volumes(enforce=Mesh(under))).idle_enforcers == ()


heights = st.lists(st.sampled_from([0.2, 0.25, 0.3, 0.4]), min_size=20, max_size=20).map(
    lambda some: some * 10
)


@given(heights, st.floats(15, 60), st.booleans())
def test_volumes_and_painted_facets_steer_alike(steps: list[float], degrees: float, flat: bool) -> None:
    """Within 0.15 mm, on any layers; on a flat lower side, and on one that leans."""
    plan = LayerPlan.from_tops(np.cumsum(steps))
    part = tee() if flat else _leaning(degrees)
    facets = facets_facing_down(part, 0.5, 60)
    place = Mesh(box((100, 100, 100), (-50, -50, 0.5)).triangles)
    pairs = (
        (Volumes(enforce=place), Volumes(enforced_facets=facets), False),
        (Volumes(block=place), Volumes(blocked_facets=facets), True),
    )
    for volume, painted, everything in pairs:
        one = steered(part, volume, plan, everything=everything).area
        other = steered(part, painted, plan, everything=everything).area
        assert offset_open(difference(one, other), 0.15).area().sum() == 0
        assert offset_open(difference(other, one), 0.15).area().sum() == 0
        if not everything:
            assert one.area().sum() > 50


def _leaning(degrees: float) -> Mesh:
    """A stem with an arm whose lower side leans by these degrees from the horizontal."""
    rise = 20 * np.tan(np.radians(degrees))
    side = np.array([[0.0, 10], [20, 10 + rise], [20, 15 + rise], [0, 15]])
    flat = prism(side, 10).triangles
    arm = Mesh(np.stack([flat[..., 0], -flat[..., 2] + 5, flat[..., 1]], axis=2))
    return joined([box((10, 10, 15), (-9.99, -5, 0)), arm], "leaning")


def test_painted_facets_that_face_up_ask_for_nothing() -> None:
    part = tee()
    up = part.triangles[part.triangles[..., 2].min(axis=1) > UNDER + 1]

    assert len(up)
    assert steered(part, Volumes(enforced_facets=up)).area.n_rings == 0


@pytest.mark.parametrize("containment", ["mid", "positive", "negative"])
def test_painted_facets_are_found_in_the_layer_that_hangs(containment: str) -> None:
    """Also if layers contain the part or lie within it; the lower side lies within a layer."""
    plan = replace(LayerPlan.from_tops(np.arange(1, 80) * 0.33), containment=containment)
    facets = facets_facing_down(tee(), 10, 30)
    result = steered(tee(), Volumes(enforced_facets=facets), plan)

    assert result.area.area().sum() == pytest.approx(300, rel=0.02)
    assert result.area.used.sum() == 1


# Negative volumes


def test_negative_volumes_are_cut_out() -> None:
    hole = Mesh(box((4, 4, 50), (-2, -2, -10)).triangles)
    part = replace(tee(), volumes=Volumes(negative=hole))
    whole, drilled = cut(tee(), PLAN, 0.001).solid.area(), cut(part, PLAN, 0.001).solid.area()

    assert drilled[whole > 0] == pytest.approx(whole[whole > 0] - 16)


def test_an_open_volume_is_refused_by_name() -> None:
    closed = box((4, 4, 50), (-2, -2, -10)).triangles
    part = replace(tee(), volumes=Volumes(negative=Mesh(closed[2:7], "part.3mf: negative volume")))

    with pytest.raises(MeshError, match=r"part\.3mf: negative volume: "):
        cut(part, PLAN, 0.001)


def test_a_part_of_which_nothing_remains_is_refused() -> None:
    part = replace(tee(), volumes=Volumes(negative=Mesh(box((90, 90, 90), (-40, -40, -10)).triangles)))

    with pytest.raises(PartError, match="tee: nothing remains"):
        cut(part, PLAN, 0.001)


def test_places_of_volumes_and_paint_add_up() -> None:
    low, high = box((4, 4, 4), (0, 0, 0)), box((4, 4, 4), (10, 0, 0))
    facets = facets_facing_down(high.moved((0, 0, 1)), 0.5, 9)
    places: VolumeSections = cut_volumes(Volumes(enforce=low, enforced_facets=facets), PLAN)
    alone = (
        cut_volumes(Volumes(enforce=low), PLAN).enforce,
        cut_volumes(Volumes(enforced_facets=facets), PLAN).enforce,
    )

    assert np.allclose(places.enforce.area(), union(*alone).area())
    assert alone[1].area().sum() == pytest.approx(4.2**2, rel=0.01)
