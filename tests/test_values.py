"""Values do not change once they are made, and solid boxes take their volume whatever the direction of the rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from inspect import signature
from itertools import product
from math import pi
from pathlib import Path

import numpy as np
import pytest

import printer_slicer
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.slicing import contours, find_mesh_faults
from tests.effort import crossed
from tests.parts import box, two_boxes


def arrays(value: object, name: str) -> Iterator[tuple[str, np.ndarray]]:  # type: ignore[type-arg]
    """All arrays in a value, however deep, with their names."""
    if isinstance(value, np.ndarray):
        yield name, value
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from arrays(part, f"{name}[{index}]")
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name), f"{name}.{field.name}")


def test_every_array_of_every_stage_is_read_only() -> None:
    stages = slice_stages(box(), load_profile())
    found = [*arrays(stages, "stages"), *arrays(contours(box(), stages.sections.plan), "contours")]
    found += arrays(find_mesh_faults(box()), "faults")

    assert len(found) > 40
    assert [name for name, array in found if array.flags.writeable] == []


@pytest.mark.parametrize(
    ("size", "how"),
    crossed(
        [(10, 10, 10), (20, 20, 10), (100, 7, 5), (4, 40, 10), (3, 30, 10)],
        list(product([0, 30, 45, 90], ["standard", "adaptive"])),
    ),
)
def test_a_solid_box_takes_its_volume_at_any_angle(
    size: tuple[float, float, float], how: tuple[float, str]
) -> None:
    angle, quality = how
    solid = {"infill_density": 1, "skirt_loops": 0, "infill_angle_deg": angle}
    profile = load_profile("marlin_220", "pla", quality, solid)

    program = slice_part(box(size), profile)
    used = program.filament_used * pi * 1.75**2 / 4

    # Inner perimeters hold what the round sides of the outermost ones leave open.
    assert used == pytest.approx(np.prod(size), rel=0.01)


def test_a_closed_mesh_has_no_faults() -> None:
    assert find_mesh_faults(two_boxes()).count == 0


def test_a_missing_lid_is_found_though_no_layer_cuts_it() -> None:
    whole = box((10, 10, 10)).triangles
    lid = (whole[:, :, 2] == 10).all(axis=1)
    faults = find_mesh_faults(Mesh(whole[~lid]))

    assert len(faults.open_edges) == 4
    assert (faults.open_edges[:, 2] == 10).all()


def test_a_flipped_facet_and_a_doubled_one_are_told_apart() -> None:
    whole = box((10, 10, 10)).triangles
    flipped, doubled = whole.copy(), np.concatenate([whole, whole[:1]])
    flipped[0] = flipped[0, ::-1]

    assert len(find_mesh_faults(Mesh(flipped)).flipped_edges) == 3
    assert len(find_mesh_faults(Mesh(doubled)).crowded_edges) == 3


def test_boxes_that_share_an_edge_are_crowded_there() -> None:
    faults = find_mesh_faults(
        Mesh(np.concatenate([box((5, 5, 5)).triangles, box((5, 5, 5), (5, 5, 0)).triangles]))
    )

    assert len(faults.crowded_edges) == 1
    assert faults.crowded_edges[0].tolist() == [5, 5, 2.5]


def test_all_values_are_structs() -> None:
    """Creating a dataclass takes twenty times as long."""
    package = Path(printer_slicer.__file__).parent

    assert [str(path) for path in package.rglob("*.py") if "@dataclass" in path.read_text("utf-8")] == []


def test_functions_for_dataclasses_accept_values() -> None:
    plan = LayerPlan.from_tops(np.array([0.2, 0.4]), "first")

    assert replace(plan, planner="second").planner == "second"
    assert [field.name for field in fields(plan)] == [
        "top",
        "cut",
        "planner",
        "containment",
        "base",
        "contour_rule",
    ]
    assert str(signature(LayerPlan)).startswith("(top: 'Float', cut: 'Float', planner: 'str' = ''")
