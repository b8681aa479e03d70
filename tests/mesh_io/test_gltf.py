"""glTF as a text, with files beside it."""

from __future__ import annotations

import base64
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

    with pytest.raises(MeshError, match=r"outside its folder") as caught:
        load_model(path)

    assert repr(uri) in str(caught.value)


def test_only_files_beside_the_model_are_opened(tmp_path: Path) -> None:
    open_model_file = list[str]()
    path = written(tmp_path)
    load_model(path)  # imports what is imported once

    def listen(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and watching:
            open_model_file.append(str(arguments[0]))

    watching = True
    sys.addaudithook(listen)
    load_model(path)
    watching = False

    assert {Path(name).parent for name in open_model_file} == {tmp_path}


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
        ({"uri": "gone.bin"}, r"refers to a missing file: 'gone\.bin'"),
        ({"uri": "."}, r"refers to a missing file"),
        ({"uri": "x\0y"}, r"cannot be read"),
        ({"uri": None}, r"buffer 0 has no 'uri'"),
        ({"uri": 5}, r"buffer 0 has no 'uri'"),
        ({"byteLength": 10**9}, r"buffer 0 has only \d+ of 1000000000 bytes"),
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

    with pytest.raises(MeshError, match="bytes that remain of the limit"):
        load_model(path, limits=limits)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"asset": {"version": "2.0"}}'])
def test_what_is_no_gltf_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "part.gltf").write_text(text)

    with pytest.raises(MeshError, match=r"part\.gltf"):
        load_model(tmp_path / "part.gltf")


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    tree = json.loads(path.read_text())
    (tmp_path / "circle.bin").symlink_to("circle.bin")
    tree["buffers"][0]["uri"] = "circle.bin"
    path.write_text(json.dumps(tree))

    with pytest.raises(MeshError, match=r"circle\.bin"):
        load_model(path)


def tetrahedron(folder: Path, **changes: object) -> Path:
    """10 mm wide, its numbers in the text itself."""
    points = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]], "<f4").tobytes()
    corners = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], "<u2").tobytes()
    coded = base64.b64encode(points + corners).decode()
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "buffers": [{"uri": f"Data:application/octet-stream;BASE64,{coded}", "byteLength": 72}],
    }
    (folder / "part.gltf").write_text(json.dumps(tree | changes))
    return folder / "part.gltf"


def test_numbers_in_the_text_and_sparse_ones_are_read(tmp_path: Path) -> None:
    assert load_model(tetrahedron(tmp_path)).mesh.size == pytest.approx([10, 10, 10])
    positions = {
        "componentType": 5126,
        "count": 4,
        "type": "VEC3",
        "sparse": {
            "count": 4,
            "indices": {"bufferView": 1, "componentType": 5123, "byteOffset": 4},  # 1, 0, 1, 3
            "values": {"bufferView": 0},
        },
    }
    corners = {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}
    sparse = load_model(tetrahedron(tmp_path, accessors=[positions, corners]))

    assert sparse.mesh.size == pytest.approx([10, 10, 10])
    assert sparse.n_folded == 0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"asset": {"version": "1.0"}}, r"version 1\.0"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, r"KHR_draco_mesh_compression"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, r"nested more than"),
        ({"nodes": [{"children": [n + 1, n + 1]} for n in range(40)] + [{"mesh": 0}]}, r"nested more than"),
        ({"nodes": [{"mesh": 0}] * 2, "scenes": [{"nodes": [0, 1] * 60_000}]}, r"more than 100000 objects"),
        ({"nodes": [{"mesh": 0, "matrix": [1e300] * 16}]}, r"coordinate 1e\+30"),
        ({"accessors": [{"componentType": 5126, "count": 10**9, "type": "VEC3"}] * 2}, r"1000000000 items"),
    ],
)
def test_what_would_exhaust_the_machine_or_is_not_known_is_refused(
    changes: dict[str, object], said: str, tmp_path: Path
) -> None:
    with pytest.raises(MeshError, match=said):
        load_model(tetrahedron(tmp_path, **changes))


def test_copies_by_an_extension_and_what_is_not_followed_are_told(tmp_path: Path) -> None:
    places = base64.b64encode(np.array([[0, 0, 0], [0.1, 0, 0]], "<f4").tobytes()).decode()
    tree = json.loads(tetrahedron(tmp_path).read_text())
    tree["buffers"].append({"uri": f"data:;base64,{places}", "byteLength": 24})
    tree["bufferViews"].append({"buffer": 1, "byteLength": 24})
    tree["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"})
    copies = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}
    tree["nodes"] = [{"mesh": 0, "skin": 0, "extensions": copies}]
    (tmp_path / "part.gltf").write_text(json.dumps(tree))

    model = load_model(tmp_path / "part.gltf")

    assert model.mesh.size == pytest.approx([110, 10, 10])
    assert any("skeleton" in note for note in model.notes)
