"""OBJ: relative numbers, blanks, comments, line ends, many groups, and what is in such files besides facets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from tiny_files import BOX, CORNERS, FACES, MIXED, QUADS, obj, write

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import Limits, Model, load_mesh, load_model

POINTS = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS.tolist())
TRIANGLES = "".join(f"f {a} {b} {c}\n" for a, b, c in (FACES + 1).tolist())


def read(folder: Path, content: str | bytes) -> Model:
    return load_model(write(folder, content, "part.obj"))


def faces_of(faces: list[list[int]], corner: str = "{}") -> str:
    return "".join("f " + " ".join(corner.format(k + 1) for k in face) + "\n" for face in faces)


def fault(folder: Path, content: str | bytes) -> str:
    with pytest.raises(MeshError) as caught:
        read(folder, content)
    assert str(folder / "part.obj") in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


def test_relative_numbers_count_back_from_the_face(tmp_path: Path) -> None:
    one = POINTS + "".join(f"f {a - 8} {b - 8} {c - 8}\n" for a, b, c in FACES.tolist())
    other = one.replace("v ", "v 9")  # 92, 93, 90.0 ... in x: another place

    triangles = read(tmp_path, one + other).mesh.triangles

    assert np.array_equal(triangles[:12], BOX)
    assert np.array_equal(triangles[12:, :, 1:], BOX[:, :, 1:])
    assert np.array_equal(triangles[12:, :, 0], BOX[:, :, 0] + 90)


def test_every_side_may_follow_its_own_corners(tmp_path: Path) -> None:
    sides = "".join(
        "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS[side].tolist()) + "f -4 -3 -2 -1\n"
        for side in QUADS
    )
    mesh = read(tmp_path, sides).mesh

    assert mesh.n_facets == 12
    assert mesh.volume == pytest.approx(24)


LEGAL = {
    "TAB behind v": (POINTS.replace("v ", "v\t"), TRIANGLES),
    "TAB behind f": (POINTS, TRIANGLES.replace("f ", "f\t")),
    "TAB between": (POINTS.replace(" ", "\t"), TRIANGLES.replace(" ", "\t")),
    "indented": (POINTS.replace("v ", "  v  "), TRIANGLES.replace("f ", "\tf \t")),
    "blanks at ends": (POINTS.replace("\n", " \t\n"), TRIANGLES.replace("\n", "  \n")),
    "comments at ends": (POINTS.replace("\n", " # v 1 2 3\n"), TRIANGLES.replace("\n", "# f 1 2 3\n")),
    "comment with backslash": ("# C:\\parts\\\n" + POINTS, "# the end \\\n" + TRIANGLES),
    "continued": (POINTS.replace(" 4.0", " \\\n4.0"), TRIANGLES.replace(" ", " \\\n")),
    "continued by nothing": (POINTS, TRIANGLES + "\\\n"),
    "backslash before a comment": (POINTS, TRIANGLES + "g \\# box\n"),
    "weights": (POINTS.replace("\n", " 0.5\n"), TRIANGLES),
    "colours": (POINTS.replace("\n", " 1 0.5 0.25\n"), TRIANGLES),
    "some colours": (POINTS.replace(" 4.0\n", " 4.0 1 0.5 0.25\n"), TRIANGLES),
    "textures": (POINTS + "vt 0 0\nvt 1 1 0\n", faces_of(FACES.tolist(), "{}/2")),
    "normals": (POINTS + "vn 0 0 1\n", faces_of(FACES.tolist(), "{}//1")),
    "both": (POINTS + "vt 0 0\nvn 0 0 1\n", faces_of(FACES.tolist(), "{}/1/1")),
    "an empty texture": (POINTS, faces_of(FACES.tolist(), "{}/")),
    "forward": (TRIANGLES, POINTS),
    "quads": (POINTS, faces_of(QUADS)),
    "mixed": (POINTS, faces_of(MIXED, "{}//7")),
    "other statements": (
        "mtllib a b.mtl\ng\no v 1 2 3\n" + POINTS + "usemtl f\ns off\nvp 1 2\n",
        TRIANGLES + "l 1 2 3\np 1\ncstype bezier\ncurv 0 1 1 2\nend\n",
    ),
    "old encoding": (b"o Geh\xe4use\n" + POINTS.encode(), TRIANGLES.encode()),
}  # fmt: skip


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize(("points", "faces"), LEGAL.values(), ids=LEGAL.keys())
def test_whatever_is_legal_is_the_box(
    tmp_path: Path, points: str | bytes, faces: str | bytes, end: str
) -> None:
    content = b"".join(text if isinstance(text, bytes) else text.encode() for text in (points, faces))
    model = read(tmp_path, content.replace(b"\n", end.encode()))

    assert model.notes == ()
    assert model.mesh.n_facets == 12
    assert model.mesh.volume == pytest.approx(24)
    assert np.array_equal(model.mesh.bounds, [[0, 0, 0], [2, 3, 4]])
    assert np.array_equal(read(tmp_path, content.rstrip()).mesh.triangles, model.mesh.triangles)


@pytest.mark.parametrize("end", ["\n", "\r"])
@pytest.mark.parametrize("indent", ["", "\t"])
def test_an_obj_is_known_by_its_lines(tmp_path: Path, indent: str, end: str) -> None:
    content = ("# box\n" + indent + obj().strip().replace("\n", f"\n{indent}")).replace("\n", end)

    assert np.array_equal(load_mesh(write(tmp_path, content, "part")).triangles, BOX)


def test_a_text_in_utf_16_is_read(tmp_path: Path) -> None:
    assert np.array_equal(read(tmp_path, obj().encode("utf-16")).mesh.triangles, BOX)


@given(
    st.lists(st.tuples(st.sampled_from([0, 1, 2, 3, 4, 5]), st.booleans()), min_size=1, max_size=40),
    st.sampled_from([" ", "\t", " \\\n", "  "]),
    st.sampled_from(["", "/1", "//1", "/1/1"]),
)
def test_relative_and_plain_numbers_mean_the_same(
    tmp_path_factory: pytest.TempPathFactory, sides: list[tuple[int, bool]], blank: str, behind: str
) -> None:
    """Sides of boxes one behind the other, each with vertices of its own or with those of the first box."""
    text, wanted, n_known = POINTS, [], 8
    for number, (side, own) in enumerate(sides):
        quad = CORNERS[QUADS[side]]
        if own:
            quad = quad + np.array([number, 0, 0])
            text += "vn 0 0 1\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in quad.tolist())
            n_known += 4
        places = np.arange(n_known - 4, n_known) if own else np.array(QUADS[side])
        words = [str(k + 1 if number % 2 else k - n_known) + behind for k in places.tolist()]
        text += blank.join(["f", *words]) + "\n"
        wanted += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    text += faces_of(QUADS)  # so that it extends in x, y and z

    triangles = read(tmp_path_factory.mktemp("obj"), text).mesh.triangles

    assert np.array_equal(triangles[:-12], wanted)


def test_files_of_several_pieces_are_read_as_one(tmp_path: Path) -> None:
    """Over 1 MiB, so that pieces end within lines, continued ones too, and faces count back over their ends."""
    made = trimesh.creation.icosphere(5, 5.0)
    points, faces = np.asarray(made.vertices), np.asarray(made.faces)
    lines = [f"v {x!r} \\\n {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"f {a}/{a}/{a} {b}/{b} \\\n {c}//1" for a, b, c in (faces - len(points)).tolist()]
    content = "\n".join(lines)

    assert len(content) > 1 << 20
    assert np.array_equal(read(tmp_path, content).mesh.triangles, points[faces])


def test_a_hundred_thousand_objects_of_a_facet_are_read(tmp_path: Path) -> None:
    """Each with a name, a group and a material; all that is done for each of them is in whole arrays."""
    faces = "".join(
        f"o part {n}\ng a{n}\nusemtl m{n}\nf {a} {b} {c}\n"
        for n, (a, b, c) in enumerate((FACES + 1).tolist() * 8400)
    )

    assert read(tmp_path, POINTS + faces).mesh.n_facets == 100_800


FAULTS = {
    "two coordinates": (POINTS + "v 1 2 # 3\n" + TRIANGLES, "line 9: a vertex has only 2 coordinates"),
    "none": (TRIANGLES + "v\n" + POINTS, "line 13: a vertex has only 0 coordinates"),
    "no number": (POINTS.replace("v 2.0 3.0", "v 2,0 3.0", 1) + TRIANGLES, "line 4: expected a number, found '2,0'"),
    "two numbers in one": (POINTS.replace("v 2.0 3.0", "v 2-1", 1) + TRIANGLES, "line 4: expected a number"),
    "no coordinate": (POINTS.replace("2.0", "nan", 1) + TRIANGLES, "has the coordinate nan"),
    "vertex 0": (POINTS + "f 1 2 3\nf 1 0 3\n", "line 10: a face uses vertex 0"),
    "too far back": (TRIANGLES + POINTS + "\n\nf -1 -8 -9\n", "line 23: a face uses vertex -9, but only 8 vertices"),
    "too far": (obj() + "# more\nf 1 2 9\n", "line 22: a face uses vertex 9 of 8"),
    "behind continued lines": (POINTS + "f 1 \\\n2 3\nf 1 \\\n2 9\n", "line 11: a face uses vertex 9 of 8"),
    "in a face of many lines": (
        POINTS + "f " + "1 \\\n" * 200_000 + "x 3\n",
        "line 9: expected a vertex number, found 'x'",
    ),
    "a fraction": (POINTS + "f 1 2 3.5\n", "line 9: expected a vertex number, found '3.5'"),
    "a name": (POINTS + "f 1 2 three\n", "line 9: expected a vertex number, found 'three'"),
    "no vertex": (POINTS + "f /1 2/2 3/3\n", "line 9: expected a vertex number, found '/1'"),
    "glued": (POINTS + "f /1 1-2 3\n", "line 9: expected a vertex number, found '/1'"),
    "endless number": (POINTS + f"f 1 2 {'9' * 5000}\n", "line 9: a face uses vertex 99999999999999999999 of 8"),
    "zero bytes": (POINTS + "f 1 2 3\0\n", "line 9: expected a vertex number, found '3\0'"),
    "points and lines": (POINTS + "p 1 2\nl 1 2 3\n", "contains no facets, only lines and points"),
    "surfaces": (POINTS + "surf 0 1 0 1 1 2 3 4\nend\n", "contains no facets, only free-form surfaces"),
    "faces of two": (POINTS + "f 1 2\nf 1\nf\n", "contains no facets"),
    "nothing": ("v 0 0 0\n", "contains no facets"),
    "an endless line": ("v 0 0 0\n" + (17 << 20) * " ", "a line is longer than 16777216 bytes"),
    "endless continuation": ("\\\n" * (9 << 20), "a line is longer than 16777216 bytes"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, content: str, message: str) -> None:
    assert message in fault(tmp_path, content)


def test_free_form_surfaces_beside_facets_are_told(tmp_path: Path) -> None:
    assert read(tmp_path, obj() + "surf 0 1 0 1 1 2 3 4\nend\n").notes == (
        "1 free-form surfaces are left out",
    )


def test_limits_hold(tmp_path: Path) -> None:
    path = write(tmp_path, POINTS + faces_of(QUADS), "part.obj")

    assert load_mesh(path, limits=Limits(facets=12)).n_facets == 12
    with pytest.raises(MeshError, match="12 facets; the limit is 11"):
        load_mesh(path, limits=Limits(facets=11))
    with pytest.raises(MeshError, match="8 vertices; the limit is 7"):
        load_mesh(path, limits=Limits(facets=7))
    with pytest.raises(MeshError, match="1000 facets; the limit is 100"):
        load_mesh(write(tmp_path, POINTS + "f 1\n" * 1000, "part.obj"), limits=Limits(facets=100))
