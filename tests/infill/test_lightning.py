"""Trees hold what needs holding, every branch of them stands on something, and they take little plastic."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, offset
from printer_slicer.infill import infill_paths
from printer_slicer.model import Mesh, Regions, Toolpaths
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.effort import examples, few_of
from tests.infill.stacks import WIDTH, rectangle, sparse_stack, volumes
from tests.parts import box, layers, plain, shape, sphere, step_pyramid
from tests.strategies import star_rings

ANGLE = 45.0
TOLERANCE = (
    0.06 + 0.7 * WIDTH
)  # mm: places nearer than 0.02 mm are one; branches shorter than a bead is wide are left out
SETTINGS = {
    "infill": "lightning",
    "infill_anchor_max": 0,
    "lightning_angle_deg": ANGLE,
    "internal_infill_overlap": 0,
}
UNEVEN = np.cumsum([0.2, 0.1, 0.3, 0.08, 0.12, 0.32] * 6)


def grown(rings: Sequence[Sequence[Float]], tops: Float, density: float = 0.2) -> tuple[Regions, Toolpaths]:
    regions = sparse_stack(rings, tops)
    return regions, infill_paths(regions, plain(infill_density=density, **SETTINGS))


def branches(paths: Toolpaths, layer: int, role: Role = Role.INTERNAL_INFILL) -> shapely.MultiLineString:
    lines = np.flatnonzero((paths.layer == layer) & (paths.role == role))
    return shapely.MultiLineString([paths.path(int(i)) for i in lines])


def room(regions: Regions) -> Areas:
    """Where centre lines may lie."""
    return offset(regions.internal_infill, -float(bead.spacing(WIDTH, regions.plan.height.max())) / 2)


def hanging(regions: Regions, paths: Toolpaths, every: int = 0) -> float:
    """mm of branches that lean out too far over branches, walls and all else that is there on the layer below.

    Where the room is another one on every so many layers, these are left out.
    """
    length, inside = 0.0, room(regions)
    for layer in (k for k in range(1, regions.plan.n_layers) if not every or k % every):
        reach = float(regions.plan.height[layer]) * np.tan(np.deg2rad(ANGLE)) + TOLERANCE
        free = shape(inside, layer - 1).buffer(-reach)
        over = branches(paths, layer).intersection(free)
        over = over.difference(branches(paths, layer - 1, Role.INTERNAL_BRIDGE).buffer(WIDTH / 2 + reach))
        length += over.difference(branches(paths, layer - 1).buffer(reach)).length
    return length


def cones(n: int, start: float, step: float) -> list[list[Float]]:
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return [[circle * max(start + step * k, 0.2) + 50] for k in range(n)]


@pytest.mark.parametrize(
    "rings",
    [
        [[rectangle(40, 30)]] * 36,
        cones(36, 4, 0.5),  # wider upward: walls close in on the trees
        cones(36, 22, -0.5),  # narrower upward: roots have to follow the walls outward
        cones(36, 22, -0.12),
        [[rectangle(40, 40), rectangle(10, 10, (6, 20))[::-1]]] * 36,
    ],
    ids=["box", "funnel", "flat cone", "steep cone", "box with a hole"],
)
def test_every_branch_stands_on_a_branch_or_at_the_wall(rings: list[list[Float]]) -> None:
    regions, paths = grown(rings, UNEVEN)

    assert paths.n_paths > 30
    assert hanging(regions, paths) < 0.05


@settings(max_examples=examples(6))
@given(st.lists(star_rings(), min_size=4, max_size=4), st.sampled_from([0.1, 0.3]))
def test_branches_stand_in_rooms_of_any_shape(shapes: list[list[Float]], height: float) -> None:
    rings = [one for one in shapes for _ in range(6)]

    regions, paths = grown(rings, layers(24, height).top)

    # A room that moves aside by more than a bead at once may leave a branch between walls that no bead fits in; in one
    # of a hundred such stacks a tip of less than a bead hangs elsewhere.
    assert hanging(regions, paths, every=6) < WIDTH


@pytest.mark.parametrize("density", few_of([0.2, 0.1, 0.4], 1))
def test_no_place_under_a_roof_is_far_from_a_branch_or_wall(density: float) -> None:
    tops = layers(20, 0.2).top
    wide, narrow = rectangle(50, 40), rectangle(20, 40)
    regions, paths = grown([[wide]] * 10 + [[narrow]] * 10, tops, density)
    spacing = float(bead.spacing(WIDTH, 0.2)) / density

    for layer, roof in ((9, shapely.box(20, 0, 50, 40)), (19, shapely.box(0, 0, 20, 40))):
        walls = shape(room(regions), layer)
        held = shapely.union_all([branches(paths, layer), walls.boundary]).buffer(0.9 * spacing)
        assert roof.intersection(walls).difference(held).area < 1e-6


def test_trees_take_little_plastic_and_vanish_far_below_a_roof() -> None:
    rings, tops = [[rectangle(30, 30)]] * 200, layers(200, 0.2).top
    _, paths = grown(rings, tops, 0.15)
    grid = infill_paths(sparse_stack(rings, tops), plain(infill="grid", infill_density=0.15))

    laid = volumes(paths)
    assert laid.sum() < 0.2 * volumes(grid).sum()
    assert (laid[:60] == 0).all()
    assert laid[-1] == pytest.approx(volumes(grid)[-1], rel=0.35)
    assert (np.diff(laid[110:]) >= -0.02).all()  # downward there is ever less


@pytest.mark.parametrize(
    "mesh", few_of([step_pyramid([30, 20, 9], [4.0, 4.0, 4.0]), sphere(12), box((20, 20, 8))], 1)
)
def test_whole_parts_have_trees_below_their_roofs_only(mesh: Mesh) -> None:
    stages = slice_stages(mesh, plain(infill_density=0.2, **SETTINGS))
    usual = slice_stages(mesh, plain(infill_density=0.2, infill="grid"))

    assert hanging(stages.regions, stages.toolpaths) < 0.5
    sparse = [
        float(one.program.filament[one.program.role == Role.INTERNAL_INFILL].sum()) for one in (stages, usual)
    ]
    assert 0 < sparse[0] < 0.6 * sparse[1]


def test_thick_beads_have_the_trees_of_the_layer_they_are_printed_on() -> None:
    rings, tops = [[rectangle(30, 30)]] * 31, layers(31, 0.1).top
    thick = infill_paths(
        sparse_stack(rings, tops), plain(infill_density=0.2, internal_infill_every=0.3, **SETTINGS)
    )

    assert set(np.round(thick.height[thick.layer > 0], 6).tolist()) == {0.3}
    used = np.unique(thick.layer)
    assert used[-1] == 30
    for upper, lower in zip(used[1:], used[:-1], strict=True):
        standing = branches(thick, int(lower)).buffer(0.3 + TOLERANCE)
        free = shapely.box(1, 1, 29, 29)
        assert upper - lower == 3
        assert branches(thick, int(upper)).intersection(free).difference(standing).length < 0.05


def test_nothing_sparse_means_no_trees() -> None:
    assert (
        infill_paths(
            sparse_stack([[]] * 3, layers(3, 0.2).top), plain(infill_density=0.2, **SETTINGS)
        ).n_paths
        == 0
    )
