"""glTF as a text, with files beside it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import Limits, load_model


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


def outside(path: Path) -> dict[str, str]:
    """Ways to name the buffer of a glTF that was moved out of its folder."""
    tree = json.loads(path.read_text())
    first = tree["buffers"][0]["uri"]
    secret = path.parent.parent / "secret.bin"
    (path.parent / first).rename(secret)
    (path.parent / "link.bin").symlink_to(secret)
    (path.parent / "below").mkdir()
    return {
        "up": "../secret.bin",
        "up, encoded": "%2e%2e/secret.bin",
        "down and up": "below/../../secret.bin",
        "absolute": str(secret),
        "file URL": secret.as_uri(),
        "link": "link.bin",
        "backslash": "..\\secret.bin",
        "taken for base64": "../secret.bin?base64,",
    }


@pytest.mark.parametrize(
    "way",
    ["up", "up, encoded", "down and up", "absolute", "file URL", "link", "backslash", "taken for base64"],
)
def test_a_buffer_outside_of_the_folder_is_refused_and_named(way: str, tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    path = written(tmp_path / "models")
    uri = outside(path)[way]
    tree = json.loads(path.read_text())
    tree["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(tree))

    with pytest.raises(MeshError, match=r"outside of its folder") as caught:
        load_model(path)

    assert repr(uri) in str(caught.value)


def test_trimesh_is_given_no_way_to_open_files(tmp_path: Path) -> None:
    opened = list[str]()
    path = written(tmp_path)
    load_model(path)  # imports what is imported once

    def listen(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and watching:
            opened.append(str(arguments[0]))

    watching = True
    sys.addaudithook(listen)
    load_model(path)
    watching = False

    assert {Path(name).parent for name in opened} == {tmp_path}


def test_buffers_below_the_folder_and_with_encoded_names_are_read(tmp_path: Path) -> None:
    path = written(tmp_path)
    tree = json.loads(path.read_text())
    first = tree["buffers"][0]["uri"]
    (tmp_path / "below").mkdir()
    (tmp_path / first).rename(tmp_path / "below" / "a b.bin")
    tree["buffers"][0]["uri"] = "below/a%20b.bin"
    path.write_text(json.dumps(tree))

    assert load_model(path).mesh.size == pytest.approx([120, 30, 40])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"uri": "gone.bin"}, r"not beside it: 'gone\.bin'"),
        ({"uri": "."}, r"not beside it"),
        ({"uri": "x\0y"}, r"cannot be read"),
        ({"uri": None}, r"buffer 0 has no 'uri'"),
        ({"uri": 5}, r"buffer 0 has no 'uri'"),
        ({"byteLength": 10**9}, r"buffer 0 has \d+ of 1000000000 bytes"),
        ({"uri": "data:application/octet-stream;base64,@@"}, r"buffer 0 is not valid base64"),
        ({"uri": "data:,abc"}, r"buffer 0 is not valid base64"),
    ],
)
def test_what_is_wrong_with_a_buffer_is_said(change: dict[str, object], said: str, tmp_path: Path) -> None:
    path = written(tmp_path)
    tree = json.loads(path.read_text())
    tree["buffers"][0].update(change)
    path.write_text(json.dumps(tree))

    with pytest.raises(MeshError, match=said) as caught:
        load_model(path)

    assert "None" not in str(caught.value)


def test_buffers_count_against_the_limit_of_bytes(tmp_path: Path) -> None:
    path = written(tmp_path)
    first = tmp_path / json.loads(path.read_text())["buffers"][0]["uri"]
    first.write_bytes(first.read_bytes() + bytes(path.stat().st_size))
    limits = Limits(file_bytes=path.stat().st_size)

    with pytest.raises(MeshError, match="bytes left by the limit"):
        load_model(path, limits=limits)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"asset": {"version": "2.0"}}'])
def test_what_is_no_gltf_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "part.gltf").write_text(text)

    with pytest.raises(MeshError, match=r"part\.gltf"):
        load_model(tmp_path / "part.gltf")
