"""From G-code text to beads: every way to say the same, purposes, heights, priming, filament."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from printer_slicer.gcode import write_gcode
from printer_slicer.inspection.coverage.extrusions import Extrusions, extrusions_of_program
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions, extrusions_of_gcode
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.pipeline import slice_part
from tests.inspection.coverage.lines import WIDTH, path
from tests.parts import box, plain

SECTION = pi * 1.75**2 / 4
BEAD = 0.2 * (WIDTH - 0.2 * (1 - pi / 4))
E10 = 10 * BEAD / SECTION


def read(*lines: str, diameter: float | None = None) -> GcodeExtrusions:
    return extrusions_of_gcode("\n".join(lines).encode(), filament_diameter=diameter)


def only(*lines: str) -> Extrusions:
    beads = read(*lines).beads
    assert beads.n_beads == 1
    return beads


SAME = {
    "absolute": ["M82", "G92 E0", "G0 X1 Y2 Z0.2", f"G1 X11 E{E10:.9f}"],
    "absolute after other beads": ["M82", "G0 X1 Y2 Z0.2", "G92 E100", f"G1 X11 E{100 + E10:.9f}"],
    "relative": ["M83", "G0 X1 Y2 Z0.2", f"G1 X11 E{E10:.9f}"],
    "relative places": ["M83", "G91", "G0 X1 Y2 Z0.2", f"G1 X10 E{E10:.9f}"],
    "inches": [
        "G20",
        "M83",
        f"G0 X{1 / 25.4:.9f} Y{2 / 25.4:.9f} Z{0.2 / 25.4:.9f}",
        f"G1 X{11 / 25.4:.9f} E{E10 / 25.4:.9f}",
    ],
    "volume": ["M200 D1.75", "M83", "G0 X1 Y2 Z0.2", f"G1 X11 E{10 * BEAD:.9f}"],
    "other places": ["M83", "G0 X1 Y2 Z0.2", "G92 X100 Y100", f"G1 X110 E{E10:.9f}"],
    "numbered, with checksums": ["M83", "N1 G0 X1 Y2 Z0.2*93", f"N2 G1 X11 E{E10:.9f}*7"],
    "after a retraction": ["M83", "G1 E-2", "G0 X1 Y2 Z0.2", "G1 E2", f"G1 X11 E{E10:.9f}"],
    "put back along the bead": ["M83", "G0 X1 Y2 Z0.2", "G1 E-2", f"G1 X11 E{E10 + 2:.9f}"],
    "wiped while retracting": ["M83", "G0 X0 Y2 Z0.2", "G1 X1 E-1", "G1 E1", f"G1 X11 E{E10:.9f}"],
    "with z-hop": ["M83", "G0 Z0.6", "G0 X1 Y2", "G0 Z0.2", f"G1 X11 E{E10:.9f}", "G0 Z0.6"],
}


@pytest.mark.parametrize("lines", SAME.values(), ids=list(SAME))
def test_the_same_bead_is_read_whatever_way_it_is_said(lines: list[str]) -> None:
    beads = only(*lines)

    assert beads.begin[0] == pytest.approx([1, 2])
    assert beads.end[0] == pytest.approx([11, 2])
    assert beads.z_top[0] == pytest.approx(0.2)
    assert beads.area[0] == pytest.approx(BEAD, rel=1e-5)


def test_a_file_may_count_volume_without_a_command_that_says_so() -> None:
    beads = read("M83", "G0 X1 Y2 Z0.2", f"G1 X11 E{10 * BEAD:.9f}", "; use_volumetric_e = 1").beads

    assert beads.area[0] == pytest.approx(BEAD, rel=1e-5)
    assert beads.line[0] == 3


def test_beads_know_their_line() -> None:
    deposit = read("; a header", "M83", "", "G0 X1 Y1 Z0.2", "G1 X5 E1 ; one", "G1 X9 E1")

    assert deposit.beads.line.tolist() == [5, 6]


def test_an_arc_becomes_beads_as_long_as_it_is() -> None:
    beads = read("M83", "G0 X10 Y0 Z0.2", "G3 X0 Y10 I-10 J0 E1").beads

    assert beads.length.sum() == pytest.approx(5 * pi, rel=1e-3)
    assert beads.volume.sum() == pytest.approx(SECTION)
    assert set(beads.line.tolist()) == {3}


def test_what_is_fed_on_the_spot_is_no_bead() -> None:
    deposit = read("M83", "G0 X1 Y1 Z0.2", "G1 E3", "G1 X5 E1")

    assert deposit.beads.n_beads == 1
    assert deposit.standing == pytest.approx(3 * SECTION)


NAMES = [
    (";TYPE:External perimeter", Purpose.EXTERNAL_PERIMETER),
    (";TYPE:Perimeter", Purpose.PERIMETER),
    (";TYPE:Overhang perimeter", Purpose.OVERHANG_PERIMETER),
    (";TYPE:Internal infill", Purpose.INTERNAL_INFILL),
    (";TYPE:Top solid infill", Purpose.TOP_SOLID_INFILL),
    (";TYPE:Bridge infill", Purpose.BRIDGE),
    (";TYPE:Gap fill", Purpose.GAP_FILL),
    (";TYPE:Support material interface", Purpose.SUPPORT_MATERIAL),
    (";TYPE:Skirt/Brim", Purpose.SKIRT),
    (";TYPE:Wipe tower", Purpose.CUSTOM),
    (";TYPE:Outer wall", Purpose.EXTERNAL_PERIMETER),
    ("; FEATURE: Inner wall", Purpose.PERIMETER),
    (";TYPE:Internal solid infill", Purpose.SOLID_INFILL),
    (";TYPE:Bottom surface", Purpose.SOLID_INFILL),
    (";TYPE:Sparse infill", Purpose.INTERNAL_INFILL),
    (";TYPE:WALL-OUTER", Purpose.EXTERNAL_PERIMETER),
    (";TYPE:WALL-INNER", Purpose.PERIMETER),
    (";TYPE:SKIN", Purpose.SOLID_INFILL),
    (";TYPE:FILL", Purpose.INTERNAL_INFILL),
    (";TYPE:SUPPORT-INTERFACE", Purpose.SUPPORT_MATERIAL),
    (";TYPE:PRIME-TOWER", Purpose.CUSTOM),
    (";TYPE:Something else", Purpose.UNKNOWN),
    ("; nothing", Purpose.UNKNOWN),
]


@pytest.mark.parametrize(("comment", "purpose"), NAMES)
def test_the_comments_of_every_slicer_tell_the_purpose(comment: str, purpose: Purpose) -> None:
    beads = read("M83", "G0 X0 Y0 Z0.2", comment, "G1 X5 E1").beads

    assert beads.purpose.tolist() == [purpose]


def test_what_is_laid_before_the_first_layer_comment_primes() -> None:
    beads = read("M83", "G0 X0 Y0 Z0.3", "G1 X50 E5", ";LAYER_CHANGE", "G0 X9 Z0.2", "G1 X20 E1").beads

    assert beads.purpose.tolist() == [Purpose.CUSTOM, Purpose.UNKNOWN]


@pytest.mark.parametrize(
    ("comment", "given", "diameter", "known"),
    [
        ("; filament_diameter = 2.85", None, 2.85, True),
        ("; material.filament_diameter = 2.85", None, 2.85, True),
        ("; filament_diameter = 2.85", 1.75, 1.75, True),
        ("; nothing", None, 1.75, False),
        ("; filament_diameter = none", None, 1.75, False),
    ],
)
def test_the_filament_is_as_thick_as_the_file_says(
    comment: str, given: float | None, diameter: float, known: bool
) -> None:
    deposit = read("M83", "G0 X0 Y0 Z0.2", "G1 X5 E1", comment, diameter=given)

    assert deposit.diameter.tolist() == [diameter]
    assert deposit.diameter_known is known
    assert deposit.beads.volume.sum() == pytest.approx(pi * diameter**2 / 4)


def test_every_tool_has_its_own_filament_and_its_own_retractions() -> None:
    lines = ["; filament_diameter = 1.75,2.85", "M83", "G0 Z0.2", "G1 X5 E1", "G1 E-1", "T1", "G1 X9 E1"]

    assert read(*lines).beads.volume.tolist() == pytest.approx([SECTION, pi * 2.85**2 / 4])


def test_a_program_and_its_text_lay_the_same() -> None:
    profile = plain(layer_height=0.3, infill_density=0.3)
    program = slice_part(box((12, 9, 3)), profile)
    one, moves = extrusions_of_program(program, profile.material.filament_diameter)
    other = extrusions_of_gcode(write_gcode(program, profile)).beads

    assert (program.filament[moves] > 0).all()
    assert other.volume.sum() == pytest.approx(one.volume.sum(), rel=1e-4)
    assert other.length.sum() == pytest.approx(one.length.sum(), rel=1e-3)
    assert sorted(set(np.round(one.z_top, 4))) == sorted(set(np.round(other.z_top, 4)))
    by_purpose = [np.bincount(beads.purpose, beads.volume, len(Purpose)) for beads in (one, other)]
    assert by_purpose[0] == pytest.approx(by_purpose[1], rel=1e-3, abs=0.1)


def test_the_width_of_a_bead_comes_from_what_it_holds() -> None:
    text = "\n".join(["M83", *path([(0, 0), (10, 0), (10, 5)], 0.2, 0.2)])
    beads = extrusions_of_gcode(text.encode()).beads
    flat = Extrusions(
        beads.begin,
        beads.end,
        beads.z_top,
        beads.rise,
        np.full(2, 0.2),
        beads.area,
        beads.purpose,
        beads.line,
    )

    assert flat.width == pytest.approx([WIDTH, WIDTH], abs=1e-4)
