"""Columns: they keep their distance from the part, and stand where they may."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.geometry import difference, intersection, normalize, offset
from printer_slicer.model import Areas, Mesh, Supports
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.support_layers import plan_shared_layers
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.upward_faces import find_upward_faces
from printer_slicer.values import replace
from tests.parts import box, joined
from tests.supports.by_stages import columns_of, prepared
from tests.supports.shapes import (
    bracket,
    hook,
    mushroom,
    round_body,
    slope_under_a_ceiling,
    sphere_on_bed,
    tee,
)

PARTS = {"tee": tee, "hook": hook, "sphere": sphere_on_bed, "mushroom": mushroom, "bracket": bracket}


@pytest.mark.parametrize("name", PARTS)
def test_columns_keep_their_distance_from_all_layers_beside_them(name: str) -> None:
    supports, sections, profile = columns_of(PARTS[name]())
    plan, gap = supports.plan.layers, profile.quality.support_xy_gap - 0.01

    own, part = np.nonzero(
        (plan.bottom[:, None] < sections.plan.top - 1e-6) & (plan.top[:, None] > sections.plan.bottom + 1e-6)
    )
    near = offset(sections.solid.copy_layers(part), gap)
    assert intersection(supports.area.copy_layers(own), near).area().max() < 1e-3


@pytest.mark.parametrize("name", PARTS)
def test_no_column_reaches_into_the_gap_under_what_it_carries(name: str) -> None:
    supports, sections, profile = columns_of(PARTS[name]())
    plan, gap = supports.plan.layers, profile.quality.support_gap

    own, part = np.nonzero(
        (plan.top[:, None] > sections.plan.bottom - gap + 1e-6)
        & (plan.bottom[:, None] < sections.plan.top + profile.quality.support_bottom_gap - 1e-6)
    )
    assert intersection(supports.area.copy_layers(own), sections.solid.copy_layers(part)).area().max() < 1e-3


@pytest.mark.parametrize("name", PARTS)
def test_areas_of_a_layer_do_not_overlap(name: str) -> None:
    supports, _, _ = columns_of(PARTS[name]())

    assert supports.area.area() == pytest.approx(normalize(supports.area).area(), abs=1e-3)


def test_a_flat_overhang_gets_its_whole_area() -> None:
    overhangs, plan, sections, profile = prepared(tee())
    supports = make_columns(overhangs, plan, sections, profile)

    (layer,) = np.flatnonzero(overhangs.area.used)
    top = supports.area.copy_layers(np.array([plan.carrier[layer]]))
    bare = difference(
        overhangs.area.copy_layers(np.array([layer])), offset(top, profile.quality.support_xy_gap)
    )
    assert bare.area().sum() < 0.01
    assert supports.interface.area()[-1] == pytest.approx(top.area()[0], rel=0.01)


def test_columns_below_slopes_have_straight_edges() -> None:
    """The strips below a leaning rod end at other places in each layer; a nozzle stops at corners of 30 degrees."""
    rod = round_body([(2.5, 0.0), (2.5, 30.0)], 48)
    lean = np.deg2rad(65)
    turn = np.array([(np.cos(lean), 0, np.sin(lean)), (0, 1, 0), (-np.sin(lean), 0, np.cos(lean))])
    turn = np.array([(np.cos(0.2), -np.sin(0.2), 0), (np.sin(0.2), np.cos(0.2), 0), (0, 0, 1)]) @ turn
    leaning = Mesh(rod.triangles @ turn.T + (0, 0, 8.0), "rod")
    post = box((6.0, 6.0, 9.0), (-3.0, -3.0, 0.0))
    supports, _, _ = columns_of(joined([leaning, post], "leaning rod"))

    area = supports.area.copy_layers(np.array([8]))
    way = area.xy[area.following] - area.xy
    before = np.empty_like(way)
    before[area.following] = way
    turns = np.arctan2(before[:, 0] * way[:, 1] - before[:, 1] * way[:, 0], (before * way).sum(axis=1))
    assert area.area()[0] > 30
    assert (np.abs(turns) > np.deg2rad(30)).sum() < 15


def test_columns_go_down_to_the_bed_or_the_part() -> None:
    supports, _, _ = columns_of(tee())
    onto_part, _, _ = columns_of(bracket())

    areas = supports.area
    assert difference(areas, areas.shift_layers(1)).area()[1:].max() < 1e-3
    assert not onto_part.area.used[0]
    assert onto_part.floor.used.sum() == 1


@pytest.mark.parametrize(("degrees", "height"), [(25.0, 0.2), (30.0, 0.2), (30.0, 0.12), (35.0, 0.15)])
def test_columns_stand_on_slopes(degrees: float, height: float) -> None:
    profile = load_profile(quality="standard", changes={"support": "columns", "layer_height": height})
    supports = slice_stages(slope_under_a_ceiling(degrees), profile).supports

    assert supports is not None
    assert sum(place.area for place in supports.unsupported) < 8


@pytest.mark.parametrize("degrees", [20.0, 30.0, 45.0])
def test_columns_on_slopes_keep_half_of_the_gap(degrees: float) -> None:
    supports, sections, profile = columns_of(slope_under_a_ceiling(degrees))
    plan, gap = supports.plan.layers, profile.quality.support_bottom_gap / 2

    own, part = np.nonzero(
        (plan.top[:, None] > sections.plan.bottom + 1e-6)
        & (plan.bottom[:, None] < sections.plan.top + gap - 1e-6)
    )
    assert intersection(supports.area.copy_layers(own), sections.solid.copy_layers(part)).area().max() < 1e-3


@pytest.mark.parametrize("gap", [0.2, 0.13])
def test_floors_begin_at_the_gap_above_the_part_and_lie_over_it(gap: float) -> None:
    overhangs, _, sections, profile = prepared(bracket(), support_bottom_gap=gap)
    landings = find_upward_faces(overhangs, sections)
    plan = plan_shared_layers([(overhangs, profile)], landings + gap)[0]
    supports = make_columns(overhangs, plan, sections, profile)
    paths = make_support_paths(supports, profile)

    assert landings == pytest.approx([4.0])
    (layer,) = np.flatnonzero(supports.floor.used)
    assert plan.layers.bottom[layer] == pytest.approx(4.0 + gap, abs=1e-6)
    plate = sections.solid.copy_layers(np.array([5]))
    (low,), (high,) = plate.boxes()
    xy = paths.xy[np.repeat(paths.layer == layer, np.diff(paths.start))]
    assert (xy.min(axis=0) >= low).all()
    assert (xy.max(axis=0) <= high).all()


def test_slopes_are_no_landings() -> None:
    for part in (sphere_on_bed(), hook(), mushroom()):
        overhangs, _, sections, _ = prepared(part)
        assert not len(find_upward_faces(overhangs, sections))


def test_on_bed_only_leaves_what_stands_on_the_part_and_tells_it() -> None:
    supports, _, _ = columns_of(bracket(), support_on_bed_only=True)

    assert difference(supports.area, supports.area.shift_layers(1)).area()[1:].max() < 1e-3
    assert any("stand on the part" in place.reason for place in supports.unsupported)


def test_a_support_outside_the_bed_is_told() -> None:
    overhangs, plan, sections, profile = prepared(tee())
    small = replace(profile, printer=replace(profile.printer, bed_x=130.0))
    supports = make_columns(overhangs, plan, sections, small)

    assert any("outside the bed" in place.reason for place in supports.unsupported)
    assert supports.area.xy[:, 0].max() <= small.printer.corners[1][0] + 1e-6


def test_slim_columns_become_wider_towards_the_bed() -> None:
    post = columns_of(hook())[0]
    tall = PARTS["hook"]()
    high = Mesh(tall.triangles * [1, 1, 4], "high")
    slim = columns_of(high, height=0.32)[0]

    def width(supports: Supports, z: float) -> float:
        layer = int(np.searchsorted(supports.plan.layers.top, z))
        return float(np.sqrt(supports.area.area()[layer]))

    assert width(post, 1.0) == pytest.approx(width(post, 10.0), rel=0.05)
    assert width(slim, 1.0) > 1.7 * width(slim, 57.0)


def test_the_first_layer_has_a_foot() -> None:
    plain = columns_of(tee(), support_first_layer_expansion=0)[0].area.area()
    wide = columns_of(tee(), support_first_layer_expansion=3)[0].area.area()

    assert plain[0] == pytest.approx(plain[1], rel=1e-3)
    assert wide[0] > 1.5 * plain[0]
    assert wide[1] == pytest.approx(plain[1], rel=1e-3)


def test_without_interface_layers_all_is_base() -> None:
    supports = columns_of(bracket(), support_interface_layers=0)[0]

    assert not supports.interface.n_rings
    assert not supports.floor.n_rings
    assert isinstance(supports.base, Areas)
