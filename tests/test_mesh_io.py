"""Reading parts in all formats, and saying what is wrong with the files that are none."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from printer_slicer.errors import MeshError, OutputError, PrinterSlicerError, UsageError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import export_stl, load_mesh, load_model
from printer_slicer.model import Mesh
from tests.effort import examples

BOX = np.array(trimesh.creation.box((2.0, 3.0, 4.0)).triangles)
"""(12, 3, 3) a box around the origin."""


def ascii_stl(triangles: np.ndarray, name: str = "part") -> str:
    lines = [f"solid {name}"]
    for corners in triangles.tolist():
        lines += ["  facet normal 0 0 0", "    outer loop"]
        lines += [f"      vertex {x!r} {y!r} {z!r}" for x, y, z in corners]
        lines += ["    endloop", "  endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""])


def binary_stl(triangles: np.ndarray, *, header: bytes = b"", announced: int | None = None) -> bytes:
    count = len(triangles) if announced is None else announced
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in triangles)
    return header.ljust(80, b"\0") + struct.pack("<I", count) + facets


def write(folder: Path, content: str | bytes, name: str = "part.stl") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def fault(path: Path, kind: type[PrinterSlicerError] = MeshError) -> str:
    """What the error says; every error names the file and a remedy."""
    with pytest.raises(kind) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


def three_mf(objects: str, build: str, unit: str = "millimeter") -> bytes:
    model = (
        f'<?xml version="1.0"?><model unit="{unit}" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    return packed.getvalue()


def object_xml(number: int, triangles: np.ndarray) -> str:
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in triangles.reshape(-1, 3).tolist())
    facets = "".join(
        f'<triangle v1="{i}" v2="{i + 1}" v3="{i + 2}"/>' for i in range(0, 3 * len(triangles), 3)
    )
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{facets}</triangles></mesh>"
    return f'<object id="{number}" type="model">{mesh}</object>'


# STL


def test_a_binary_stl_is_read_as_it_is(tmp_path: Path) -> None:
    mesh = load_mesh(write(tmp_path, binary_stl(BOX)))

    assert np.array_equal(mesh.triangles, BOX)
    assert mesh.name == "part"
    assert mesh.volume == pytest.approx(24.0)


def test_a_binary_stl_that_begins_with_solid_is_binary(tmp_path: Path) -> None:
    path = write(tmp_path, binary_stl(BOX, header=b"solid made by a program that lies"))

    assert np.array_equal(load_mesh(path).triangles, BOX)


def test_an_ascii_stl_is_read_as_it_is(tmp_path: Path) -> None:
    assert np.array_equal(load_mesh(write(tmp_path, ascii_stl(BOX))).triangles, BOX)


@pytest.mark.parametrize(
    "change",
    [
        str.upper,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: "\n\n" + text.replace("  ", "\t"),
        lambda text: text.replace("solid part", "solid"),
        lambda text: text.replace("solid part", "solid facet of a solid vertex 1 2 endsolid"),
        lambda text: text.replace("facet normal 0 0 0", "facet normal nan nan nan"),
        lambda text: text.replace("2.0", "2.0e+00"),
    ],
    ids=["upper", "crlf", "cr", "bom", "spaces", "no-name", "odd-name", "normals", "exponent"],
)
def test_an_ascii_stl_may_be_written_in_many_ways(tmp_path: Path, change) -> None:
    assert np.array_equal(load_mesh(write(tmp_path, change(ascii_stl(BOX)))).triangles, BOX)


def test_several_solids_in_a_file_are_one_part(tmp_path: Path) -> None:
    path = write(tmp_path, ascii_stl(BOX, "one") + ascii_stl(BOX + 10, "two"))

    assert np.array_equal(load_mesh(path).triangles, np.concatenate([BOX, BOX + 10]))


@pytest.mark.parametrize("tail", [b"\0" * 500, b"made by a program"])
def test_a_tail_without_facets_is_ignored(tmp_path: Path, tail: bytes) -> None:
    assert np.array_equal(load_mesh(write(tmp_path, binary_stl(BOX) + tail)).triangles, BOX)


TEXT = b"COLOR=200,200,200 created 2019-01-01 00:00:00, 12 facets, UNITS=MM\r\n" * 40
COLOURS = np.random.default_rng(3).integers(0, 256, 4 * 1000, dtype=np.uint8).tobytes()


@pytest.mark.parametrize("length", [50, 99, 1000, 2500])
@pytest.mark.parametrize(
    "tail", [TEXT, b"0 " * 2000, b"F7A0" * 1000, COLOURS, b"\x80\x80\x80\xff" * 1000, b"\0\0\x80\x7f" * 1000]
)
def test_a_tail_that_can_be_no_facets_is_left_out_and_told(tmp_path: Path, tail: bytes, length: int) -> None:
    model = load_model(write(tmp_path, binary_stl(BOX) + tail[:length]))

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == (f"{length} bytes after the last facet are not facets and are left out",)


@pytest.mark.parametrize("padding", [b"", bytes(500), bytes(500_000), TEXT[:2500], COLOURS[:2500]])
@pytest.mark.parametrize("second", [binary_stl(BOX + 20), binary_stl(BOX + 20)[84:], binary_stl(BOX)[84:134]])
def test_facets_in_a_tail_are_never_left_out(tmp_path: Path, padding: bytes, second: bytes) -> None:
    """Another STL behind the first, or facets that the header does not count; also behind other things."""
    more = np.concatenate([BOX + shift for shift in range(8)])  # as many as what is before them
    second = second if len(padding) < 600 or not padding.strip(b"\0") else binary_stl(more)[84:]
    message = fault(write(tmp_path, binary_stl(BOX) + padding + second))

    assert "states 12 facets" in message


def test_a_coordinate_too_far_out_is_named_with_what_to_do(tmp_path: Path) -> None:
    far = (BOX + 1) * np.array([1e8, 1, 1])
    path = write(tmp_path, binary_stl(far))

    message = fault(path)
    assert "has the coordinate 2e+08" in message
    assert "`units`" in message
    assert load_mesh(path, units="micron").size[0] == pytest.approx(2e5)
    assert "`units`" not in fault(write(tmp_path, binary_stl(BOX * 1e30)))


def test_a_cut_off_binary_stl_tells_how_many_facets_are_left(tmp_path: Path) -> None:
    message = fault(write(tmp_path, binary_stl(BOX)[:-120]))

    assert "states 12 facets" in message
    assert "contains 9" in message


@pytest.mark.parametrize("announced", [5, 11, 13, 0x7FFFFFFF])
def test_a_wrong_number_of_facets_is_not_believed(tmp_path: Path, announced: int) -> None:
    message = fault(write(tmp_path, binary_stl(BOX, announced=announced)))

    assert f"states {announced} facets" in message
    assert "contains 12" in message


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e30])
def test_a_vertex_that_is_not_a_number_is_named_by_facet(tmp_path: Path, bad: float) -> None:
    triangles = BOX.copy()
    triangles[6, 1, 2] = bad

    assert f"facet 7 of 12 has the coordinate {bad:g}" in fault(write(tmp_path, binary_stl(triangles)))


@pytest.mark.parametrize("bad", ["nan", "-inf", "1e999"])
def test_a_vertex_that_is_not_a_number_is_named_by_line(tmp_path: Path, bad: str) -> None:
    lines = ascii_stl(BOX).splitlines()
    lines[9 + 3] = f"vertex 0 0 {bad}"

    assert f"line 13: a vertex has the coordinate '{bad}'" in fault(write(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (4, "vertex 1,5 0 0", "line 5: expected a number, found '1,5'"),
        (5, "vertex 1 0", "line 7: expected a number, found 'endloop'"),
        (5, "", "line 6: expected 'vertex', found 'endloop'"),
        (5, "vertex 1 0 0 1", "line 6: expected 'endloop', found '1'"),
        (1, "facet", "line 3: expected 'normal', found 'outer'"),
        (20, "rubbish", "line 21: expected 'endloop', found 'rubbish'"),
        (8, "endsolid part", "line 10: expected 'facet', found 'outer'"),
    ],
)
def test_a_damaged_ascii_stl_is_named_by_line(tmp_path: Path, line: int, text: str, message: str) -> None:
    lines = ascii_stl(BOX).splitlines()
    lines[line] = text
    if not text:
        del lines[line]

    found = fault(write(tmp_path, "\n".join(lines)))
    assert message in found


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (6, "line 6: the file ends in the middle of a facet"),
        (7, "line 7: the file ends in the middle of a facet"),
        (1, "line 1: the file ends without 'endsolid'"),
    ],
)
def test_a_cut_off_ascii_stl_is_named_by_its_last_line(tmp_path: Path, kept: int, message: str) -> None:
    lines = ascii_stl(BOX).splitlines()[:kept]

    assert message in fault(write(tmp_path, "\n".join(lines) + "\n"))


def test_a_solid_that_ends_within_a_facet_is_named_by_line(tmp_path: Path) -> None:
    lines = [*ascii_stl(BOX).splitlines()[:5], "endsolid part"]

    assert "line 6: the solid ends in the middle of a facet" in fault(write(tmp_path, "\n".join(lines)))


# Files that are no parts


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    assert "no such file" in fault(tmp_path / "nothing.stl", UsageError)


def test_a_folder_is_not_a_part(tmp_path: Path) -> None:
    assert "is a folder" in fault(tmp_path, UsageError)


def test_a_path_through_a_file_cannot_be_read(tmp_path: Path) -> None:
    write(tmp_path, "x", "file")

    assert "Not a directory" in fault(tmp_path / "file" / "part.stl", UsageError)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_said_so(tmp_path: Path) -> None:
    path = write(tmp_path, binary_stl(BOX))
    path.chmod(0)

    assert "not allowed" in fault(path, UsageError)


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(UsageError, match="not a valid file name"):
        load_mesh("a\0b.stl")


@pytest.mark.parametrize("extension", ["stl", "3mf", "obj", "ply", "off", "glb", "xyz"])
def test_an_empty_file_is_said_to_be_empty(tmp_path: Path, extension: str) -> None:
    assert "is empty" in fault(write(tmp_path, b"", f"part.{extension}"))


def test_text_is_not_an_stl(tmp_path: Path) -> None:
    assert "not an STL" in fault(write(tmp_path, "Dear printer,\nplease print this.\n" * 20))
    assert "not an STL" in fault(write(tmp_path, b"\x01\x02"))


def test_an_unknown_format_gets_the_list_of_known_ones(tmp_path: Path) -> None:
    message = fault(write(tmp_path, "Dear printer", "part.doc"), UsageError)

    for extension in (".stl", ".3mf", ".obj", ".ply", ".off", ".glb"):
        assert extension in message


@pytest.mark.parametrize("content", [binary_stl(BOX[:0]), ascii_stl(BOX[:0])], ids=["binary", "ascii"])
def test_a_file_without_facets_is_not_a_part(tmp_path: Path, content: str | bytes) -> None:
    assert "no facets" in fault(write(tmp_path, content))


def test_facets_without_area_are_dropped(tmp_path: Path) -> None:
    corners = BOX[:3].copy()
    corners[0, 1], corners[1, 2], corners[2, 0] = corners[0, 0], corners[1, 1], corners[2, 2]
    path = write(tmp_path, binary_stl(np.concatenate([corners[:2], BOX, corners[2:]])))

    assert np.array_equal(load_mesh(path).triangles, BOX)


def test_nothing_but_facets_without_area_is_not_a_part(tmp_path: Path) -> None:
    assert "zero area" in fault(write(tmp_path, binary_stl(np.repeat(BOX[:, :1], 3, axis=1))))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_flat_part_is_named_by_its_axis(tmp_path: Path, axis: int) -> None:
    flat = BOX.copy()
    flat[:, :, axis] = 1.5

    assert f"does not extend in {'xyz'[axis]}" in fault(write(tmp_path, binary_stl(flat)))


def test_a_sheet_encloses_no_volume(tmp_path: Path) -> None:
    sheet = np.concatenate([BOX[:4], BOX[:4, ::-1]])

    with pytest.raises(MeshError, match="no volume"):
        repair(load_mesh(write(tmp_path, binary_stl(sheet))))


@given(st.binary(max_size=400), st.sampled_from(["stl", "3mf", "obj", "ply", "off", "glb", "bin"]))
@settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(30)
)
def test_no_content_leads_to_a_traceback(tmp_path: Path, content: bytes, extension: str) -> None:
    with pytest.raises((MeshError, UsageError)):
        load_mesh(write(tmp_path, content, f"part.{extension}"))


@given(st.data())
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_refused_but_never_fails(tmp_path: Path, data: st.DataObject) -> None:
    original = data.draw(st.sampled_from([binary_stl(BOX), ascii_stl(BOX).encode()]))
    content = bytearray(original)
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    del content[data.draw(st.integers(0, len(content))) :]
    path = write(tmp_path, bytes(content))

    try:
        mesh = load_mesh(path)
    except (MeshError, UsageError):
        return
    assert np.isfinite(mesh.triangles).all()
    assert mesh.volume > 0


# Other formats


@pytest.mark.parametrize("extension", ["3mf", "obj", "ply", "off"])
@pytest.mark.parametrize("named", [True, False], ids=["by-extension", "by-content"])
def test_other_formats_are_read_as_trimesh_wrote_them(tmp_path: Path, extension: str, named: bool) -> None:
    made = trimesh.creation.icosphere(2, 5.0).apply_translation([3, 4, 5])
    path = tmp_path / (f"part.{extension}" if named else "part")
    made.export(path, file_type=extension)

    mesh = load_mesh(path)

    assert mesh.n_facets == len(made.faces)
    assert mesh.volume == pytest.approx(made.volume, rel=1e-6)
    np.testing.assert_allclose(mesh.bounds, made.bounds, atol=1e-5)


@pytest.mark.parametrize("content", [binary_stl(BOX), ascii_stl(BOX)], ids=["binary", "ascii"])
def test_an_stl_is_known_by_its_content(tmp_path: Path, content: str | bytes) -> None:
    assert np.array_equal(load_mesh(write(tmp_path, content, "part.bin")).triangles, BOX)


def test_glb_is_in_metres_with_y_up(tmp_path: Path) -> None:
    path = tmp_path / "part.glb"
    trimesh.creation.box((0.01, 0.02, 0.03)).export(path)

    np.testing.assert_allclose(load_mesh(path).size, [10.0, 30.0, 20.0], rtol=1e-6)
    assert load_mesh(path).volume == pytest.approx(6000.0, rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "mm"),
    [
        ("micron", 0.001),
        ("millimeter", 1),
        ("centimeter", 10),
        ("inch", 25.4),
        ("foot", 304.8),
        ("meter", 1000),
    ],
)
def test_every_unit_of_a_3mf_becomes_mm(tmp_path: Path, unit: str, mm: float) -> None:
    content = three_mf(object_xml(1, BOX), '<item objectid="1"/>', unit)

    np.testing.assert_allclose(
        load_mesh(write(tmp_path, content, "part.3mf")).triangles, BOX * mm, rtol=1e-12
    )


def test_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    content = three_mf(object_xml(1, BOX), '<item objectid="1"/>', "furlong")

    assert "'furlong'" in fault(write(tmp_path, content, "part.3mf"))


def test_a_3mf_is_built_from_its_items(tmp_path: Path) -> None:
    # Row vectors times a 4 x 3 matrix: turned by 90° about z and moved, moved only, and mirrored in x.
    build = (
        '<item objectid="1" transform="0 1 0 -1 0 0 0 0 1 100 0 0"/>'
        '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 50 0"/>'
        '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 -50 0"/>'
    )
    content = three_mf(object_xml(1, BOX) + object_xml(2, 7 * BOX), build)

    mesh = load_mesh(write(tmp_path, content, "part.3mf"))

    assert mesh.n_facets == 36  # object 2 is not built
    assert mesh.volume == pytest.approx(3 * 24.0)
    np.testing.assert_allclose(mesh.bounds, [[-1, -51.5, -2], [101.5, 51.5, 2]])


def test_components_of_a_3mf_move_with_their_object(tmp_path: Path) -> None:
    group = (
        '<object id="5" type="model"><components>'
        '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 10 0 0"/>'
        '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 20 0 0"/>'
        "</components></object>"
    )
    build = '<item objectid="5" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/>'

    mesh = load_mesh(write(tmp_path, three_mf(object_xml(1, BOX) + group, build), "part.3mf"))

    assert mesh.n_facets == 24
    np.testing.assert_allclose(mesh.bounds, [[-1.5, 9, -2], [1.5, 21, 2]])


def test_a_cloud_of_points_has_no_facets(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(BOX.reshape(-1, 3)).export(path)

    assert "no facets" in fault(path)


@pytest.mark.parametrize("extension", ["3mf", "ply", "off", "glb"])
def test_a_damaged_file_of_another_format_is_refused(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"part.{extension}"
    trimesh.creation.box().export(path)
    path.write_bytes(path.read_bytes()[:-200])

    fault(path)


def test_reading_a_part_does_not_import_trimesh(tmp_path: Path) -> None:
    paths = [tmp_path / f"part.{extension}" for extension in ("stl", "3mf", "obj", "ply", "off", "glb")]
    for path in paths:
        trimesh.creation.box().export(path)
    code = (
        "import sys\n"
        "from printer_slicer.mesh_io import load_mesh\n"
        "for path in sys.argv[1:]:\n"
        "    load_mesh(path, units='mm')\n"
        "print([name for name in ('trimesh', 'scipy', 'networkx', 'lxml') if name in sys.modules])\n"
    )

    run = subprocess.run(
        [sys.executable, "-c", code, *map(str, paths)], capture_output=True, text=True, check=True
    )

    assert run.stdout.strip() == "[]"


# Writing


def test_what_is_written_is_what_trimesh_reads(tmp_path: Path) -> None:
    made = trimesh.creation.icosphere(2, 5.0)
    export_stl(Mesh(made.triangles), tmp_path / "part.stl")

    read = trimesh.load_mesh(tmp_path / "part.stl")

    assert read.is_watertight
    assert read.volume == pytest.approx(made.volume, rel=1e-6)
    np.testing.assert_allclose(read.face_normals, made.face_normals, atol=1e-5)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    export_stl(Mesh(BOX), tmp_path / "part.stl")

    assert np.array_equal(load_mesh(tmp_path / "part.stl").triangles, BOX)
    assert (tmp_path / "part.stl").stat().st_size == 84 + 50 * 12


def test_the_same_mesh_is_always_the_same_file(tmp_path: Path) -> None:
    export_stl(Mesh(BOX, "one"), tmp_path / "one.stl")
    export_stl(Mesh(BOX.copy(), "two"), tmp_path / "two.stl")

    assert (tmp_path / "one.stl").read_bytes() == (tmp_path / "two.stl").read_bytes()


def test_a_place_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        export_stl(Mesh(BOX), tmp_path / "nowhere" / "part.stl")
