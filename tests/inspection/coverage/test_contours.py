"""Which extrusions are contoured, and the layers of files with them."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.coverage.gcode_extrusions import extrusions_of_gcode
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.pipeline import slice_part
from tests.contoured_gcode import HEIGHT, KINDS, PARTS, example
from tests.parts import box, cone, plain

LABELS = (";LAYER", ";Z:", ";HEIGHT")


def read(text: str) -> Stack:
    return stack_extrusions(extrusions_of_gcode(text.encode()).beads)


@pytest.mark.parametrize("comments", [True, False], ids=["comments", "no comments"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PARTS)
def test_the_layers_of_a_contoured_file_are_those_of_its_plan(
    name: str, kind: str, *, comments: bool
) -> None:
    part, text = example(name, kind)
    if not comments:
        text = "\n".join(row for row in text.split("\n") if not row.startswith(LABELS))
    stack = read(text)

    assert stack.n_layers == round(part.mesh.height / HEIGHT)
    assert not stack.is_spiral
    if comments:
        assert stack.top == pytest.approx(np.arange(1, stack.n_layers + 1) * HEIGHT)
        assert stack.beads.is_contoured.any()


@pytest.mark.parametrize("name", ["wedge 10", "wedge 20"])
def test_contoured_beads_are_as_high_as_the_surface_above_the_bottom_of_their_layer(name: str) -> None:
    part, text = example(name, "lowered")
    stack = read(text)
    beads = stack.beads.take(stack.beads.is_contoured)
    layer = stack.layer[stack.beads.is_contoured]
    surface = part.surface((beads.begin + beads.end) / 2)
    inside = (surface > stack.bottom[layer] + 0.06) & (surface < stack.top[layer] - 0.01)

    assert inside.sum() > 100
    assert beads.height[inside] == pytest.approx(surface[inside] - stack.bottom[layer[inside]], abs=0.02)
    assert np.median(np.abs(beads.width - 0.45)) < 0.005


@pytest.mark.parametrize("changes", [{"spiral": True}, {"scarf_length": 8.0}, {}], ids=str)
def test_files_that_only_rise_are_not_contoured(changes: dict[str, object]) -> None:
    profile = plain(**changes)
    for mesh in (cone(height=8.0), box((20.0, 15.0, 4.0))):
        text = gcode_of(slice_part(mesh, profile), profile)

        assert not extrusions_of_gcode(text).beads.is_contoured.any()
