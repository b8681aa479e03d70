"""Scaling, turning, joining, and where parts are put."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parts import box, profile, sphere

from printer_slicer.errors import PartError, UsageError
from printer_slicer.model import Mesh, PlateObject
from printer_slicer.placing import Placement, join, place, transform

PRINTER = profile().printer
BED = np.array([PRINTER.bed_x, PRINTER.bed_y])
angles = st.floats(-720, 720)


def brick() -> Mesh:
    """From (5, 0, 0) to (7, 3, 4)."""
    return box((2.0, 3.0, 4.0), (5.0, 0.0, 0.0))


# Scaling and turning


def test_nothing_to_do_gives_the_same_part() -> None:
    part = brick()

    assert transform(part) is part
    assert transform(part, rotate=(360, 0, -720)) is part


def test_scaling_is_about_the_origin_of_the_file() -> None:
    assert transform(brick(), scale=2).bounds.tolist() == [[10, 0, 0], [14, 6, 8]]
    assert transform(brick(), scale=(1, 2, 0.5)).bounds.tolist() == [[5, 0, 0], [7, 6, 2]]


@pytest.mark.parametrize(
    ("rotate", "bounds"),
    [
        ((90, 0, 0), [[5, -4, 0], [7, 0, 3]]),
        ((0, 90, 0), [[0, 0, -7], [4, 3, -5]]),
        ((0, 0, 90), [[-3, 5, 0], [0, 7, 4]]),
        ((0, 0, -90), [[0, -7, 0], [3, -5, 4]]),
        ((0, 0, 450), [[-3, 5, 0], [0, 7, 4]]),
        ((180, 0, 0), [[5, -3, -4], [7, 0, 0]]),
        ((90, 90, 0), [[0, -4, -7], [3, 0, -5]]),  # about x first: (x, -z, y), then about y: (y, -z, -x)
        ((90, 0, 90), [[0, 5, 0], [4, 7, 3]]),
    ],
)
def test_quarter_turns_are_exact(rotate: tuple[float, float, float], bounds: list[list[float]]) -> None:
    assert transform(brick(), rotate=rotate).bounds.tolist() == bounds


def test_scaling_comes_before_turning() -> None:
    assert transform(brick(), scale=(1, 10, 1), rotate=(0, 0, 90)).bounds.tolist() == [
        [-30, 5, 0],
        [0, 7, 4],
    ]


@given(angles, angles, angles, st.floats(0.01, 100))
def test_turning_keeps_the_volume_and_scaling_cubes_it(x: float, y: float, z: float, scale: float) -> None:
    part = brick()

    assert transform(part, rotate=(x, y, z)).volume == pytest.approx(24.0)
    assert transform(part, scale=scale, rotate=(x, y, z)).volume == pytest.approx(24.0 * scale**3)


@given(angles, angles, angles)
def test_three_turns_are_one_after_the_other(x: float, y: float, z: float) -> None:
    one = transform(transform(transform(brick(), rotate=(x, 0, 0)), rotate=(0, y, 0)), rotate=(0, 0, z))

    np.testing.assert_allclose(transform(brick(), rotate=(x, y, z)).triangles, one.triangles, atol=1e-9)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf"), (1.0, 1.0, -1.0)])
def test_a_scale_that_is_none_is_refused(scale: float) -> None:
    with pytest.raises(UsageError, match="must be greater than 0"):
        transform(brick(), scale=scale)


def test_an_angle_that_is_none_is_refused() -> None:
    with pytest.raises(UsageError, match="not three angles"):
        transform(brick(), rotate=(0, float("nan"), 0))


# Joining


def test_joined_parts_keep_their_places() -> None:
    plate = join([brick(), brick().moved((10, 0, 5)), sphere(3)])

    assert plate.volume == pytest.approx(48 + sphere(3).volume)
    assert plate.name == f"{brick().name} and 2 more"
    assert join([brick()]).n_facets == 12
    with pytest.raises(UsageError, match="no part"):
        join([])


# Placing


def middle_of(mesh: Mesh) -> list[float]:
    return mesh.bounds.mean(axis=0)[:2].tolist()


def test_a_part_stands_in_the_middle_of_the_bed() -> None:
    placed = place(brick().moved((0, 0, 77)), PRINTER)

    assert middle_of(placed) == (BED / 2).tolist()
    assert placed.bounds[:, 2].tolist() == [0, 4]


def test_its_middle_can_be_put_elsewhere() -> None:
    assert middle_of(place(brick(), PRINTER, Placement(center=(30, 40)))) == [30, 40]


def test_as_placed_keeps_x_and_y() -> None:
    placed = place(brick().moved((0, 0, 9)), PRINTER, Placement(as_placed=True))

    assert placed.bounds.tolist() == [[5, 0, 0], [7, 3, 4]]


def test_without_drop_z_is_kept() -> None:
    placed = place(brick().moved((0, 0, 9)), PRINTER, Placement(as_placed=True, drop=False))

    assert placed.bounds.tolist() == [[5, 0, 9], [7, 3, 13]]


@pytest.mark.parametrize(
    ("by", "placement", "message"),
    [
        ((-6, 0, 0), Placement(as_placed=True), "from x -1 to 1 mm, but the bed"),
        ((0, 1000, 0), Placement(as_placed=True), "from y 1000 to 1003 mm"),
        ((0, 0, 0), Placement(center=(0, 50)), "from x -1 to 1 mm"),
        ((0, 0, -1.5), Placement(drop=False), "extends 1.5 mm below the bed"),
        ((0, 0, 1000), Placement(drop=False), "extends up to z 1004 mm"),
    ],
)
def test_what_leaves_the_printer_is_refused(
    by: tuple[float, float, float], placement: Placement, message: str
) -> None:
    with pytest.raises(PartError) as caught:
        place(brick().moved(by), PRINTER, placement)

    assert message in str(caught.value)
    assert caught.value.remedy


def test_a_part_that_just_reaches_the_edges_fits() -> None:
    size = (PRINTER.bed_x, PRINTER.bed_y, PRINTER.bed_z)

    np.testing.assert_allclose(place(box(size), PRINTER).bounds, [[0, 0, 0], size])


def test_a_part_in_another_unit_is_refused_with_a_guess() -> None:
    large = transform(brick(), scale=25_400)
    with pytest.raises(PartError) as caught:
        place(large, PRINTER, Placement(unit="m"))

    assert "does not fit" in str(caught.value)
    assert "`scale=0.0024` would just fit" in caught.value.remedy
    assert '`units="mm"` makes the part 50.8 x 76.2 x 101.6 mm' in caught.value.remedy
    assert place(transform(large, scale=0.0024), PRINTER).n_facets == 12


def test_a_single_object_that_is_joined_has_all_facets_of_its_mesh() -> None:
    mesh = brick()
    single = Mesh(mesh.triangles, "file", (PlateObject.of("object", mesh.bounds, 0, 0),))
    both = join([single, single])

    assert [(one.first, one.count) for one in both.objects] == [
        (0, mesh.n_facets),
        (mesh.n_facets, mesh.n_facets),
    ]
