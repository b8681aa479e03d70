"""What every format promises: the file holds the contours of the sections, to its rounding, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import pytest
from hypothesis import given

from printer_slicer.arrays import Float
from printer_slicer.exports import (
    round_to_float32,
    round_to_grid,
    write_cli,
    write_slc,
    write_svg,
    write_svgs,
)
from printer_slicer.model import Sections
from tests.exports.readers import read_cli, read_slc, read_svg
from tests.exports.stacks import frame, islands, of, sections, signed_area, uneven
from tests.strategies import box


@dataclass(frozen=True)
class Read:
    """What any format tells: the bounds of each layer in z, and its rings without a repeated first point."""

    bounds: list[tuple[float, float]]
    rings: list[list[Float]]


def opened(ring: Float) -> Float:
    """A closed polyline without its last point, which is its first."""
    assert (ring[0] == ring[-1]).all()
    return ring[:-1]


def from_cli(stack: Sections, *, binary: bool) -> Read:
    layers = read_cli(write_cli(stack, binary=binary)).layers
    z = [height for height, _ in layers]
    assert layers[0][1] == []
    for _, polylines in layers:
        for direction, ring in polylines:
            assert direction == (signed_area(opened(ring)) > 0)
    return Read(list(pairwise(z)), [[opened(r) for _, r in each] for _, each in layers[1:]])


def from_slc(stack: Sections) -> Read:
    file = read_slc(write_slc(stack))
    z = [*(bottom for bottom, _ in file.layers), file.top]
    return Read(list(pairwise(z)), [[opened(r) for r in rings] for _, rings in file.layers])


def from_svg(stack: Sections) -> Read:
    layers = read_svg(write_svg(stack))[2]
    bounds = [(layer.z - float(layer.attributes["layer-height"]), layer.z) for layer in layers]
    # The drawing is turned over, so a ring read back in the part's coordinates is the way it was.
    return Read(bounds, [layer.rings for layer in layers])


def from_svgs(stack: Sections) -> Read:
    layers = [read_svg(data)[2] for _, data in write_svgs(stack)]
    assert all(len(one) == 1 for one in layers)
    bounds = [(one[0].z - float(one[0].attributes["layer-height"]), one[0].z) for one in layers]
    return Read(bounds, [one[0].rings for one in layers])


FORMATS: Final[dict[str, Callable[[Sections], Read]]] = {
    "cli ascii": lambda stack: from_cli(stack, binary=False),
    "cli binary": lambda stack: from_cli(stack, binary=True),
    "slc": from_slc,
    "svg": from_svg,
    "svgs": from_svgs,
}
WRITERS: Final[dict[str, Callable[[Sections], bytes]]] = {
    "cli ascii": lambda stack: write_cli(stack, binary=False),
    "cli binary": lambda stack: write_cli(stack, binary=True),
    "slc": write_slc,
    "svg": write_svg,
    "svgs": lambda stack: b"".join(name.encode() + data for name, data in write_svgs(stack)),
}
HALF_UNIT: Final = 0.0005 + 1e-9
each_format = pytest.mark.parametrize("name", FORMATS)


def check(read: Read, stack: Sections) -> None:
    """Every ring is there, point by point, and every layer is where the plan has it."""
    bottom, top = np.array(read.bounds).T
    np.testing.assert_allclose(bottom, stack.plan.bottom, atol=HALF_UNIT)
    np.testing.assert_allclose(top, stack.plan.top, atol=HALF_UNIT)
    for layer, rings in enumerate(read.rings):
        wanted = list(stack.solid.rings(layer))
        assert len(rings) == len(wanted)
        for ring, old in zip(rings, wanted, strict=True):
            np.testing.assert_allclose(ring, old, atol=HALF_UNIT)


@each_format
def test_holes_islands_empty_layers_and_uneven_heights_are_read_back(name: str) -> None:
    stack = uneven()
    read = FORMATS[name](stack)

    check(read, stack)
    assert [len(rings) for rings in read.rings] == [3, 0, 2, 3, 1]
    areas = [sum(signed_area(ring) for ring in rings) for rings in read.rings]
    np.testing.assert_allclose(areas, [88, 0, 8, 88, 1], atol=1e-3)


@each_format
@given(stack=sections())
def test_any_stack_is_read_back_with_the_areas_it_has(name: str, stack: Sections) -> None:
    read = FORMATS[name](stack)
    areas = np.array([sum(signed_area(ring) for ring in rings) for rings in read.rings])

    # Corners that move by half a unit in x and y change an area by that much along its contour.
    length = stack.solid.length()
    assert (np.abs(areas - stack.solid.area()) <= 1e-6 + length * 0.0005 * np.sqrt(2)).all()
    assert read.bounds == sorted(read.bounds)


@each_format
def test_a_part_of_one_layer_is_read_back(name: str) -> None:
    stack = of([frame()], [0.2])

    check(FORMATS[name](stack), stack)


@each_format
def test_two_thousand_layers_are_read_back_in_order(name: str) -> None:
    rings = [islands() if layer % 7 else [] for layer in range(2000)]
    stack = of(rings, (np.arange(1, 2001) * 0.05).tolist())

    check(FORMATS[name](stack), stack)


@each_format
def test_a_stack_without_any_contour_is_still_a_file(name: str) -> None:
    stack = of([[], [], []], [0.2, 0.4, 0.6])
    read = FORMATS[name](stack)

    assert read.rings == [[], [], []]
    check(read, stack)


@each_format
def test_the_same_sections_give_the_same_bytes(name: str) -> None:
    assert WRITERS[name](uneven()) == WRITERS[name](uneven())


@each_format
def test_points_that_round_to_their_neighbours_and_rings_that_round_to_nothing_are_left_out(
    name: str,
) -> None:
    nearly = np.array([(0, 0), (5, 0), (5.00000001, 0), (5, 5), (0, 5)], dtype=np.float64)
    dust = box(2, 2, 2.00000001, 2.00000001)[::-1]
    stack = of([[nearly, dust]], [0.2])
    rings = FORMATS[name](stack).rings

    assert len(rings) == 1
    assert [len(ring) for ring in rings[0]] == [4]
    assert signed_area(rings[0][0]) == pytest.approx(25)


def test_a_ring_that_rounding_would_turn_over_is_left_out_and_counted() -> None:
    sliver = np.array([(0, 0), (10, 0.0006), (5, 0.0004)], dtype=np.float64)
    stack = of([[sliver, box(0, 1, 1, 2)]], [0.2])
    rounded = round_to_grid(stack.solid, 0.001)

    assert stack.solid.ring_area()[0] > 0
    assert rounded.lost == 1
    assert [len(rings) for rings in FORMATS["cli ascii"](stack).rings] == [1]
    assert round_to_float32(stack.solid).lost == 0


def test_what_rounding_moves_is_measured() -> None:
    stack = of([[box(0.0004, 0, 10.12345, 7)]], [0.2])

    assert round_to_grid(stack.solid, 0.001).error == pytest.approx(0.00045)
    assert 0 < round_to_float32(stack.solid).error < 4e-6
