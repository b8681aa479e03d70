"""Ordering changes when and from which end a path is printed, and nothing else."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.adhesion import adhesion_paths
from printer_slicer.arrays import Float
from printer_slicer.infill import infill_paths
from printer_slicer.model import Areas, LayerPlan, Mesh, Sections, Toolpaths
from printer_slicer.ordering import order
from printer_slicer.ordering.loops import Loops, start_loops_at
from printer_slicer.perimeters import lay_walls
from printer_slicer.profile import Profile
from printer_slicer.regions import classify
from printer_slicer.roles import Role
from printer_slicer.slicing import cut
from tests.effort import crossed
from tests.parts import (
    box,
    box_with_hole,
    joined,
    plain,
    prism,
    pyramid,
    shape,
    shapely,
    sphere,
    step_pyramid,
    two_boxes,
)

PERIMETERS = (Role.PERIMETER, Role.EXTERNAL_PERIMETER)


@cache
def made(mesh: Mesh, wanted: Profile, n_layers: int = 8) -> tuple[Sections, Toolpaths]:
    """All paths of a part as the stages before give them."""
    sections = cut(mesh, LayerPlan.from_tops(mesh.height * np.arange(1, n_layers + 1) / n_layers), 0.0125)
    walls = lay_walls(sections, wanted)
    regions = classify(sections, walls, wanted)
    parts = [adhesion_paths(sections, wanted), walls.paths, infill_paths(regions, wanted)]
    return sections, Toolpaths.joined(sections.plan, parts)


@cache
def ordered(mesh: Mesh, wanted: Profile, n_layers: int = 8) -> tuple[Sections, Toolpaths, Toolpaths]:
    sections, before = made(mesh, wanted, n_layers)
    return sections, before, order(before, sections, wanted)


def identities(paths: Toolpaths) -> dict[tuple[float, ...], float]:
    """Mm of bead for each layer, role, height and straight line: the same wherever paths begin, end and are broken."""
    size = np.diff(paths.start)
    owner = np.repeat(np.arange(paths.n_paths), size)
    way = paths.xy[paths.following] - paths.xy
    length = np.hypot(*way.T)
    way, begin, owner = way[length > 0], paths.xy[length > 0], owner[length > 0]
    length = length[length > 0]
    way = way / length[:, None]
    way *= np.where((way[:, 0] < -1e-7) | (np.abs(way[:, 0]) <= 1e-7) & (way[:, 1] < 0), -1, 1)[:, None]
    offset = begin[:, 0] * way[:, 1] - begin[:, 1] * way[:, 0]
    # Rounded a little beside what is usual in parts, so that noise does not matter.
    line = np.round(np.column_stack([way, offset]) + 0.000123456789, 4) + 0.0
    found: dict[tuple[float, ...], float] = {}
    of_path = np.column_stack([paths.layer, paths.role, paths.height])
    for key, mm in zip(np.hstack([of_path[owner], line]).tolist(), length.tolist(), strict=True):
        found[tuple(key)] = found.get(tuple(key), 0.0) + mm
    return found


def nested() -> Mesh:
    """A block standing alone in the hole of another."""
    return joined([box_with_hole((20, 20, 4), (12, 12)), box((5, 5, 4), (7.5, 7.5, 0))], "nested")


def posts() -> Mesh:
    return joined([box((4, 4, 4), (8.0 * i, 8.0 * j, 0)) for i in range(3) for j in range(2)], "posts")


MESHES = [
    box((9, 9, 3)),
    two_boxes(),
    box_with_hole(),
    nested(),
    posts(),
    sphere(4),
    pyramid(20, 8),
    step_pyramid([12, 8, 5], [1, 1, 2]),
]
each_mesh = pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.name)
SEAMS = ["aligned", "nearest", "rear", "direction", "random"]
each_mesh_and_seam = pytest.mark.parametrize(("mesh", "seam"), crossed(MESHES, SEAMS))


@each_mesh_and_seam
def test_every_path_is_there_once_and_unaltered(mesh: Mesh, seam: str) -> None:
    _, before, after = ordered(mesh, plain(seam=seam, skirt_loops=2, brim_width=1))

    assert after.n_paths >= before.n_paths > 20
    assert identities(after) == pytest.approx(identities(before), abs=1e-5)


@each_mesh
def test_layers_ascend(mesh: Mesh) -> None:
    _, _, after = ordered(mesh, plain())

    assert (np.diff(after.layer) >= 0).all()
    assert set(after.layer.tolist()) == set(range(8))


@each_mesh
def test_skirt_then_brim_then_the_part(mesh: Mesh) -> None:
    _, _, after = ordered(mesh, plain(skirt_loops=2, brim_width=2))

    rank = np.array(
        [{Role.SKIRT: 0, Role.BRIM: 1}.get(Role(role), 2) for role in after.role[after.layer == 0].tolist()]
    )
    assert (np.diff(rank) >= 0).all()


def islands(sections: Sections, paths: Toolpaths, layer: int) -> list[tuple[int, int]]:
    """Island and role of each path of a layer in order; skirt and brim left out."""
    parts = shapely.get_parts(shape(sections.solid, layer))
    here = [i for i in np.flatnonzero(paths.layer == layer).tolist() if paths.role[i] > Role.BRIM]
    starts = shapely.points(np.array([paths.path(i)[0] for i in here]))
    owner = [int(np.argmin(shapely.distance(parts, start))) for start in starts]
    return list(zip(owner, paths.role[here].tolist(), strict=True))


@each_mesh_and_seam
def test_an_island_is_finished_before_the_next_one_begins(mesh: Mesh, seam: str) -> None:
    sections, _, after = ordered(mesh, plain(seam=seam))

    for layer in range(8):
        visits = [island for island, _ in islands(sections, after, layer)]
        runs = [visits[0], *(b for a, b in pairwise(visits) if a != b)]
        assert len(runs) == len(set(runs)) == len(shapely.get_parts(shape(sections.solid, layer)))


@pytest.mark.parametrize(("mesh", "infill_first"), crossed(MESHES, [False, True]))
def test_within_an_island_perimeters_come_before_infill_or_after_it(mesh: Mesh, infill_first: bool) -> None:
    sections, _, after = ordered(mesh, plain(infill_first=infill_first))

    for layer in range(8):
        for island in {owner for owner, _ in islands(sections, after, layer)}:
            roles = [role for owner, role in islands(sections, after, layer) if owner == island]
            kinds = [role in PERIMETERS for role in roles if role < Role.TOP_SOLID_INFILL]
            assert kinds == sorted(kinds, reverse=not infill_first)
            late = [role for role in roles if role >= Role.TOP_SOLID_INFILL]
            assert roles[len(roles) - len(late) :] == late == sorted(late)


@pytest.mark.parametrize(("mesh", "outer_first"), crossed(MESHES, [False, True]))
def test_an_outer_loop_follows_the_inner_ones_beside_it_or_leads_them(mesh: Mesh, outer_first: bool) -> None:
    _, _, after = ordered(mesh, plain(external_perimeter_first=outer_first, perimeters=3))

    loops = np.flatnonzero(after.closed & np.isin(after.role, PERIMETERS))
    rings = {i: shapely.linearrings(after.path(i)) for i in loops.tolist() if len(after.path(i)) > 2}
    pairs = 0
    for outer in (i for i in rings if after.role[i] == Role.EXTERNAL_PERIMETER):
        for inner in (i for i in rings if after.role[i] == Role.PERIMETER):
            if after.layer[inner] == after.layer[outer] and rings[inner].distance(rings[outer]) < 0.5:
                pairs += 1
                assert (inner < outer) != outer_first
    assert pairs >= 5


def test_deeper_loops_are_printed_before_the_outer_one() -> None:
    _, _, after = ordered(box((9, 9, 3)), plain(perimeters=4))

    loops = after.closed & (after.layer == 3)
    assert after.role[loops].tolist() == [Role.PERIMETER] * 3 + [Role.EXTERNAL_PERIMETER]


def travel(paths: Toolpaths) -> float:
    """mm from the end of each path to the beginning of the next."""
    begin = paths.xy[paths.start[:-1]]
    end = np.where(paths.closed[:, None], begin, paths.xy[paths.start[1:] - 1])
    return float(np.hypot(*(begin[1:] - end[:-1]).T).sum())


@each_mesh
def test_travels_get_shorter(mesh: Mesh) -> None:
    _, before, after = ordered(mesh, plain(infill="grid", infill_density=0.3, seam="nearest"))

    assert travel(after) < travel(before)


def test_a_long_line_that_ends_far_off_is_broken_where_the_nozzle_passes() -> None:
    """It lies between two loops in one corner, and its ends are near to each other in the opposite one."""
    plan = LayerPlan.from_tops(np.array([0.2]))
    loop = np.array([(1, 1), (2, 1), (2, 2), (1, 2)], float)
    line = np.array([(20, 18), (5, 18), (5, 5), (18, 5), (18, 17)], float)
    paths = Toolpaths.gathered(
        plan,
        xy=np.concatenate([loop, line, loop + 0.5]),
        size=np.array([4, 5, 4]),
        layer=np.zeros(3, np.int64),
        role=np.array([Role.EXTERNAL_PERIMETER, Role.INTERNAL_INFILL, Role.TOP_SOLID_INFILL]),
        width=np.full(3, 0.4),
        closed=np.array([True, False, True]),
    )
    square = np.array([(0, 0), (30, 0), (30, 30), (0, 30)], float)

    after = order(paths, Sections(plan, Areas.from_rings([[square]])), plain())

    assert after.n_paths == 4
    assert after.path(1)[0] == pytest.approx([5, 5])
    assert after.path(2)[-1] == pytest.approx([5, 5])
    assert after.length()[1:3].sum() == pytest.approx(paths.length()[1])
    assert travel(after) < 15 < travel(paths)


def test_infill_that_ends_where_it_begins_is_entered_beside_the_seam() -> None:
    plan = LayerPlan.from_tops(np.array([0.2]))
    outer = np.array([(0, 0), (30, 0), (30, 30), (0, 30)], float)
    round_trip = np.array([(1, 1), (29, 1), (29, 29), (1, 29), (1, 1)], float)
    paths = Toolpaths.gathered(
        plan,
        xy=np.concatenate([outer, round_trip]),
        size=np.array([4, 5]),
        layer=np.zeros(2, np.int64),
        role=np.array([Role.EXTERNAL_PERIMETER, Role.INTERNAL_INFILL]),
        width=np.full(2, 0.4),
        closed=np.array([True, False]),
    )

    after = order(paths, Sections(plan, Areas.from_rings([[outer]])), plain(seam="rear"))

    assert after.path(1)[0] == pytest.approx([29, 29])
    assert after.length() == pytest.approx(paths.length())


# --- seams ---


def begins(paths: Toolpaths) -> Float:
    outer = np.flatnonzero(paths.role == Role.EXTERNAL_PERIMETER)
    return paths.xy[paths.start[outer]]


def test_a_rear_seam_is_the_point_farthest_back_and_of_several_the_rightmost() -> None:
    _, _, after = ordered(box((9, 9, 3)), plain(seam="rear"))

    assert begins(after) == pytest.approx(np.full((8, 2), 9 - 0.225), abs=2e-5)


def test_aligned_seams_lie_above_each_other() -> None:
    _, _, after = ordered(sphere(4), plain(seam="aligned"), 24)

    steps = np.hypot(*np.diff(begins(after)[2:-2], axis=0).T)
    assert steps.max() < 1.5


def l_shaped() -> Mesh:
    return prism([(0, 0), (20, 0), (20, 8), (8, 8), (8, 20), (0, 20)], 3.0)


@pytest.mark.parametrize(
    "tops", [np.arange(1, 11) * 0.3, np.cumsum([0.3, 0.1, 0.1, 0.3, 0.3, 0.2, 0.6, 0.5, 0.6])]
)
def test_an_aligned_seam_hides_in_the_inward_corner_whatever_the_layers(tops: Float) -> None:
    sections = cut(l_shaped(), LayerPlan.from_tops(tops), 0.0125)
    wanted = plain(seam="aligned", perimeters=2)

    after = order(lay_walls(sections, wanted).paths, sections, wanted)

    assert begins(after) == pytest.approx(np.full((len(tops), 2), 8 - 0.225), abs=0.02)


def test_inner_loops_begin_beside_the_seam_of_their_outer_one() -> None:
    _, _, after = ordered(sphere(8), plain(seam="aligned", perimeters=3), 12)

    loops = np.flatnonzero(after.closed & np.isin(after.role, PERIMETERS))
    begin = after.xy[after.start[loops]]
    same = np.diff(after.layer[loops]) == 0
    assert same.sum() >= 20
    assert np.hypot(*np.diff(begin, axis=0)[same].T).max() < 0.8


def test_staggered_inner_seams_lie_beside_the_outer_one_to_and_fro() -> None:
    wanted = plain(seam="aligned", perimeters=2, staggered_inner_seams=True)
    _, _, after = ordered(box((30, 20, 3)), wanted)

    inner = np.flatnonzero(after.closed & (after.role == Role.PERIMETER))
    gap = after.xy[after.start[inner]] - begins(after)
    assert (np.hypot(*gap.T) > 1.0).all()
    assert np.hypot(*(gap[::2] - gap[1::2]).T).min() > 1.5


@pytest.mark.parametrize("angle", [0.0, 90.0, 200.0])
def test_seams_in_a_direction_lie_on_that_side(angle: float) -> None:
    _, _, after = ordered(sphere(6), plain(seam="direction", seam_angle_deg=angle), 24)

    toward = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    outer = np.flatnonzero(after.closed & (after.role == Role.EXTERNAL_PERIMETER))
    for path in outer.tolist():
        ring = after.path(path) @ toward
        assert ring[0] > ring.min() + 0.9 * np.ptp(ring)


def test_random_seams_are_spread_and_the_same_each_time() -> None:
    wanted = plain(seam="random", perimeters=1)
    _, _, after = ordered(box((20, 20, 12)), wanted, 60)
    _, _, again = ordered(box((20, 20, 12)), wanted, 60)

    seams = begins(after) - 10
    quarter = np.bincount((np.degrees(np.arctan2(*seams.T)) + 180).astype(int) // 90 % 4, minlength=4)
    assert quarter.min() >= 6
    assert np.array_equal(after.xy, again.xy)
    assert (np.abs(seams).min(axis=1) > 0.3).sum() > 40  # not only at corners


def test_aligned_seams_of_two_islands_stay_on_their_islands() -> None:
    _, _, after = ordered(two_boxes(), plain(seam="aligned"))

    left = begins(after)[begins(after)[:, 0] < 15]
    assert len(left) == 8
    assert np.ptp(left, axis=0) == pytest.approx([0, 0], abs=1e-4)


def test_a_nearest_seam_is_the_point_nearest_to_where_the_nozzle_was() -> None:
    _, _, after = ordered(box((9, 9, 3)), plain(seam="nearest", perimeters=1))

    outer = np.flatnonzero(after.role == Role.EXTERNAL_PERIMETER)
    for path in outer[1:].tolist():
        before = after.path(path - 1)[0 if after.closed[path - 1] else -1]
        gap = np.hypot(*(after.path(path) - before).T)
        assert gap[0] == pytest.approx(gap.min())


# --- any paths ---


@st.composite
def toolpaths(draw: st.DrawFn) -> tuple[Toolpaths, Sections]:
    """Random polylines and loops of any role on three layers, some of them outside all islands."""
    plan = LayerPlan.from_tops(np.array([0.2, 0.4, 0.6]))
    squares = [
        [np.array([(x, 0), (x + 10, 0), (x + 10, 10), (x, 10)], dtype=float) for x in (0, 20)][: 1 + k % 2]
        for k in range(3)
    ]
    seed, count = draw(st.integers(0, 10**6)), draw(st.integers(0, 30))
    rng = np.random.default_rng(seed)
    role = rng.integers(1, 10, count)
    size = rng.integers(3, 6, count)
    layer = np.sort(rng.integers(0, 3, count))
    xy = rng.integers(-2, 33, (int(size.sum()), 2)) / 1.0
    closed = role <= Role.EXTERNAL_PERIMETER
    paths = Toolpaths.gathered(
        plan, xy=xy, size=size, layer=layer, role=role, width=np.full(count, 0.4), closed=closed
    )
    return paths, Sections(plan, Areas.from_rings(squares))


@given(case=toolpaths(), seam=st.sampled_from(SEAMS))
def test_no_paths_are_lost_or_altered_whatever_they_are(case: tuple[Toolpaths, Sections], seam: str) -> None:
    paths, sections = case

    after = order(paths, sections, plain(seam=seam))

    assert identities(after) == pytest.approx(identities(paths), abs=1e-5)
    assert (np.diff(after.layer) >= 0).all()


def test_more_paths_than_are_worth_sorting_are_all_there() -> None:
    """Beyond some hundred lines of one role they are taken as they stand."""
    rng = np.random.default_rng(2)
    count = 1000
    plan = LayerPlan.from_tops(np.array([0.2]))
    paths = Toolpaths.gathered(
        plan,
        xy=rng.uniform(0, 50, (2 * count, 2)),
        size=np.full(count, 2),
        layer=np.zeros(count, np.int64),
        role=np.full(count, int(Role.INTERNAL_INFILL)),
        width=np.full(count, 0.4),
        closed=False,
    )
    square = np.array([(0, 0), (50, 0), (50, 50), (0, 50)], dtype=float)

    after = order(paths, Sections(plan, Areas.from_rings([[square]])), plain())

    assert identities(after) == pytest.approx(identities(paths), abs=1e-5)


def test_the_same_paths_give_the_same_order() -> None:
    first, second = (ordered(posts(), plain())[2] for _ in range(2))

    assert np.array_equal(first.xy, second.xy)
    assert np.array_equal(first.role, second.role)


@given(share=st.floats(0.05, 0.95))
def test_a_seam_between_two_points_has_a_width_between_theirs(share: float) -> None:
    plan = LayerPlan.from_tops(np.array([0.2]))
    xy, width = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]), np.array([0.4, 0.8, 0.6])
    role, closed = np.array([Role.EXTERNAL_PERIMETER]), np.array([True])
    paths = Toolpaths(plan, xy, width, np.array([0, 3]), np.array([0]), role, np.array([0.2]), closed)

    begun = start_loops_at(paths, Loops.of(paths, np.array([0])), np.array([10 * share]))
    assert begun.xy[0] == pytest.approx([10 * share, 0.0])
    assert begun.width[0] == pytest.approx(0.4 + 0.4 * share)
