"""Single layers of a file: those of the part, of its supports and of its raft, and what lies in each."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.gcode import write_gcode
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions, extrusions_of_gcode
from printer_slicer.inspection.coverage.layer_extrusions import (
    FileLayers,
    LayerExtrusions,
    extrusions_of_layer,
    file_layers_of,
)
from printer_slicer.inspection.coverage.stack import stack_extrusions
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.inspection.coverage.lines import WIDTH, path
from tests.parts import box, plain


def read(*lines: str) -> tuple[GcodeExtrusions, FileLayers]:
    deposit = extrusions_of_gcode("\n".join(["M83", *lines]).encode())
    return deposit, file_layers_of(deposit, stack_extrusions(deposit.beads))


def square(z: float, height: float = 0.2, at: float = 0.0) -> list[str]:
    return path([(at, 0), (at + 20, 0), (at + 20, 20), (at, 20), (at, 0)], z, height)


def sheets(*lines: str) -> list[LayerExtrusions]:
    deposit, levels = read(*lines)
    return [extrusions_of_layer(deposit, levels, number) for number in range(levels.n_layers)]


def test_every_layer_of_a_part_is_a_sheet_with_its_beads() -> None:
    low, high = sheets(";TYPE:Perimeter", *square(0.3, 0.3), ";TYPE:Internal infill", *square(0.5)[:3])

    assert (low.number, low.count, low.top, low.height) == (0, 2, 0.3, 0.3)
    assert (high.number, high.count, high.top) == (1, 2, 0.5)
    assert high.height == pytest.approx(0.2)
    assert [low.beads.n_beads, high.beads.n_beads] == [4, 2]
    assert low.beads.width == pytest.approx(np.full(4, WIDTH), abs=1e-4)


def test_beads_keep_the_names_that_the_file_gives_them() -> None:
    (sheet,) = sheets(
        *square(0.2)[:2],
        ";TYPE:Outer wall",
        *square(0.2, at=30),
        "; FEATURE: Sparse infill",
        *square(0.2, at=60),
    )

    assert [sheet.names[i] for i in sheet.name] == [""] + ["Outer wall"] * 4 + ["Sparse infill"] * 4


def test_supports_between_the_layers_of_the_part_have_layers_of_their_own() -> None:
    wall, support = ";TYPE:Perimeter", [";TYPE:Support material", ";HEIGHT:0.3"]
    three = sheets(wall, *square(0.2), *support, *square(0.3, 0.3, at=30), wall, *square(0.4))

    assert [sheet.top for sheet in three] == pytest.approx([0.2, 0.3, 0.4])
    assert [sheet.beads.n_beads for sheet in three] == [4, 4, 4]
    # The part's beads are as thick as its own layers, the support's as the file says.
    assert [float(sheet.beads.width.max()) for sheet in three] == pytest.approx([WIDTH] * 3, abs=1e-4)


def test_supports_at_a_height_of_the_part_lie_in_its_layer() -> None:
    two = sheets(*square(0.2), ";TYPE:Support material", *square(0.2, at=30), ";TYPE:Perimeter", *square(0.4))

    assert [sheet.beads.n_beads for sheet in two] == [8, 4]


def test_a_raft_comes_first_and_its_beads_are_as_thick_as_the_step_where_nothing_tells() -> None:
    raft = [";TYPE:Support material", *square(0.3, 0.3), *square(0.6, 0.3)]
    three = sheets(*raft, ";TYPE:Perimeter", *square(0.8))

    assert [sheet.top for sheet in three] == pytest.approx([0.3, 0.6, 0.8])
    assert three[0].beads.width == pytest.approx(np.full(4, WIDTH), abs=1e-4)
    assert three[1].beads.width == pytest.approx(np.full(4, WIDTH), abs=1e-4)


def test_a_file_of_supports_alone_has_their_layers() -> None:
    two = sheets(";TYPE:Support material", *square(0.2), *square(0.5, 0.3))

    assert [sheet.top for sheet in two] == pytest.approx([0.2, 0.5])
    assert two[1].beads.width == pytest.approx(np.full(4, WIDTH), abs=1e-4)


def test_a_file_that_lays_nothing_has_no_layers() -> None:
    assert read("G1 X5 Y5")[1].n_layers == 0


def test_a_line_that_primes_the_nozzle_makes_no_layer() -> None:
    prime = path([(-50, 0), (-50, 60)], 0.37, 0.37)
    two = sheets(*prime, ";LAYER_CHANGE", *square(0.2), ";LAYER_CHANGE", *square(0.4))

    assert [sheet.beads.n_beads for sheet in two] == [4, 4]


def test_a_height_is_looked_up_in_the_layer_that_holds_it() -> None:
    _, levels = read(*square(0.3, 0.3), *square(0.5))

    assert [levels.layer_at(z) for z in (0.0, 0.1, 0.3, 0.301, 0.35, 0.5)] == [0, 0, 0, 0, 1, 1]
    assert [levels.layer_at(z) for z in (-0.1, 0.51, 7.0)] == [-1, -1, -1]


def test_ways_that_lay_nothing_belong_to_the_bead_they_lead_to() -> None:
    first, second = sheets(*square(0.2), "G0 X5 Y5", "G0 X9 Y5", *square(0.4, at=2), "G0 X0 Y0")

    assert len(first.travel) == 0  # the machine begins where the first square does
    assert second.travel.tolist() == [[[0, 0], [5, 5]], [[5, 5], [9, 5]], [[9, 5], [2, 0]]]


def test_each_turn_of_a_spiral_is_a_layer() -> None:
    base = square(0.2)
    turn = np.linspace(0, 6 * np.pi, 3 * 60 + 1)
    places = np.column_stack([10 + 9 * np.cos(turn), 10 + 9 * np.sin(turn), 0.2 + 0.2 * turn / (2 * np.pi)])
    rising = [f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} E0.03" for x, y, z in places]
    found = sheets(*base, "G0 X19 Y10", *rising)

    # A turn is as high as its nozzle in the middle of it.
    assert [sheet.top for sheet in found] == pytest.approx([0.2, 0.3, 0.5, 0.7], abs=0.01)
    assert [sheet.beads.n_beads for sheet in found[1:]] == pytest.approx([60] * 3, abs=4)


def test_a_layer_that_is_not_there_is_refused() -> None:
    deposit, levels = read(*square(0.2))

    with pytest.raises(ValueError, match="layer 1 is not in the file, which has 1 layers"):
        extrusions_of_layer(deposit, levels, 1)


def test_a_file_of_ours_has_the_layers_of_its_program_raft_included() -> None:
    profile = plain(raft_height=0.8, raft_gap=0.2)
    program = slice_stages(box((12, 10, 2)), profile).program
    deposit = extrusions_of_gcode(write_gcode(program, profile))
    levels = file_layers_of(deposit, stack_extrusions(deposit.beads))

    assert levels.top == pytest.approx(program.plan.top, abs=1e-3)
    for number in range(levels.n_layers):
        sheet = extrusions_of_layer(deposit, levels, number)
        own = (program.layer == number) & (program.role != Role.TRAVEL)
        length = float(np.hypot(*(program.xyz - program.start)[own, :2].T).sum())
        assert float(sheet.beads.length.sum()) == pytest.approx(length, abs=0.05)
        # Places and filament are rounded in the text: that is much of the shortest beads.
        assert sheet.beads.width == pytest.approx(program.width[own], rel=0.05)
        assert np.median(sheet.beads.width / program.width[own]) == pytest.approx(1, abs=1e-3)
