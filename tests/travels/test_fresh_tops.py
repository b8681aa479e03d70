"""Travels do not drag over top surfaces that are printed already: they retract, also along the lines of these."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.model import LayerPlan, Mesh, Sections, Toolpaths
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from printer_slicer.travels import travel
from tests.effort import examples
from tests.parts import box, joined, plain, profile, shapely
from tests.travels.places import sections_of, way

HEIGHT, STEP = 0.25, 0.1


def bracket(bosses: tuple[tuple[int, int], ...], size: int) -> Mesh:
    """A plate of 40 x 30 mm with square bosses on it, whose top surface has to go around them."""
    feet = [box((size, size, 2.0), (x, y, 0.0)) for x, y in bosses]
    return joined([box((40, 30, 1.0)), *feet], "bracket")


def unretracted_over_tops(stages: Stages, find_shortest_paths: float) -> Iterator[str]:
    """Travels over top surfaces that are printed before in their layer, sampled, farther than a bead from both ends."""
    paths, travels = stages.toolpaths, stages.travels
    tops = paths.role == Role.TOP_SOLID_INFILL
    for layer in np.unique(paths.layer[tops]).tolist():
        own = np.flatnonzero(tops & (paths.layer == layer))
        beads = np.array(
            [
                shapely.buffer(shapely.LineString(paths.path(i)), 0.49 * float(paths.width[paths.start[i]]))
                for i in own.tolist()
            ]
        )
        for index in np.flatnonzero((paths.layer == layer) & ~travels.retract)[1:].tolist():
            line = way(paths, travels, index)
            length = shapely.length(shapely.LineString(line))
            if paths.layer[index - 1] != layer or length <= find_shortest_paths:
                continue
            at = np.arange(0.5, length - 0.5, STEP)
            points = shapely.points(
                shapely.get_coordinates(shapely.line_interpolate_point(shapely.LineString(line), at))
            )
            printed = shapely.union_all(beads[own < index])
            over = STEP * int(shapely.contains(printed, points).sum())
            if over > 2 * STEP:
                yield f"layer {layer}, travel {index}: {over:.1f} of {length:.1f} mm over the top surface"


corners = st.tuples(st.integers(3, 30), st.integers(3, 20))


@settings(max_examples=examples(12))
@given(
    bosses=st.lists(corners, min_size=1, max_size=3).map(tuple),
    size=st.integers(3, 9),
    angle=st.integers(0, 90),
)
def test_travels_over_printed_top_surfaces_retract(
    bosses: tuple[tuple[int, int], ...], size: int, angle: int
) -> None:
    wanted = plain(infill_angle_deg=angle, infill_density=0.15)
    plan = LayerPlan.from_tops(np.arange(1, 9) * HEIGHT)

    stages = slice_stages(bracket(bosses, size), wanted, plan=plan)

    assert (stages.toolpaths.role == Role.TOP_SOLID_INFILL).any()
    assert not list(unretracted_over_tops(stages, wanted.printer.retract_before_travel))


def along_lines(y: float, *, order: int = 1) -> bool:
    """Whether a way of 20 mm along ten lines of top skin, at `y` from the first, is retracted."""
    sections: Sections = sections_of(shapely.box(0, 0, 40, 40))
    rows = [[(5.0, 10 + 0.4 * i), (30.0, 10 + 0.4 * i)] for i in range(10)]
    ends = [[(8.0, 10 + y)] * 2, [(28.0, 10 + y)] * 2]
    lines = [*rows, *ends][::order]
    roles = [int(Role.TOP_SOLID_INFILL)] * len(rows) + [int(Role.SOLID_INFILL)] * 2
    paths = Toolpaths.gathered(
        sections.plan,
        xy=np.array(lines, np.float64).reshape(-1, 2),
        size=np.full(len(lines), 2),
        layer=np.zeros(len(lines), np.int64),
        role=np.array(roles[::order]),
        width=np.full(2 * len(lines), 0.45),
        closed=False,
    )
    retracted = travel(paths, sections, profile()).retract
    return bool(retracted[11 if order == 1 else 1])


def test_a_travel_between_two_lines_retracts_though_it_crosses_none() -> None:
    assert along_lines(0.6)
    assert along_lines(0.0)


def test_a_travel_beside_the_lines_or_before_they_are_printed_does_not() -> None:
    assert not along_lines(-0.3)
    assert not along_lines(0.6, order=-1)
