"""Lines fill each region bead by bead or to a density, on layers of any height, and stay where they belong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.infill import PATTERNS, infill_paths
from printer_slicer.model import Areas, Float, LayerPlan, Mesh, Regions, Role, Toolpaths
from printer_slicer.pipeline import Stages, slice_stages
from tests.parts import box, box_with_hole, joined, layers, plain, shape, shapely, sphere

WIDTH = 0.45
UNEVEN = np.array([0.1, 0.42, 0.5, 0.82, 1.0, 1.32])
engines = pytest.mark.parametrize("engine", list(ENGINES))
patterns = pytest.mark.parametrize("pattern", list(PATTERNS))
SOLID_ROLES = (Role.BRIDGE, Role.BOTTOM_SKIN, Role.SOLID, Role.TOP_SKIN)


def rectangle(x: float, y: float) -> Float:
    return np.array([(0, 0), (x, 0), (x, y), (0, y)], dtype=np.float64)


def sparse_only(rings: Sequence[Float], tops: Float = UNEVEN) -> Regions:
    """The same area on every layer, all of it sparse."""
    plan = LayerPlan.from_tops(tops)
    none = Areas.empty(plan.n_layers)
    area = Areas.from_rings([list(rings) for _ in tops])
    return Regions(plan, none, none, none, none, area, np.zeros(0))


def solid_only(rings: Sequence[Float], role: Role = Role.SOLID, tops: Float = UNEVEN) -> Regions:
    sparse = sparse_only(rings, tops)
    areas = {one: sparse.sparse if one == role else Areas.empty(len(tops)) for one in SOLID_ROLES}
    return Regions(
        sparse.plan,
        areas[Role.BOTTOM_SKIN],
        areas[Role.BRIDGE],
        areas[Role.TOP_SKIN],
        areas[Role.SOLID],
        Areas.empty(len(tops)),
        np.zeros(areas[Role.BRIDGE].n_rings),
    )


def lengths(paths: Toolpaths) -> Float:
    """(L,) mm of path on each layer."""
    each = [float(np.hypot(*np.diff(paths.path(i), axis=0).T).sum()) for i in range(paths.n_paths)]
    return np.bincount(paths.layer, each, minlength=paths.plan.n_layers).astype(np.float64)


def rows(paths: Toolpaths, layer: int, angle: float) -> Float:
    """Where the long lines of a layer lie, across their direction."""
    across = np.array([-np.sin(angle), np.cos(angle)])
    along = np.array([np.cos(angle), np.sin(angle)])
    places = []
    for i in np.flatnonzero(paths.layer == layer):
        xy = paths.path(int(i))
        step = np.diff(xy, axis=0)
        straight = np.abs(step @ along) > 0.999 * np.hypot(*step.T)
        places += (xy[:-1][straight] @ across).tolist()
    return np.unique(np.round(places, 6))


# --- solid ---


@pytest.mark.parametrize("role", SOLID_ROLES, ids=lambda role: role.name.lower())
def test_neighbouring_solid_lines_lie_one_spacing_of_their_own_layer_apart(role: Role) -> None:
    """Width - height * (1 - pi / 4), so on a plan of uneven layers each has another spacing."""
    wanted = plain(infill_angle_deg=0, thick_bridges=False)
    paths = infill_paths(solid_only([rectangle(12, 9)], role), wanted)

    height = np.diff(UNEVEN, prepend=0)
    for layer in range(6):
        angle = 0.0 if role == Role.BRIDGE else np.pi / 2 * (layer % 2)
        gaps = np.diff(rows(paths, layer, angle))
        width = paths.width[np.repeat(paths.layer, np.diff(paths.start)) == layer]
        # A bridge's beads have as much plastic as usual, however near the next one is.
        near = 0.05 if role == Role.BRIDGE else 1e-4
        assert gaps == pytest.approx(width[0] - height[layer] * (1 - np.pi / 4), rel=near)
        assert (width == width[0]).all()
        assert width[0] == pytest.approx(WIDTH, rel=0.05)  # so that a whole number of beads fills 12 or 9 mm


@engines
def test_solid_lines_lay_as_much_plastic_as_the_area_holds(engine: str) -> None:
    with using_engine(engine):
        paths = infill_paths(solid_only([rectangle(30, 20)]), plain(infill_overlap=0))

    assert lengths(paths) * bead.spacing(WIDTH, paths.plan.height) == pytest.approx(600, rel=0.01)


def test_the_direction_turns_by_a_right_angle_from_layer_to_layer() -> None:
    paths = infill_paths(solid_only([rectangle(12, 9)]), plain(infill_angle_deg=30))

    for layer in range(6):
        angle = np.deg2rad(30) + np.pi / 2 * (layer % 2)
        assert len(rows(paths, layer, angle)) > 15
        assert len(rows(paths, layer, angle + np.pi / 2)) == 0


def test_bridges_run_in_their_own_direction() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    angles = np.deg2rad([10, 20, 30, 40, 50, 60])
    turned = Regions(
        regions.plan,
        regions.bottom_skin,
        regions.bridge,
        regions.top_skin,
        regions.solid,
        regions.sparse,
        angles,
    )

    paths = infill_paths(turned, plain())

    assert all(len(rows(paths, layer, float(angle))) > 10 for layer, angle in enumerate(angles))


def test_centre_lines_stay_half_a_bead_inside_their_region_but_for_the_overlap() -> None:
    for overlap in (0.0, 0.15):
        regions = solid_only([rectangle(12, 9)])
        paths = infill_paths(regions, plain(infill_overlap=overlap))
        for i in range(paths.n_paths):
            gap = float(bead.spacing(paths.width[paths.start[i]], paths.plan.height[paths.layer[i]]))
            inset = gap / 2 - overlap * WIDTH
            low, high = paths.path(i).min(axis=0), paths.path(i).max(axis=0)
            assert (low >= inset - 1e-4).all()
            assert (high <= np.array([12, 9]) - inset + 1e-4).all()


def test_thick_bridges_are_round_threads_with_a_little_air_between_them() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    for flow in (0.8, 1.0, 1.3):
        paths = infill_paths(regions, plain(bridge_flow_ratio=flow))

        thread = 0.4 * np.sqrt(flow)
        assert paths.width == pytest.approx(thread)
        assert paths.height == pytest.approx(thread)
        assert bead.cross_section(thread, thread) == pytest.approx(flow * np.pi / 4 * 0.4**2)
        assert np.diff(rows(paths, 3, 0.0)) == pytest.approx(thread + 0.05, rel=0.05)


def test_flat_bridges_have_as_much_plastic_as_asked_for() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    usual, less = (
        infill_paths(regions, plain(bridge_flow_ratio=flow, thick_bridges=False)) for flow in (1.0, 0.8)
    )

    assert np.array_equal(usual.xy, less.xy)
    assert np.array_equal(less.height, less.plan.height[less.layer])
    of_path = np.repeat(less.layer, np.diff(less.start))
    section = bead.cross_section(less.width, less.plan.height[of_path])
    full = bead.cross_section(usual.width, usual.plan.height[of_path])
    assert section == pytest.approx(0.8 * full, rel=1e-3)


@pytest.mark.parametrize(("pattern", "between"), [("grid", 45), ("rectilinear", 90)])
def test_internal_bridges_cross_the_infill_below(pattern: str, between: float) -> None:
    regions = sparse_only([rectangle(40, 40)])
    above = np.flatnonzero(regions.sparse.ring_layer == 3)
    none = Areas.empty(6)
    bridged = Regions(
        regions.plan,
        *(none, none, none, none),
        regions.sparse.take(np.flatnonzero(regions.sparse.ring_layer == 2)),
        np.zeros(0),
        internal_bridge=regions.sparse.take(above),
    )
    paths = infill_paths(bridged, plain(infill=pattern))

    angles = np.deg2rad(np.arange(0, 180, 5))
    below, over = (
        [i for i, angle in enumerate(angles) if len(rows(paths, layer, float(angle))) > 4] for layer in (2, 3)
    )
    assert set(paths.role[paths.layer == 3].tolist()) == {Role.INTERNAL_BRIDGE}
    assert {abs((over[0] - one) * 5 + 90) % 180 - 90 for one in below} <= {
        between - 180,
        between,
        -between,
        0 - between,
    }


def test_strips_beside_a_wall_are_filled_along_it() -> None:
    """A ring 1 mm wide in a 30 mm square inside: long lines, and as much plastic as it holds."""
    square, hole = rectangle(30, 30), (rectangle(28, 28) + 1)[::-1]
    regions = solid_only([square, hole], tops=layers(4, 0.2).top)
    inside = solid_only([square], tops=layers(4, 0.2).top).solid
    along = Regions(
        regions.plan,
        *(regions.bottom_skin, regions.bridge, regions.top_skin, regions.solid, regions.sparse, np.zeros(0)),
        inside=inside,
    )
    paths, across = infill_paths(along, plain()), infill_paths(regions, plain())

    assert paths.n_paths <= 3 * 4
    assert across.n_paths > 0
    width = paths.width[paths.start[0]]
    assert lengths(paths) * bead.spacing(width, 0.2) == pytest.approx(30**2 - 28**2, rel=0.1)
    # No end hangs loose: a closed way returns to its beginning.
    for i in range(paths.n_paths):
        assert np.array_equal(paths.path(i)[0], paths.path(i)[-1])


# --- sparse ---


@patterns
@engines
@pytest.mark.parametrize("density", [0.15, 0.3, 0.5, 0.8])
def test_density_is_the_share_of_a_large_area_that_is_filled(
    engine: str, pattern: str, density: float
) -> None:
    wanted = plain(infill=pattern, infill_density=density)
    with using_engine(engine):
        paths = infill_paths(sparse_only([rectangle(150, 150)]), wanted)

    filled = lengths(paths) * bead.spacing(WIDTH, paths.plan.height) / 150**2
    assert filled == pytest.approx(density, rel=0.05)


@patterns
def test_no_density_means_no_lines(pattern: str) -> None:
    assert (
        infill_paths(sparse_only([rectangle(20, 20)]), plain(infill=pattern, infill_density=0)).n_paths == 0
    )


def test_grid_and_rectilinear_lay_the_same_plastic() -> None:
    regions = sparse_only([rectangle(40, 40)], layers(10, 0.2).top)
    grid, lines = (
        lengths(infill_paths(regions, plain(infill=pattern, infill_density=0.15))).sum()
        for pattern in ("grid", "rectilinear")
    )

    assert lines == pytest.approx(grid, rel=0.05)


def test_a_grid_has_both_directions_on_every_layer() -> None:
    paths = infill_paths(sparse_only([rectangle(40, 40)]), plain(infill="grid", infill_angle_deg=20))

    for layer in range(6):
        for angle in (20, 110):
            assert len(rows(paths, layer, np.deg2rad(angle))) > 4


def test_the_walls_of_a_grid_stand_on_each_other() -> None:
    plan = layers(6, 0.2).top
    paths = infill_paths(sparse_only([rectangle(40, 40)], plan), plain(infill="grid"))

    first = rows(paths, 0, np.pi / 4)
    assert all(np.array_equal(rows(paths, layer, np.pi / 4), first) for layer in range(1, 6))


@patterns
def test_more_density_means_more_plastic(pattern: str) -> None:
    laid = [
        lengths(infill_paths(sparse_only([rectangle(30, 20)]), plain(infill=pattern, infill_density=d))).sum()
        for d in (0.05, 0.1, 0.2, 0.4, 0.8, 0.99)
    ]

    assert (np.diff(laid) > 0).all()


@patterns
@settings(deadline=None, max_examples=20)
@given(x=st.floats(-200, 200), y=st.floats(-200, 200))
def test_the_pattern_belongs_to_the_bed_so_areas_may_lie_anywhere(pattern: str, x: float, y: float) -> None:
    paths = infill_paths(
        sparse_only([rectangle(60, 50) + np.array([x, y])]), plain(infill=pattern, infill_density=0.3)
    )

    filled = lengths(paths) * bead.spacing(WIDTH, paths.plan.height) / 3000
    assert filled == pytest.approx(0.3, rel=0.1)


# --- all ---


def slots(width: float, depth: float) -> Mesh:
    """A block of 30 x 20 with a slot open to one side."""
    left, right = box((14, 20, 2)), box((16 - width, 20, 2), (14 + width, 0, 0))
    return joined([left, right, box((width, 20 - depth, 2), (14, 0, 0))], "slot")


def outside(stages: Stages) -> float:
    """mm of open paths outside the sections."""
    paths, length = stages.toolpaths, 0.0
    for layer in range(stages.sections.plan.n_layers):
        here = np.flatnonzero((paths.layer == layer) & ~paths.closed)
        lines = [shapely.LineString(paths.path(int(i))) for i in here]
        section = shape(stages.sections.solid, layer)
        length += sum(float(shapely.length(shapely.difference(line, section))) for line in lines)
    return length


@patterns
@pytest.mark.parametrize(
    "mesh", [box_with_hole((20, 20, 2)), sphere(3), slots(2, 12)], ids=lambda mesh: mesh.name
)
def test_no_line_leaves_the_section(pattern: str, mesh: Mesh) -> None:
    length = outside(slice_stages(mesh, plain(infill=pattern, infill_density=0.3)))

    assert length < 1e-3


@patterns
def test_no_sparse_line_crosses_the_mouth_of_a_slot(pattern: str) -> None:
    wanted = plain(
        infill=pattern, infill_angle_deg=90, infill_density=0.15, top_thickness=0.2, bottom_thickness=0.2
    )

    length = outside(slice_stages(slots(1, 3), wanted))

    assert length < 1e-3


@patterns
def test_paths_are_open_have_a_length_and_a_width(pattern: str) -> None:
    paths = infill_paths(sparse_only([rectangle(20, 20), rectangle(4, 4)[::-1] + 8]), plain(infill=pattern))

    assert not paths.closed.any()
    assert (paths.width == WIDTH).all()
    assert (np.diff(paths.start) >= 2).all()
    assert (np.diff(paths.layer) >= 0).all()
    assert min(float(np.hypot(*np.diff(paths.path(i), axis=0).T).min()) for i in range(paths.n_paths)) > 0


def test_areas_too_small_for_a_line_get_none() -> None:
    assert infill_paths(solid_only([rectangle(0.2, 5)]), plain(infill_overlap=0)).n_paths == 0
