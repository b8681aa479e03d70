"""GLB: nodes, strips, sparse and quantized positions; against trimesh where that can read them."""

from __future__ import annotations

import base64
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from tiny_files import BOX, CORNERS, FACES, glb, glb_box, write

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import Limits, load_mesh, load_model

UPRIGHT = np.stack([BOX[:, :, 0], -BOX[:, :, 2], BOX[:, :, 1]], axis=2)
"""The box with its y up."""


def fault(folder: Path, content: bytes) -> str:
    path = write(folder, content, "part.glb")
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


def test_a_glb_is_in_metres_with_y_up(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, glb_box(), "part.glb"))

    assert np.array_equal(model.mesh.triangles, 1000 * UPRIGHT)
    assert (model.kind, model.unit) == ("glb", "m")
    assert np.array_equal(load_mesh(tmp_path / "part.glb", units="mm").triangles, UPRIGHT)


@pytest.mark.parametrize(
    "make", [trimesh.creation.icosphere, trimesh.creation.cylinder, trimesh.creation.torus]
)
def test_what_trimesh_writes_is_read_as_trimesh_reads_it(tmp_path: Path, make: Any) -> None:
    sizes = {"cylinder": {"radius": 2, "height": 5}, "torus": {"major_radius": 5, "minor_radius": 1}}
    part = make(**sizes.get(make.__name__, {}))
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6])
    scene.add_geometry(part, node_name="one", transform=turn)
    scene.add_geometry(part, node_name="two", parent_node_name="one", transform=np.diag([-1.0, 2, 1, 1]))
    path = tmp_path / "part.glb"
    path.write_bytes(scene.export(file_type="glb"))
    expected = trimesh.util.concatenate(trimesh.load(path, force="scene").dump())

    mesh = load_mesh(path, units="mm")

    x, y, z = expected.bounds.T
    np.testing.assert_allclose(mesh.bounds.T, [x, -z[::-1], y], atol=1e-6)
    assert mesh.volume == pytest.approx(abs(expected.volume), rel=1e-6)


def test_nodes_move_what_hangs_on_them(tmp_path: Path) -> None:
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0], "rotation": [0, 0, 0.5**0.5, 0.5**0.5]},
        {"mesh": 0, "scale": [2, 1, 1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 50, 1]},
    ]
    mesh = load_mesh(write(tmp_path, glb_box(nodes=nodes), "part.glb"), units="mm")

    # In its own axes: x of 4 and 2 becomes y by the turn; then x is shifted. z of the box is our -y.
    np.testing.assert_allclose(mesh.bounds, [[7, -54, 0], [10, 0, 4]], atol=1e-6)


def test_a_file_without_scenes_shows_the_nodes_that_hang_on_none(tmp_path: Path) -> None:
    nodes = [{"mesh": 0}, {"children": [0], "translation": [5, 0, 0]}]
    mesh = load_mesh(write(tmp_path, glb_box(nodes=nodes, scenes=[]), "part.glb"), units="mm")

    assert mesh.bounds[:, 0].tolist() == [5, 7]


@pytest.mark.parametrize("mode", [5, 6], ids=["strip", "fan"])
def test_strips_and_fans_become_facets(tmp_path: Path, mode: int) -> None:
    """Two of them make a box of four triangles: a tetrahedron."""
    points = np.array([[0, 0, 0], [0, 0, 3], [0, 3, 0], [3, 0, 0]], dtype="<f4")
    strips = {5: [0, 1, 2, 3, 0, 1], 6: [0, 1, 2, 3, 1]}
    corners = np.array(strips[mode], dtype="<u2")
    closing = np.array([1, 3, 2], dtype="<u2")
    binary = points.tobytes() + corners.tobytes() + closing.tobytes()
    primitives = [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]
    primitives += [{"attributes": {"POSITION": 0}, "indices": 2, "mode": 4}] if mode == 6 else []
    tree = {
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(corners), "type": "SCALAR"},
            {
                "bufferView": 1,
                "byteOffset": corners.nbytes,
                "componentType": 5123,
                "count": 3,
                "type": "SCALAR",
            },
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": len(binary) - 48},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    mesh = load_mesh(write(tmp_path, glb(tree, binary), "part.glb"), units="mm")

    assert mesh.n_facets == 4
    assert mesh.volume == pytest.approx(4.5)


def with_accessor(**changes: Any) -> dict[str, Any]:
    position = {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"} | changes
    return {"accessors": [position, {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}]}


def test_sparse_positions_replace_others(tmp_path: Path) -> None:
    """The last corner, (2, 3, 4), is moved to (2, 9, 4)."""
    tree_binary = CORNERS.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
    binary = tree_binary + struct.pack("<H2x3f", 7, 2, 9, 4)
    sparse = {"count": 1, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}}
    views = [(0, 96), (96, 72), (168, 2), (172, 12)]
    tree = {
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": length} for start, length in views],
        "buffers": [{"byteLength": len(binary)}],
    } | with_accessor(sparse=sparse)
    mesh = load_mesh(write(tmp_path, glb(tree, binary), "part.glb"), units="mm")

    assert mesh.bounds.tolist() == [[0, -4, 0], [2, 0, 9]]


def test_quantized_positions_are_read(tmp_path: Path) -> None:
    """Whole numbers that mean shares of 32767, in rows of 8 bytes, scaled by the node."""
    rows = np.zeros((8, 4), dtype="<i2")
    rows[:, :3] = np.round(CORNERS / 4 * 32767)
    binary = rows.tobytes() + FACES.astype("<u2").tobytes()
    tree = {
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "scale": [4, 4, 4]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 64, "byteStride": 8},
            {"buffer": 0, "byteOffset": 64, "byteLength": 72},
        ],
        "buffers": [{"byteLength": len(binary)}],
    } | with_accessor(componentType=5122, normalized=True)
    mesh = load_mesh(write(tmp_path, glb(tree, binary), "part.glb"), units="mm")

    np.testing.assert_allclose(mesh.triangles, UPRIGHT, atol=2e-4)


@pytest.mark.parametrize(
    "nodes",
    [
        [{"mesh": 0, "scale": [-1, 1, 1]}],
        [{"mesh": 0, "scale": [-1, -1, -1]}],
        [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]}],
        [{"children": [1], "scale": [1, -2, 1]}, {"mesh": 0, "scale": [1, 0.5, 1]}],
        [{"children": [1], "scale": [1, -1, 1]}, {"mesh": 0, "scale": [-1, 1, 1]}],
    ],
    ids=["x", "all", "matrix", "outer", "twice"],
)
def test_mirrored_nodes_keep_their_outside_out(nodes: list[dict[str, Any]], tmp_path: Path) -> None:
    scenes = [{"nodes": [0]}]

    mesh = load_mesh(write(tmp_path, glb_box(nodes=nodes, scenes=scenes, scene=0), "part.glb"), units="mm")

    assert mesh.volume == pytest.approx(24.0)


def test_a_buffer_may_stand_in_the_text(tmp_path: Path) -> None:
    binary = CORNERS.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    buffers = [{"byteLength": len(binary), "uri": uri}]

    assert np.array_equal(
        load_mesh(write(tmp_path, glb_box(buffers=buffers), "part.glb"), units="mm").triangles, UPRIGHT
    )


TURNS = np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0.5, 0.5, 0.5, 0.5]])
PLACES = {
    "TRANSLATION": np.array([[0, 0, 0], [10, 0, 0], [0, 20, 5.0]]),
    "ROTATION": TURNS,
    "SCALE": np.array([[1, 1, 1], [2, 1, 1], [-1, 1, 0.5]]),
}


def instanced(places: dict[str, np.ndarray], *, kind: int = 5126, **changes: Any) -> bytes:
    """The box as one node that extends its mesh by copies; quaternions may be of another kind."""
    binary = CORNERS.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
    views = [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
    ]
    for name, numbers in places.items():
        whole = kind == 5122 and name == "ROTATION"
        data = (np.rint(numbers * 32767).astype("<i2") if whole else numbers.astype("<f4")).tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        accessor = {"componentType": kind, "normalized": True} if whole else {"componentType": 5126}
        accessor |= {"count": len(numbers), "type": f"VEC{numbers.shape[1]}", "bufferView": len(views) - 1}
        accessors.append(accessor)
        binary += data
    attributes = {name: number for number, name in enumerate(places, start=2)}
    node = {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [node | {"translation": [100, 0, 0], "scale": [1, 1, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    return glb(tree | changes, binary)


@pytest.mark.parametrize("names", [["TRANSLATION"], ["ROTATION"], ["TRANSLATION", "SCALE"], list(PLACES)])
@pytest.mark.parametrize("kind", [5126, 5122], ids=["floats", "whole numbers"])
@pytest.mark.parametrize("required", [[], ["EXT_mesh_gpu_instancing"]], ids=["used", "required"])
def test_instances_of_a_mesh_stand_as_nodes_would(
    tmp_path: Path, names: list[str], kind: int, required: list[str]
) -> None:
    content = instanced({name: PLACES[name] for name in names}, kind=kind, extensionsRequired=required)
    fields = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
    children = [
        {"mesh": 0} | {fields[name]: PLACES[name][number].tolist() for name in names} for number in range(3)
    ]
    nodes = [{"children": [1, 2, 3], "translation": [100, 0, 0], "scale": [1, 1, 2]}, *children]

    model = load_model(write(tmp_path, content, "part.glb"), units="mm")
    expected = load_mesh(write(tmp_path, glb_box(nodes=nodes), "nodes.glb"), units="mm")

    assert model.mesh.n_facets == 36
    np.testing.assert_allclose(model.mesh.triangles, expected.triangles, atol=1e-5 if kind == 5126 else 2e-3)
    assert model.mesh.volume == pytest.approx(expected.volume, rel=1e-3)
    assert model.notes == ()


def test_instances_are_counted_however_many_nodes_share_their_places(tmp_path: Path) -> None:
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}
    nodes = [{"mesh": 0, "extensions": extension}] * 50
    path = write(tmp_path, glb_box(nodes=nodes, scenes=[]), "part.glb")

    assert load_mesh(path).n_facets == 50 * 8 * 12
    with pytest.raises(MeshError, match="more than 399 objects are placed"):
        load_mesh(path, limits=Limits(instances=399))


WEIGHED = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 0}]}


@pytest.mark.parametrize(
    ("changes", "notes"),
    [
        (
            {"nodes": [{"mesh": 0, "skin": 0}], "skins": [{"joints": [0]}]},
            ("1 meshes are bent by a skeleton",),
        ),
        (
            {"meshes": [{"primitives": [WEIGHED]}], "nodes": [{"mesh": 0, "weights": [0.5]}]},
            ("1 meshes are changed by morph weights",),
        ),
        ({"meshes": [{"primitives": [WEIGHED], "weights": [1]}]}, ("1 meshes are changed by morph weights",)),
        (
            {"meshes": [{"primitives": [WEIGHED], "weights": [1]}], "nodes": [{"mesh": 0, "weights": [0]}]},
            (),
        ),
        ({"meshes": [{"primitives": [WEIGHED]}]}, ()),
    ],
    ids=["skin", "weights of a node", "weights of a mesh", "weights of 0", "no weights"],
)
def test_skeletons_and_morph_weights_are_told(
    tmp_path: Path, changes: dict[str, Any], notes: tuple[str, ...]
) -> None:
    model = load_model(write(tmp_path, glb_box(**changes), "part.glb"), units="mm")

    assert np.array_equal(model.mesh.triangles, UPRIGHT)
    assert model.notes == tuple(f"{note}: this is ignored, and their rest shape is used" for note in notes)


VIEW = {"buffer": 0, "byteLength": 96}
FAULTS = {
    "draco": (glb_box(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
    "meshopt": (glb_box(extensionsRequired=["EXT_meshopt_compression"]), "EXT_meshopt_compression"),
    "draco not told in front": (
        glb_box(
            meshes=[
                {
                    "primitives": [
                        {
                            "attributes": {"POSITION": 0},
                            "indices": 1,
                            "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0}},
                        }
                    ]
                }
            ],
            accessors=[
                {"componentType": 5126, "count": 8, "type": "VEC3"},
                {"componentType": 5123, "count": 36, "type": "SCALAR"},
            ],
        ),
        "requires the glTF extension 'KHR_draco_mesh_compression'",
    ),
    "meshopt not told in front": (
        glb_box(
            buffers=[{"byteLength": 168}, {"byteLength": 168}],
            bufferViews=[VIEW | {"buffer": 1, "extensions": {"EXT_meshopt_compression": {"buffer": 0}}}, VIEW],
        ),
        "requires the glTF extension 'EXT_meshopt_compression'",
    ),
    "a buffer without bytes": (
        glb_box(buffers=[{"byteLength": 168}, {"byteLength": 168}], bufferViews=[VIEW | {"buffer": 1}, VIEW]),
        "buffer 1 has no data",
    ),
    "other file": (glb_box(buffers=[{"byteLength": 9, "uri": "/etc/passwd"}]), "in another file"),
    "web": (glb_box(buffers=[{"byteLength": 9, "uri": "http://127.0.0.1:9/x"}]), "in another file"),
    "too many items": (glb_box(**with_accessor(count=9)), "do not fit"),
    "billions of nothing": (glb_box(**with_accessor(bufferView=0, count=4_000_000_000)), "4000000000"),
    "items without bytes": (
        glb_box(accessors=[{"componentType": 5126, "count": 50_000_000, "type": "VEC3"}]), "50000000 items"
    ),
    "negative offset": (glb_box(**with_accessor(byteOffset=-4)), "outside its buffer"),
    "overlapping rows": (glb_box(bufferViews=[VIEW | {"byteStride": 1}, VIEW]), "outside its buffer"),
    "view beyond the end": (glb_box(bufferViews=[VIEW | {"byteLength": 10**9}, VIEW]), "outside its buffer"),
    "index beyond the last": (glb_box(bufferViews=[VIEW, VIEW]), "a facet uses vertex"),
    "negative index": (glb_box(nodes=[{"mesh": -1}]), "expected an index, found -1"),
    "node in itself": (glb_box(nodes=[{"mesh": 0, "children": [0]}]), "nested more than"),
    "endless turn": (glb_box(nodes=[{"mesh": 0, "translation": [float("inf"), 0, 0]}]), "not finite"),
    "deep text": (glb_box(extras=0).replace(b'"extras": 0', b'"extras":' + b"[" * 3), "valid .glb"),
    "version 1": (b"glTF\1\0\0\0" + glb_box()[8:], "version 2"),
    "cut off": (glb_box()[:-20], "are left"),
    "head only": (b"glTF", "valid .glb"),
    "instances without places": (instanced({}), "instance attributes are missing"),
    "instances in other numbers": (
        instanced(PLACES | {"SCALE": PLACES["SCALE"][:2]}), "differ in length"
    ),
    "instances turned in three directions": (
        instanced({"ROTATION": PLACES["SCALE"]}), "the wrong number of components"
    ),
    "instances nowhere": (instanced({"TRANSLATION": np.full((3, 3), np.nan)}), "not finite"),
    "empty scene": (glb_box(scenes=[{}]), "no facets"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_a_broken_glb_is_refused_with_what_is_wrong(content: bytes, message: str, tmp_path: Path) -> None:
    assert message in fault(tmp_path, content)
