"""Which layers there are, and how thick each bead is."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.inspection.coverage.gcode_extrusions import extrusions_of_gcode
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import (
    Stack,
    split_thick_extrusions,
    stack_extrusions,
    stack_of_program,
)
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.pipeline import slice_stages
from tests.inspection.coverage.lines import WIDTH, beads_along, joined, path
from tests.parts import cone, plain


def read(*lines: str) -> Stack:
    return stack_extrusions(extrusions_of_gcode("\n".join(["M83", *lines]).encode()).beads)


def loop(z: float, height: float = 0.2, width: float = WIDTH) -> list[str]:
    return path([(0, 0), (20, 0), (20, 20), (0, 20), (0, 0)], z, height, width)


def test_layers_are_where_plastic_is_laid_whatever_comments_say() -> None:
    stack = read(";LAYER:7", ";HEIGHT:3", *loop(0.3, 0.3), "G0 Z5", ";Z:9", *loop(0.5), "G0 Z1", *loop(0.7))

    assert stack.top.tolist() == pytest.approx([0.3, 0.5, 0.7])
    assert stack.height.tolist() == pytest.approx([0.3, 0.2, 0.2])
    assert stack.layer.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert stack.beads.width == pytest.approx(np.full(12, WIDTH), abs=1e-4)


def test_beads_after_a_layer_that_is_missing_have_more_height_to_fill() -> None:
    stack = read(";TYPE:Perimeter", *loop(0.2), *loop(0.4), ";HEIGHT:0.2", *loop(0.8))

    assert stack.height.tolist() == pytest.approx([0.2, 0.2, 0.4])
    assert stack.beads.height[-4:] == pytest.approx(np.full(4, 0.4))


def test_heights_that_differ_by_rounding_are_one_layer() -> None:
    assert read(*loop(0.2), *loop(0.399), *loop(0.4001)).top.tolist() == pytest.approx([0.2, 0.4001])


@pytest.mark.parametrize("comment", [[], [";HEIGHT:0.4"]], ids=["from its flow", "as a comment says"])
def test_sparse_infill_printed_every_second_layer_is_twice_as_thick(comment: list[str]) -> None:
    thick = [";TYPE:Internal infill", *comment, *path([(2, 2), (18, 18)], 0.4, 0.4)]
    wall = [";TYPE:Perimeter", ";HEIGHT:0.2"]
    stack = read(*wall, *loop(0.2), *wall, *loop(0.4), *thick, *wall, *loop(0.6))
    sparse = stack.beads.purpose == Purpose.INTERNAL_INFILL

    assert stack.beads.height[sparse] == pytest.approx([0.4])
    assert stack.beads.width[sparse] == pytest.approx([WIDTH], abs=1e-4)
    assert stack.beads.height[~sparse] == pytest.approx(np.full(12, 0.2))


@pytest.mark.parametrize("loops", [1, 5])
def test_inner_perimeters_that_fill_two_layers_are_known_by_their_comments(loops: int) -> None:
    """And by their flow, however many of them there are."""
    outer, inner = [";TYPE:External perimeter", ";HEIGHT:0.2"], [";TYPE:Perimeter", ";HEIGHT:0.4"]
    thick = [row for k in range(loops) for row in path([(2 + k, 2), (2 + k, 18)], 0.4, 0.4)]
    stack = read(*outer, *loop(0.2), *loop(0.4), *inner, *thick)
    deep = stack.beads.purpose == Purpose.PERIMETER

    assert stack.beads.height[deep] == pytest.approx(np.full(loops, 0.4))
    assert stack.beads.width[deep] == pytest.approx(np.full(loops, WIDTH), abs=1e-4)
    assert stack.beads.height[~deep] == pytest.approx(np.full(8, 0.2))


@pytest.mark.parametrize("layers", [3, 7, 8, 20])
def test_an_object_among_many_thin_layers_of_another_one_keeps_its_height(layers: int) -> None:
    thick = round(0.02 * layers, 6)
    rows = ["G0 X0", ";TYPE:External perimeter", ";HEIGHT:0.2", *loop(0.2)]
    for k in range(1, layers + 1):
        z = round(0.2 + 0.02 * k, 6)
        rows += [";HEIGHT:0.02", *path([(30, 0), (50, 0), (50, 20)], z, 0.02)]
    rows += [f";HEIGHT:{thick}", *loop(0.2 + thick, thick)]
    stack = read(*rows)

    assert stack.n_layers == layers + 1
    assert stack.beads.height[-4:] == pytest.approx(np.full(4, thick))
    assert stack.beads.width[-4:] == pytest.approx(np.full(4, WIDTH), abs=1e-4)


def test_beads_that_fill_several_layers_are_cut_into_what_they_hold_of_each() -> None:
    outer, inner = [";TYPE:External perimeter", ";HEIGHT:0.2"], [";TYPE:Perimeter", ";HEIGHT:0.4"]
    stack = read(
        *outer, *loop(0.2), *loop(0.4), *inner, *path([(2, 2), (2, 18)], 0.4, 0.4), *outer, *loop(0.6)
    )
    parts, source = split_thick_extrusions(stack)

    assert parts.beads.volume.sum() == pytest.approx(stack.beads.volume.sum())
    assert np.bincount(parts.layer).tolist() == [5, 5, 4]
    deep = np.flatnonzero(np.bincount(source)[source] == 2)
    assert parts.layer[deep].tolist() == [0, 1]
    assert parts.beads.z_top[deep] == pytest.approx([0.2, 0.4])
    assert parts.beads.height[deep] == pytest.approx([0.2, 0.2])
    # What lies side by side is as far apart at every height.
    assert parts.beads.area[deep] / 0.2 == pytest.approx(np.full(2, bead.spacing(WIDTH, 0.4)), abs=1e-4)
    assert split_thick_extrusions(parts)[0] is parts


def test_perimeters_with_too_much_plastic_are_wide_not_thick() -> None:
    stack = read(";TYPE:Perimeter", *loop(0.2), *loop(0.4), *loop(0.6, 0.2, 0.9))

    assert stack.beads.height == pytest.approx(np.full(12, 0.2))
    assert stack.beads.width[-4:] == pytest.approx(np.full(4, 0.9), abs=1e-4)


def test_a_height_in_a_comment_that_the_flow_contradicts_does_not_count() -> None:
    lie = [";TYPE:Internal infill", ";HEIGHT:0.6", *path([(2, 2), (18, 18)], 0.6, 0.2, 0.4)]
    stack = read(";TYPE:Perimeter", *loop(0.2), *loop(0.4), *loop(0.6), *lie)

    assert stack.beads.height[-1] == pytest.approx(0.2)


def test_threads_across_a_gap_are_as_thick_as_they_leave_the_nozzle() -> None:
    thread = [";TYPE:Bridge infill", ";HEIGHT:0.4", *path([(2, 2), (18, 2)], 0.6, 0.4, 0.4)]
    stack = read(";TYPE:Perimeter", *loop(0.3, 0.3), *loop(0.6, 0.3), *thread)

    assert stack.beads.height[-1] == pytest.approx(0.4)
    assert stack.beads.width[-1] == pytest.approx(0.4, abs=1e-4)


def spiral(turns: int, height: float = 0.2, low: float = 0.4) -> list[str]:
    sides = 48
    lines, area = [], height * (WIDTH - height * (1 - pi / 4))
    chord = 2 * 10 * sin(pi / sides)
    for k in range(1, turns * sides + 1):
        angle = 2 * pi * k / sides
        fed = chord * area / (pi * 1.75**2 / 4)
        z = low + height * k / sides
        lines.append(f"G1 X{10 + 10 * cos(angle):.5f} Y{10 + 10 * sin(angle):.5f} Z{z:.5f} E{fed:.6f}")
    return lines


def test_every_turn_of_a_spiral_is_a_layer() -> None:
    stack = read(*loop(0.2), *loop(0.4), "G0 X20 Y10", *spiral(10))

    assert stack.is_spiral
    assert stack.top.tolist() == pytest.approx([0.2, 0.4, *(0.5 + 0.2 * k for k in range(10))])
    assert stack.beads.height == pytest.approx(np.full(stack.beads.n_beads, 0.2))
    assert np.bincount(stack.layer).tolist() == [4, 4, *[48] * 10]


def test_a_spiral_without_layers_below_has_layers_too() -> None:
    stack = read("G0 X20 Y10 Z0", *spiral(6, low=0.0))

    assert stack.n_layers == 6
    assert np.diff(stack.top) == pytest.approx(np.full(5, 0.2), abs=1e-3)


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_the_first_layer_of_a_part_on_a_raft_begins_where_the_raft_ends_or_a_little_higher(
    gap: float,
) -> None:
    raft = [";TYPE:Support material", *path([(0, 0), (20, 0)], 0.3, 0.3), *path([(0, 1), (20, 1)], 0.6, 0.3)]
    stack = read(*raft, ";TYPE:Perimeter", *loop(0.6 + gap + 0.2), *loop(1.0 + gap))

    assert stack.top.tolist() == pytest.approx([0.8 + gap, 1.0 + gap])
    assert stack.height.tolist() == pytest.approx([0.2, 0.2])
    assert stack.layer[:2].tolist() == [-1, -1]


def test_beads_beside_the_part_make_no_layers() -> None:
    beads = joined(
        beads_along([(0, 0), (50, 0)], z=0.3, height=0.3, purpose=Purpose.SKIRT),
        beads_along([(0, 9), (50, 9)], z=0.2),
    )

    assert stack_extrusions(beads).top.tolist() == [0.2]
    assert stack_extrusions(beads).layer.tolist() == [-1, 0]


def test_a_program_keeps_the_layers_of_its_plan_even_where_nothing_fits() -> None:
    # The tip of a cone is narrower than a bead.
    profile = plain(layer_height=0.3, planner__kind="uniform", min_feature=1)
    stages = slice_stages(cone(radius=4, height=8), profile)
    stack = stack_of_program(stages.program, profile.material.filament_diameter)
    coverage = coverage_of(stack, stages.sections.solid)

    assert stack.n_layers == stages.sections.plan.n_layers
    assert coverage.volume[-1] == 0
    assert coverage.fill.shell[:20] == pytest.approx(np.ones(20), abs=0.1)


def test_no_beads_have_no_layers() -> None:
    assert stack_extrusions(extrusions_of_gcode(b"G28\nG1 X5\n").beads).n_layers == 0
