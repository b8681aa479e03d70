"""PLY and OFF with polygons of any number of corners, in any mixture, and what else such files hold."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_files import BOX, CORNERS, FACES, MIXED, QUADS, off_of, ply, ply_of, write

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import Limits, load_mesh

PENTAGON = np.array([[0, 0], [10, 0], [10, 10], [5, 2], [0, 10]], dtype=float)
"""Not convex; only its corner at (5, 2) sees all of it. 60 mm²."""
KINDS = ("ascii", "binary_little_endian", "binary_big_endian")


BOX_STRIPS = ([0, 2, 1, 3, 5, 7, 4, 6, 0, 2], [0, 1, 4, 5], [3, 2, 7, 6])
"""Around four sides, and the two that are left; what has two equal corners has no area."""


def strips_of(strips: Iterable[Sequence[int]], kind: str = "ascii") -> bytes:
    """A PLY of the corners of the box and strips, each list one element."""
    order = "<" if kind == KINDS[1] else ">"
    header = [
        f"ply\nformat {kind} 1.0\nelement vertex 8",
        *(f"property float {name}" for name in "xyz"),
        f"element tristrips {len(list(strips))}\nproperty list int int vertex_indices\nend_header\n",
    ]
    rows = [[len(strip), *strip] for strip in strips]
    if kind == "ascii":
        body = "\n".join(" ".join(map(str, row)) for row in [*CORNERS.tolist(), *rows]).encode()
    else:
        body = CORNERS.astype(f"{order}f4").tobytes() + b"".join(
            struct.pack(f"{order}{len(r)}i", *r) for r in rows
        )
    return "\n".join(header).encode() + body


def binary_off(faces: Sequence[Sequence[int]], head: str = "OFF", *, colours: Sequence[int] = ()) -> bytes:
    """With so many numbers of colour behind each face."""
    behind = {"OFF": 0, "COFF": 4, "NOFF": 3, "STCNOFF": 9}[head]
    vertices = np.column_stack([CORNERS, np.full((8, behind), 0.5)]).astype(">f4")
    data = f"{head} BINARY\n".encode() + struct.pack(">3i", 8, len(faces), 0) + vertices.tobytes()
    for number, face in enumerate(faces):
        colour = [0.5] * (colours[number] if colours else 0)
        data += struct.pack(f">{len(face) + 2}i{len(colour)}f", len(face), *face, len(colour), *colour)
    return data


def prism() -> tuple[np.ndarray, list[list[int]]]:
    """Over the pentagon, 5 mm high, with caps of five corners."""
    low = np.column_stack([PENTAGON, np.zeros(5)])
    walls = [[n, (n + 1) % 5, (n + 1) % 5 + 5, n + 5] for n in range(5)]
    return np.concatenate([low, np.add(low, (0, 0, 5))]), [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9], *walls]


def load(folder: Path, content: str | bytes, name: str) -> np.ndarray:
    return load_mesh(write(folder, content, name)).triangles


def areas(triangles: np.ndarray) -> np.ndarray:
    a, b, c = triangles.transpose(1, 0, 2)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


@pytest.mark.parametrize("extras", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("faces", [QUADS, MIXED])
def test_a_ply_of_triangles_and_quads_is_the_box(
    tmp_path: Path, faces: list[list[int]], kind: str, extras: bool
) -> None:
    mesh = load_mesh(write(tmp_path, ply_of(CORNERS, faces, kind, extras=extras), "box.ply"))

    assert mesh.n_facets == 12
    assert mesh.volume == pytest.approx(24)
    assert areas(mesh.triangles).sum() == pytest.approx(52)
    assert np.array_equal(mesh.bounds, [[0, 0, 0], [2, 3, 4]])


@pytest.mark.parametrize("faces", [QUADS, MIXED])
@pytest.mark.parametrize("more", ["", " 0.5 0.5 0.5", " 255 0 0 255"])
def test_an_off_of_triangles_and_quads_is_the_box(tmp_path: Path, faces: list[list[int]], more: str) -> None:
    mesh = load_mesh(write(tmp_path, off_of(CORNERS, faces, more), "box.off"))

    assert mesh.n_facets == 12
    assert mesh.volume == pytest.approx(24)
    assert areas(mesh.triangles).sum() == pytest.approx(52)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "strips",
    [
        BOX_STRIPS,
        [[*BOX_STRIPS[0], -1, *BOX_STRIPS[1], -1, *BOX_STRIPS[2]]],
        [[*BOX_STRIPS[0], -1], [-1], *BOX_STRIPS[1:]],
    ],
    ids=["a list each", "one list", "both"],
)
def test_a_ply_of_strips_is_the_box(tmp_path: Path, kind: str, strips: Sequence[Sequence[int]]) -> None:
    mesh = load_mesh(write(tmp_path, strips_of(strips, kind), "box.ply"))

    assert mesh.n_facets == 12
    assert mesh.volume == pytest.approx(24)
    assert areas(mesh.triangles).sum() == pytest.approx(52)


@pytest.mark.parametrize("head", ["OFF", "COFF", "NOFF", "STCNOFF"])
@pytest.mark.parametrize("faces", [QUADS, MIXED])
def test_a_binary_off_is_the_box(tmp_path: Path, faces: list[list[int]], head: str) -> None:
    for colours in ([], [3] * len(faces), [number % 5 for number in range(len(faces))]):
        mesh = load_mesh(write(tmp_path, binary_off(faces, head, colours=colours), "box.off"))

        assert mesh.n_facets == 12
        assert mesh.volume == pytest.approx(24)
        assert np.array_equal(mesh.bounds, [[0, 0, 0], [2, 3, 4]])


@pytest.mark.parametrize(
    "head",
    ["OFF 8 6 12\n", "COFF\n8 6\n", "# box\nOFF # here\n\n8 6 0 # so many\n", "STCNOFF\n8 6 0\n", "8 6 0\n"],
)
def test_an_off_may_begin_in_several_ways(tmp_path: Path, head: str) -> None:
    content = head + off_of(CORNERS, QUADS).split("\n", 2)[2].replace("\n", "\r\n")

    assert load_mesh(write(tmp_path, content, "box.off")).volume == pytest.approx(24)


FLAT = {
    "one line": lambda text: text.replace("\n", " "),
    "a number a line": lambda text: text.replace(" ", "\n"),
    "a line a piece": lambda text: text.replace("\n", " ").replace("8 8 0", "\n8 8 0\n"),
    "comments between": lambda text: text.replace("\n", " # x\n").replace(" 0.0", "\n0.0", 3),
    "no edges": lambda text: text.replace("\n", " ").replace("8 8 0", "\n8 8\n"),
}


@pytest.mark.parametrize("behind", ["", "C", "N", "CN"])
@pytest.mark.parametrize("change", FLAT.values(), ids=FLAT.keys())
def test_an_off_need_not_have_a_line_for_each(
    tmp_path: Path, change: Callable[[str], str], behind: str
) -> None:
    head, counts, *rows = off_of(CORNERS, MIXED).splitlines()
    numbers = " 0.5" * (4 * ("C" in behind) + 3 * ("N" in behind))
    vertices = [row + numbers for row in rows[:8]]
    mesh = load_mesh(
        write(tmp_path, change("\n".join([behind + head, counts, *vertices, *rows[8:]])), "a.off")
    )

    assert mesh.n_facets == 12
    assert mesh.volume == pytest.approx(24)


def test_numbers_that_are_too_many_or_too_few_are_not_guessed_at(tmp_path: Path) -> None:
    """Colours of faces are told from the next face by the ends of lines only."""
    flat = off_of(CORNERS, MIXED).replace("\n", " ")
    for content in (
        flat + "0",
        flat.rstrip()[:-2],
        flat.replace("2.0", "", 1),
        off_of(CORNERS, MIXED, " 255 0 0").replace("\n", " "),
    ):
        with pytest.raises(MeshError, match=r"8 vertices and 8 faces are stated|are missing"):
            load_mesh(write(tmp_path, content, "a.off"))


NAMES = ("texcoord", "vertex_index")
WORDS = ("0.5", "-1.5e3", "nan", "1.#QNAN", "-1.#IND", "0,5", "abc", "-")


@given(
    st.data(),
    st.permutations(["vertex_indices", *NAMES]),
    st.sampled_from([QUADS, MIXED, FACES.tolist()]),
    st.booleans(),
)
def test_a_second_list_for_each_face_may_hold_anything(
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
    names: list[str],
    faces: list[list[int]],
    same: bool,
) -> None:
    words = st.lists(st.sampled_from(WORDS), max_size=6)
    first = data.draw(words)
    rows = []
    for face in faces:
        lists = {
            "vertex_indices": [str(corner) for corner in face],
            "texcoord": first if same else data.draw(words),
            "vertex_index": [],
        }
        rows.append(" ".join(f"{len(lists[name])} {' '.join(lists[name])}" for name in names))
    kinds = {"texcoord": "float", "vertex_index": "int", "vertex_indices": "int"}
    header = [
        "ply\nformat ascii 1.0\nelement vertex 8",
        *(f"property float {name}" for name in "xyz"),
        f"element face {len(faces)}",
        *(f"property list uchar {kinds[name]} {name}" for name in names),
        "end_header",
    ]
    points = [" ".join(map(str, point)) for point in CORNERS.tolist()]
    text = "\n".join([*header, *points, *rows, ""])

    triangles = load(tmp_path_factory.mktemp("ply"), text, "part.ply")

    assert areas(triangles).sum() == pytest.approx(areas(BOX).sum())


@pytest.mark.parametrize("kind", ["off", *KINDS])
def test_a_polygon_that_is_not_convex_is_cut_without_folds(tmp_path: Path, kind: str) -> None:
    vertices, faces = prism()
    content = off_of(vertices, faces) if kind == "off" else ply_of(vertices, faces, kind)
    triangles = load(tmp_path, content, "prism.off" if kind == "off" else "prism.ply")
    caps = triangles[np.ptp(triangles[:, :, 2], axis=1) == 0]

    assert len(triangles) == 16
    assert areas(caps).sum() == pytest.approx(2 * 60)
    assert load_mesh(tmp_path / f"prism.{'off' if kind == 'off' else 'ply'}").volume == pytest.approx(300)


@given(st.lists(st.integers(3, 9), min_size=1, max_size=30), st.sampled_from(["off", *KINDS]), st.booleans())
def test_every_polygon_keeps_its_area_and_its_place(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int], kind: str, extras: bool
) -> None:
    """Regular polygons, one over the other: facets come in the order of the file."""
    rings, faces = [], []
    for level, size in enumerate(sizes):
        angle = 2 * np.pi * np.arange(size) / size
        faces.append([sum(sizes[:level]) + n for n in range(size)])
        rings.append(np.column_stack([np.cos(angle), np.sin(angle), level + 0.1 * np.cos(angle)]))
    vertices = np.concatenate(rings)
    content = off_of(vertices, faces) if kind == "off" else ply_of(vertices, faces, kind, extras=extras)
    folder = tmp_path_factory.mktemp("polygons")
    triangles = load(folder, content, "rings.off" if kind == "off" else "rings.ply")

    levels = np.repeat(np.arange(len(sizes)), np.subtract(sizes, 2))
    wanted = np.multiply(sizes, np.sin(2 * np.pi / np.array(sizes))) / 2 * np.hypot(1, 0.1)
    assert (np.rint(triangles.mean(axis=1)[:, 2]) == levels).all()
    assert np.bincount(levels, areas(triangles)) == pytest.approx(wanted)


@pytest.mark.parametrize("kind", KINDS)
def test_polygons_without_three_corners_have_no_facets(tmp_path: Path, kind: str) -> None:
    assert (
        load_mesh(write(tmp_path, ply_of(CORNERS, [[], *MIXED, [3], [0, 1]], kind), "a.ply")).n_facets == 12
    )
    assert load_mesh(write(tmp_path, off_of(CORNERS, [[], *MIXED, [3], [0, 1]]), "a.off")).n_facets == 12


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("binary", [False, True])
def test_a_header_ends_its_lines_in_any_way(tmp_path: Path, end: str, binary: bool) -> None:
    head, mark, body = ply(binary=binary).partition(b"end_header\n")
    content = (head + mark).replace(b"\n", end.encode()) + body

    assert np.array_equal(load(tmp_path, content, "box.ply"), BOX)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_breaks_off_anywhere_is_refused(tmp_path: Path, kind: str) -> None:
    content = ply_of(CORNERS, MIXED, kind, extras=True).rstrip(b"\n")
    off = off_of(CORNERS, MIXED).rstrip("\n")
    for length in range(1, len(content) - 4, 7):
        with pytest.raises(MeshError):
            load(tmp_path, content[:length], "cut.ply")
    for length in range(4, off.rfind("\n"), 7):
        with pytest.raises(MeshError):
            load(tmp_path, off[:length], "cut.off")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ply", ply_of(CORNERS, [*MIXED[:-1], [0, 1, 2, 8]], KINDS[1]), "face 8 uses vertex 8 of 8"),
        ("a.off", off_of(CORNERS, [*MIXED, [0, 1, -2]]), "face 9 uses vertex -2 of 8"),
        ("a.ply", ply_of(CORNERS, MIXED, "ascii").replace(b"3 0 2 3", b"3 0 x 3"), "expected a number, found 'x'"),
        ("a.ply", ply_of(CORNERS, MIXED, "ascii").replace(b"3 0 2 3", b"3 0 2.5 3"), "not a whole number"),
        ("a.ply", ply_of(CORNERS, MIXED, "binary_middle_endian"), "'format binary_middle_endian 1.0'"),
        ("a.ply", ply().replace(b"float z", b"half z"), "property 'half z'"),
        ("a.ply", ply().replace(b"float z", b"float w"), "'vertex' has no property 'z'"),
        ("a.ply", ply().replace(b"vertex_indices", b"corners"), "'face' has no property 'vertex_indices'"),
        ("a.off", off_of(CORNERS, MIXED).replace("2.0 0.0 0.0", "2.0 0.0", 1), "a vertex does not have 3 numbers"),
        ("a.off", off_of(CORNERS, MIXED).replace("3 0 2 3", "3 0  2  ", 1), "a face does not have 3 numbers"),
        ("a.off", off_of(CORNERS, FACES.tolist()).replace("0 1 4", "0 1", 1), "face 5 is malformed: '3 0 1'"),
        ("a.off", off_of(CORNERS, MIXED).replace("3 0 2 3", "9999 0 2 3", 1), "face 1 is malformed: '9999 0 2 3'"),
        ("a.off", "4OFF\n1 1 0\n", "do not have three coordinates"),
        ("a.off", "OFF BINARY\n\0\0", "numbers of vertices and faces"),
        ("a.off", "4OFF BINARY\n" + 12 * "\0", "do not have three coordinates"),
        ("a.off", binary_off(MIXED)[:-1], "is damaged within element 'face'"),
        ("a.off", binary_off(MIXED)[:50], "element 'vertex'"),
        ("a.off", binary_off([*MIXED, [0, 1, 8]]), "face 9 uses vertex 8 of 8"),
        ("a.ply", strips_of([[0, 1, 2, 9]]), "uses vertex 9 of 8"),
        ("a.ply", strips_of([[0, 1, -2, 3]]), "uses vertex -2 of 8"),
        ("a.off", "OFF\neight\n", "numbers of vertices and faces"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path: Path, name: str, content: str | bytes, words: str) -> None:
    with pytest.raises(MeshError) as caught:
        load(tmp_path, content, name)
    assert words in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize("name", ["a.off", "a.ply"])
def test_facets_of_polygons_are_counted_against_the_limit(tmp_path: Path, name: str) -> None:
    content = off_of(CORNERS, QUADS).encode() if name == "a.off" else ply_of(CORNERS, QUADS, KINDS[1])
    path = write(tmp_path, content, name)

    assert load_mesh(path, limits=Limits(facets=12)).n_facets == 12
    with pytest.raises(MeshError, match="11"):
        load_mesh(path, limits=Limits(facets=11))


def test_lists_that_lead_beyond_the_file_are_refused(tmp_path: Path) -> None:
    head, _, body = ply_of(CORNERS, MIXED, KINDS[1]).partition(b"end_header\n")
    for count in (b"int", b"uint"):
        long = head.replace(b"list uchar", b"list " + count) + b"end_header\n"
        for number in (b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff"):
            with pytest.raises(MeshError, match="is damaged"):
                load(tmp_path, long + body[: 8 * 24] + number + body, "a.ply")
