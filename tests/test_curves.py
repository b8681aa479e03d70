"""Arcs: near to the lines they stand for, with the same plastic, and as long in the machine as in the estimate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.commands import split_gcode
from printer_slicer.curves import fit_arcs
from printer_slicer.extrusion import move_seconds
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.parts import box, cone, plain, shapely, sphere

PLAN = LayerPlan.from_tops(np.array([0.2]))


def path_of(
    xy: Float, *, closed: bool, width: Float | None = None, support_ratio: Float | None = None
) -> Toolpaths:
    return Toolpaths.gathered(
        PLAN,
        xy=xy,
        size=np.array([len(xy)]),
        layer=np.array([0]),
        role=np.array([int(Role.EXTERNAL_PERIMETER)]),
        width=np.array([0.45]) if width is None else width,
        closed=closed,
        support_ratio=support_ratio,
    )


def circle(radius: float, n: int, turn: float = 2 * np.pi, begin: float = 0.3) -> Float:
    angle = begin + np.linspace(0, turn, n, endpoint=abs(turn) < 2 * np.pi - 1e-9)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def line_of(paths: Toolpaths) -> shapely.LineString:
    xy = paths.path(0)
    return shapely.LineString(np.concatenate([xy, xy[:1]]) if paths.closed[0] else xy)


def arcs(paths: Toolpaths) -> int:
    """How many arcs there are."""
    centre = paths.centre
    return int(
        (
            np.isfinite(centre[:, 0]) & (np.append([[np.nan] * 2], centre[:-1], axis=0) != centre).any(axis=1)
        ).sum()
    )


@pytest.mark.parametrize("radius", [3.0, 5.0, 60.0])
@pytest.mark.parametrize("way", [1, -1])
def test_a_circle_becomes_three_arcs_about_its_middle(radius: float, way: int) -> None:
    after = fit_arcs(path_of(circle(radius, 120)[::way], closed=True), plain(arc_tolerance=0.05))

    assert 3 <= arcs(after) <= 5
    assert after.centre == pytest.approx(np.zeros((len(after.xy), 2)), abs=1e-3 * radius)
    assert np.hypot(*after.xy.T) == pytest.approx(radius, rel=1e-4)


@given(
    seed=st.integers(0, 10**6), n=st.integers(2, 80), tolerance=st.floats(0.005, 0.2), closed=st.booleans()
)
def test_no_point_is_farther_off_than_the_tolerance(
    seed: int, n: int, tolerance: float, closed: bool
) -> None:
    """Wavy paths, curved here and cornered there."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0, 0.2, n) + rng.choice([0, 1.5], n, p=[0.95, 0.05]))
    xy = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * rng.uniform(0.05, 1, (n, 1)), axis=0)
    before = path_of(xy, closed=closed and n > 2)

    after = fit_arcs(before, plain(arc_tolerance=tolerance))

    old, new = line_of(before), line_of(after)
    # The chords that a machine makes of an arc lie inside of it.
    assert shapely.hausdorff_distance(old, new, densify=0.02) <= tolerance + 0.012
    assert after.path(0)[0] == pytest.approx(before.path(0)[0])
    if not before.closed[0]:
        assert after.path(0)[-1] == pytest.approx(before.path(0)[-1])
    assert np.isfinite(after.xy).all()


def test_circles_so_small_that_their_chords_would_outrun_the_planner_stay_lines() -> None:
    assert arcs(fit_arcs(path_of(circle(1.5, 60), closed=True), plain(arc_tolerance=0.05))) == 0


def test_beads_whose_width_changes_and_those_that_hang_stay_lines() -> None:
    xy = circle(5, 60, turn=2.0)
    wavy = fit_arcs(path_of(xy, closed=False, width=np.linspace(0.3, 0.6, 60)), plain(arc_tolerance=0.05))
    carried = np.where(np.arange(60) < 30, 1.0, 0.4)
    hanging = fit_arcs(path_of(xy, closed=False, support_ratio=carried), plain(arc_tolerance=0.05))

    assert arcs(wavy) == 0
    assert arcs(hanging) == 2
    assert set(hanging.support_ratio.tolist()) == {1.0, 0.4}


def test_corners_and_straight_lines_are_no_arcs() -> None:
    square = np.array([(0, 0), (5, 0), (10, 0), (10, 5), (10, 10), (0, 10)], float)

    assert arcs(fit_arcs(path_of(square, closed=True), plain(arc_tolerance=0.1))) == 0


@pytest.mark.parametrize("mesh", [cone(12, 4), sphere(5), box((10, 10, 2))], ids=lambda mesh: mesh.name)
def test_files_with_arcs_say_the_same_in_fewer_lines(mesh) -> None:  # type: ignore[no-untyped-def]
    wanted, usual = plain(arc_tolerance=0.03), plain()
    program, lines = slice_stages(mesh, wanted).program, slice_stages(mesh, usual).program
    text, longer = gcode_of(program, wanted), gcode_of(lines, usual)

    round_about = text.count(b"\nG2 ") + text.count(b"\nG3 ")
    assert (round_about > 20) == (mesh.name != "box")
    assert len(text.splitlines()) <= len(longer.splitlines()) + 1
    assert program.filament_used == pytest.approx(lines.filament_used, rel=2e-3)
    moves = read_moves(
        split_gcode(text).commands, wanted.printer.corners[0], FLAVOURS[wanted.printer.flavour]
    )
    # What the machine makes of the arcs is what was planned.
    done = shapely.linestrings(moves.end[:, :2])
    shapely.prepare(done)
    chords = program.xyz[np.isfinite(program.centre[:, 0])]
    assert shapely.distance(done, shapely.points(chords[:, :2])).max(initial=0.0) < 0.02
    assert moves.delta[:, 3].sum() == pytest.approx(program.filament.sum(), abs=1e-3)
    # The way to the first bead is not part of the estimate.
    late = read_moves(
        split_gcode(longer).commands, wanted.printer.corners[0], FLAVOURS[wanted.printer.flavour]
    )
    extra = late.seconds(limits_of(wanted.printer)) - float(move_seconds(lines, usual).sum())
    told = moves.seconds(limits_of(wanted.printer)) - extra
    assert told == pytest.approx(float(move_seconds(program, wanted).sum()), rel=1e-3)
