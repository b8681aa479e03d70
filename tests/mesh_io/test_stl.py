"""STL as programs really write it: counts that are none, line ends, encodings, decimal commas, large files."""

from __future__ import annotations

import codecs
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from tiny_files import BOX, ascii_stl, binary_stl, every_format, write, zipped

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import Limits, Model, export_stl, load_mesh, load_model
from printer_slicer.mesh_io.files import CHUNK
from printer_slicer.model import Mesh

CUT = "the file ends without 'endsolid' after {} complete facets: it may be truncated"


def read(folder: Path, content: str | bytes, name: str = "part.stl") -> Model:
    return load_model(write(folder, content, name))


def fault(folder: Path, content: str | bytes) -> str:
    path = write(folder, content, "part.stl")
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


@pytest.mark.parametrize("announced", [0, 0xFFFFFFFF], ids=["zero", "all-ones"])
def test_a_program_that_did_not_count_its_facets_is_forgiven_and_told(tmp_path: Path, announced: int) -> None:
    model = read(tmp_path, binary_stl(announced=announced))

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == ("the header does not state the number of facets; all 12 in the file are read",)


@pytest.mark.parametrize("announced", [0, 0xFFFFFFFF], ids=["zero", "all-ones"])
def test_without_a_count_nothing_but_whole_facets_is_believed(tmp_path: Path, announced: int) -> None:
    for tail in (b"x" * 20, b"\0" * 50):
        assert "states" in fault(tmp_path, binary_stl(announced=announced) + tail)


@pytest.mark.parametrize(
    "header", [b"solid", b"ply", b"glTF", b"PK\3\4", b"OFF", b"ISO-10303-21", b"\xff\xfe"]
)
def test_the_length_decides_whatever_the_header_says(tmp_path: Path, header: bytes) -> None:
    for name in ("part.stl", "part", "part.obj"):
        assert np.array_equal(read(tmp_path, binary_stl(header=header), name).mesh.triangles, BOX)


def test_a_binary_file_named_solid_with_a_tail_is_binary(tmp_path: Path) -> None:
    model = read(tmp_path, binary_stl(header=b"solid x") + b"made by a program")

    assert np.array_equal(model.mesh.triangles, BOX)


def test_a_zero_byte_in_a_text_is_named_by_its_line(tmp_path: Path) -> None:
    content = (ascii_stl() * 3).encode()
    place = content.find(b"endloop")

    assert "line 7: expected 'endloop', found '\0ndloop'" in fault(
        tmp_path, content[:place] + b"\0" + content[place + 1 :]
    )


@pytest.mark.parametrize("coding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_a_text_may_be_unicode_of_any_kind(tmp_path: Path, coding: str) -> None:
    mark = {"utf-16-le": codecs.BOM_UTF16_LE, "utf-16-be": codecs.BOM_UTF16_BE}.get(coding, b"")
    text = ascii_stl(name="Gehäuse – 部品")

    assert np.array_equal(read(tmp_path, mark + text.encode(coding)).mesh.triangles, BOX)


@pytest.mark.parametrize("kind", ["part.obj", "part.off", "ascii.ply"])
def test_a_byte_order_mark_before_another_text_is_no_fault(tmp_path: Path, kind: str) -> None:
    content = every_format()[kind]

    for marked in (codecs.BOM_UTF8 + content, content.decode().encode("utf-16")):
        assert np.array_equal(read(tmp_path, marked, kind).mesh.triangles, BOX)


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="this system has no /dev/stdin")
@pytest.mark.parametrize("name", ["binary.stl", "ascii.stl", "deflated.3mf", "part.obj"])
def test_a_part_may_come_out_of_a_pipe(name: str) -> None:
    code = "from printer_slicer import load_mesh; print(load_mesh('/dev/stdin').n_facets)"
    data = every_format()[name]
    done = subprocess.run([sys.executable, "-c", code], input=data, capture_output=True, check=True)

    assert done.stdout.split() == [b"24" if name == "deflated.3mf" else b"12"]


def test_a_pipe_without_end_is_refused() -> None:
    if not Path("/dev/zero").exists():
        pytest.skip("this system has no /dev/zero")
    with pytest.raises(MeshError, match="the limit for this format is 3000000"):
        load_mesh("/dev/zero", limits=Limits(file_bytes=3_000_000))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_named_pipe_without_a_writer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    os.mkfifo(path)

    with pytest.raises(UsageError, match="no program writes to this named pipe") as caught:
        load_mesh(path, limits=Limits(pipe_seconds=0.01))

    assert "Start the program" in caught.value.remedy


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_named_pipe_with_a_writer_is_read(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    os.mkfifo(path)
    writer = threading.Thread(target=lambda: path.write_bytes(binary_stl()))
    writer.start()

    mesh = load_mesh(path, limits=Limits(pipe_seconds=300))
    writer.join()

    assert mesh.n_facets == 12


@pytest.mark.parametrize(
    "normal",
    [
        "",
        "0 0",
        "0 0 1 0",
        "nan nan nan",
        "-1.#IND 1.#QNAN 0",
        "-nan(ind) 0 0",
        "0,0 0,0 1,0",
        "(null)",
        "vertex 1 2",
    ],
)
def test_normals_may_be_anything(tmp_path: Path, normal: str) -> None:
    text = re.sub(r"facet normal.*", f"facet normal {normal}", ascii_stl())

    assert text.count(f"facet normal {normal}\n") == 12
    assert np.array_equal(read(tmp_path, text).mesh.triangles, BOX)


def test_behind_a_senseless_normal_other_faults_are_found(tmp_path: Path) -> None:
    text = ascii_stl().replace("facet normal", "facet normal nan() #", 1).replace("2.0", "2,0", 1)

    assert "expected a number, found '2,0'" in fault(tmp_path, text)


def test_decimal_commas_are_named_with_what_to_do(tmp_path: Path) -> None:
    message = fault(tmp_path, ascii_stl().replace("2.0", "2,0"))

    assert "line 6: expected a number, found '2,0'" in message
    assert "decimal points" in message


def many_boxes(count: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    return np.concatenate([BOX + shift for shift in rng.integers(-500, 500, (count, 3)) / 8.0])


def test_a_text_longer_than_one_chunk_is_read_whole(tmp_path: Path) -> None:
    triangles = many_boxes(1000)
    one, two = triangles[:7_000], triangles[7_000:]
    content = (ascii_stl(one, "a") + ascii_stl(two, "b")).encode()

    assert len(content) > CHUNK
    assert np.array_equal(load_mesh(write(tmp_path, content, "part.stl")).triangles, triangles)
    late = content.replace(b"vertex", b"vertax", 25_001).replace(b"vertax", b"vertex", 25_000)
    line = late[: late.find(b"vertax")].count(b"\n") + 1
    assert f"line {line}: expected 'vertex', found 'vertax'" in fault(tmp_path, late)
    cut = read(tmp_path, content[:-12])
    assert np.array_equal(cut.mesh.triangles, triangles)
    assert cut.notes == (CUT.format(12_000),)


@pytest.mark.parametrize("size", [1, 20, 5_000, 3 * CHUNK], ids=["byte", "bytes", "page", "many"])
@pytest.mark.parametrize("padding", [b"\0", b"\x1a", b"\x1a\0"], ids=["zeros", "Ctrl-Z", "both"])
def test_a_text_may_be_padded(tmp_path: Path, padding: bytes, size: int) -> None:
    text = ascii_stl().encode()
    model = read(tmp_path, text + padding * size)
    cut = read(tmp_path, text[: text.find(b"endsolid")] + padding * size)

    assert np.array_equal(model.mesh.triangles, BOX)
    assert np.array_equal(cut.mesh.triangles, BOX)
    assert (model.notes, cut.notes) == ((), (CUT.format(12),))


def test_padding_within_a_text_is_not_left_out(tmp_path: Path) -> None:
    text = ascii_stl().encode()
    place = text.find(b"facet normal", 500)

    assert "expected 'facet'" in fault(tmp_path, text[:place] + 30 * b"\x1a" + text[place:])
    assert "line 3: the file ends in the middle of a facet" in fault(
        tmp_path, b"\n".join(text.split(b"\n")[:3]) + 9 * b"\0"
    )


def test_a_text_without_its_end_and_without_facets_is_refused(tmp_path: Path) -> None:
    assert "line 1: the file ends without 'endsolid'" in fault(tmp_path, "solid a\n")


def test_a_binary_file_longer_than_one_chunk_tells_how_far_it_is(tmp_path: Path) -> None:
    triangles = many_boxes(15_000)
    export_stl(Mesh(triangles), tmp_path / "part.stl")
    shares: list[float] = []
    model = load_model(tmp_path / "part.stl", progress=shares.append)

    assert np.array_equal(model.mesh.triangles, triangles)
    assert len(shares) > 10
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


def test_of_small_files_no_progress_is_told(tmp_path: Path) -> None:
    shares: list[float] = []
    load_model(write(tmp_path, binary_stl(), "part.stl"), progress=shares.append)

    assert shares == []


@pytest.mark.parametrize("places", [[0], [3, 9_000, 70_000], list(range(8_190, 8_195)), [179_999]])
def test_facets_without_area_are_left_out_wherever_they_are(tmp_path: Path, places: list[int]) -> None:
    """Also at the seams of the blocks that are looked at together."""
    triangles = many_boxes(15_000)
    folded = triangles.copy()
    folded[places, 2] = folded[places, 0]
    export_stl(Mesh(folded), tmp_path / "part.stl")
    model = load_model(tmp_path / "part.stl")

    assert model.n_folded == len(places)
    assert np.array_equal(model.mesh.triangles, np.delete(triangles, places, axis=0))


def test_a_bad_number_is_found_in_every_block(tmp_path: Path) -> None:
    for place in (0, 8_191, 8_192, 59_999):
        triangles = many_boxes(5000)
        triangles[place, 1, 1] = np.nan
        export_stl(Mesh(triangles), tmp_path / "part.stl")

        assert f"facet {place + 1} of 60000 has the coordinate nan" in fault(
            tmp_path, (tmp_path / "part.stl").read_bytes()
        )


def test_a_part_with_its_inside_out_is_read_as_it_is_and_turned_by_repair(tmp_path: Path) -> None:
    triangles = many_boxes(200)
    export_stl(Mesh(triangles[:, ::-1]), tmp_path / "part.stl")
    model = load_model(tmp_path / "part.stl")
    mended, repairs = repair(model.mesh)

    assert np.array_equal(model.mesh.triangles, triangles[:, ::-1])
    assert mended.volume == pytest.approx(Mesh(triangles).volume)
    assert [one.kind for one in repairs.done] == ["shells turned outward"]


def test_numbers_mean_what_the_person_says(tmp_path: Path) -> None:
    for content in (binary_stl(), ascii_stl()):
        path = write(tmp_path, content, "part.stl")

        assert np.array_equal(load_mesh(path, units="cm").triangles, BOX * 10)
        assert load_mesh(path, units="inch").size.tolist() == pytest.approx([50.8, 76.2, 101.6])


@pytest.mark.parametrize("wrong", ["part.stl", "part.obj", "part"])
def test_a_file_with_the_wrong_extension_is_known_by_how_it_begins(tmp_path: Path, wrong: str) -> None:
    for name in ("deflated.3mf", "part.glb"):
        assert read(tmp_path, every_format()[name], wrong).kind == name[-3:]


@pytest.mark.parametrize("name", ["part.amf", "part"])
def test_an_amf_is_refused_with_the_formats_to_use(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, "<?xml version='1.0'?>\n<amf unit='millimeter'><object id='1'/></amf>", name)

    with pytest.raises(UsageError, match=r"part\S*: AMF files are not supported") as caught:
        load_mesh(path)

    assert caught.value.remedy == "Export the part as 3MF or STL"


def test_a_packed_amf_is_refused_with_the_formats_to_use(tmp_path: Path) -> None:
    path = write(tmp_path, zipped({"part.amf": "<amf/>"}), "part.amf")

    with pytest.raises(UsageError, match="AMF files are not supported"):
        load_mesh(path)
