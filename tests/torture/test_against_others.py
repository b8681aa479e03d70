"""Sections against those of trimesh and manifold3d: areas and perimeters of parts, as they stand and turned.

Where the environment variable PRINTER_SLICER_MODELS names a folder, also of the models in it. They must be solids that
do not overlap: trimesh takes what two bodies share for empty.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.healing import repair
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import LayerPlan, Mesh
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
FOLDER = os.environ.get("PRINTER_SLICER_MODELS", "")
MODELS = [
    path
    for path in sorted(Path(FOLDER).glob("*") if FOLDER else [])
    if path.suffix.lower().removeprefix(".") in FORMATS and path.suffix.lower() != ".step"  # that is an extra
]
seeds = st.integers(0, 2**32 - 1)


def ours(mesh: Mesh, cuts: Float) -> tuple[Float, Float]:
    """(n,) areas, mm², and perimeters, mm."""
    solid = cut(repair(mesh)[0], LayerPlan(cuts + 1e-6, cuts), 0.0).solid
    return solid.area(), solid.length()


def indexed(mesh: Mesh) -> tuple[Float, Any]:
    corners, index = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return corners, index.reshape(-1, 3)


def possible_solid(mesh: Mesh) -> Any:
    """As manifold3d has it, in double precision; its status says whether it takes it."""
    corners, index = indexed(mesh)
    return manifold3d.Manifold(manifold3d.Mesh64(corners, index.astype(np.uint64)))


def solid(mesh: Mesh) -> Any:
    """The same, which is sound."""
    body = possible_solid(mesh)
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


def trimeshs(mesh: Mesh, cuts: Float) -> tuple[Float, Float]:
    """The same by trimesh: the area of the outlines it joins, each taken in or out by turns, and their length."""
    corners, index = indexed(mesh)
    body: Any = trimesh.Trimesh(corners, index, process=False)
    areas, lengths = [], []
    for z in cuts:
        section = body.section(plane_origin=[0, 0, z], plane_normal=[0, 0, 1])
        whole = shapely.Polygon()
        for line in [] if section is None else section.discrete:
            ring = shapely.Polygon(np.asarray(line)[:, :2])
            # Outlines may cross themselves by less than can be measured; GEOS overlays none that do.
            whole = shapely.symmetric_difference(whole, shapely.make_valid(ring))
        areas.append(float(shapely.area(whole)))
        lengths.append(0.0 if section is None else float(section.length))
    return np.array(areas), np.array(lengths)


def standing(name: str) -> Mesh:
    mesh = load_mesh(SAMPLES / f"{name}.stl")
    return mesh.moved((0, 0, -mesh.bounds[0, 2]))


def between_levels(mesh: Mesh, n: int, rng: np.random.Generator, least: float = 0.01) -> Float:
    """Random heights, none nearer to a corner than `least` mm, or a ten-thousandth of a small part's height."""
    levels = np.unique(mesh.triangles[:, :, 2])
    cuts = np.sort(rng.uniform(0.01, 0.99, 4 * n)) * mesh.height
    near = np.abs(cuts[:, None] - levels[np.searchsorted(levels, cuts)[:, None] - [1, 0]]).min(axis=1)
    return np.asarray(np.sort(cuts[near > min(least, 1e-4 * mesh.height)][:n]))


def test_areas_and_perimeters_of_the_sample_parts_agree() -> None:
    for name in NAMES:
        mesh = standing(name)
        cuts = between_levels(mesh, 6, np.random.default_rng(1))
        area, length = ours(mesh, cuts)
        their_area, their_length = theirs(mesh, cuts)

        assert area == pytest.approx(their_area, abs=1e-3, rel=1e-6), name
        assert length == pytest.approx(their_length, abs=1e-3, rel=1e-6), name
        their_area, their_length = trimeshs(mesh, cuts)
        assert area == pytest.approx(their_area, abs=1e-3, rel=1e-6), name
        assert length == pytest.approx(their_length, abs=1e-3, rel=1e-6), name


@pytest.mark.skipif(not MODELS, reason="PRINTER_SLICER_MODELS names no folder with models")
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_areas_and_perimeters_of_models_elsewhere_agree(path: Path, turned: bool) -> None:
    whole = repair(load_mesh(path))[0]
    mesh = turned_body(whole, 1) if turned else whole.moved((0, 0, -whole.bounds[0, 2]))
    cuts = between_levels(mesh, 4, np.random.default_rng(1), 1e-5)  # many corners, at any height
    area, length = ours(mesh, cuts)
    others = [trimeshs(mesh, cuts)]
    if possible_solid(mesh).status() == manifold3d.Error.NoError:
        others.append(theirs(mesh, cuts))

    assert len(cuts) == 4
    for their_area, their_length in others:
        assert area == pytest.approx(their_area, abs=2e-3, rel=1e-6)
        assert length == pytest.approx(their_length, abs=2e-3, rel=1e-6)


@given(body=st.sampled_from(range(len(SOUND))), seed=seeds)
def test_areas_and_perimeters_of_turned_bodies_agree(body: int, seed: int) -> None:
    mesh = turned_body(SOUND[body], seed)
    cuts = between_levels(mesh, 4, np.random.default_rng(seed))
    area, length = ours(mesh, cuts)
    their_area, their_length = theirs(mesh, cuts)

    assert area == pytest.approx(their_area, abs=2e-3)
    assert length == pytest.approx(their_length, abs=2e-3)
    their_area, their_length = trimeshs(mesh, cuts)
    assert area == pytest.approx(their_area, abs=2e-3)
    assert length == pytest.approx(their_length, abs=2e-3)


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
