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


VERSION = "<metadata type='slic3rpe_amf_version'>2</metadata>"


def placed(head: str, **place: float) -> str:
    plate = f"<constellation id='2'>{instance(1, **place)}</constellation>"
    return amf(f"{head}<object id='1'>{amf_mesh(10 * CORNERS)}</object>{plate}")


PRUSA_SLICERS = [
    (
        {"deltax": 25.9954, "deltay": 36.5767, "deltaz": 76.0892, "rx": 0.493, "ry": -2.4352, "rz": -0.4012}
        | {"scalex": 1.6976, "scaley": 0.8993, "scalez": 2.3364, "mirrorx": -1, "mirrory": -1, "mirrorz": -1},
        85604.8544,
        [[24.344, 1.375], [116.24, 56.426]],
        94.378,
    ),
    (
        {"deltax": 66.235, "deltay": 85.2025, "deltaz": 34.5034, "rx": 0.7805, "ry": -1.211, "rz": 1.4505}
        | {"scalex": 2.3054, "scaley": 1.0468, "scalez": 2.5747, "mirrorx": -1, "mirrory": 1, "mirrorz": 1},
        149124.1311,
        [[39.652, -25.464], [129.958, 85.202]],
        76.701,
    ),
    (
        {"deltax": 88.1422, "deltay": 40.8881, "deltaz": 41.979, "rx": 2.3503, "ry": 0.511, "rz": -0.1721}
        | {"scalex": 2.4332, "scaley": 0.5759, "scalez": 2.2674, "mirrorx": 1, "mirrory": -1, "mirrorz": -1},
        76254.2792,
        [[84.301, 33.619], [171.727, 112.099]],
        90.126,
    ),
]  # fmt: skip
"""Place of a box, and volume, bounds in x and y and height of what PrusaSlicer 2.5.0 exports of it as STL."""


@pytest.mark.parametrize(("place", "volume", "bounds", "height"), PRUSA_SLICERS)
def test_instances_of_prusa_slicer_stand_as_it_exports_them(
    tmp_path: Path, place: dict[str, float], volume: float, bounds: list[list[float]], height: float
) -> None:
    model = read(tmp_path, placed(VERSION, **place, printable=1))

    np.testing.assert_allclose(model.mesh.bounds[:, :2], bounds, atol=1e-3)
    assert model.mesh.size[2] == pytest.approx(height, abs=1e-3)
    assert model.mesh.volume == pytest.approx(volume, rel=1e-6)  # outside out, mirrored or not
    assert model.notes == ()


@pytest.mark.parametrize(
    ("head", "angle"),
    [
        ("", 90),
        ("<metadata type='cad'>Slic3r 1.1.7</metadata>", 90),
        ("<metadata type='cad'>Slic3r 1.2.9</metadata>", np.pi / 2),
        ("<metadata type='cad'>Slic3r 1.3.1-dev</metadata>", np.pi / 2),
        ("<metadata type='cad'>SuperSlicer</metadata>" + VERSION, np.pi / 2),
        ("<metadata type='cad'>some CAD 2.0</metadata>", 90),
    ],
)
def test_angles_are_degrees_but_for_those_of_slicers(tmp_path: Path, head: str, angle: float) -> None:
    mesh = read(tmp_path, placed(head, deltax=100, rz=angle, scale=0.5)).mesh

    np.testing.assert_allclose(mesh.bounds, [[85, 0, 0], [100, 10, 20]], atol=1e-9)


def test_instances_that_are_not_printable_are_left_out_and_told(tmp_path: Path) -> None:
    text = f"{ONE}<constellation id='2'>{instance(1, deltax=9)}{instance(1, printable=0)}</constellation>"
    model = read(tmp_path, amf(text))

    assert model.mesh.bounds.tolist() == [[9, 0, 0], [11, 3, 4]]
    assert model.notes == ("1 instances are marked as not printable and left out",)


def test_an_object_none_of_whose_instances_is_printable_is_not_there(tmp_path: Path) -> None:
    text = ONE + f"<object id='3'>{amf_mesh(CORNERS + 5)}</object>"
    text += f"<constellation id='2'>{instance(1, printable=0)}</constellation>"

    assert read(tmp_path, amf(text)).mesh.bounds.tolist() == [[5, 5, 5], [7, 8, 9]]


def test_what_is_not_known_of_an_instance_is_told(tmp_path: Path) -> None:
    odd = instance(1, shearx=3, deltax=9, twist=1).replace(
        "</instance>", "<metadata type='a'>b</metadata></instance>"
    )
    model = read(tmp_path, amf(f"{ONE}<constellation id='2'>{odd}</constellation><twist/>"))

    assert model.mesh.bounds.tolist() == [[9, 0, 0], [11, 3, 4]]
    assert model.notes == ("instances have shearx, twist, which is not followed: look at the shape",)


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
