"""Plates whose objects have their own layers: nothing is found where nothing is wrong, and planted faults are found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from printer_slicer.arrays import Bool
from printer_slicer.gcode import write_gcode
from printer_slicer.inspection.coverage.model_check import (
    Check,
    CheckOptions,
    check_gcode,
    place_sections,
    read_gcode_extrusions,
)
from printer_slicer.model import Mesh, PlateObject, Program
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import Placement
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from tests.inspection.coverage.changed_programs import without
from tests.parts import box, cone, plain, sphere

NAMES = ("box", "ball", "cone")


@cache
def plate() -> Mesh:
    """A box, a ball and a cone side by side; the middles are at x 6, 26 and 46."""
    shapes = (box((12.0, 12.0, 9.0)), sphere(6.0), cone(7.0, 10.0))
    solids = list[Mesh]()
    for k, shape in enumerate(shapes):
        low, high = shape.bounds
        x, y = (low + high)[:2] / 2
        solids.append(shape.moved((20.0 * k + 6 - x, 6 - y, -low[2])))
    count = [len(one.triangles) for one in solids]
    items = tuple(
        PlateObject(name, one.bounds[0], one.bounds[1], sum(count[:k]), count[k])
        for k, (name, one) in enumerate(zip(NAMES, solids, strict=True))
    )
    return Mesh(np.concatenate([one.triangles for one in solids]), "plate", items)


@cache
def profile(stacks: str = "objects") -> Profile:
    return plain(planner__kind="optimal", planner__stacks=stacks, skirt_loops=0, infill_density=0.2)


@cache
def program(stacks: str = "objects") -> Program:
    return slice_part(plate(), profile(stacks))


def checked(made: Program, asked: CheckOptions | None = None, stacks: str = "objects") -> Check:
    return check_gcode(write_gcode(made, profile(stacks)), plate(), asked or CheckOptions())


def of_object(made: Program, k: int) -> Bool:
    """(M,) the moves of one of the objects; the middle of the plate is that of its boxes."""
    x = made.xyz[:, 0]
    low, high = x[made.role == Role.EXTERNAL_PERIMETER].min(), x[made.role == Role.EXTERNAL_PERIMETER].max()
    at = (x - low) / (high - low) * 53
    return np.asarray(np.searchsorted([16.0, 36.0], at) == k)


def layer_of(made: Program, k: int, share: float = 0.5) -> float:
    """The top of a layer of an object that no other object has, near a share of its height."""
    laid = (made.role != Role.TRAVEL) & (made.filament > 0)
    own = np.unique(made.z_top[laid & of_object(made, k)].round(6))
    alone = np.setdiff1d(own, made.z_top[laid & ~of_object(made, k)].round(6))
    return float(alone[np.abs(alone - share * own[-1]).argmin()])


def moved(made: Program, chosen: Bool, by: tuple[float, float, float]) -> Program:
    return replace(made, xyz=made.xyz + np.where(chosen, 1.0, 0.0)[:, None] * np.array(by))


@pytest.mark.parametrize("stacks", ["one", "objects", "features"])
def test_a_plate_is_within_all_limits_whatever_layers_its_objects_have(stacks: str) -> None:
    check = checked(program(stacks), stacks=stacks)

    assert (check.findings, check.problems) == ((), ())
    assert check.match.share > 0.99
    assert check.match.spread < 0.01
    assert bool(check.coverage.stack.group.any()) == (stacks != "one")
    assert not any("not reliable" in note for note in check.notes)


def test_each_object_has_the_number_of_layers_that_was_planned() -> None:
    made, stack = program(), checked(program()).coverage.stack

    for k in range(3):
        laid = of_object(made, k) & (made.role != Role.TRAVEL)
        assert stack.top[stack.group == k] == pytest.approx(np.unique(made.z_top[laid].round(6)))
    assert stack.number[-1] == len(np.unique(made.z_top[made.role != Role.TRAVEL].round(6)))


def test_a_file_without_comments_is_understood_too() -> None:
    text = write_gcode(program(), profile())
    bare = b"\n".join(line for line in text.split(b"\n") if not line.startswith(b";"))
    check = check_gcode(bare, plate(), CheckOptions(filament_diameter=1.75))

    assert (check.match.share > 0.9, check.problems) == (True, ())
    assert check.coverage.stack.group.any()


def test_a_file_may_have_the_objects_at_other_places_than_the_model() -> None:
    far = moved(program(), np.ones(program().n_moves, np.bool_), (13.5, -7.25, 0.0))
    here, there = checked(program()), checked(far)

    assert (there.findings, there.problems) == ((), ())
    assert np.subtract(there.match.shift, here.match.shift) == pytest.approx((13.5, -7.25), abs=0.002)


def test_layers_with_the_same_top_are_one_layer_of_a_drawing() -> None:
    deposit, stack = read_gcode_extrusions(write_gcode(program(), profile()), None, "plate")
    joined, sections, match = place_sections(plate(), deposit, stack)

    assert joined.top == pytest.approx(stack.top)
    assert match.share > 0.99
    assert sections.area()[0] > 144 + 100


# --- planted faults ---


def codes_near(check: Check, z: float) -> set[str]:
    return {one.code for one in check.findings if one.z is not None and abs(one.z - z) < 0.35}


@pytest.mark.parametrize("k", [0, 1, 2])
def test_missing_walls_of_one_object_are_found(k: int) -> None:
    z = layer_of(program(), k)
    here = of_object(program(), k) & np.isclose(program().z_top, z)
    check = checked(without(program(), here & (program().role == Role.EXTERNAL_PERIMETER)))

    assert {"uncovered", "outline"} <= codes_near(check, z)
    assert {round(one.z or 0, 6) for one in check.findings} == {z}


@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_missing_layer_of_one_object_is_found(k: int) -> None:
    z = layer_of(program(), k)
    check = checked(without(program(), of_object(program(), k) & np.isclose(program().z_top, z)))

    assert "underfilled" in codes_near(check, z)


@pytest.mark.parametrize(("share", "code"), [(0.8, "underfilled"), (1.3, "overfilled")])
@pytest.mark.parametrize("k", [0, 1, 2])
def test_too_little_and_too_much_plastic_in_one_object_is_found(k: int, share: float, code: str) -> None:
    made = program()
    flow = np.where(of_object(made, k) & (made.role != Role.TRAVEL), share, 1.0)
    check = checked(replace(made, filament=made.filament * flow))

    [first, *_] = found = [one for one in check.findings if one.code == code]
    places = dict.fromkeys(range(3), 0)
    stack = check.coverage.stack
    for one in found:
        beads = np.flatnonzero(stack.beads.line == one.line)
        places[int(stack.group[stack.layer[beads[0]]])] += 1
    assert first.amount == pytest.approx(share, abs=0.12)
    assert [number for number, count in places.items() if count] == [k]


@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_shifted_layer_of_one_object_is_found(k: int) -> None:
    z = layer_of(program(), k)
    here = of_object(program(), k) & np.isclose(program().z_top, z)
    check = checked(moved(program(), here, (1.0, 0.0, 0.0)))

    assert {"outline", "outside"} <= codes_near(check, z)


@pytest.mark.parametrize("k", [0, 1, 2])
def test_an_object_at_a_wrong_place_is_found(k: int) -> None:
    check = checked(moved(program(), of_object(program(), k), (0.0, 2.0, 0.0)))

    assert "outline" in {one.code for one in check.findings}


def test_a_plate_at_a_wrong_place_is_found() -> None:
    right, wrong = (
        checked(program(), CheckOptions(placement=Placement(center=(0.0, y)))) for y in (0.0, 0.5)
    )

    assert right.ok
    assert {"outline", "outside"} <= {one.code for one in wrong.findings}


@pytest.mark.parametrize("k", [0, 1, 2])
def test_missing_layers_at_the_top_of_one_object_are_found(k: int) -> None:
    made = program()
    tops = np.unique(made.z_top[of_object(made, k) & (made.role != Role.TRAVEL)].round(6))
    gone = of_object(made, k) & (made.z_top > tops[-8])
    problems = checked(without(made, gone)).problems

    assert any(f"below the top of {NAMES[k]}" in one for one in problems)


def test_an_object_that_is_not_printed_is_told() -> None:
    check = checked(without(program(), of_object(program(), 1)))

    assert "nothing of ball is printed" in check.problems


def test_infill_laid_twice_in_one_object_is_found() -> None:
    made = program()
    twice = of_object(made, 0) & (made.role == Role.BOTTOM_SOLID_INFILL) & (made.z_top < 0.5)
    check = checked(replace(made, filament=made.filament * np.where(twice, 2.0, 1.0)))

    assert "overlap" in {one.code for one in check.findings}


def test_an_object_that_begins_in_the_air_is_found() -> None:
    made = program()
    lifted = moved(made, of_object(made, 0), (0.0, 0.0, 3.0))

    assert not checked(lifted).ok
