"""Sections against those of trimesh and manifold3d: areas and perimeters of parts, as they stand and turned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.healing import repair
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Float, LayerPlan, Mesh
from printer_slicer.slicing import cut
from tests.parts import (
    box,
    box_with_hole,
    case_study,
    cone,
    joined,
    shapely,
    sheared_prism,
    sphere,
    step_pyramid,
)
from tests.torture.bodies import ball, turned_body

manifold3d = pytest.importorskip("manifold3d")

SAMPLES = Path(__file__).parents[2] / "sample_parts"
NAMES = sorted(path.stem for path in SAMPLES.glob("*.stl"))
SOUND = [
    box(),
    ball(),
    box_with_hole(),
    case_study(),
    cone(),
    sheared_prism(),
    sphere(),
    step_pyramid([20, 12, 5], [3, 2, 4]),
]
seeds = st.integers(0, 2**32 - 1)


def ours(mesh: Mesh, cuts: Float) -> tuple[Float, Float]:
    """(n,) areas, mm², and perimeters, mm."""
    solid = cut(repair(mesh)[0], LayerPlan(cuts + 1e-6, cuts), 0.0).solid
    return solid.area(), np.bincount(solid.ring_layer, solid.ring_length(), minlength=len(cuts))


def indexed(mesh: Mesh) -> tuple[Float, Any]:
    corners, index = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return corners, index.reshape(-1, 3)


def solid(mesh: Mesh) -> Any:
    """As manifold3d has it, in double precision."""
    corners, index = indexed(mesh)
    body = manifold3d.Manifold(manifold3d.Mesh64(corners, index.astype(np.uint64)))
    assert body.status() == manifold3d.Error.NoError
    return body


def theirs(mesh: Mesh, cuts: Float) -> tuple[Float, Float]:
    """The same by manifold3d."""
    body = solid(mesh)
    sections = [body.slice(float(z)) for z in cuts]
    outlines = [[np.asarray(ring) for ring in section.to_polygons()] for section in sections]
    length = [
        sum(float(np.hypot(*(np.roll(ring, -1, axis=0) - ring).T).sum()) for ring in rings)
        for rings in outlines
    ]
    return np.array([section.area() for section in sections]), np.array(length)


def trimeshs(mesh: Mesh, cuts: Float) -> Float:
    """(n,) areas by trimesh: the outlines it joins, each taken in or out by turns."""
    corners, index = indexed(mesh)
    body: Any = trimesh.Trimesh(corners, index, process=False)
    areas = []
    for z in cuts:
        section = body.section(plane_origin=[0, 0, z], plane_normal=[0, 0, 1])
        whole = shapely.Polygon()
        for line in [] if section is None else section.discrete:
            whole = shapely.symmetric_difference(whole, shapely.Polygon(np.asarray(line)[:, :2]))
        areas.append(float(shapely.area(whole)))
    return np.array(areas)


def standing(name: str) -> Mesh:
    mesh = load_mesh(SAMPLES / f"{name}.stl")
    return mesh.moved((0, 0, -mesh.bounds[0, 2]))


def between_levels(mesh: Mesh, n: int, rng: np.random.Generator) -> Float:
    """Random heights, none nearer than a hundredth of a mm to a corner."""
    levels = np.unique(mesh.triangles[:, :, 2])
    cuts = np.sort(rng.uniform(0.01, 0.99, 4 * n)) * mesh.height
    near = np.abs(cuts[:, None] - levels[np.searchsorted(levels, cuts)[:, None] - [1, 0]]).min(axis=1)
    return np.asarray(np.sort(cuts[near > min(0.01, 1e-4 * mesh.height)][:n]))


def test_areas_and_perimeters_of_the_sample_parts_agree() -> None:
    for name in NAMES:
        mesh = standing(name)
        cuts = between_levels(mesh, 6, np.random.default_rng(1))
        area, length = ours(mesh, cuts)
        their_area, their_length = theirs(mesh, cuts)

        assert area == pytest.approx(their_area, abs=1e-3, rel=1e-6), name
        assert length == pytest.approx(their_length, abs=1e-3, rel=1e-6), name
        assert area == pytest.approx(trimeshs(mesh, cuts), abs=1e-3, rel=1e-6), name


@settings(deadline=None, max_examples=30)
@given(body=st.sampled_from(range(len(SOUND))), seed=seeds)
def test_areas_and_perimeters_of_turned_bodies_agree(body: int, seed: int) -> None:
    mesh = turned_body(SOUND[body], seed)
    cuts = between_levels(mesh, 4, np.random.default_rng(seed))
    area, length = ours(mesh, cuts)
    their_area, their_length = theirs(mesh, cuts)

    assert area == pytest.approx(their_area, abs=2e-3)
    assert length == pytest.approx(their_length, abs=2e-3)
    assert area == pytest.approx(trimeshs(mesh, cuts), abs=2e-3)


@settings(deadline=None, max_examples=20)
@given(first=st.sampled_from(range(len(SOUND))), second=st.sampled_from(range(len(SOUND))), seed=seeds)
def test_overlapping_bodies_have_the_sections_of_their_union(first: int, second: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = turned_body(SOUND[first], seed), turned_body(SOUND[second], seed + 1)
    other = other.moved(
        tuple(
            (
                one.triangles.mean(axis=(0, 1)) - other.triangles.mean(axis=(0, 1)) + rng.uniform(-3, 3, 3)
            ).tolist()
        )
    )
    both = joined([one, other])
    both = both.moved((0, 0, -both.bounds[0, 2]))
    cuts = between_levels(both, 4, rng)
    halves = [Mesh(both.triangles[: one.n_facets]), Mesh(both.triangles[one.n_facets :])]
    made = [solid(half) for half in halves]
    union = made[0] + made[1]

    area = ours(both, cuts)[0]

    assert area == pytest.approx([union.slice(float(z)).area() for z in cuts], abs=5e-3)
