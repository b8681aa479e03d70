"""3MF files that are written: shapes once, copies as items, read back as they were."""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.mesh_io.three_mf_writing import BuildItem, make_three_mf
from tests.parts import box

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_copies_share_their_shape_and_come_back_where_they_were(tmp_path: Path) -> None:
    shape = ps.Mesh(box((10, 20, 5)).triangles, 'a "box" & <more>')
    other = ps.join(
        [ps.Mesh(box((3, 3, 3)).triangles, "left"), ps.Mesh(box((4, 4, 4), at=(9, 0, 0)).triangles, "right")]
    )
    data = make_three_mf(
        [
            BuildItem(shape, np.eye(3), np.array([1.5, 2.5, 0])),
            BuildItem(shape, TURN, np.array([100, 50, 7])),
            BuildItem(other, np.eye(3), np.array([30, 0, 0])),
        ]
    )
    path = tmp_path / "plate.3mf"
    path.write_bytes(data)
    read = ps.load_mesh(path)

    text = zipfile.ZipFile(BytesIO(data)).read("3D/3dmodel.model").decode()
    assert text.count("<object ") == 3
    assert text.count("<vertex ") == 24
    assert [item.name for item in read.objects] == ['a "box" & <more>'] * 2 + ["left", "right"]
    assert read.objects[0].low == pytest.approx((1.5, 2.5, 0))
    assert read.objects[1].low == pytest.approx((80, 50, 7))
    assert read.objects[1].high == pytest.approx((100, 60, 12))
    assert read.objects[3].low == pytest.approx((39, 0, 0))
    assert read.volume == pytest.approx(2000 + 27 + 64)


def test_the_same_items_give_the_same_bytes() -> None:
    def make() -> bytes:
        return make_three_mf([BuildItem(ps.Mesh(box((1, 2, 3)).triangles), np.eye(3), np.zeros(3))])

    assert make() == make()
