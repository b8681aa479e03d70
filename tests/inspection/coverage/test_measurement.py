"""The coverage of beads whose answers are known: areas, fill, overlap, unsupported extrusion, outlines."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.geometry import Areas
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.limits import excess_ratio, findings
from printer_slicer.inspection.coverage.matching import fit_sections, guess_shift, shift_areas
from printer_slicer.inspection.coverage.measurement import Coverage, CoverageRules, coverage_of, find_overlaps
from printer_slicer.inspection.coverage.stack import stack_extrusions
from printer_slicer.inspection.deposition.marks import Purpose
from tests.effort import examples
from tests.inspection.coverage.lines import WIDTH, beads_along, joined, sections, solid, square

HEIGHT = 0.2
GAP = float(bead.spacing(WIDTH, HEIGHT))
RULES = CoverageRules()
ROUND = 0.01  # mm² that the chords of a round end may lack


def ring(
    side: float, z: float = HEIGHT, inset: float = WIDTH / 2, purpose: Purpose = Purpose.UNKNOWN
) -> Extrusions:
    """A closed bead along a square of this side, `inset` within it."""
    a, b = inset, side - inset
    return beads_along([(a, a), (b, a), (b, b), (a, b), (a, a)], z=z, purpose=purpose)


def account(beads: Extrusions, *rings: list[np.ndarray], rules: CoverageRules = RULES) -> Coverage:  # type: ignore[type-arg]
    return coverage_of(stack_extrusions(beads), sections(*rings), rules)


# --- areas ---


def test_one_loop_covers_its_outline() -> None:
    coverage = account(ring(20), [square(20)])

    assert coverage.covered.area()[0] == pytest.approx(
        4 * WIDTH * (20 - WIDTH) - (4 - pi) * WIDTH**2 / 4, abs=ROUND
    )
    assert coverage.outside.area()[0] == 0
    assert coverage.volume.tolist() == pytest.approx([4 * (20 - WIDTH) * GAP * HEIGHT])
    assert coverage.section_volume.tolist() == pytest.approx([400 * HEIGHT])


def test_the_shell_that_one_loop_leaves_open_is_uncovered() -> None:
    coverage = account(ring(20), [square(20), square(12, (4, 4))[::-1]], rules=CoverageRules(shell=1.0))

    # Nothing lies along the hole; there the shell, and where air begins above and below, is the whole section.
    wanted = 400 - 144 - float(coverage.covered.area()[0])
    assert coverage.shell.area()[0] == pytest.approx(400 - 144)
    assert coverage.uncovered.area()[0] == pytest.approx(wanted, abs=0.1)


def test_what_is_laid_beyond_the_section_is_outside() -> None:
    coverage = account(
        beads_along([(0, 5), (30, 5)]), [square(20)], rules=CoverageRules(outside_tolerance=0.1)
    )

    # From the left, half a round end; from the right 10 mm and half a round end; but for 0.1 mm on either side.
    long = 10 * WIDTH + pi * WIDTH**2 / 4 - 2 * 0.1 * WIDTH
    assert coverage.outside.area()[0] == pytest.approx(long, abs=0.01)


def test_gaps_narrower_than_a_slit_are_not_told() -> None:
    beads = joined(beads_along([(0, 0.225), (20, 0.225)]), beads_along([(0, 0.725), (20, 0.725)]))
    section = np.array([(0, 0), (20, 0), (20, 0.95), (0, 0.95)])
    narrow, wide = (
        account(beads, [section], rules=CoverageRules(min_gap=min_gap)).uncovered.area()[0]
        for min_gap in (0.06, 0.04)
    )

    assert narrow == pytest.approx(0, abs=0.02)
    assert wide == pytest.approx(20 * 0.05, abs=0.05)


# --- fill and overlap ---


@pytest.mark.parametrize("height", [0.1, 0.2, 0.32])
def test_beads_a_spacing_apart_fill_a_layer_just_once(height: float) -> None:
    rows = 30
    beads = solid(12.0, rows, z=height, height=height)
    gap, side = float(bead.spacing(WIDTH, height)), float(bead.compute_side_extension(height))
    wide = rows * gap + 2 * side
    coverage = account(beads, [np.array([(0, 0), (12, 0), (12, wide), (0, wide)])])

    assert coverage.fill.overlap.tolist() == [0]
    assert coverage.fill.most[0] == pytest.approx(1, abs=0.02)
    assert coverage.fill.shell[0] == pytest.approx(1, abs=0.02)
    assert coverage.volume[0] == pytest.approx(12 * rows * gap * height)


@pytest.mark.parametrize("degrees", [0, 17, 30, 45])
def test_it_does_not_matter_in_which_direction_a_layer_is_filled(degrees: float) -> None:
    beads, turn = solid(12.0, 30), np.deg2rad(degrees)
    matrix = np.array([(np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))])
    wide = 30 * GAP + (WIDTH - GAP)
    section = np.array([(0, 0), (12, 0), (12, wide), (0, wide)]) @ matrix
    coverage = account(replace(beads, begin=beads.begin @ matrix, end=beads.end @ matrix), [section])

    assert coverage.fill.overlap.tolist() == [0]
    assert coverage.fill.most[0] == pytest.approx(1, abs=0.03)
    assert coverage.fill.shell[0] == pytest.approx(1, abs=0.02)


def test_large_plates_have_coarser_cells() -> None:
    far = joined(solid(12.0, 30), beads_along([(200, 200), (210, 200)]))
    wide = 30 * GAP + (WIDTH - GAP)
    coverage = account(far, [np.array([(0, 0), (12, 0), (12, wide), (0, wide)]), square(9.9, (200, 199.775))])

    assert (account(solid(12.0, 30), [square(12)]).fill.cell, coverage.fill.cell) == (0.1, 0.2)
    assert coverage.fill.most[0] == pytest.approx(1, abs=0.06)
    assert coverage.volume[0] == pytest.approx(far.volume.sum())


def test_the_inside_of_a_right_angled_corner_is_not_told() -> None:
    coverage = account(joined(ring(20), ring(20, inset=WIDTH / 2 + GAP)), [square(20)])

    assert coverage.fill.overlap.tolist() == [0]
    assert 1 < coverage.fill.most[0] < 1.3


@pytest.mark.parametrize("filled", [False, True])
def test_a_shell_with_nothing_inside_is_full_but_for_three_hundredths(filled: bool) -> None:
    """It needs what the round sides along the outline leave empty, too, from a wider inner perimeter."""
    inner = ring(20, inset=WIDTH / 2 + GAP)
    sides = 80 * float(bead.compute_side_extension(HEIGHT)) / (4 * (20 - WIDTH - 2 * GAP)) / GAP
    beads = joined(ring(20), replace(inner, area=inner.area * (1 + sides)) if filled else inner)
    stack = stack_extrusions(
        joined(beads, replace(beads, z_top=beads.z_top * 2), replace(beads, z_top=beads.z_top * 3))
    )
    coverage = coverage_of(stack, sections(*[[square(20)]] * 3), CoverageRules(shell=2 * GAP + WIDTH - GAP))

    # Half of what makes the inner one wider lies inside of the shell.
    missing = float(bead.compute_side_extension(HEIGHT)) / (2 * GAP) / (2 if filled else 1)
    assert coverage.fill.shell[1] == pytest.approx(0.985 - missing, abs=0.016)


@pytest.mark.parametrize("share", [0.5, 0.8, 1.2])
def test_the_shell_holds_as_much_as_is_laid(share: float) -> None:
    beads = solid(12.0, 30)
    wide = 30 * GAP + (WIDTH - GAP)
    some = Extrusions(
        beads.begin,
        beads.end,
        beads.z_top,
        beads.rise,
        beads.height,
        beads.area * share,
        beads.purpose,
        beads.line,
    )
    coverage = account(some, [np.array([(0, 0), (12, 0), (12, wide), (0, wide)])])

    assert coverage.fill.shell[0] == pytest.approx(share, rel=0.03)


def test_a_bead_laid_twice_overlaps_along_its_length() -> None:
    once = account(beads_along([(0, 5), (18, 5)]), [square(20)])
    twice = account(joined(*[beads_along([(0, 5), (18, 5)])] * 2), [square(20)])

    assert once.fill.overlap.tolist() == [0]
    # Windows are as wide as the bead and empty on either side of it: only those over its middle are too full.
    assert 0.3 * 18 * WIDTH < twice.fill.overlap[0] < 18 * WIDTH
    assert twice.fill.most[0] == pytest.approx(2 * GAP / 0.5, abs=0.1)
    x, y = twice.fill.place[0]
    assert 0 <= x <= 18
    assert y == pytest.approx(5, abs=0.2)
    assert find_overlaps(twice, 0).area()[0] == pytest.approx(twice.fill.overlap[0], abs=0.01)


def test_short_beads_however_many_do_not_change_how_overlap_is_judged() -> None:
    twice = joined(*[beads_along([(0, 5), (18, 5)])] * 2)
    dots = joined(*(beads_along([(x / 5, 15), (x / 5 + 0.1, 15)], width=HEIGHT) for x in range(80)))
    alone, among = account(twice, [square(20)]), account(joined(twice, dots), [square(20)])

    assert among.fill.overlap == pytest.approx(alone.fill.overlap)
    assert among.fill.most == pytest.approx(alone.fill.most)


# --- unsupported extrusion ---


BELOW = (0.2, 0.4, 0.6, 0.8)


def two_posts(top: Extrusions) -> Coverage:
    """Two blocks 25 mm apart, 0.8 mm high, and beads above them."""
    blocks = (
        beads_along([(x, y * GAP), (x + 5, y * GAP)], z=z)
        for z in BELOW
        for x in (0.0, 30.0)
        for y in range(20)
    )
    low = [square(5), square(5, (30, 0))]
    return account(joined(*blocks, top), *[low] * 4, [square(35)])


def test_on_the_bed_nothing_hangs() -> None:
    assert account(ring(20), [square(20)]).unsupported_length.tolist() == [0]


def test_a_straight_bead_over_a_gap_that_is_held_at_both_ends_is_a_bridge() -> None:
    assert two_posts(beads_along([(1, 3), (34, 3)], z=1.0)).unsupported_length.tolist() == [0] * 5


def test_a_bead_that_ends_in_the_air_hangs_but_for_what_is_near_its_hold() -> None:
    coverage = two_posts(beads_along([(1, 3), (25, 3)], z=1.0))

    assert coverage.unsupported_length[:4].tolist() == [0] * 4
    assert coverage.unsupported_length[4] == pytest.approx(20 - 5, abs=0.8)
    (one,) = coverage.unsupported
    assert (one.x, one.y) == pytest.approx((10, 3), abs=0.8)
    assert one.z == pytest.approx(1.0)


def test_a_bead_that_turns_in_the_air_hangs() -> None:
    coverage = two_posts(beads_along([(1, 1), (20, 1), (20, 4), (1, 4)], z=1.0))

    assert coverage.unsupported_length[4] == pytest.approx(2 * (15 - 5) + 3, abs=1.6)


def test_a_bead_a_little_beside_the_one_below_rests_on_it() -> None:
    near, far = (
        account(joined(*(ring(20, z=z) for z in BELOW), ring(20, z=1.0, inset=inset)), *[[square(20)]] * 5)
        for inset in (-0.1, -1.5)
    )

    assert near.unsupported_length.tolist() == [0] * 5
    assert far.unsupported_length[4] == pytest.approx(4 * 23, abs=0.5)


def test_supports_carry_what_is_laid_over_them_at_a_little_distance() -> None:
    post = [beads_along([(0, y * GAP), (5, y * GAP)], z=z) for z in BELOW for y in range(20)]
    over = beads_along([(1, 3), (20, 3)], z=1.0)
    support = [beads_along([(5, 3), (25, 3)], z=z, purpose=Purpose.SUPPORT_MATERIAL) for z in BELOW[:3]]
    rings = [*[[square(5)]] * 4, [square(25)]]

    assert account(joined(*post, over), *rings).unsupported_length[4] > 8
    assert account(joined(*post, *support, over), *rings).unsupported_length.tolist() == [0] * 5


# --- outlines ---


@pytest.mark.parametrize("off", [0.0, 0.2, -0.2])
def test_the_outline_is_off_by_how_much_the_part_is_too_large(off: float) -> None:
    beads = joined(ring(20, inset=WIDTH / 2 - off), ring(20, inset=WIDTH / 2 - off + GAP))
    coverage = account(beads, [square(20)], rules=CoverageRules(shell=0.8))

    assert coverage.outline.p95[0] == pytest.approx(abs(off), abs=0.02)
    # At corners beads are round.
    assert coverage.outline.largest[0] <= np.hypot(off, off) + 0.1


def test_a_void_inside_does_not_change_the_outline() -> None:
    beads = joined(ring(6), ring(6, inset=WIDTH / 2 + GAP))
    coverage = account(beads, [square(6)], rules=CoverageRules(shell=3.0))

    assert coverage.uncovered.area()[0] > 10
    assert coverage.outline.largest[0] < 0.1


# --- matching ---


@settings(max_examples=examples(15))
@given(
    st.floats(-50, 150),
    st.floats(-50, 150),
    st.floats(6, 30),
    st.floats(6, 30),
    st.sampled_from(list(Purpose)[:2]),
)
def test_a_box_is_found_wherever_it_is_printed(
    x: float, y: float, wide: float, deep: float, purpose: Purpose
) -> None:
    half = WIDTH / 2
    corners = [
        (half, half),
        (wide - half, half),
        (wide - half, deep - half),
        (half, deep - half),
        (half, half),
    ]
    beads = beads_along([(a + x, b + y) for a, b in corners], purpose=purpose)
    stack = stack_extrusions(beads)
    section = sections([np.array([(0, 0), (wide, 0), (wide, deep), (0, deep)])])
    guess = guess_shift(stack, section)
    match = fit_sections(stack, shift_areas(section, guess))

    assert np.add(guess, match.shift) == pytest.approx([x, y], abs=2e-3)
    assert match.share == 1
    coverage = coverage_of(stack, shift_areas(section, np.add(guess, match.shift)))
    assert coverage.volume.sum() == pytest.approx(beads.volume.sum())
    assert coverage.outside.area().sum() == pytest.approx(0, abs=1e-3)
    assert (coverage.covered.area() <= section.area() + 0.1).all()


def test_layers_and_sections_must_be_as_many() -> None:
    with pytest.raises(ValueError, match="1 layers, but there are 2 sections"):
        coverage_of(stack_extrusions(ring(20)), Areas.empty(2))


def test_findings_are_runs_of_layers_and_the_worst_comes_first() -> None:
    beads = joined(*(ring(20, z=0.2 * (k + 1), inset=-2.0 if k in {3, 4} else WIDTH / 2) for k in range(8)))
    found = findings(account(beads, *[[square(20)]] * 8, rules=CoverageRules(shell=0.4)))
    outside = [one for one in found if one.code == "outside"]

    assert [(one.first, one.last) for one in outside] == [(4, 5)]
    assert [excess_ratio(one) for one in found] == sorted(map(excess_ratio, found), reverse=True)
    assert outside[0].line > 0


def test_ironing_does_not_overlap() -> None:
    beads = solid(12.0, 20)
    wide = 20 * GAP + (WIDTH - GAP)
    section = [np.array([(0, 0), (12, 0), (12, wide), (0, wide)])]
    iron = beads_along([(0, 4), (12, 4)], purpose=Purpose.IRONING)

    assert account(joined(beads, iron), section).fill.overlap.tolist() == [0]
    assert account(joined(beads, beads_along([(0, 4), (12, 4)])), section).fill.overlap[0] > 3
