"""Objects of a plate that need repair: their facets stay known if they are apart."""

from __future__ import annotations

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.healing import repair
from tests.parts import box


def open_box(x: float, name: str, *, turned: int = 5) -> ps.Mesh:
    """A box at x without its first facet, one facet turned, and one twice."""
    triangles = box((10, 10, 5), at=(x, 20, 0)).triangles[1:].copy()
    triangles[turned] = triangles[turned, ::-1]
    return ps.Mesh(np.concatenate([triangles, triangles[:1]]), name)


def sound_box(x: float) -> ps.Mesh:
    return ps.Mesh(box((10, 10, 8), at=(x, 20, 0)).triangles, "sound")


def test_each_object_keeps_its_facets() -> None:
    plate = ps.join([open_box(0, "a"), sound_box(30), open_box(60, "b")])

    repaired, repairs = repair(plate)

    assert [item.name for item in repaired.objects] == ["a", "sound", "b"]
    assert sum(item.count for item in repaired.objects) == len(repaired.triangles)
    for item, volume in zip(repaired.objects, (500, 800, 500), strict=True):
        own = ps.Mesh(repaired.triangles[item.facets])
        assert repair(own)[1].count == 0
        assert own.volume == pytest.approx(volume)
        assert own.bounds[0] == pytest.approx(item.low)
    alone = [repair(one)[1] for one in (open_box(0, "a"), open_box(60, "b"))]
    wanted = {one.kind: 2 * one.count for one in alone[0].done}
    assert {one.kind: one.count for one in repairs.done} == wanted


def test_objects_that_touch_are_repaired_together() -> None:
    plate = ps.join([open_box(0, "a"), open_box(10.2, "b")])

    repaired, repairs = repair(plate)

    assert repairs.count
    assert [item.count for item in repaired.objects] == [0, 0]


def test_sound_objects_are_not_changed() -> None:
    plate = ps.join([sound_box(0), sound_box(40)])

    assert repair(plate)[0] is plate


def test_repaired_objects_can_be_printed_one_after_the_other() -> None:
    profile = ps.load_profile("marlin_220", changes={"print_order": "by_object", "printer.head": "0: 10"})
    plate = ps.join([open_box(50, "a"), open_box(90, "b")])

    assert len(ps.slice_stages(plate, profile).program.plan.stack_starts) == 2
