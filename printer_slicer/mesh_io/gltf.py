"""Read glTF 2.0 files as text (.gltf) and in binary form (.glb).

Only data that determines the shape is read, no materials or images. A .gltf file may refer to files in its folder or
below it; a GLB file may not.
"""

from __future__ import annotations

import base64
import errno
import json
import struct
from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.input_files import read_input
from printer_slicer.mesh_io.assembly import ObjectBuilder, ObjectReference, assemble_facets
from printer_slicer.mesh_io.files import strip_byte_order_mark
from printer_slicer.mesh_io.limits import check_facets, check_instances, check_vertices
from printer_slicer.mesh_io.soundness import COPY_AGAIN, EXPORT_AGAIN
from printer_slicer.mesh_io.units import UNITS

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_glb", "read_gltf"]

Numbers = np.ndarray[tuple[int, ...], np.dtype[Any]]
JSON_CHUNK: Final = 0x4E4F534A
BINARY_CHUNK: Final = 0x004E4942
COMPONENTS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""glTF component type -> type in numpy."""
COLUMNS: Final = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
"""Numbers per item of an accessor, by its type."""
TRIANGLES, STRIP, FAN = 4, 5, 6
INSTANCING: Final = "EXT_mesh_gpu_instancing"
ACCEPTED_EXTENSIONS: Final = (
    INSTANCING,
    "KHR_mesh_quantization",
    "KHR_materials",
    "KHR_texture",
    "KHR_lights",
    "EXT_texture",
    "KHR_xmp",
)
"""Prefixes of the extensions that are supported or do not affect the shape."""
COMPRESSION_EXTENSIONS: Final = (
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
)
SCENE: Final = ("scene", 0)
KEEP_TOGETHER: Final = "Keep the files of a glTF together, or export it as GLB"
Y_UP_TO_Z_UP: Final = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Rotates y up, as in glTF, to z up; for row vectors."""


FAULTS: Final = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    struct.error,
)
"""Exceptions that an inconsistent file causes while it is read."""


class _Document:
    """The JSON of a file and the arrays in its buffers."""

    def __init__(
        self, tree: dict[str, Any], buffers: Mapping[int, bytes | memoryview], path: Path, limits: Limits
    ) -> None:
        self.tree = tree
        self._limits = limits
        self._path = path
        self._n_vertices = self._n_facets = self._n_instances = 0
        self.n_skinned = self.n_morphed = 0
        self._buffers = dict(buffers)
        self._length = sum(map(len, buffers.values()))

    def reject_compression(self, item: dict[str, Any]) -> None:
        """Reject compressed data, even if the file does not declare that it requires the compression extension.

        Raises:
            MeshError: a primitive or a buffer view uses a compression extension.
        """
        for name in COMPRESSION_EXTENSIONS:
            if name in item.get("extensions", {}):
                raise _extension_error(self._path, name)

    def read_accessor(self, index: int) -> Numbers:
        """Return the numbers (count, columns) of the accessor with this index."""
        accessor = self.tree["accessors"][_require_index(index)]
        count, columns = int(accessor["count"]), COLUMNS[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        if not 0 <= count <= 3 * self._limits.facets:
            raise ValueError(f"an accessor states {count} items, which is not possible")
        if "bufferView" in accessor:
            numbers = self._read_numbers(accessor, kind, count, columns)
        elif count <= self._length:
            numbers = np.zeros((count, columns), dtype=kind)
        else:
            raise ValueError(f"an accessor of {count} items has no data")
        if "sparse" in accessor:
            numbers = self._apply_sparse(numbers, accessor["sparse"])
        if accessor.get("normalized"):
            return np.maximum(numbers / np.iinfo(kind).max, -1.0)
        return numbers

    def add_counts(self, n_vertices: int, n_facets: int) -> None:
        """Add to the number of vertices and facets.

        Raises:
            MeshError: there are too many; several primitives can share the same bytes.
        """
        self._n_vertices += n_vertices
        self._n_facets += n_facets
        check_vertices(self._n_vertices, self._path, self._limits)
        check_facets(self._n_facets, self._path, self._limits)

    def add_instances(self, count: int) -> None:
        """Add to the number of instances.

        Raises:
            MeshError: there are too many; several nodes can share the same bytes.
        """
        self._n_instances += count
        check_instances(self._n_instances, self._path, self._limits)

    def list_warnings(self) -> list[str]:
        """Return warnings about properties of the file that are ignored."""
        return [
            f"{number} meshes are {what}: this is ignored, and their rest shape is used"
            for number, what in (
                (self.n_skinned, "bent by a skeleton"),
                (self.n_morphed, "changed by morph weights"),
            )
            if number
        ]

    def _apply_sparse(self, numbers: Numbers, sparse: dict[str, Any]) -> Numbers:
        """Return the numbers with the substitutions of a sparse accessor applied."""
        count = int(sparse["count"])
        kind = np.dtype(COMPONENTS[sparse["indices"]["componentType"]])
        places = self._read_numbers(sparse["indices"], kind, count, 1)[:, 0]
        replaced = numbers.copy()
        replaced[places] = self._read_numbers(sparse["values"], numbers.dtype, count, numbers.shape[1])
        return replaced

    def _read_numbers(self, where: dict[str, Any], kind: np.dtype[Any], count: int, columns: int) -> Numbers:
        """Return numbers (count, columns) as a view of the buffer that `where` refers to."""
        view = self.tree["bufferViews"][_require_index(where["bufferView"])]
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        offset, least = int(where.get("byteOffset", 0)), columns * kind.itemsize
        stride = int(view.get("byteStride", least))
        buffer = self._get_buffer(view)
        if min(start, length, offset) < 0 or stride < least or start + length > len(buffer):
            raise ValueError("a buffer view lies outside its buffer")
        if count and offset + (count - 1) * stride + least > length:
            raise ValueError(f"{count} items do not fit into their buffer view")
        return np.ndarray(
            (count, columns), kind, buffer[start : start + length], offset, (stride, kind.itemsize)
        )

    def _get_buffer(self, view: dict[str, Any]) -> memoryview | bytes:
        """Return the buffer of a buffer view."""
        number = _require_index(view["buffer"])
        if number not in self._buffers:
            uri = self.tree["buffers"][number].get("uri")
            if uri is None:
                self.reject_compression(view)
                raise ValueError(f"buffer {number} has no data")
            head, comma, text = str(uri).partition(",")
            if not comma or not head.lower().startswith("data:") or not head.lower().endswith("base64"):
                raise ValueError("a buffer is in another file")
            self._buffers[number] = base64.b64decode(text, validate=True)
        return self._buffers[number]


def _check_extensions(tree: Mapping[str, Any], path: Path) -> None:
    """Reject a file that requires an unsupported extension.

    Raises:
        MeshError: the file requires one.
        TypeError: the required extensions are not a list.
    """
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(ACCEPTED_EXTENSIONS):
            raise _extension_error(path, str(name))


def read_glb(
    data: bytes, path: Path, limits: Limits, unit: str | None, *, y_up: bool = True
) -> tuple[Float, str, list[str]]:
    """Read the scene of a GLB file and turn it z up.

    Args:
        data: content of the file.
        path: path of the file, for messages.
        limits: limits for the content.
        unit: unit of the coordinates, a key in UNITS; None means metres, as in the glTF specification.
        y_up: whether y points up, as in the glTF specification.

    Returns:
        Corners (F, 3, 3), mm; the unit of the file; warnings.

    Raises:
        MeshError: the GLB is not valid.
    """
    try:
        tree, binary = _split_chunks(data, limits)
        # The binary chunk is the first buffer if that has no 'uri'.
        is_own = tree.get("buffers") and tree["buffers"][0].get("uri") is None
        return _read_scene(tree, {0: binary} if is_own else {}, path, limits, unit, y_up=y_up)
    except FAULTS as error:
        raise MeshError(
            f"{path}: not a valid .glb file: {_describe_error(error)}", remedy=COPY_AGAIN
        ) from error


def read_gltf(
    data: bytes, path: Path, limits: Limits, unit: str | None = None
) -> tuple[Float, str, list[str]]:
    """Read the scene of a .gltf file and turn it z up.

    Args:
        data: content of the file.
        path: path of the file; it may refer to files in its folder.
        limits: limits for the bytes of all files together and for the facets.
        unit: unit of the coordinates, a key in UNITS; None means metres.

    Returns:
        Corners (F, 3, 3), mm; the unit of the file; warnings.

    Raises:
        MeshError: the file is not valid, a file it refers to is missing or outside its folder, or it has too many
            facets.
    """
    try:
        tree = json.loads(strip_byte_order_mark(data))
        _check_version(tree)
        _check_extensions(tree, path)
        buffers = _read_buffers(tree, path, limits.file_bytes - len(data))
        return _read_scene(tree, buffers, path, limits, unit)
    except FAULTS as error:
        raise MeshError(
            f"{path}: not a valid .gltf file: {_describe_error(error)}", remedy=EXPORT_AGAIN
        ) from error


def _read_scene(
    tree: dict[str, Any],
    buffers: Mapping[int, bytes | memoryview],
    path: Path,
    limits: Limits,
    unit: str | None,
    *,
    y_up: bool = True,
) -> tuple[Float, str, list[str]]:
    """Read the scene of a glTF document and turn it z up.

    Args:
        tree: the JSON document.
        buffers: number -> bytes of the buffers.
        path: path of the file, for messages.
        limits: limits for the content.
        unit: see `read_glb`.
        y_up: see `read_glb`.

    Returns:
        See `read_glb`.

    Raises:
        MeshError: the content exceeds a limit, or an extension is not supported.
        FAULTS: the file is inconsistent.
    """
    _check_extensions(tree, path)
    document = _Document(tree, buffers, path, limits)
    bodies = _build_objects(document)
    bodies[SCENE] = _build_scene(tree)
    own_unit = unit or "m"
    return (
        assemble_facets(
            [ObjectReference(SCENE, Y_UP_TO_Z_UP if y_up else None)], bodies, path, limits, UNITS[own_unit]
        ),
        own_unit,
        document.list_warnings(),
    )


def _describe_error(error: Exception) -> str:
    """Describe one of the exceptions in `FAULTS`."""
    reason = str(error).partition("\n")[0][:200] or type(error).__name__
    return f"missing key {reason}" if isinstance(error, KeyError) else reason


def _check_version(tree: object) -> None:
    if not isinstance(tree, dict):
        raise TypeError("the text is not a JSON object")
    version = str(tree.get("asset", {}).get("version", "2.0"))
    if not version.startswith("2."):
        raise ValueError(f"glTF version {version[:20]} is not supported; only 2.0 is")


def _read_buffers(tree: dict[str, Any], path: Path, bytes_left: int) -> dict[int, bytes]:
    """Read the bytes of each buffer, by its number.

    Args:
        tree: the JSON document.
        path: path of the file.
        bytes_left: maximum length of all buffers together, bytes.

    Raises:
        MeshError: a buffer cannot be read.
    """
    found: dict[int, bytes] = {}
    buffers = tree.get("buffers", [])
    if not isinstance(buffers, list):
        raise MeshError(f"{path}: not a valid .gltf file: 'buffers' is not a list", remedy=EXPORT_AGAIN)
    for number, buffer in enumerate(buffers):
        uri = buffer.get("uri") if isinstance(buffer, dict) else None
        if not isinstance(uri, str):
            raise MeshError(
                f"{path}: not a valid .gltf file: buffer {number} has no 'uri'", remedy=EXPORT_AGAIN
            )
        data = (
            _decode_data_uri(uri, number, path)
            if uri[:5].lower() == "data:"
            else _read_buffer_file(uri, path, bytes_left)
        )
        wanted = buffer.get("byteLength")
        if isinstance(wanted, int) and len(data) < wanted:
            raise MeshError(
                f"{path}: buffer {number} has only {len(data)} of {wanted} bytes", remedy=EXPORT_AGAIN
            )
        bytes_left -= len(data)
        found[number] = data
    return found


def _decode_data_uri(uri: str, number: int, path: Path) -> bytes:
    """Decode a buffer that is embedded as a data URI."""
    kind, _, text = uri.partition(",")
    try:
        data = base64.b64decode(unquote(text), validate=True)
    except ValueError:
        kind = ""
    if not kind.lower().endswith(";base64"):
        raise MeshError(
            f"{path}: not a valid .gltf file: buffer {number} is not valid base64", remedy=EXPORT_AGAIN
        )
    return data


def _read_buffer_file(uri: str, path: Path, limit: int) -> bytes:
    """Read a buffer from a file in the folder of the model or below it.

    Args:
        uri: name of the file, relative to the folder; special characters may be encoded as in URLs.
        path: path of the model.
        limit: maximum length, bytes.

    Raises:
        MeshError: the file is outside the folder, missing or too long.
    """
    try:
        folder = path.parent.resolve()
        # A backslash separates folders on some systems only; treat it so on all, so that the check is the same.
        target = (folder / unquote(uri).replace("\\", "/")).resolve()
        if ":" in uri.partition("/")[0] or not target.is_relative_to(folder):
            raise MeshError(f"{path}: refers to a file outside its folder: {uri!r}", remedy=KEEP_TOGETHER)
        return read_input(target, limit)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise MeshError(f"{path}: refers to a missing file: {uri!r}", remedy=KEEP_TOGETHER) from None
    except RuntimeError:  # raised by older Pythons for circular links
        raise MeshError(f"{path}: refers to a circular link: {uri!r}", remedy=KEEP_TOGETHER) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            reason = f"it is longer than the {max(limit, 0)} bytes that remain of the limit for all files"
        raise MeshError(
            f"{path}: refers to a file that cannot be read: {uri!r}: {reason}", remedy=KEEP_TOGETHER
        ) from None


def _split_chunks(data: bytes, limits: Limits) -> tuple[dict[str, Any], memoryview]:
    """Return the JSON of a GLB and its binary chunk, which may be empty."""
    magic, version, _ = struct.unpack_from("<4sLL", data)
    if magic != b"glTF" or version != 2:
        raise ValueError("it is not binary glTF version 2")
    chunks: dict[int, memoryview] = {}
    place, view = 12, memoryview(data)
    while place + 8 <= len(data):
        length, kind = struct.unpack_from("<LL", data, place)
        if place + 8 + length > len(data):
            raise ValueError(f"a chunk has {length} bytes, but only {len(data) - place - 8} are left")
        chunks.setdefault(kind, view[place + 8 : place + 8 + length])
        place += 8 + length
    if len(chunks[JSON_CHUNK]) > limits.json_bytes:
        raise ValueError(f"{len(chunks[JSON_CHUNK])} bytes of JSON; the limit is {limits.json_bytes}")
    tree = json.loads(bytes(chunks[JSON_CHUNK]))
    if not isinstance(tree, dict):
        raise TypeError("the text is not a JSON object")
    return tree, chunks.get(BINARY_CHUNK, memoryview(b""))


def _build_scene(tree: dict[str, Any]) -> ObjectBuilder:
    """Return the scene as an object that consists of its root nodes."""
    nodes, scenes = tree.get("nodes", []), tree.get("scenes", [])
    if scenes:
        roots = [
            _require_index(index) for index in scenes[_require_index(tree.get("scene", 0))].get("nodes", [])
        ]
    else:
        children = {_require_index(child) for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in children]
    return ObjectBuilder(
        "the scene",
        parts=[ObjectReference(("node", index), _read_transform(nodes[index])) for index in roots],
    )


def _build_objects(document: _Document) -> dict[Hashable, ObjectBuilder]:
    """Return an object for each node and each mesh in use."""
    bodies: dict[Hashable, ObjectBuilder] = {}
    nodes = document.tree.get("nodes", [])
    for index, node in enumerate(nodes):
        body = bodies["node", index] = ObjectBuilder(f"node {index}")
        if "mesh" in node:
            key = ("mesh", _require_index(node["mesh"]))
            if key not in bodies:
                bodies[key] = _read_mesh(document, key[1])
            document.n_skinned += "skin" in node
            document.n_morphed += _is_morphed(node, document.tree["meshes"][key[1]])
            body.parts += [
                ObjectReference(key, matrix) for matrix in _read_instance_transforms(document, node)
            ]
        children = [_require_index(child) for child in node.get("children", [])]
        body.parts += [ObjectReference(("node", child), _read_transform(nodes[child])) for child in children]
    return bodies


def _is_morphed(node: dict[str, Any], mesh: dict[str, Any]) -> bool:
    """Return whether morph targets move the vertices of a mesh."""
    return any(node.get("weights", mesh.get("weights", []))) and any(
        "targets" in primitive for primitive in mesh["primitives"]
    )


def _read_instance_transforms(document: _Document, node: dict[str, Any]) -> Sequence[Float | None]:
    """Return the transforms (4, 4) of the instances of a node's mesh; a single None unless the node has instances."""
    if INSTANCING not in node.get("extensions", {}):
        return [None]
    attributes = node["extensions"][INSTANCING]["attributes"]
    places = {
        name: document.read_accessor(attributes[name]).astype(np.float64)
        for name in ("TRANSLATION", "ROTATION", "SCALE")
        if name in attributes
    }
    counts = {len(numbers) for numbers in places.values()}
    if len(counts) != 1:
        raise ValueError("the instance attributes are missing or differ in length")
    count = counts.pop()
    document.add_instances(count)
    return list(
        _compose_transforms(
            places.get("TRANSLATION", np.zeros((count, 3))),
            places.get("ROTATION", np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))),
            places.get("SCALE", np.ones((count, 3))),
        )
    )


def _read_mesh(document: _Document, index: int) -> ObjectBuilder:
    """Read the facets of all primitives of a mesh."""
    body = ObjectBuilder(f"mesh {index}")
    for primitive in document.tree["meshes"][index]["primitives"]:
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
            continue
        if any(
            "bufferView" not in document.tree["accessors"][_require_index(one)]
            for one in _list_accessors(primitive)
        ):
            document.reject_compression(primitive)
        points = document.read_accessor(primitive["attributes"]["POSITION"])
        if points.shape[1] != 3:
            raise ValueError("the vertex positions do not have three coordinates")
        if "indices" in primitive:
            corners = document.read_accessor(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(points), dtype=np.int64)
        if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
            raise ValueError(f"a facet uses vertex {corners.max()} of {len(points)}")
        document.add_counts(len(points), len(corners) // 3 if mode == TRIANGLES else len(corners))
        faces = _split_into_facets(corners, mode) + len(body.xyz) // 3
        body.xyz.frombytes(points.astype(np.float64).tobytes())
        body.corners.frombytes(faces.tobytes())
    return body


def _list_accessors(primitive: dict[str, Any]) -> list[Any]:
    """Return the accessor indices of the positions and of the vertex indices."""
    return [primitive["attributes"]["POSITION"], *([primitive["indices"]] if "indices" in primitive else [])]


def _extension_error(path: Path, extension: str) -> MeshError:
    """Return the error for a file that requires an unsupported extension."""
    return MeshError(
        f"{path}: the file requires the glTF extension '{extension[:60]}', which is not supported",
        remedy="Export it without compression, or as STL or 3MF",
    )


def _split_into_facets(corners: Numbers, mode: int) -> Numbers:
    """Return the facets (F, 3) of a list, a strip or a fan of vertex indices."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    first = np.arange(count)
    if mode == FAN:
        return np.stack([corners[first * 0], corners[first + 1], corners[first + 2]], axis=1)
    odd = first % 2  # every second facet of a strip has the opposite winding
    return np.stack([corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=1)


def _read_transform(node: dict[str, Any]) -> Float | None:
    """Return the transform (4, 4) of a node, for row vectors; None if it has none."""
    if "matrix" in node:
        return _require_finite(np.reshape(np.array(node["matrix"], dtype=np.float64), (4, 4)))
    if not node.keys() & {"translation", "rotation", "scale"}:
        return None
    translation, rotation, scale = (
        np.reshape(np.array(node.get(name, usual), dtype=np.float64), (1, len(usual)))
        for name, usual in (("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))
    )
    matrix: Float = _compose_transforms(translation, rotation, scale)[0]
    return matrix


def _compose_transforms(translation: Float, rotation: Float, scale: Float) -> Float:
    """Return transforms (N, 4, 4) for row vectors.

    Args:
        translation: (N, 3).
        rotation: (N, 4) quaternions, real part last.
        scale: (N, 3).
    """
    if translation.shape[1] != 3 or rotation.shape[1] != 4 or scale.shape[1] != 3:
        raise ValueError("a transform has the wrong number of components")
    matrices = np.zeros((len(translation), 4, 4))
    x, y, z, w = rotation.T
    matrices[:, :3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    matrices[:, :3, :3] *= scale[:, :, None]
    matrices[:, 3, :3] = translation
    matrices[:, 3, 3] = 1
    return _require_finite(matrices)


def _require_finite(matrices: Float) -> Float:
    if not np.isfinite(matrices).all():
        raise ValueError("the transform of a node is not finite")
    return matrices


def _require_index(value: object) -> int:
    """Return an index after checking that it is not negative; Python would count a negative index from the end."""
    if not isinstance(value, int) or value < 0:
        raise ValueError(f"expected an index, found {str(value)[:20]}")
    return value
