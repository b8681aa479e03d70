"""The skirt lies around everything at its distance; as a draft shield it clears every layer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.adhesion import adhesion_paths
from printer_slicer.geometry import Areas
from printer_slicer.model import LayerPlan, Mesh, Sections, Toolpaths
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.roles import Role
from printer_slicer.slicing import cut
from tests.adhesion.plates import disc, lines, standing
from tests.parts import (
    box,
    box_with_hole,
    layers,
    plain,
    profile,
    shape,
    shapely,
    sheared_prism,
    sphere,
    two_boxes,
)
from tests.strategies import clean_areas

TOPS = np.array([0.3, 0.5, 0.7])


def sections_of(mesh: Mesh) -> Sections:
    return cut(mesh, LayerPlan.from_tops(TOPS), 0.0125)


def around(mesh: Mesh, **changes: Any) -> tuple[Sections, Toolpaths]:
    sections = sections_of(mesh)
    return sections, adhesion_paths(sections, plain(**changes))


def rings(paths: Toolpaths, role: Role) -> list[shapely.LinearRing]:
    return [shapely.LinearRing(paths.path(i)) for i in np.flatnonzero(paths.role == role).tolist()]


def test_nothing_is_laid_if_nothing_is_asked_for() -> None:
    assert around(box(), skirt_loops=0, brim_width=0)[1].n_paths == 0


def test_skirt_and_brim_lie_on_the_first_layer_as_closed_loops() -> None:
    _, paths = around(box(), skirt_loops=2, brim_width=3)

    assert (paths.layer == 0).all()
    assert paths.closed.all()
    assert (paths.width == 0.45).all()
    assert set(paths.role.tolist()) == {Role.SKIRT, Role.BRIM}


@pytest.mark.parametrize("mesh", [box(), two_boxes(), sphere(), box_with_hole()], ids=lambda mesh: mesh.name)
def test_the_skirt_keeps_its_distance_from_the_part(mesh: Mesh) -> None:
    sections, paths = around(mesh, skirt_loops=3, skirt_distance=4)
    foot = shape(sections.solid, 0)
    gap = float(bead.spacing(0.45, 0.3))

    distances = sorted({round(float(shapely.distance(ring, foot)), 2) for ring in rings(paths, Role.SKIRT)})
    assert distances == pytest.approx([4 + 0.225 + i * gap for i in range(3)], abs=0.02)


def test_the_skirt_goes_from_outside_inward() -> None:
    _, paths = around(box(), skirt_loops=3)

    lengths = [ring.length for ring in rings(paths, Role.SKIRT)]
    assert lengths == sorted(lengths, reverse=True)


@pytest.mark.parametrize("gap", [4, 30])
def test_several_bodies_have_one_skirt(gap: float) -> None:
    sections, paths = around(two_boxes(gap=gap), skirt_loops=1, skirt_distance=3)

    (ring,) = rings(paths, Role.SKIRT)
    assert shapely.contains(shapely.Polygon(ring), shape(sections.solid, 0))


def test_nothing_is_laid_beside_the_bed() -> None:
    """A part that fits with little room leaves no place for the skirt; it must not be laid outside."""
    wanted = profile(skirt_loops=1, skirt_distance=5)

    program = slice_part(box((219, 30, 0.4)), wanted)

    low, high = program.xyz.min(axis=0), program.xyz.max(axis=0)
    assert (low[:2] >= 0).all()
    assert (high[:2] <= [wanted.printer.bed_x, wanted.printer.bed_y]).all()


# Length


@pytest.mark.parametrize("wanted", [0.1, 3.0, 40.0, 120.0])
def test_there_are_as_many_loops_as_the_length_takes_and_no_more(wanted: float) -> None:
    setting = plain(skirt_loops=1, skirt_min_length=wanted, flow_ratio=0.9)
    sections = sections_of(box())
    paths = adhesion_paths(sections, setting)
    per_mm = 0.9 * float(bead.filament_per_mm(0.45, 0.3, 1.75))
    fed = [ring.length * per_mm for ring in rings(paths, Role.SKIRT)]  # from the outside inward

    assert sum(fed) >= wanted * 0.999
    assert len(fed) == 1 or sum(fed[1:]) < wanted


def test_loops_for_the_length_lie_on_the_first_layer_only() -> None:
    _, paths = around(box(), skirt_loops=2, skirt_min_length=100, skirt_height=0.7)

    count = np.bincount(paths.layer)
    assert count[0] > 2
    assert count[1:].tolist() == [2, 2]


def test_a_length_for_which_the_bed_is_too_small_takes_what_room_there_is() -> None:
    sections, setting = (
        sections_of(box((100, 100, 0.7), (-50, -50, 0))),
        plain(skirt_loops=1, skirt_min_length=10000),
    )
    paths = adhesion_paths(sections, setting)

    assert paths.n_paths > 50
    assert np.abs(paths.xy).max() <= 110 - 0.45 / 2
    assert np.abs(paths.xy).max() > 110 - 0.45


# Draft shield


@pytest.mark.parametrize(("height", "count"), [(0, 1), (0.3, 1), (0.31, 2), (0.5, 2), (0.6, 3), (10000, 3)])
def test_a_draft_shield_reaches_its_height_on_layers_of_any_height(height: float, count: int) -> None:
    _, paths = around(box(), skirt_loops=1, skirt_height=height)

    assert paths.layer.tolist() == list(range(count))
    assert paths.height.tolist() == pytest.approx([0.3, 0.2, 0.2][:count])


def test_a_draft_shield_clears_what_leans_over_it() -> None:
    """The part leans 20 mm to one side; the shield is 2 mm high, and nothing of the part comes near or over it."""
    mesh, plan = sheared_prism(), layers(100, 0.2)
    sections = cut(mesh, plan, 0.0125)
    paths = adhesion_paths(sections, plain(skirt_loops=2, skirt_distance=3, skirt_height=2))
    shadow = shapely.union_all([shape(sections.solid, k) for k in range(0, 100, 9)])

    assert paths.n_paths == 20
    for ring in rings(paths, Role.SKIRT):
        assert float(shapely.distance(ring, shadow)) > 3 + 0.225 - 0.01
        assert shapely.contains(shapely.Polygon(ring), shadow)


def test_a_draft_shield_around_a_part_that_turns_has_no_more_corners_than_it_needs() -> None:
    """The corners of 300 triangles, each turned a little farther, lie on a circle."""
    sections = standing(Areas.from_rings([[disc(20, turned=0.01 * k, sides=3)] for k in range(300)]))
    paths = adhesion_paths(sections, plain(skirt_loops=1, skirt_distance=3, skirt_height=1))

    assert np.diff(paths.start).max() < 300  # of 900
    assert np.hypot(*paths.xy.T).min() > 23.225 - 0.01


@given(clean_areas(3), st.sampled_from([0.0, 0.25, 10000.0]), st.integers(1, 3))
def test_the_skirt_is_never_nearer_than_its_distance(areas: Areas, height: float, loops: int) -> None:
    sections = standing(areas)
    setting = plain(
        skirt_loops=loops, skirt_distance=2, skirt_height=height, printer__bed_x=400, printer__bed_y=400
    )
    paths = adhesion_paths(sections, setting)
    seen = areas if height > 0.2 else areas.select(areas.ring_layer == 0)
    if seen.n_rings == 0:
        assert paths.n_paths == 0
        return
    shadow = shapely.union_all([shape(seen, k) for k in range(3)])
    n_layers = {0.0: 1, 0.25: 2, 10000.0: 3}[height]

    assert paths.layer.tolist() == np.repeat(np.arange(n_layers), loops).tolist()
    for layer in range(n_layers):
        distances = sorted(float(shapely.distance(line, shadow)) for line in lines(paths, Role.SKIRT, layer))
        gap = float(bead.spacing(0.45, 0.2))
        assert distances == pytest.approx([2.225 + i * gap for i in range(loops)], abs=0.03)


def test_a_draft_shield_is_printed_first_on_every_layer_at_the_height_of_the_layer() -> None:
    stages = slice_stages(box((20, 20, 2)), profile(skirt_loops=2, skirt_height=1, first_layer_height=0.3))
    paths = stages.toolpaths
    shield = np.unique(paths.layer[paths.role == Role.SKIRT])

    assert shield.tolist() == list(range(len(shield)))
    assert 1 <= stages.sections.plan.top[shield[-1]] < 1.32
    for layer in shield.tolist():
        assert (paths.role[paths.layer == layer][:2] == Role.SKIRT).all()
    beads = stages.program.role == Role.SKIRT
    volume = stages.program.filament[beads].sum() * np.pi * 1.75**2 / 4
    sides = np.hypot(*(stages.program.xyz - stages.program.start)[beads, :2].T)
    height = stages.sections.plan.height[stages.program.layer[beads]]
    assert volume == pytest.approx((sides * bead.cross_section(0.45, height)).sum(), rel=1e-6)


def test_a_draft_shield_is_quicker_over_the_first_layer() -> None:
    wanted = plain(skirt_loops=1, skirt_height=1)
    program = slice_part(box((40, 40, 1)), wanted)
    shield = program.role == Role.SKIRT

    assert set(program.speed[shield & (program.layer == 0)].tolist()) == {20.0}
    assert set(program.speed[shield & (program.layer > 0)].tolist()) == {wanted.speeds.external_perimeter}
