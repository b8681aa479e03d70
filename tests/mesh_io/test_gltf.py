"""glTF as a text, with files beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import load_model


def written(folder: Path) -> Path:
    """Two boxes of 20 x 30 x 40 mm, the second one mirrored and 0.1 m to the right; y is up in the file."""
    scene = trimesh.Scene()
    box = trimesh.creation.box((0.02, 0.04, 0.03))
    scene.add_geometry(box, geom_name="box", node_name="one")
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[0, 3] = 0.1
    scene.graph.update("two", matrix=mirror, geometry="box")
    for name, data in trimesh.exchange.gltf.export_gltf(scene).items():
        (folder / name).write_bytes(data)
    (folder / "model.gltf").rename(folder / "part.gltf")
    return folder / "part.gltf"


def test_meshes_of_all_nodes_are_read_in_mm_with_z_up(tmp_path: Path) -> None:
    model = load_model(written(tmp_path))

    assert model.unit == "m"
    assert model.mesh.size == pytest.approx([120, 30, 40])
    assert model.mesh.volume == pytest.approx(2 * 20 * 30 * 40)


def test_a_missing_buffer_is_named(tmp_path: Path) -> None:
    path = written(tmp_path)
    buffers = [one["uri"] for one in json.loads(path.read_text())["buffers"]]
    (tmp_path / buffers[0]).unlink()

    with pytest.raises(MeshError, match=r"part\.gltf") as caught:
        load_model(path)

    assert caught.value.remedy


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"asset": {"version": "2.0"}}'])
def test_what_is_no_gltf_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "part.gltf").write_text(text)

    with pytest.raises(MeshError, match=r"part\.gltf"):
        load_model(tmp_path / "part.gltf")
