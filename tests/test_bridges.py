"""Bridges run so that their lines rest at both ends, and of such directions along the shortest way."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from benchmarks.gallery import ENTRIES
from printer_slicer.arrays import Float
from printer_slicer.bridges import find_bridge_angles
from printer_slicer.geometry import Areas, hatch, offset_open, split_connected
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.effort import crossed, few_of
from tests.parts import box, joined, plain, prism, shape, shapely

SPACING = np.array([0.45])
USUAL = np.deg2rad(45)
ANCHOR = 1.5
WALLS = (Role.EXTERNAL_PERIMETER, Role.PERIMETER)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Any:
    return shapely.box(x0, y0, x1, y1)


def disc(radius: float) -> Any:
    return shapely.buffer(shapely.points(0, 0), radius, quad_segs=32)


def ring(outer: float, inner: float) -> Any:
    return shapely.difference(disc(outer), disc(inner))


def frame(room: Any) -> Any:
    """A wall of 4 mm all around a room."""
    return shapely.difference(shapely.buffer(room, 4, join_style="mitre"), room)


def stack(area: Any) -> Areas:
    parts = shapely.get_parts(shapely.orient_polygons(area))
    rings = [np.array(line.coords[:-1]) for part in parts for line in (part.exterior, *part.interiors)]
    return Areas.from_rings([rings])


def bridged(room: Any, support: Any) -> tuple[float, float, float]:
    """Direction of the bridge in degrees, how much of its lines rests at both ends, and how long the longest is."""
    grown = shapely.intersection(
        shapely.buffer(room, ANCHOR, join_style="mitre"), shapely.union(room, support)
    )
    bridge = stack(
        max(shapely.get_parts(grown), key=shapely.area)
    )  # turned, corners may be cut off by rounding
    angle, held = find_bridge_angles(split_connected(bridge), stack(support), SPACING, USUAL)
    assert held.all()
    assert np.ptp(angle) == 0
    lines = hatch(bridge, angle=angle[0], spacing=SPACING)
    on = shapely.buffer(shape(stack(support), 0), 1e-3)
    rests = shapely.intersects(on, shapely.points(lines.ends)).all(axis=1)
    length = lines.length()
    return np.rad2deg(angle[0]) % 180, length[rests].sum() / length.sum(), float(length.max())


LETTER = shapely.union(rectangle(0, 0, 30, 8), rectangle(0, 0, 8, 30))
CASES = {
    "two sides": (
        rectangle(0, 0, 20, 10),
        shapely.union(rectangle(-4, -4, 0, 14), rectangle(20, -4, 24, 14)),
    ),
    "four sides": (rectangle(0, 0, 20, 10), frame(rectangle(0, 0, 20, 10))),
    "a square": (rectangle(0, 0, 20, 20), frame(rectangle(0, 0, 20, 20))),
    "three sides": (
        rectangle(0, 0, 20, 10),
        shapely.difference(frame(rectangle(0, 0, 20, 10)), rectangle(20, -9, 30, 19)),
    ),
    "a round room": (disc(10), ring(14, 10)),
    "a ring": (ring(10, 4), shapely.union(ring(14, 10), disc(4))),
    "an L-shaped room": (LETTER, frame(LETTER)),
}
# Degrees, and the longest line, mm, with its anchors.
FOUND = {
    "two sides": (0, 23),
    "four sides": (90, 13),
    "a square": (0, 23),
    "three sides": (90, 13),
    "a round room": (0, 23),
    "a ring": (None, 23),
    "an L-shaped room": (45, 26),
}


@pytest.mark.parametrize("name", CASES)
def test_lines_over_a_room_rest_at_both_ends_and_go_the_shortest_way(name: str) -> None:
    angle, share, longest = bridged(*CASES[name])

    wanted, most = FOUND[name]
    assert share > 0.99
    assert longest < most + 0.1
    if wanted is not None:
        assert angle == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("degrees", [0, 10, 20, 45, 70, 85])
def test_bridges_of_a_turned_part_are_turned_with_it(degrees: int) -> None:
    room, support = (shapely.affinity.rotate(one, degrees, origin=(0, 0)) for one in CASES["two sides"])
    between = (bridged(room, support)[0] - degrees + 90) % 180 - 90

    assert abs(between) <= 5


def test_over_a_corner_lines_run_from_one_wall_to_the_other() -> None:
    """Held along two sides that meet: straight lines would rest at one end only."""
    corner = shapely.union(rectangle(-4, -4, 0, 20), rectangle(-4, -4, 20, 0))
    angle, share, _ = bridged(rectangle(0, 0, 20, 20), corner)

    assert angle == pytest.approx(135)
    assert share > 0.45  # beyond the diagonal nothing can rest at both ends


def test_what_is_held_on_one_side_only_has_lines_that_run_out_from_there() -> None:
    angle, share, _ = bridged(rectangle(0, 0, 5, 30), rectangle(-4, -4, 0, 34))

    assert angle == pytest.approx(0, abs=1e-6)
    assert share < 0.1


def covered_room(size: tuple[float, float, float], wall: float) -> Mesh:
    """A lid 1 mm thick over a room of that size, with walls as thick all around."""
    x, y, z = size
    sides = [
        box((x + 2 * wall, wall, z)),
        box((x + 2 * wall, wall, z), (0, wall + y, 0)),
        box((wall, y + 2 * wall, z)),
        box((wall, y + 2 * wall, z), (wall + x, 0, 0)),
    ]
    return joined([*sides, box((x + 2 * wall, y + 2 * wall, 1), (0, 0, z))], "covered room")


def test_what_lies_beside_the_lines_of_a_bridge_is_not_bridged() -> None:
    room, wall = (24.0, 10.0, 4.0), 8.0
    stages = slice_stages(covered_room(room, wall), plain(infill_density=0.15, layer_height=0.2))

    bridge = stages.regions.bridge
    (layer,) = set(bridge.ring_layer.tolist())
    low, high = bridge.xy.min(axis=0), bridge.xy.max(axis=0)
    assert np.cos(stages.regions.bridge_angle) == pytest.approx(0, abs=1e-6)  # the short way
    assert high[1] - low[1] == pytest.approx(room[1] + 2 * ANCHOR, abs=0.01)
    # What is solid anyway, over the perimeters around the room, is bridged too, and no more.
    assert room[0] < high[0] - low[0] < room[0] + 2 * 1.1
    assert shape(stages.regions.internal_infill, layer).distance(shape(bridge, layer)) < 1e-3


def test_no_dots_of_sparse_infill_are_laid_beside_bridges() -> None:
    """Between a round room and a wall near it, what is left is too narrow for sparse infill."""
    entry = ENTRIES["bridge"]
    stages = slice_stages(entry.part(), plain(infill_density=0.15))
    regions, paths, layer = stages.regions, stages.toolpaths, entry.layer - 1

    assert regions.bridge.area()[layer] > 300
    assert regions.internal_bridge.area()[layer] == 0
    sparse = shape(regions.internal_infill, layer)
    useful = shape(offset_open(regions.internal_infill, 1.4 * 0.45), layer)
    assert all(part.intersects(useful) for part in shapely.get_parts(sparse))
    here = np.flatnonzero((paths.layer == layer) & (paths.role == Role.INTERNAL_INFILL))
    assert min(shapely.LineString(paths.path(int(i))).length for i in here) > 3


def lid_over(room: list[tuple[float, float]], wall: float) -> Mesh:
    """A lid 1 mm thick over a convex room, 4 mm high, with walls as thick all around."""
    inner = np.array(room, dtype=np.float64)
    around = shapely.orient_polygons(shapely.Polygon(inner).buffer(wall, join_style="mitre"))
    outer = np.asarray(around.exterior.coords)[:-1]
    outer = np.roll(outer, -int(np.argmin(np.hypot(*(outer - inner[0]).T))), axis=0)
    after, beyond = np.roll(inner, -1, axis=0), np.roll(outer, -1, axis=0)
    sides = [prism(np.array(quad), 4.0) for quad in zip(outer, beyond, after, inner, strict=True)]
    return joined([*sides, prism(outer, 1.0).moved((0, 0, 4))], "lid")


ROOMS = {
    "straight": [(0, 0), (24, 0), (24, 10), (0, 10)],
    "slanted": [(0, 0), (24, 0), (30, 10), (6, 10)],
    "pointed": [(0, 0), (24, 0), (8, 14)],
    "six-sided": [(10 * np.cos(turn), 10 * np.sin(turn)) for turn in np.arange(6) * np.pi / 3],
}


def threads_of(stages: Stages, width: float) -> tuple[int, list[Float]]:
    """The layer of the only bridge, and its threads; wedges at its sides hold beads of varying width."""
    paths = stages.toolpaths
    (layer,) = set(stages.regions.bridge.ring_layer.tolist())
    here = np.flatnonzero((paths.layer == layer) & (paths.role == Role.BRIDGE)).tolist()
    whole = [i for i in here if (paths.width[paths.start[i] : paths.start[i + 1]] == width).all()]
    return layer, [paths.path(i) for i in whole]


@pytest.mark.parametrize(("name", "how"), crossed(ROOMS, list(product([True, False], ENGINES))))
def test_threads_begin_and_end_in_the_wall_and_turn_beside_it(name: str, how: tuple[bool, str]) -> None:
    """No wall here meets the threads at less than 26°; beside such walls beads of their own lie along it."""
    thick, engine = how
    wanted = plain(infill_density=0.15, layer_height=0.2, thick_bridges=thick)
    with using_engine(engine):
        stages = slice_stages(lid_over(ROOMS[name], 1.2), wanted)

    paths, half = stages.toolpaths, wanted.extrusion_width / 2
    layer, threads = threads_of(stages, wanted.printer.nozzle_diameter if thick else wanted.extrusion_width)
    here = np.flatnonzero((paths.layer == layer) & np.isin(paths.role, WALLS) & paths.closed)
    walls = shapely.union_all([shapely.LinearRing(paths.path(i)) for i in here.tolist()])
    ends = shapely.points([place for thread in threads for place in (thread[0], thread[-1])])
    turns = shapely.points(np.concatenate([thread[1:-1] for thread in threads]))
    assert shapely.distance(walls, ends).max() <= half
    assert shapely.distance(walls, turns).min() > half
    assert shapely.contains(shape(stages.sections.solid, layer - 1), ends).all()


@pytest.mark.parametrize("name", ROOMS)
def test_without_walls_threads_end_within_the_part(name: str) -> None:
    wanted = plain(layer_height=0.2, perimeters=0)
    stages = slice_stages(lid_over(ROOMS[name], 1.2), wanted)

    width = wanted.printer.nozzle_diameter
    layer, threads = threads_of(stages, width)
    ends = shapely.points([place for thread in threads for place in (thread[0], thread[-1])])
    lid = shape(stages.sections.solid, layer)
    assert shapely.contains(lid, ends).all()
    assert shapely.distance(lid.boundary, ends).min() >= width / 2


def bare_beam(thickness: float, degrees: float) -> float:
    """mm² that stay uncovered where a beam of that thickness spans the gap between two posts, all of it turned."""
    beam = [box((5, thickness, 2)), box((5, thickness, 2), (9, 0, 0)), box((14, thickness, 1), (0, 0, 2))]
    turn = np.deg2rad(degrees)
    around = np.array([(np.cos(turn), np.sin(turn), 0), (-np.sin(turn), np.cos(turn), 0), (0, 0, 1)])
    wanted = plain(layer_height=0.2, planner__kind="uniform")
    stages = slice_stages(Mesh(joined(beam).triangles @ around, "beam"), wanted)

    assert set(stages.regions.bridge.ring_layer.tolist()) == {10}
    coverage = coverage_of(
        stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
    )
    return float(coverage.uncovered.area()[10])


@pytest.mark.parametrize("thickness", few_of([3.0, 2.6, 3.6], 1))
def test_narrow_strips_are_as_full_however_they_are_turned(thickness: float) -> None:
    """Rows a few degrees off their sides would leave them half empty."""
    straight = bare_beam(thickness, 0)

    assert [bare_beam(thickness, degrees) for degrees in (3, 33, 41, 88)] == pytest.approx(
        [straight] * 4, abs=0.02
    )
