"""What holds for any beads: they tile, they move, they swell, they turn; and another engine says the same."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, normalize
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.matching import shift_areas
from printer_slicer.inspection.coverage.measurement import CoverageRules, coverage_of
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.inspection.deposition.marks import Purpose
from tests.effort import examples
from tests.inspection.coverage.lines import WIDTH, beads_along, joined, sections, solid
from tests.parts import shape, shapely
from tests.strategies import star_rings

GAP = float(bead.spacing(WIDTH, 0.2))
ARC = 0.006  # mm that drawn circles and rounded widths may be off


def turned(xy: Float, degrees: float) -> Float:
    angle = np.deg2rad(degrees)
    return np.asarray(xy @ np.array([(cos(angle), sin(angle)), (-sin(angle), cos(angle))]))


def with_ends(beads: Extrusions, begin: Float, end: Float) -> Extrusions:
    return replace(beads, begin=begin, end=end)


def loops(side: float, deep: float, count: int = 1) -> Extrusions:
    """Beads along a rectangle from the origin, one spacing inside each other, the first with its side on the edge."""
    found = []
    for k in range(count):
        a = WIDTH / 2 + k * GAP
        corners = [(a, a), (side - a, a), (side - a, deep - a), (a, deep - a), (a, a)]
        found.append(beads_along(corners, purpose=Purpose.EXTERNAL_PERIMETER))
    return joined(*found)


@given(
    st.integers(3, 40),
    st.floats(3, 25),
    st.sampled_from([0.08, 0.2, 0.32]),
    st.floats(0.36, 0.8),
    st.floats(0, 180),
)
def test_beads_that_tile_a_rectangle_leave_nothing_open_and_nothing_twice(
    rows: int, wide: float, height: float, width: float, degrees: float
) -> None:
    beads = solid(wide, rows, z=height, height=height, width=width)
    gap, side = float(bead.spacing(width, height)), float(bead.compute_side_extension(height))
    deep = rows * gap + 2 * side
    section = np.array([(0, 0), (wide, 0), (wide, deep), (0, deep)])
    tiles = with_ends(beads, turned(beads.begin, degrees), turned(beads.end, degrees))
    coverage = coverage_of(stack_extrusions(tiles), sections([turned(section, degrees)]))

    assert coverage.uncovered.area()[0] == 0
    assert coverage.fill.overlap[0] == 0
    assert coverage.volume[0] == pytest.approx(wide * rows * gap * height)
    # The outline is followed to the side; at the ends the half-circles are left out here.
    assert coverage.fill.shell[0] == pytest.approx(1, abs=0.035)


@given(st.floats(12, 30), st.floats(12, 30), st.floats(-0.35, 0.35), st.floats(0, 90))
def test_a_layer_shifted_across_its_sides_is_off_by_the_shift(
    side: float, deep: float, by: float, degrees: float
) -> None:
    beads = loops(side, deep, 2)
    section = np.array([(0, 0), (side, 0), (side, deep), (0, deep)])
    place = np.array([by, 0.0])
    shifted = with_ends(beads, turned(beads.begin + place, degrees), turned(beads.end + place, degrees))
    coverage = coverage_of(
        stack_extrusions(shifted), sections([turned(section, degrees)]), CoverageRules(shell=2 * GAP)
    )

    assert coverage.outline.p95[0] == pytest.approx(abs(by), abs=ARC)
    # A round corner lacks (√2 - 1)/2 of the width, and more when it is shifted.
    corner = (np.sqrt(2) - 1) * WIDTH / 2
    assert abs(by) - ARC < coverage.outline.largest[0] < abs(by) + corner + ARC
    assert coverage.outside.area()[0] == pytest.approx(
        max(abs(by) - 0.1, 0) * (deep - (4 - pi) * WIDTH / 4), abs=0.08
    )


@given(star_rings(), st.floats(0.5, 1.5))
def test_flow_is_volume(rings: list[Float], share: float) -> None:
    beads = joined(*(beads_along([*map(tuple, ring), tuple(ring[0])]) for ring in rings))
    section = normalize(sections(rings))
    usual = coverage_of(stack_extrusions(beads), section)
    other = coverage_of(
        stack_extrusions(replace(beads, area=beads.area * share)), section, CoverageRules(usual.shell_depth)
    )

    assert other.volume == pytest.approx(usual.volume * share)
    assert other.by_purpose == pytest.approx(usual.by_purpose * share)
    assert other.section_volume == pytest.approx(usual.section_volume)
    order = (usual, other) if share > 1 else (other, usual)
    assert order[0].covered.area()[0] <= order[1].covered.area()[0] + 1e-3
    assert order[0].uncovered.area()[0] >= order[1].uncovered.area()[0] - 1e-3


@given(star_rings(), st.floats(-90, 90), st.floats(-90, 90), st.floats(0, 180))
def test_it_does_not_matter_where_and_how_a_layer_lies(
    rings: list[Float], x: float, y: float, degrees: float
) -> None:
    beads = joined(*(beads_along([*map(tuple, ring), tuple(ring[0])]) for ring in rings))
    rules = CoverageRules(shell=0.8)
    here = coverage_of(stack_extrusions(beads), normalize(sections(rings)), rules)
    place = np.array([x, y])
    there = coverage_of(
        stack_extrusions(
            with_ends(beads, turned(beads.begin, degrees) + place, turned(beads.end, degrees) + place)
        ),
        shift_areas(normalize(sections([turned(ring, degrees) for ring in rings])), (x, y)),
        rules,
    )

    for name in ("covered", "shell", "uncovered", "outside"):
        assert getattr(there, name).area()[0] == pytest.approx(
            getattr(here, name).area()[0], rel=0.01, abs=0.1
        )
    assert there.volume == pytest.approx(here.volume)
    assert there.outline.p95[0] == pytest.approx(here.outline.p95[0], abs=0.01)
    assert there.outline.largest[0] == pytest.approx(here.outline.largest[0], abs=0.02)
    # Cells lie elsewhere: an edge around every piece may be told or not.
    assert there.fill.overlap[0] == pytest.approx(here.fill.overlap[0], rel=0.25, abs=0.5)


def remove_narrow_gaps(area: object, min_gap: float) -> object:
    gone = shapely.buffer(area, -min_gap / 2, join_style="mitre")
    return shapely.intersection(shapely.buffer(gone, min_gap / 2, join_style="mitre"), area)


@given(star_rings(), st.floats(0.3, 0.9), st.floats(0.4, 2.0))
def test_areas_are_those_of_another_engine(rings: list[Float], width: float, depth: float) -> None:
    section = normalize(sections(rings))
    lines = [np.vstack([ring, ring[:1]]) * 0.97 for ring in rings]
    beads = joined(*(beads_along(list(map(tuple, line)), width=width) for line in lines))
    coverage = coverage_of(stack_extrusions(beads), section, CoverageRules(shell=depth))

    part = shape(section, 0)
    covered = shapely.union_all(
        [shapely.buffer(shapely.LineString(line), width / 2, quad_segs=32) for line in lines]
    )
    length = sum(shapely.LineString(line).length for line in lines)
    assert coverage.covered.area()[0] == pytest.approx(covered.area, abs=ARC * (2 * length + 1))
    assert coverage.outside.area()[0] == pytest.approx(
        shapely.difference(covered, shapely.buffer(part, 0.1, join_style="mitre", mitre_limit=2.0)).area,
        abs=ARC * (2 * length + 1) + 0.1,
    )
    # All of a lone layer has air above.
    # A slit hardly wider or narrower than what counts may be told or not.
    bare = shapely.difference(part, covered)
    least, most = (remove_narrow_gaps(bare, min_gap).area for min_gap in (0.11, 0.09))  # type: ignore[attr-defined]
    slack = ARC * (2 * length + part.length) + 0.1
    assert least - slack <= coverage.uncovered.area()[0] <= most + slack


@given(st.floats(1.2, 30), st.floats(1.2, 30))
@example(2.25, 2.25)
def test_round_corners_count_by_their_length(side: float, deep: float) -> None:
    section = np.array([(0, 0), (side, 0), (side, deep), (0, deep)])
    coverage = coverage_of(
        stack_extrusions(loops(side, deep)), sections([section]), CoverageRules(shell=WIDTH)
    )

    half = WIDTH / 2
    along = np.linspace(0, half, 2001)
    angle = np.linspace(0, pi / 4, 2001)
    off = np.concatenate([np.hypot(half - along, half) - half, half * (1 - np.cos(angle))])
    weight = np.repeat([8 * half / 2001, 8 * half * pi / 4 / 2001], 2001)
    straight = 2 * (2 * (side + deep) - 8 * half)
    order = np.argsort(off)
    reached = straight + np.cumsum(weight[order])
    share = reached[-1] - max(0.05 * reached[-1], 2.0)  # 2 mm are let pass
    # The distance grows fast where the straight sides end: samples of the outline are half a mm apart there.
    places = np.clip(np.searchsorted(reached, [share - 0.5, share + 0.5]), 0, len(off) - 1)
    least, most = np.where(reached[0] < share + np.array([-0.5, 0.5]), off[order][places], 0.0)
    assert least - 2 * ARC <= coverage.outline.p95[0] <= most + 2 * ARC
    assert coverage.outline.largest[0] == pytest.approx((np.sqrt(2) - 1) * half, abs=ARC)


# --- spirals ---


def spiral(slope: float, share: float, turns: int = 5, height: float = 0.2) -> tuple[Stack, Areas]:
    """A wall along a cone whose radius grows by `slope` with z, and the sections of its turns."""
    sides = 64
    nth = np.arange(turns * sides + 1)
    z, angle = height * nth / sides, 2 * pi * nth / sides
    middle = 10 + slope * (z - height / 2)
    xy = (middle - WIDTH / 2)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n = len(nth) - 1
    area = np.full(n, share * float(bead.cross_section(WIDTH, height)))
    purpose = np.full(n, Purpose.EXTERNAL_PERIMETER)
    rise = np.full(n, height / sides)
    beads = Extrusions(xy[:-1], xy[1:], z[1:], rise, np.full(n, np.nan), area, purpose, np.zeros(n))
    stack = stack_extrusions(beads)
    around = 2 * pi * np.arange(128) / 128
    unit = np.stack([np.cos(around), np.sin(around)], axis=1)
    return stack, sections(*[[(10 + slope * z) * unit] for z in ((stack.top + stack.bottom) / 2).tolist()])


@settings(max_examples=examples(5))
@given(st.floats(-0.7, 0.7), st.floats(0.9, 1.1))
def test_a_spiral_holds_what_its_wall_needs_however_it_slopes(slope: float, share: float) -> None:
    stack, around = spiral(slope, share)
    coverage = coverage_of(stack, around)

    assert stack.is_spiral
    # Where every wall slopes, how thick they are is only known from what they hold.
    known = share if abs(slope) < 0.05 else max(share, 1.0)
    assert coverage.fill.shell[1:-1] == pytest.approx(np.full(stack.n_layers - 2, known), abs=0.04)


def test_an_upright_spiral_with_too_little_plastic_is_told() -> None:
    stack, around = spiral(0.0, 0.8)

    assert coverage_of(stack, around).fill.shell[1:-1] == pytest.approx(np.full(3, 0.8), abs=0.04)
