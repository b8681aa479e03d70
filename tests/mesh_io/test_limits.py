"""Files made to exhaust the machine that reads them: refused, with the limit that stopped them."""

from __future__ import annotations

import struct
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_files import (
    BOX,
    CORNERS,
    FACES,
    ascii_stl,
    binary_stl,
    every_format,
    glb_box,
    item,
    mesh_xml,
    model_xml,
    obj,
    three_mf,
    write,
    zipped,
)

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io import LIMITS, Limits, load_mesh

MODEL = model_xml({1: mesh_xml()}, item(1))


def fault(folder: Path, content: str | bytes, name: str, limits: Limits = LIMITS) -> str:
    path = write(folder, content, name)
    with pytest.raises(MeshError) as caught:
        load_mesh(path, limits=limits)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


def stored(document: str) -> bytes:
    """A 3MF that is not packed, so that its length is no reason to refuse it."""
    return zipped({"3D/3dmodel.model": document}, zipfile.ZIP_STORED)


# Archives


def test_a_member_that_unpacks_to_many_times_its_length_is_refused(tmp_path: Path) -> None:
    bomb = zipped({"3D/3dmodel.model": b" " * 20_000_000})

    assert len(bomb) < 25_000
    assert "at most 100 times" in fault(tmp_path, bomb, "bomb.3mf")


def test_a_member_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    limits = replace(LIMITS, expanded_bytes=3000)

    assert "the limit is 3000" in fault(tmp_path, three_mf(MODEL + " " * 3000), "part.3mf", limits)


def test_what_all_members_unpack_to_is_added_up(tmp_path: Path) -> None:
    group = (
        "<components>"
        + "".join(f'<component objectid="1" p:path="/{n}.model"/>' for n in range(5))
        + "</components>"
    )
    members = {f"{number}.model": MODEL for number in range(5)}
    content = three_mf(model_xml({9: group}, item(9)), members)

    assert load_mesh(write(tmp_path, content, "part.3mf")).n_facets == 60
    assert "the limit is" in fault(
        tmp_path, content, "part.3mf", replace(LIMITS, expanded_bytes=3 * len(MODEL))
    )


def test_a_member_that_lies_about_its_length_is_refused(tmp_path: Path) -> None:
    """The directory says 10 bytes; more is never unpacked than it says."""
    content = bytearray(zipped({"3D/3dmodel.model": MODEL + " " * 10_000_000}))
    entry = content.rfind(b"PK\1\2")
    struct.pack_into("<L", content, entry + 24, 10)

    fault(tmp_path, bytes(content), "part.3mf")


def test_members_that_lie_upon_each_other_are_refused_by_what_they_unpack_to(tmp_path: Path) -> None:
    """Many entries of the directory, one packed kernel: each is counted by itself, and what nobody asks for is left."""
    kernel = b" " * 900_000
    content = zipped({"3D/3dmodel.model": kernel})
    at = content.rfind(b"PK\1\2")
    end = content.rfind(b"PK\5\6")
    entry = content[at:end]
    many = 2000
    record = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, many, many, len(entry) * many, at, 0)
    path = write(tmp_path, content[:at] + entry * many + record, "part.3mf")

    with pytest.raises(MeshError):
        load_mesh(path)


def test_an_archive_with_too_many_members_is_refused(tmp_path: Path) -> None:
    members: dict[str, str | bytes] = {f"{number}.txt": "" for number in range(30)}
    limits = replace(LIMITS, members=20)

    assert "32 files in the archive" in fault(tmp_path, three_mf(MODEL, members), "part.3mf", limits)


def test_a_directory_of_endless_length_is_not_read(tmp_path: Path) -> None:
    packed = bytearray(three_mf(MODEL))
    struct.pack_into("<L", packed, packed.rfind(b"PK\5\6") + 12, 2**31)

    assert "the directory of the archive has 2147483648 bytes" in fault(tmp_path, bytes(packed), "part.3mf")


def test_an_encrypted_member_is_refused(tmp_path: Path) -> None:
    packed = bytearray(three_mf(MODEL))
    for mark, place in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        at = packed.find(mark)
        while at >= 0:
            packed[at + place] |= 1
            at = packed.find(mark, at + 1)

    assert "encrypted" in fault(tmp_path, bytes(packed), "part.3mf")


def test_an_archive_in_an_archive_is_no_part(tmp_path: Path) -> None:
    inner: dict[str, str | bytes] = {"3D/3dmodel.model": three_mf(MODEL)}

    assert "not valid XML" in fault(tmp_path, zipped(inner, zipfile.ZIP_STORED), "part.3mf")


# XML

LAUGHS = "<!DOCTYPE x [" + '<!ENTITY a0 "ha">' + "".join(
    f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10)
) + "]>"  # fmt: skip
TRAPS = {
    "billion laughs": (LAUGHS, "&a9;"),
    "quadratic blowup": (f'<!DOCTYPE x [<!ENTITY a "{"a" * 50_000}">]>', "&a;" * 50_000),
    "external entity": ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>', "&a;"),
    "external document type": ('<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">', ""),
    "parameter entity": ('<!DOCTYPE x [<!ENTITY % a SYSTEM "http://127.0.0.1:9/x"> %a;]>', ""),
    "attribute default": ('<!DOCTYPE x [<!ATTLIST object id CDATA "7">]>', ""),
}


@pytest.mark.parametrize(("head", "text"), TRAPS.values(), ids=TRAPS.keys())
def test_entities_of_every_kind_are_refused(head: str, text: str, tmp_path: Path) -> None:
    document = MODEL.replace("<model ", f"{head}<model ")
    document = document.replace("<resources>", f"<resources><metadata name='x'>{text}</metadata>")

    assert "declares a document type" in fault(tmp_path, three_mf(document), "part.3mf")


def test_the_relations_of_an_archive_are_read_with_the_same_care(tmp_path: Path) -> None:
    content = zipped({"_rels/.rels": LAUGHS + "<x>&a9;</x>", "3D/3dmodel.model": MODEL})

    assert "declares a document type" in fault(tmp_path, content, "part.3mf")


def test_deep_markup_is_refused(tmp_path: Path) -> None:
    assert "elements are nested more than 64" in fault(
        tmp_path, stored("<model>" + "<a>" * 100_000), "part.3mf"
    )


@pytest.mark.parametrize(
    "begin",
    ["<model a='", "<model><!--", "<model><?x ", "<model><![CDATA["],
    ids=["tag", "comment", "instruction", "text"],
)
def test_markup_without_an_end_is_refused_or_read_without_delay(tmp_path: Path, begin: str) -> None:
    fault(tmp_path, stored(begin + "x" * 30_000_000), "part.3mf")


# Numbers of things


def test_objects_that_hold_objects_ten_times_each_are_refused(tmp_path: Path) -> None:
    """Nine levels: a billion boxes in two kilobytes."""
    objects = {1: mesh_xml()}
    for number in range(2, 11):
        objects[number] = "<components>" + f'<component objectid="{number - 1}"/>' * 10 + "</components>"

    assert "objects are placed" in fault(tmp_path, three_mf(model_xml(objects, item(10))), "part.3mf")


def test_objects_without_facets_are_counted_too(tmp_path: Path) -> None:
    objects = {1: "<mesh/>"}
    for number in range(2, 25):
        objects[number] = "<components>" + f'<component objectid="{number - 1}"/>' * 2 + "</components>"

    assert "objects are placed" in fault(tmp_path, three_mf(model_xml(objects, item(24))), "part.3mf")


def test_copies_count_as_facets(tmp_path: Path) -> None:
    limits = replace(LIMITS, facets=30)

    assert load_mesh(write(tmp_path, three_mf(MODEL), "part.3mf"), limits=limits).n_facets == 12
    assert "36 facets; the limit is 30" in fault(
        tmp_path, three_mf(model_xml({1: mesh_xml()}, item(1) * 3)), "part.3mf", limits
    )


SWOLLEN = {
    "vertices": "<object id='1'><mesh><vertices>" + "<vertex x='0' y='0' z='0'/>" * 200_000,
    "facets": "<object id='1'><mesh><triangles>" + "<triangle v1='0' v2='1' v3='2'/>" * 200_000,
    "objects": "".join(f"<object id='{number}'/>" for number in range(2000)),
    "names": "".join(f"<n{number}/>" for number in range(200_000)),
    "attributes": "".join(f"<a n{number}='1'/>" for number in range(200_000)),
    "namespaces": "".join(f"<a xmlns:n{number}='1'/>" for number in range(11_000)),
    "components": "<object id='1'><components>" + "<component objectid='1'/>" * 2000,
    "items": "<object id='1'/></resources><build>" + "<item objectid='1'/>" * 2000,
}


@pytest.mark.parametrize("name", SWOLLEN)
def test_what_swells_in_memory_is_refused_while_it_is_read(name: str, tmp_path: Path) -> None:
    """The documents break off, so that whoever reads them to the end says something else."""
    content = stored(f"<model><resources>{SWOLLEN[name]}")
    message = fault(tmp_path, content, "part.3mf", replace(LIMITS, facets=1000, instances=1000))

    assert "the limit" in message or "more than 10" in message, message


def test_vertices_without_facets_count_when_they_are_copied(tmp_path: Path) -> None:
    corners = np.tile(CORNERS, (100, 1))
    content = three_mf(model_xml({1: mesh_xml(corners)}, item(1) * 50))

    assert "vertices; the limit is 3000" in fault(tmp_path, content, "part.3mf", replace(LIMITS, facets=1000))


def test_primitives_that_share_their_bytes_are_counted_each(tmp_path: Path) -> None:
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    content = glb_box(meshes=[{"primitives": [primitive] * 100}])

    assert "the limit" in fault(tmp_path, content, "part.glb", replace(LIMITS, facets=300))


def test_the_text_of_a_glb_has_a_limit_of_its_own(tmp_path: Path) -> None:
    content = glb_box(extras=[[]] * 1000)

    assert "bytes of JSON; the limit is 2000" in fault(
        tmp_path, content, "part.glb", replace(LIMITS, json_bytes=2000)
    )


def test_every_format_keeps_the_limit_of_facets(tmp_path: Path) -> None:
    for name, content in every_format().items():
        message = fault(tmp_path, content, name, replace(LIMITS, facets=3))
        assert "the limit" in message or "36 items" in message, (name, message)


def test_every_format_keeps_the_limit_of_the_file(tmp_path: Path) -> None:
    for name, content in every_format().items():
        assert f"{len(content)} bytes; the limit for this format is 100" in fault(
            tmp_path, content, name, replace(LIMITS, file_bytes=100)
        )


@pytest.mark.parametrize("name", ["ascii.ply", "part.off", "part.glb"])
def test_what_is_read_as_a_whole_has_a_limit_of_its_own(tmp_path: Path, name: str) -> None:
    content = every_format()[name]

    assert "the limit" in fault(tmp_path, content, name, replace(LIMITS, text_bytes=50))


HUGE = {
    "binary.stl": binary_stl(announced=4_000_000_000),
    "vertices.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 900000000\nproperty double x\nend_header\n",
    "ascii.ply": b"ply\nformat ascii 1.0\nelement vertex 99999999999999\nproperty double x\nend_header\n1\n",
    "facets.ply": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face -5\nend_header\n1\n",
    "vertices.off": b"OFF\n99999999999 1 0\n0 0 0\n",
    "facets.off": b"OFF # 1 2 3\n1 99999999999 0\n0 0 0\n",
    "index.obj": obj().encode().replace(b"f 1", b"f 999999999999"),
}


@pytest.mark.parametrize("name", HUGE)
def test_a_small_file_that_announces_much_is_refused_without_making_room(name: str, tmp_path: Path) -> None:
    fault(tmp_path, HUGE[name], name)


def test_a_line_without_end_is_no_stl(tmp_path: Path) -> None:
    assert "which no STL needs" in fault(tmp_path, "solid x\nfacet " + "9" * 40_000_000, "part.stl")


def test_a_unit_that_is_none_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, binary_stl(), "part.stl")

    with pytest.raises(UsageError, match="furlong"):
        load_mesh(path, units="furlong")


def test_raising_a_limit_lets_the_file_in(tmp_path: Path) -> None:
    content = zipped({"3D/3dmodel.model": MODEL + " " * 3_000_000})

    assert "100 times" in fault(tmp_path, content, "part.3mf")
    mesh = load_mesh(tmp_path / "part.3mf", limits=Limits(expansion=2000))
    assert mesh.n_facets == len(FACES)


def test_good_files_are_far_from_every_limit(tmp_path: Path) -> None:
    sizes: dict[str, Any] = {
        name: load_mesh(write(tmp_path, data, name)).n_facets for name, data in every_format().items()
    }

    assert all(count >= 4 for count in sizes.values())
    assert sizes["binary.stl"] == len(BOX) == ascii_stl().count("endfacet")
