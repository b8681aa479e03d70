"""Links: no stretch of a file asks for more lines than the link brings, and what that costs is told."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.extrusion import move_seconds
from printer_slicer.link_limiter import find_underruns
from printer_slicer.model import LayerPlan, Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.parts import plain, shapely, sphere

PLAN = LayerPlan.from_tops(np.arange(1, 13) * 0.25)


def sliced(**changes: object) -> tuple[Stages, Profile]:
    wanted = plain(**{"resolution": 0.001, "quality.speeds.external_perimeter": 120} | changes)
    return slice_stages(sphere(8), wanted, plan=PLAN), wanted


def waits(program: Program, profile: Profile, rate: float) -> float:
    """Seconds that a machine waits which takes up lines as they come and holds as many as its firmware does."""
    seconds, held = move_seconds(program, profile), profile.printer.firmware.planner_blocks
    clock, waited, begun = 0.0, 0.0, [0.0] * len(seconds)
    arrival = 0.0
    for k, lasts in enumerate(seconds.tolist()):
        # A line is sent when the one before it has arrived and there is room for it.
        arrival = max(arrival, begun[k - held] if k >= held else 0.0) + 1 / rate
        start = max(clock, arrival)
        waited += start - clock if k > held else 0.0
        begun[k], clock = start, start + lasts
    return waited


@pytest.mark.parametrize("rate", [25.0, 45.0])
@pytest.mark.parametrize("arcs", [0.0, 0.03])
def test_the_machine_never_waits_for_lines(rate: float, arcs: float) -> None:
    before, usual = sliced(arc_tolerance=arcs)
    after, wanted = sliced(arc_tolerance=arcs, link_lines_per_second=rate)

    assert after.link is not None
    assert not find_underruns(after.program, wanted).any()
    if not arcs:
        assert waits(before.program, usual, rate) > 0.2
        assert waits(after.program, wanted, rate) < 0.02
    assert after.program.filament_used == pytest.approx(before.program.filament_used, rel=0.01)


def test_the_report_says_where_and_what_it_cost() -> None:
    before, usual = sliced()
    after, wanted = sliced(link_lines_per_second=25)

    link = after.link
    assert link is not None
    busy = find_underruns(before.program, plain(link_lines_per_second=25))
    assert set(link.layers) == set((np.unique(before.program.layer[busy]) + 1).tolist())
    assert link.merged == before.program.n_moves - after.program.n_moves > 0
    lost = move_seconds(after.program, wanted).sum() - move_seconds(before.program, usual).sum()
    assert link.seconds == pytest.approx(lost)
    assert link.slowed > 0


def test_merging_moves_nothing_by_more_than_the_tolerance() -> None:
    before, _ = sliced()
    after, _ = sliced(link_lines_per_second=25, link_tolerance=0.02)

    for role in (Role.EXTERNAL_PERIMETER, Role.PERIMETER):
        for layer in (3, 8):
            old, new = (
                shapely.union_all(
                    [
                        shapely.linearrings(paths.path(i))
                        for i in np.flatnonzero(
                            (paths.role == role) & (paths.layer == layer) & paths.closed
                        ).tolist()
                    ]
                )
                for paths in (before.toolpaths, after.toolpaths)
            )
            assert shapely.hausdorff_distance(old, new, densify=0.02) < 0.021


def test_arcs_stay_arcs_when_what_follows_them_is_merged() -> None:
    after, wanted = sliced(arc_tolerance=0.03, link_lines_per_second=20)
    program = after.program

    chords = np.isfinite(program.centre[:, 0])
    out, home = (ends[chords, :2] - program.centre[chords] for ends in (program.start, program.xyz))
    assert chords.sum() > 200
    assert np.hypot(*out.T) == pytest.approx(np.hypot(*home.T), abs=0.002)
    assert not find_underruns(program, wanted).any()


def test_a_quick_link_changes_nothing() -> None:
    before, _ = sliced()
    after, _ = sliced(link_lines_per_second=100_000)

    assert np.array_equal(before.program.xyz, after.program.xyz)
    assert np.array_equal(before.program.speed, after.program.speed)
    assert after.link is not None
    assert after.link.layers == ()
    assert before.link is None


def test_lines_that_are_no_moves_count() -> None:
    said = "\n".join(["M117 here"] * 5)
    plainly, usual = sliced(link_lines_per_second=45)
    talking, wanted = sliced(link_lines_per_second=45, layer_gcode=said)

    assert talking.link is not None
    assert not find_underruns(plainly.program, usual).any()
    assert find_underruns(plainly.program, wanted).any()
    assert not find_underruns(talking.program, wanted).any()
    assert not talking.link.waits


def test_what_cannot_be_helped_is_told() -> None:
    """More lines at once than the firmware holds: nothing before them can be so slow that they come in time."""
    stages, wanted = sliced(link_lines_per_second=5, layer_gcode="\n".join(["M117 here"] * 60))

    link, left = stages.link, find_underruns(stages.program, wanted)
    assert link is not None
    assert set(link.waits) == set((np.unique(stages.program.layer[left]) + 1).tolist())
    assert link.waits
