"""Contoured tops: what follows a surface, how exactly, and what stays as it is."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from benchmarks.contour_bounds import sample_part
from printer_slicer import bead, geometry
from printer_slicer.arrays import Bool, Float
from printer_slicer.contouring import FacetBins, find_inexact_layers, find_tops, make_contour_rule
from printer_slicer.contouring.deviations import TopErrors
from printer_slicer.contouring.fine_points import FinePoints
from printer_slicer.contouring.surface_heights import LayerPoints
from printer_slicer.contouring.z_profiles import (
    MAX_CHANGE,
    Positions,
    fill_short_dips,
    find_needed_points,
    limit_changes,
    smooth,
)
from printer_slicer.extrusion import move_seconds
from printer_slicer.facts.findings import list_slicing_warnings
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import contain_points, difference
from printer_slicer.geometry.vectors import measure_distances_from_triangles
from printer_slicer.model import LayerPlan, Mesh, Program, Toolpaths
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role, is_perimeter
from printer_slicer.slicing import cut
from printer_slicer.stages import Stages
from printer_slicer.surface import certify_stacks
from tests.contoured_parts import dome, wedge, wedge_height
from tests.parts import box, box_with_hole, joined, layers, plain, pyramid, turned

LEAST = 0.05  # mm, the default least height
WEDGES = pytest.mark.parametrize("degrees", [5.0, 10.0, 15.0, 20.0, 25.0])


def contoured(**changes: object) -> Profile:
    return plain(z_contouring=True, layer_height=0.2, first_layer_height=0.2, **changes)


def sliced(mesh: Mesh, **changes: object) -> Stages:
    return slice_stages(mesh, contoured(**changes))


def moves_of(program: Program) -> Float:
    return np.column_stack([program.xyz, program.filament, program.speed])


def changes_of_z(paths: Toolpaths) -> Float:
    """Change of z of all extrusions, mm per mm of path."""
    begin, end = paths.ends_of_beads
    far = np.hypot(*(paths.xy[end] - paths.xy[begin]).T)
    return np.abs(paths.z_offset[end] - paths.z_offset[begin])[far > 1e-6] / far[far > 1e-6]


@WEDGES
def test_extrusions_keep_between_the_least_height_and_their_layer(degrees: float) -> None:
    paths = sliced(wedge(degrees)).toolpaths
    owner = paths.path_of_point
    local = paths.height[owner] + paths.z_offset

    assert paths.z_offset.min() < -0.05
    assert paths.z_offset.max() <= 0
    assert local.min() >= LEAST - 1e-9
    assert changes_of_z(paths).max() <= MAX_CHANGE + 1e-6
    assert paths.flow_ratio * paths.height[owner] == pytest.approx(local)


def test_what_is_laid_is_the_integral_of_the_local_heights() -> None:
    """The spacing of extrusions is that of full height, and so is the width that each of them fills."""
    stages = sliced(wedge(10.0))
    paths, profile = stages.toolpaths, contoured()
    begin, end = paths.ends_of_beads
    owner = paths.path_of_bead
    steps = (np.arange(50) + 0.5)[:, None] / 50
    width, z = (one[begin] + steps * (one[end] - one[begin]) for one in (paths.width, paths.z_offset))
    length = np.hypot(*(paths.xy[end] - paths.xy[begin]).T)
    filled = bead.spacing(width, paths.height[owner]) * (paths.height[owner] + z)
    volume = float((filled.mean(axis=0) * length).sum())

    fed = float(stages.program.filament[stages.program.role != Role.TRAVEL].sum())

    assert fed * profile.material.filament_area == pytest.approx(volume, rel=0.001)


@WEDGES
def test_beads_of_a_wedge_lie_beside_its_surface_by_half_of_their_width_at_most(degrees: float) -> None:
    stages = sliced(wedge(degrees))
    paths = stages.toolpaths
    begin, end = paths.ends_of_beads
    share = np.linspace(0, 1, 20)[:, None]
    x, y, z = (one[begin] + share * (one[end] - one[begin]) for one in (*paths.xy.T, paths.z_offset))
    path = paths.path_of_bead
    low, high = stages.part.bounds
    top, bottom = paths.z_top[path], (paths.z_top - paths.height)[path]
    surface = wedge_height(x - low[0], degrees)
    # Fades take up to 0.7 mm at the sides, and the first layer is flat.
    inside = np.abs(y - (low[1] + high[1]) / 2) < (high[1] - low[1]) / 2 - 1.5
    exposed = inside & (surface < top) & (surface > bottom) & (paths.layer[path] > 0)
    reach = np.tan(np.deg2rad(degrees)) * contoured().extrusion_width / 2

    assert exposed.sum() > 100
    followed = exposed & (surface > bottom + LEAST)
    assert np.abs(top + z - surface)[followed].max() <= reach + 0.01
    assert np.abs(top + z - surface)[exposed].max() <= LEAST + 0.01


@pytest.mark.parametrize(
    "mesh",
    [box((12, 10, 2)), box((12, 10, 2.0004)), pyramid(12, 12), turned(box((8, 6, 3)))],
    ids=["plate", "rounded", "steep", "turned"],
)
def test_parts_without_shallow_tops_are_printed_as_ever(mesh: Mesh) -> None:
    flat, followed = (
        slice_stages(mesh, contoured() if on else plain(layer_height=0.2, first_layer_height=0.2))
        for on in (False, True)
    )

    assert np.array_equal(moves_of(flat.program), moves_of(followed.program))
    assert followed.toolpaths.z_offset.any() == False  # noqa: E712 - a NumPy bool


def test_a_flat_inside_a_layer_is_met() -> None:
    paths = slice_stages(box((12, 10, 1.94)), contoured(), plan=layers(10, 0.2)).toolpaths
    top = paths.layer == paths.plan.n_layers - 1
    exposed = top & np.isin(paths.role, [Role.TOP_SOLID_INFILL, Role.EXTERNAL_PERIMETER])

    assert exposed.any()
    assert paths.z_offset[exposed[paths.path_of_point]] == pytest.approx(-0.06)


@pytest.mark.parametrize("degrees", [8.0, 18.0])
def test_a_turned_part_is_contoured_alike(degrees: float) -> None:
    figures = []
    for quarters in range(2):
        stages = sliced(turned(wedge(degrees, (10.0, 10.0)), quarters))
        program, paths = stages.program, stages.toolpaths
        lowered = float(-(paths.z_offset * paths.steps()).sum())
        figures.append((program.filament_used, float(move_seconds(program, contoured()).sum()), lowered))

    assert figures[1] == pytest.approx(figures[0], rel=0.04)


def test_beads_are_laid_from_low_to_high() -> None:
    paths = sliced(wedge(10.0)).toolpaths
    middle = np.add.reduceat(paths.z_offset, paths.start[:-1]) / np.diff(paths.start)
    lowered = np.minimum.reduceat(paths.z_offset, paths.start[:-1]) < -0.01
    found = 0
    for layer in np.unique(paths.layer[lowered]):
        here = paths.layer == layer
        walls = np.flatnonzero(here & is_perimeter(paths.role) & paths.closed)
        infill = np.flatnonzero(here & (paths.role == Role.TOP_SOLID_INFILL))
        if len(walls) == 2 and lowered[walls].all():
            assert paths.role[walls].tolist() == [Role.EXTERNAL_PERIMETER, Role.PERIMETER]
            assert middle[walls[0]] < middle[walls[1]]
            assert not len(infill) or infill.min() > walls.max()
            found += 1
    assert found > 3


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_rows_of_top_infill_lie_along_the_contour_lines(degrees: float) -> None:
    mesh = turned_about_z(wedge(5.0, (20.0, 15.0)), degrees)
    paths = sliced(mesh).toolpaths
    begin, end = paths.ends_of_beads
    far = np.hypot(*(paths.xy[end] - paths.xy[begin]).T)
    rows = (paths.role[paths.path_of_bead] == Role.TOP_SOLID_INFILL) & (far > 2.0)

    assert far[rows].sum() > 500
    assert np.abs(paths.z_offset[end] - paths.z_offset[begin])[rows].max() < 0.011


def test_rows_of_tops_that_slope_in_all_directions_are_as_ever() -> None:
    regions = sliced(dome()).regions

    assert regions.top_solid_infill.n_rings
    assert np.isnan(regions.top_angle[regions.top_solid_infill.ring_layer > 15]).all()


def turned_about_z(mesh: Mesh, degrees: float) -> Mesh:
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(mesh.triangles @ turn.T, mesh.name)


def test_infill_that_climbs_begins_low() -> None:
    """Rows across the slope: the chain of rows is printed from its low side on."""
    stages = slice_stages(wedge(5.0, (20.0, 12.0)), contoured(infill_angle_deg=0.0, perimeters=1))
    paths = stages.toolpaths
    owner = paths.path_of_point
    chains = (paths.role == Role.TOP_SOLID_INFILL) & ~paths.closed
    slopes = []
    for path in np.flatnonzero(chains):
        z = paths.z_offset[owner == path]
        if len(z) > 6 and np.ptp(z) > 0.05:
            slopes.append(np.corrcoef(np.arange(len(z)), z)[0, 1])

    assert slopes
    assert min(slopes) > -0.31


def test_travels_after_lowered_paths_clear_the_layer() -> None:
    stages = sliced(wedge(5.0, (20.0, 12.0)))
    program = stages.program
    start = program.start
    far = np.hypot(*(program.xyz - start)[:, :2].T) > 1.5 * contoured().extrusion_width
    travels = np.flatnonzero((program.role == Role.TRAVEL) & far)

    assert stages.toolpaths.z_offset.min() < -0.1
    assert (program.xyz[travels, 2] >= program.plan.top[program.layer[travels]] - 1e-6).all()


def lowered_moves(stages: Stages) -> Bool:
    program = stages.program
    plan = program.plan
    return (program.role != Role.TRAVEL) & (program.xyz[:, 2] < plan.top[program.layer] - 1e-6)


@pytest.mark.parametrize("limit", [0.5, 2.0, 30.0])
def test_extrusions_climb_no_faster_than_the_z_axis(limit: float) -> None:
    program = sliced(wedge(20.0), max_speed_z=limit).program
    delta = program.xyz - program.start
    length = np.sqrt((delta**2).sum(axis=1))
    climbs = (program.role != Role.TRAVEL) & (np.abs(delta[:, 2]) > 1e-6)

    assert climbs.any()
    assert (program.speed * np.abs(delta[:, 2]) / np.maximum(length, 1e-9))[climbs].max() <= limit + 1e-6


def test_the_flow_changes_at_a_limited_rate() -> None:
    quick, slow = (sliced(wedge(20.0), max_speed_z=500.0, min_speed=speed) for speed in (1.0, 60.0))
    program = quick.program
    delta = program.xyz - program.start
    seconds = np.sqrt((delta**2).sum(axis=1)) / program.speed
    climbs = np.flatnonzero(lowered_moves(quick) & (np.abs(delta[:, 2]) > 1e-6))
    layer, width = program.layer[climbs], program.width[climbs]
    full, top = program.plan.height[layer], program.plan.top[layer]
    low, high = (
        bead.cross_section(width, full + z[climbs] - top) for z in (program.start[:, 2], program.xyz[:, 2])
    )
    rate = np.abs(high - low) / bead.cross_section(width, full) / seconds[climbs]

    assert len(climbs)
    assert rate.max() == pytest.approx(25, rel=0.05)
    assert (slow.program.speed >= program.speed - 1e-9).all()
    assert (slow.program.speed > program.speed + 1).any()


def test_cooling_slows_a_contoured_path_as_a_whole() -> None:
    mesh = wedge(10.0, (6.0, 5.0))
    quick, slow = (sliced(mesh, min_layer_time=seconds, min_speed=10.0) for seconds in (0, 30))
    outer = (quick.program.role == Role.EXTERNAL_PERIMETER) & (quick.program.layer > 0)
    ratio = slow.program.speed / quick.program.speed
    lowered = False
    for layer in range(2, quick.program.plan.n_layers):
        here = outer & (quick.program.layer == layer)
        low = lowered_moves(quick)[here]
        if low.any() and not low.all():
            lowered = True
            assert np.ptp(ratio[here]) < 0.01
    assert lowered
    assert ratio[outer].min() < 0.9


@given(
    z=arrays.arrays(np.float64, st.integers(2, 60), elements=st.floats(-0.3, 0)),
    step=st.floats(0.02, 0.25),
    closed=st.booleans(),
)
def test_limited_changes_are_the_lowest_that_are_high_enough(z: Float, step: float, closed: bool) -> None:
    steps = np.full(len(z), step)
    steps[-1] *= closed
    start = np.array([0, len(z)])
    positions = Positions.from_steps(steps, start, np.array([closed]))

    limited = limit_changes(z, positions)

    apart = np.abs(np.subtract.outer(np.arange(len(z)), np.arange(len(z)))) * step
    apart = np.minimum(apart, len(z) * step - apart) if closed else apart
    assert limited == pytest.approx((z - MAX_CHANGE * apart).max(axis=1), abs=1e-7)


@given(
    low=st.lists(st.lists(st.booleans(), min_size=2, max_size=60), min_size=1, max_size=4),
    closed=st.booleans(),
    shortest=st.sampled_from([0.1, 0.6, 2.0]),
)
def test_short_dips_between_high_places_are_filled(
    low: list[list[bool]], closed: bool, shortest: float
) -> None:
    sizes = [len(one) for one in low]
    start = np.append(0, np.cumsum(sizes))
    steps = np.full(start[-1], 0.25)
    steps[start[1:] - 1] *= closed
    z = np.where(np.concatenate(low), -0.1, 0.0)

    filled = fill_short_dips(z, Positions.from_steps(steps, start, np.full(len(low), closed)), shortest)

    for first, last in pairwise(start):
        assert filled[first:last].tolist() == _fill(z[first:last].tolist(), closed, shortest)


def _fill(z: list[float], closed: bool, shortest: float) -> list[float]:
    """The same, dip by dip; loops are turned so that they begin at a high place."""
    if 0.0 not in z:
        return z
    turn = z.index(0.0) if closed else 0
    line = z[turn:] + z[:turn] + ([0.0] if closed else [])
    high = [place for place, one in enumerate(line) if one == 0]
    for one, other in pairwise(high):
        if (other - one) * 0.25 - 2 * 0.1 / MAX_CHANGE < shortest:
            line[one:other] = [0.0] * (other - one)
    line = line[: len(z)]
    return line[len(z) - turn :] + line[: len(z) - turn]


@given(
    z=arrays.arrays(np.float64, st.integers(3, 60), elements=st.floats(-0.3, 0)),
    closed=st.booleans(),
    corner=st.integers(0, 59),
)
def test_points_that_are_left_out_lie_near_the_lines_that_remain(z: Float, closed: bool, corner: int) -> None:
    n = len(z)
    steps = np.full(n, 0.25)
    steps[-1] *= closed
    positions = Positions.from_steps(steps, np.array([0, n]), np.array([closed]))
    is_corner = np.zeros(n, np.bool_)
    is_corner[[0, corner % n]] = True
    is_corner[-1] |= not closed

    kept = find_needed_points(z, positions, is_corner)

    assert kept[is_corner].all()
    known, at = np.append(z, z[0]), np.arange(n + 1)
    some = np.flatnonzero(np.append(kept, True)) if closed else np.flatnonzero(kept)
    assert np.abs(np.interp(at[:n], at[some], known[some]) - z).max() <= 0.01 + 1e-9


@pytest.mark.parametrize("degrees", [3.0, 5.0, 10.0])
def test_extrusions_under_the_next_layer_are_level(degrees: float) -> None:
    stages = sliced(wedge(degrees))
    paths, solid = stages.toolpaths, stages.sections.solid
    fine = FinePoints.of(paths, 0.1)
    layer = paths.layer[fine.owner]
    z = paths.z_offset
    offset = z[fine.corner] + fine.share * (z[paths.following[fine.corner]] - z[fine.corner])
    some = np.flatnonzero(layer + 1 < stages.sections.plan.n_layers)
    some = some[np.argsort(layer[some], kind="stable")]
    inner = geometry.offset(solid, -0.3)  # farther from the border than the points at which z is found
    covered = some[contain_points(inner, fine.xy[some], layer[some] + 1)]

    assert len(covered) > 1000
    assert (offset[covered] == 0).all()


@given(seed=st.integers(0, 10_000), size=st.sampled_from([0.2, 2.0, 30.0]))
def test_errors_are_compared_with_the_nearest_facet(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    centre = random.uniform(-20, 20, (int(random.integers(1, 200)), 1, 3)) * [1, 1, 0.1]
    facets = centre + random.normal(size=(len(centre), 3, 3)) * [size, size, size / 10]
    low = random.uniform(-20, 20, (30, 3)) * [1, 1, 0.1]
    high = low + [0, 0, 0.2] * random.uniform(-1, 1, (30, 1))
    layer = np.floor((low[:, 2] + 2.5) / 0.3).astype(np.int64)
    known = np.where(random.random(30) < 0.5, np.inf, random.uniform(0, 0.7, 30))

    found = TopErrors(low, high, layer, known).refine(facets, 0.7).deviation

    for one in range(30):
        ends = (np.repeat(end[one : one + 1], len(facets), axis=0) for end in (low, high))
        nearest = np.maximum(*(measure_distances_from_triangles(end, facets) for end in ends)).min()
        if nearest <= min(known[one], 0.7):
            assert found[one] == pytest.approx(nearest, abs=1e-9)
        else:
            assert min(nearest, known[one], 0.7) - 1e-9 <= found[one] <= known[one]


@pytest.mark.parametrize("degrees", [8.0, 12.0])
def test_no_sampled_point_is_beyond_the_certificate_of_the_print(degrees: float) -> None:
    part = joined([dome(), wedge(degrees)])  # in whose valley extrusions reach under the cap
    assert sample_part(part, "adaptive", 40_000, np.random.default_rng(1)) == 0


@pytest.mark.parametrize("closed", [True, False])
def test_smoothing_keeps_straight_ramps_and_constant_heights(closed: bool) -> None:
    z = np.concatenate([np.full(20, -0.1), np.full(30, -0.2) if closed else np.linspace(-0.2, 0, 30)])
    steps = np.full(50, 0.1)
    steps[[19, 49]] = 0.1 * closed
    start = np.array([0, 20, 50])
    positions = Positions.from_steps(steps, start, np.array([closed, closed]))

    assert smooth(z, positions, np.arange(50)) == pytest.approx(z, abs=1e-9)


@given(seed=st.integers(0, 10_000), height=st.sampled_from([0.1, 0.2, 0.35]))
def test_heights_from_bins_are_those_of_all_facets(seed: int, height: float) -> None:
    random = np.random.default_rng(seed)
    corners = random.uniform(-4, 4, (40, 3, 3)) * [1, 1, 0.08] + [0, 0, 0.9]
    side = corners[:, 1:, :2] - corners[:, :1, :2]
    clockwise = side[:, 0, 0] * side[:, 1, 1] < side[:, 0, 1] * side[:, 1, 0]
    corners[clockwise] = corners[clockwise, ::-1]
    plan, rule = layers(int(1.6 / height), height), make_contour_rule(contoured())
    assert rule is not None
    tops = find_tops(Mesh(corners, "facets"), plan, rule)
    if tops is None:
        return
    xy, layer = random.uniform(-4, 4, (200, 2)), np.sort(random.integers(1, plan.n_layers, 200))
    steepest = rule.find_max_slopes(plan.height)[layer]
    points = LayerPoints(xy, layer, plan.bottom[layer], plan.top[layer], steepest)

    bins = FacetBins.from_tops(tops)
    found = bins.measure_heights(xy, bins.find_facets(points))

    least, most = (_highest(tops.corners, points, margin) for margin in (1e-3, -1e-3))
    assert (found >= least - 1e-6).all()
    assert (found <= most + 1e-6).all()


def _highest(corners: Float, points: LayerPoints, margin: float) -> Float:
    """The heights by brute force: barycentric coordinates of all points in all facets, beyond a margin."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    gap = points.xy[:, None] - corners[None, :, 0, :2]
    u = (gap[..., 0] * other[:, 1] - gap[..., 1] * other[:, 0]) / area
    v = (one[:, 0] * gap[..., 1] - one[:, 1] * gap[..., 0]) / area
    z = corners[:, 0, 2] + u * one[:, 2] + v * other[:, 2]
    normal = np.cross(one, other)
    slope = np.hypot(normal[:, 0], normal[:, 1]) / normal[:, 2]
    within = (u >= margin) & (v >= margin) & (u + v <= 1 - margin) & (slope <= points.steepest[:, None])
    within &= z >= points.bottom[:, None] + 1e-6 * np.sign(margin)
    within &= z <= points.top[:, None] - 1e-6 * np.sign(margin)
    return np.where(within, z, -np.inf).max(axis=1)


def points_every_tenth(stages: Stages) -> tuple[Float, Float]:
    """Points every 0.1 mm of all paths, relative to the part, and how deep they are lowered."""
    paths = stages.toolpaths
    fine = FinePoints.of(paths, 0.1)
    begin, end = (paths.z_offset[one] for one in (fine.corner, paths.following[fine.corner]))
    return fine.xy - stages.part.bounds[0, :2], -(begin + fine.share * (end - begin))


def distances_from_tower(xy: Float) -> Float:
    """Distances from `tower`, negative within."""
    return np.asarray(np.maximum([4.0, 3.0] - xy, xy - [8.0, 7.0]).max(axis=1))


def test_surfaces_inside_other_bodies_are_not_followed() -> None:
    tower = box((4.0, 4.0, 8.0), (4.0, 3.0, 0.0))
    deepest = {}
    for name, bodies in (("alone", [wedge(10.0)]), ("together", [wedge(10.0), tower])):
        xy, depth = points_every_tenth(sliced(joined(bodies)))
        inside = distances_from_tower(xy) < 0
        deepest[name] = depth[inside].max(), depth[~inside].max()

    assert min(deepest["alone"]) > 0.1
    assert deepest["together"][0] < 0.06  # z changes by at most 20 degrees over the 0.25 mm up to the border
    assert deepest["together"][1] > 0.1


def test_extrusions_beside_steep_surfaces_stay_at_the_top_of_their_layer() -> None:
    xy, depth = points_every_tenth(sliced(joined([wedge(10.0), box((4.0, 4.0, 8.0), (4.0, 3.0, 0.0))])))

    far = distances_from_tower(xy[depth > 0.02])
    assert -0.25 < far.min() < 0.3
    assert (depth[distances_from_tower(xy) < -0.25] == 0).all()


def test_deviations_of_printed_extrusions_are_those_of_half_a_width() -> None:
    stages = sliced(wedge(15.0, (12.0, 10.0)))
    contours = stages.stacks[0].contours
    assert contours is not None
    sloped = (contours.top > 1.4) & (contours.top < stages.part.height - 0.2)

    assert contours.deviation[sloped].max() <= 0.45 / 2 * np.sin(np.deg2rad(15.0)) + 0.0125
    assert contours.deviation[sloped].min() > 0.02
    x = contours.place[sloped, 0] - stages.part.bounds[0, 0]
    assert contours.place[sloped, 2] == pytest.approx(wedge_height(x, 15.0), abs=1e-6)


def slope_and_pyramid() -> Mesh:
    """Extrusions cannot follow the slope as closely as planned where the pyramid rises from it."""
    return joined([wedge(12.0), pyramid(6.0, 5.0)])


@pytest.mark.parametrize("mesh", [wedge(20.0), dome(), slope_and_pyramid()])
def test_printed_extrusions_keep_the_tolerance(mesh: Mesh) -> None:
    stages = sliced(mesh, planner__kind="optimal", tolerance=0.1)

    assert certify_stacks(stages.stacks).max_error <= 0.1 + 1e-6


def test_places_that_break_the_tolerance_are_levelled() -> None:
    stages = sliced(slope_and_pyramid(), planner__kind="optimal", tolerance=0.08)
    rule, paths = stages.stacks[0].plan.contour_rule, stages.toolpaths

    assert rule is not None
    assert len({top for top, _, _ in rule.level_places}) > 1
    assert certify_stacks(stages.stacks).max_error <= 0.08 + 1e-6
    top = paths.plan.top[paths.layer[paths.path_of_point]]
    for level, *place in rule.level_places:
        near = (np.abs(top - level) < 1e-6) & (np.hypot(*(paths.xy - place).T) < 0.6)
        assert (paths.z_offset[near] == 0).all()
    partly = np.isin(top, [level for level, _, _ in rule.level_places])
    assert paths.z_offset[partly].min() < -0.03  # farther away, the surface is followed


def test_layers_are_levelled_where_level_places_are_not_enough() -> None:
    stages = sliced(slope_and_pyramid(), planner__kind="optimal", tolerance=0.08)
    (stack,) = stages.stacks
    assert stack.contours is not None
    again = find_inexact_layers(stack, np.full(stack.plan.n_layers, 0.03))

    partly = {top for top, _, _ in stack.plan.contour_rule.level_places} if stack.plan.contour_rule else set()
    assert partly
    assert not partly & {top for top, _, _ in again.places}
    assert not (set(again.level) | set(again.thick)) & {top for top, _, _ in again.places}


@pytest.mark.parametrize("changes", [{}, {"single_top_perimeter": True, "extra_perimeters": True}])
def test_the_plan_with_level_layers_gives_the_same_print_again(changes: dict[str, object]) -> None:
    """Only the perimeters of level layers and their neighbours are made again."""
    mesh, wanted = slope_and_pyramid(), contoured(planner__kind="optimal", tolerance=0.08, **changes)
    stages = slice_stages(mesh, wanted)
    plan = stages.stacks[0].plan

    again = slice_stages(mesh, wanted, plan=plan)

    assert plan.contour_rule
    assert plan.contour_rule.level_places
    assert gcode_of(again.program, wanted) == gcode_of(stages.program, wanted)


def test_a_loop_around_a_narrow_ridge_begins_with_its_lower_side() -> None:
    stages = sliced(wedge(20.0, (12.0, 20.0)))
    paths = stages.toolpaths
    x = paths.xy[:, 0] - stages.part.bounds[0, 0]
    first = paths.start[:-1]
    width = np.maximum.reduceat(x, first) - np.minimum.reduceat(x, first)
    narrow = np.flatnonzero(
        paths.closed & (np.minimum.reduceat(paths.z_offset, first) < -0.03) & (width < 1.0)
    )

    assert len(narrow)
    for path in narrow:
        own = slice(paths.start[path], paths.start[path + 1])
        along = np.append(0.0, np.cumsum(paths.steps()[own]))[:-1]
        low = along[paths.z_offset[own] < paths.z_offset[own].min() / 2]
        assert low.max() < 0.6 * paths.length()[path]


def test_a_widened_section_is_that_at_half_of_the_least_height() -> None:
    mesh, profile = dome(), contoured(contour_max_slope_deg=40.0)
    sections = slice_stages(mesh, profile).sections
    plan = sections.plan
    some = np.arange(6, plan.n_layers)
    low = LayerPlan(plan.top, plan.bottom + LEAST / 2)
    wanted = cut(sections_mesh(mesh, profile), low, 0.0).solid.of_layers(some)
    solid = sections.solid.of_layers(some)

    wrong = difference(solid, wanted).area() + difference(wanted, solid).area()

    assert (wrong[some] <= 0.03 * solid.length()[some] + 1e-6).all()


def test_a_flat_inside_a_layer_is_filled_up_to_a_wall() -> None:
    """Perimeters go along the wall, so only a gap remains that is just wide enough to be no part of the section."""
    plate = box_with_hole((30.0, 20.0, 1.49), (20.0, 10.0))
    solid = sliced(joined([plate, box((20.0, 10.0, 4.0), (5.0, 5.0, 0.0))])).sections.solid.area()
    gap = 2 * (20.0 + 10.0) * 0.06

    assert 30.0 * 20.0 - gap < solid[7] < 30.0 * 20.0
    assert solid[8] == pytest.approx(20.0 * 10.0)


def sections_mesh(mesh: Mesh, profile: Profile) -> Mesh:
    return slice_stages(mesh, profile).part


@pytest.mark.parametrize(
    "changes",
    [{"contour_max_slope_deg": 4.0}, {"containment": "positive"}, {"containment": "negative"}],
    ids=str,
)
def test_steep_tops_and_contained_parts_stay_flat(changes: dict[str, object]) -> None:
    assert not sliced(wedge(10.0), **changes).toolpaths.z_offset.any()


def find_max_slopes(height: Float, **changes: object) -> Float:
    rule = make_contour_rule(contoured(**changes))
    assert rule is not None
    return rule.find_max_slopes(height)


def test_the_rule_of_slopes() -> None:
    height = np.array([0.1, 0.2, 0.3])
    width = contoured().extrusion_width

    steepest = find_max_slopes(height)

    assert steepest == pytest.approx(np.minimum(1.2 * height / width, np.tan(np.deg2rad(35))))
    assert find_max_slopes(height, contour_max_slope_deg=30.0) == pytest.approx(np.tan(np.deg2rad(30)))


def test_first_layers_and_rafts_are_not_contoured() -> None:
    low = Mesh(wedge(5.0).triangles * np.array([1, 1, 0.2]), "low")
    on_bed, on_raft = sliced(low), sliced(wedge(10.0), raft_height=1.0)

    assert not on_bed.toolpaths.z_offset[on_bed.toolpaths.layer[on_bed.toolpaths.path_of_point] == 0].any()
    paths = on_raft.toolpaths
    lowered = np.unique(paths.role[paths.path_of_point[paths.z_offset < 0]])
    assert len(lowered)
    assert Role.RAFT not in lowered
    bare = sliced(wedge(10.0)).toolpaths
    assert paths.z_offset.min() == pytest.approx(bare.z_offset.min(), abs=1e-6)


def test_a_contoured_loop_has_no_scarf_and_others_keep_theirs() -> None:
    stages = sliced(wedge(10.0), scarf_length=4.0)
    paths = stages.toolpaths
    owner = paths.path_of_point
    scarfed = np.zeros(paths.n_paths, np.bool_)
    scarfed[owner[(paths.flow_ratio < 1) & (paths.z_offset == 0)]] = True
    external = paths.role == Role.EXTERNAL_PERIMETER
    deep = np.minimum.reduceat(paths.z_offset, paths.start[:-1]) < -0.02

    assert (scarfed & external & (paths.layer < 4)).any()
    assert not (scarfed & external & (paths.layer > 6) & (paths.layer < paths.plan.n_layers - 2)).any()
    assert (deep & ~scarfed).any()


@pytest.mark.parametrize("degrees", [5.0, 12.0])
def test_the_shell_below_a_contoured_top_is_as_thick_as_below_a_flat_one(degrees: float) -> None:
    mesh, profile = wedge(degrees, (40.0, 12.0)), contoured(slope_shell_ratio=0.0)
    stages = slice_stages(mesh, profile)
    plan, infill = stages.sections.plan, stages.regions.internal_infill
    left = float(stages.part.bounds[0, 0])
    found = 0
    for layer in np.flatnonzero(infill.used):
        nearest = min(float(ring[:, 0].min()) for ring in infill.rings(layer))
        surface = float(wedge_height(np.array(nearest - left), degrees))
        end = int(np.searchsorted(plan.bottom, plan.top[layer] + profile.quality.top_thickness - 1e-6)) - 1
        if end < plan.n_layers - 1:
            found += 1
            assert surface >= plan.cut[end] - 0.02
    assert found > 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"z_step": 0.04, "layer_step": 0.04}, "steps of 0.04 mm"),
        ({"containment": "negative"}, "no effect with containment = negative"),
        ({}, ""),
    ],
    ids=["coarse", "contained", "fine"],
)
def test_what_makes_contouring_poor_is_told(changes: dict[str, object], said: str) -> None:
    profile = contoured(**changes)

    warnings = list_slicing_warnings(slice_stages(wedge(10.0), profile), profile, [])

    assert said in "".join(warnings)
    assert bool(said) == any("z_contouring" in one for one in warnings)
