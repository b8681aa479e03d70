"""Skirt and brim lie around the first layer, at their distance, and only there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.adhesion import adhesion_paths
from printer_slicer.model import LayerPlan, Mesh, Role, Sections, Toolpaths
from printer_slicer.pipeline import slice_part
from printer_slicer.slicing import cut
from tests.parts import box, box_with_hole, plain, profile, shape, shapely, sphere, two_boxes

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


@pytest.mark.parametrize("wide", [0.3, 1.0, 2.5, 5.0])
def test_the_brim_is_at_least_as_wide_as_asked_for_and_touches_the_part(wide: float) -> None:
    sections, paths = around(box(), brim_width=wide)
    foot = shape(sections.solid, 0)
    gap = float(bead.spacing(0.45, 0.3))

    distances = sorted(float(shapely.distance(ring, foot)) for ring in rings(paths, Role.BRIM))
    assert distances[0] == pytest.approx(0.225, abs=0.01)
    assert np.diff(distances) == pytest.approx(gap, abs=0.01)
    assert wide <= distances[-1] + 0.225 + 0.02
    assert distances[-1] + 0.225 < wide + 2 * gap


def test_skirt_comes_before_brim_and_lies_around_it() -> None:
    sections, paths = around(box(), skirt_loops=1, skirt_distance=2, brim_width=3)
    foot = shape(sections.solid, 0)

    assert paths.role[0] == Role.SKIRT
    brim = max(shapely.distance(ring, foot) for ring in rings(paths, Role.BRIM))
    skirt = min(shapely.distance(ring, foot) for ring in rings(paths, Role.SKIRT))
    assert skirt - brim > 2


def test_nothing_is_laid_in_holes() -> None:
    sections, paths = around(box_with_hole(), skirt_loops=1, brim_width=1)
    filled = shapely.convex_hull(shape(sections.solid, 0))

    assert len(rings(paths, Role.BRIM)) > 0
    assert not any(
        shapely.intersects(ring, filled) for ring in [*rings(paths, Role.BRIM), *rings(paths, Role.SKIRT)]
    )


def test_loops_around_neighbours_become_one() -> None:
    _, paths = around(two_boxes(gap=4), skirt_loops=1, skirt_distance=3)

    assert len(rings(paths, Role.SKIRT)) == 1


def test_loops_around_parts_far_apart_stay_two() -> None:
    _, paths = around(two_boxes(gap=30), skirt_loops=1, skirt_distance=3)

    assert len(rings(paths, Role.SKIRT)) == 2


def test_nothing_is_laid_beside_the_bed() -> None:
    """A part that fits with little room leaves no place for the skirt; it must not be laid outside."""
    wanted = profile(skirt_loops=1, skirt_distance=5)

    program = slice_part(box((219, 30, 0.4)), wanted)

    low, high = program.xyz.min(axis=0), program.xyz.max(axis=0)
    assert (low[:2] >= 0).all()
    assert (high[:2] <= [wanted.printer.bed_x, wanted.printer.bed_y]).all()
