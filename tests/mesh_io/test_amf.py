"""AMF: objects, volumes, constellations and units, plain and packed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_files import BOX, CORNERS, amf, amf_mesh, write, zipped

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import Model, load_mesh, load_model

ONE = f"<object id='1'>{amf_mesh()}</object>"


def read(folder: Path, content: str | bytes) -> Model:
    return load_model(write(folder, content, "part.amf"))


def instance(number: object, **place: float) -> str:
    inside = "".join(f"<{name}>{value}</{name}>" for name, value in place.items())
    return f"<instance objectid='{number}'>{inside}</instance>"


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "packed"])
@pytest.mark.parametrize("name", ["part.amf", "part.bin"])
def test_an_amf_is_read_as_it_is(tmp_path: Path, name: str, packed: bool) -> None:
    text = amf(ONE)
    model = load_model(write(tmp_path, zipped({"x.amf": text}) if packed else text, name))

    assert np.array_equal(model.mesh.triangles, BOX)
    assert (model.unit, model.notes) == ("mm", ())


@pytest.mark.parametrize(
    ("unit", "mm"), [("inch", 25.4), ("feet", 304.8), ("meter", 1000), ("micron", 0.001), ("MM", 1)]
)
def test_units_become_mm(tmp_path: Path, unit: str, mm: float) -> None:
    assert read(tmp_path, amf(ONE, unit)).mesh.size.tolist() == pytest.approx([2 * mm, 3 * mm, 4 * mm])


def test_objects_and_volumes_are_joined(tmp_path: Path) -> None:
    two = amf_mesh(np.concatenate([CORNERS, CORNERS + 9])).replace(
        "</volume>",
        "</volume><volume>" + amf_mesh().partition("<volume>")[2].partition("</volume>")[0] + "</volume>",
    )
    two = two.replace("</volume></mesh>", "</volume></mesh>")
    model = read(
        tmp_path, amf(f"<object id='1'>{two}</object><object id='2'>{amf_mesh(CORNERS - 9)}</object>")
    )

    assert model.mesh.n_facets == 36


def test_an_object_of_a_constellation_is_only_where_that_puts_it(tmp_path: Path) -> None:
    text = (
        ONE + f"<constellation id='2'>{instance(1, deltax=10, rz=90)}{instance(1, deltaz=7)}</constellation>"
    )
    mesh = read(tmp_path, amf(text)).mesh

    # (0..2, 0..3) turned by 90 degrees about z: (-3..0, 0..2).
    assert mesh.n_facets == 24
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [10, 3, 11]], atol=1e-12)
    np.testing.assert_allclose(mesh.triangles[:12, :, 0].min(), 7, atol=1e-12)


def test_turns_are_about_x_then_y_then_z(tmp_path: Path) -> None:
    mesh = read(tmp_path, amf(f"{ONE}<constellation id='2'>{instance(1, rx=90, ry=90)}</constellation>")).mesh

    # About x: (x, y, z) -> (x, -z, y); about y: (x, y, z) -> (z, y, -x). Together (y, -z, -x).
    np.testing.assert_allclose(mesh.bounds, [[0, -4, -2], [3, 0, 0]], atol=1e-12)


def test_constellations_may_hold_constellations(tmp_path: Path) -> None:
    text = f"<constellation id='3'>{instance(2, deltay=100)}</constellation>"
    text += f"{ONE}<constellation id='2'>{instance(1, deltax=10)}</constellation>"

    assert read(tmp_path, amf(text)).mesh.bounds.tolist() == [[10, 100, 0], [12, 103, 4]]


def test_supports_and_modifiers_are_left_out_and_told(tmp_path: Path) -> None:
    modifier = amf_mesh(3 * CORNERS).replace(
        "<volume>", '<volume><metadata type="slic3r.modifier">1</metadata>'
    )
    plain = amf_mesh(CORNERS).replace("<volume>", '<volume><metadata type="slic3r.modifier">0</metadata>')
    text = f"<object id='1'>{plain}</object><object id='2'>{modifier}</object>"
    text += f"<object id='3'>{amf_mesh(5 * CORNERS, kind='support')}</object>"
    model = read(tmp_path, amf(text))

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == ("2 volumes are supports or modifiers and left out",)


def test_curves_are_told(tmp_path: Path) -> None:
    text = amf(ONE).replace(
        "</coordinates>", "</coordinates><normal><nx>0</nx><ny>0</ny><nz>1</nz></normal>", 1
    )

    assert read(tmp_path, text).notes == ("curved facets are read as flat ones",)


FAULTS = {
    "vertex beyond the last": (amf(ONE).replace("<v1>0<", "<v1>99<", 1), "object 1: facet 1 has vertex 99 of 8"),
    "facet with two corners": (amf(ONE).replace("<v1>0</v1>", "", 1), "facet 1 has vertex -1 of 8"),
    "vertex with two numbers": (amf(ONE).replace("<z>0.0</z>", "", 1), "has the coordinate nan"),
    "no number": (amf(ONE).replace("<x>2.0<", "<x>2,0<", 1), "line 2: could not convert"),
    "endless number": (amf(ONE).replace("<x>2.0<", "<x>" + "2" * 100_000 + "<", 1), "has the coordinate 2.2"),
    "unit": (amf(ONE, "furlong"), "'furlong'"),
    "object missing": (amf(f"{ONE}<constellation id='2'>{instance(9)}</constellation>"), "there is no object 9"),
    "object twice": (amf(ONE + ONE), "object 1 is there twice"),
    "constellation in itself": (amf(f"<constellation id='2'>{instance(2)}</constellation>"), "part of another one"),
    "circle": (
        amf(
            f"<constellation id='2'>{instance(3)}</constellation><constellation id='3'>{instance(2)}</constellation>"
            f"<constellation id='4'>{instance(3)}</constellation>"
        ),
        "objects within each other",
    ),
    "moved by nothing": (
        amf(f"{ONE}<constellation id='2'>{instance(1, deltax=float('nan'))}</constellation>"), "deltax nan"
    ),
    "cut off": (amf(ONE)[:-100], "not sound XML"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_a_broken_amf_is_refused_with_what_is_wrong(text: str, message: str, tmp_path: Path) -> None:
    path = write(tmp_path, text, "part.amf")
    with pytest.raises(MeshError) as caught:
        load_mesh(path)

    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
