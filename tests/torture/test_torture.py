"""Broken meshes: each is sliced with the right area, or refused with the name of the fault."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.errors import PartError
from printer_slicer.healing import repair
from printer_slicer.model import LayerPlan
from printer_slicer.slicing import cut, list_section_repairs
from tests.torture.cases import CASES, Case


def plan_of(cuts: tuple[float, ...]) -> LayerPlan:
    heights = np.array(cuts)
    return LayerPlan(heights + 1e-3, heights)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_broken_mesh_is_sliced_right_or_refused(case: Case) -> None:
    if case.refused:
        with pytest.raises(PartError, match=case.refused) as caught:
            cut(repair(case.mesh)[0], plan_of(case.cuts), 0.0)

        assert caught.value.remedy
        return
    mended, repairs = repair(case.mesh)
    sections = cut(mended, plan_of(case.cuts), 0.0)

    kinds = {one.kind for one in (*repairs.done, *list_section_repairs(sections))}
    assert sections.solid.area() == pytest.approx(case.areas, abs=case.tolerance)
    assert kinds >= set(case.repairs)
