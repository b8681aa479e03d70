"""Meshes of trimesh and back."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from printer_slicer import Mesh
from printer_slicer.errors import MeshError, UsageError
from printer_slicer.slicing import find_mesh_faults
from tests.parts import box, box_with_hole, sphere


@pytest.mark.parametrize("mesh", [box(), box_with_hole(), sphere()], ids=lambda mesh: mesh.name)
def test_there_and_back_is_the_same_surface(mesh: Mesh) -> None:
    there = mesh.to_trimesh()
    back = Mesh.from_trimesh(there, mesh.name)

    assert there.is_watertight
    assert there.volume == pytest.approx(mesh.volume)
    assert np.array_equal(back.triangles, mesh.triangles)
    assert back.name == mesh.name == there.metadata["name"]


def test_what_trimesh_makes_can_be_sliced() -> None:
    made = Mesh.from_trimesh(trimesh.creation.cylinder(radius=5, height=12), "cylinder")

    assert find_mesh_faults(made).count == 0
    assert made.size == pytest.approx([10, 10, 12], rel=0.01)


@pytest.mark.parametrize(
    ("vertices", "faces"), [(np.zeros((0, 3)), np.zeros((0, 3), int)), (np.full((3, 3), np.nan), [[0, 1, 2]])]
)
def test_meshes_that_are_none_are_refused(vertices: np.ndarray, faces: object) -> None:
    with pytest.raises(MeshError, match="thing: the trimesh has"):
        Mesh.from_trimesh(trimesh.Trimesh(vertices, faces, process=False), "thing")


@pytest.mark.parametrize(
    ("given", "called"),
    [
        (None, "nothing"),
        (trimesh.PointCloud(np.eye(3)), "a value of type PointCloud"),
        (trimesh.load_path(np.eye(3)), "a value of type Path3D"),
        (np.zeros((1, 3, 3)), "a value of type ndarray"),
    ],
)
def test_what_has_no_triangles_is_refused_by_what_it_is(given: object, called: str) -> None:
    with pytest.raises(UsageError, match=f"thing: from_trimesh expects a trimesh.Trimesh, not {called}"):
        Mesh.from_trimesh(given, "thing")  # type: ignore[arg-type]


def test_trimesh_costs_nothing_until_it_is_asked_for() -> None:
    code = "import sys, printer_slicer; printer_slicer.Mesh; printer_slicer.load_mesh; print('trimesh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout == "False\n"
