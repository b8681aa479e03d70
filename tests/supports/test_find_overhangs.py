"""What needs supports: planes by their angle, bridges by both ends, patches by their size, islands always."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.geometry import Areas, depths, intersection, normalize, split_connected
from printer_slicer.model import LayerPlan, Mesh, Overhangs, Regions, Sections
from printer_slicer.supports import find_overhangs
from tests.effort import examples
from tests.parts import box, joined, loft, plain, sheared_prism, sphere

CELL: Final = 3.0  # mm
Array = np.ndarray


def found(mesh: Mesh, tops: Any = 0.2, **changes: object) -> Overhangs:
    """The overhangs of a mesh with these tops of layers, or with layers of one height."""
    if isinstance(tops, float):
        tops = np.arange(1, round(np.ptp(mesh.bounds[:, 2]) / tops) + 1) * tops
    return ps.overhangs(mesh, plain(**changes), plan=LayerPlan.from_tops(np.asarray(tops)))


def solid(made: trimesh.Trimesh) -> Mesh:
    """A part made by trimesh."""
    return Mesh(np.asarray(made.triangles, np.float64), "part")


def joined_layers(areas: Areas) -> Areas:
    """The areas of all layers as seen from above."""
    return normalize(areas.on_layers(np.zeros(areas.n_layers, np.int64), 1))


def seen_from_above(hanging: Overhangs) -> float:
    """What hangs, as seen from above, mm²."""
    return float(joined_layers(hanging.area).area()[0])


def is_within(areas: Areas, xy: Array) -> Array:
    """Whether points lie in the only layer of areas."""
    depth = depths(areas, xy, np.zeros(len(xy), np.int64), 50.0)
    return np.asarray(depth > 0)


def wall_with_hole(diameter: float, thickness: float) -> Mesh:
    """An upright wall with a round hole across."""
    wall = trimesh.creation.box((30, thickness, 20))
    across = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)
    hole = trimesh.creation.cylinder(diameter / 2, 3 * thickness, sections=96, transform=across)
    return solid(trimesh.boolean.difference([wall, hole], engine="manifold"))


def gallows(reach: float = 10.0, height: float = 10.0, width: float = 10.0) -> Mesh:
    """A post with an arm to one side."""
    return joined([box((5, width, height + 2)), box((5 + reach, width, 2), (0, 0, height))])


def gate(span: float, width: float) -> Mesh:
    """Two posts and a plate across."""
    posts = [box((6, width, 10), (x, 0, 0)) for x in (0.0, 6 + span)]
    return joined([*posts, box((12 + span, width, 3), (0, 0, 8))])


def icicle(radius: float, length: float, at: tuple[float, float], roof: float) -> Mesh:
    """A cone that points down from a roof; its base lies inside the roof."""
    turn = 2 * np.pi * np.arange(24) / 24
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    ring = radius * circle + at
    return Mesh(loft([1e-3 * circle + at, ring, ring], [roof - length, roof, roof + 0.5]), "icicle")


@given(
    st.floats(20, 65),
    st.sampled_from([-5.0, -1.0, -0.5, 0.5, 1.0, 5.0]),
    st.lists(st.integers(10, 32), min_size=60, max_size=60),
)
def test_a_plane_is_found_if_it_is_flatter_than_the_threshold(
    threshold: float, beside: float, heights: list[int]
) -> None:
    shift = 6 / np.tan(np.deg2rad(threshold + beside))
    tops = np.cumsum(np.array(heights) / 100)
    tops = tops[tops < 5.7]
    plan = np.append(tops, 6.0)

    overhangs = found(sheared_prism(10, 6, shift), plan, support_threshold_deg=threshold)

    cut = overhangs.plan.cut
    moved = 10 * shift * (cut[-1] - cut[0]) / 6
    assert overhangs.area.area().sum() == pytest.approx(moved if beside < 0 else 0, rel=0.01)
    assert overhangs.n_patches == int(beside < 0)
    assert not overhangs.islands.n_rings


@cache
def found_as_it_is(part: Mesh) -> Overhangs:
    return found(part)


@settings(max_examples=examples(6, 200))
@given(st.floats(0, 360), st.sampled_from([gallows(), sheared_prism(10, 6, 12), sphere(8)]))
def test_rotation_about_z_does_not_change_the_area(degrees: float, part: Mesh) -> None:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turned = Mesh(part.triangles @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), "turned")

    before, after = found_as_it_is(part), found(turned)

    assert after.area.area().sum() == pytest.approx(before.area.area().sum(), rel=0.01)
    assert after.n_patches == before.n_patches


@pytest.mark.parametrize(
    "part",
    [
        gallows(),
        gallows(reach=0.8),
        sheared_prism(10, 6, 12),
        sphere(8),
        wall_with_hole(3, 10),
        wall_with_hole(6, 2),
        wall_with_hole(16, 10),
        joined([gallows(), icicle(2, 6, (10, 5), 10)]),
    ],
    ids=["arm", "ledge", "prism", "sphere", "small hole", "hole in a thin wall", "large hole", "icicle"],
)
def test_layers_of_half_the_height_keep_the_same_patches(part: Mesh) -> None:
    thick, thin = found(part, 0.2), found(part, 0.1)

    assert thin.n_patches == thick.n_patches
    assert thin.area.area().sum() == pytest.approx(thick.area.area().sum(), rel=0.15)


@pytest.mark.parametrize("thickness", [1.2, 2.0, 10.0])
@pytest.mark.parametrize("diameter", [3.0, 6.0])
def test_a_small_hole_in_a_wall_needs_nothing(diameter: float, thickness: float) -> None:
    overhangs = found(wall_with_hole(diameter, thickness))

    assert overhangs.n_patches == 0
    assert overhangs.bridged.n_rings


@pytest.mark.parametrize("width", [1.6, 3.0, 12.0])
def test_a_bridge_needs_nothing_up_to_the_maximum_length(width: float) -> None:
    assert found(gate(10.0, width)).n_patches == 0
    assert found(gate(10.5, width)).area.area().sum() == pytest.approx(10.5 * width, rel=0.02)
    assert found(gate(10.5, width), support_max_bridge=11).n_patches == 0
    assert found(gate(4.0, width), support_max_bridge=0).n_patches == 1


@pytest.mark.parametrize("width", [1.6, 12.0])
def test_the_length_of_a_bridge_is_that_below_leaning_ends(width: float) -> None:
    # The posts lean by 45°, so they are 0.4 mm farther apart at the second cut below the plate than at the first one.
    assert found(gate_of_leaning_posts(9.3, width)).n_patches == 0
    assert found(gate_of_leaning_posts(9.6, width)).n_patches == 1


def gate_of_leaning_posts(span: float, width: float, height: float = 8.0, lean: float = 0.4) -> Mesh:
    """Two posts that lean towards each other below the plate across, up to `span`."""
    heights = [0.0, height - lean, height, height + 1]
    right = 6 + span
    left_post = [_rectangle(0.0, 6 + by, width) for by in (-lean, -lean, 0.0, 0.0)]
    right_post = [_rectangle(right + by, right + 6, width) for by in (lean, lean, 0.0, 0.0)]
    posts = [Mesh(loft(rings, heights), "post") for rings in (left_post, right_post)]
    return joined([*posts, box((12 + span, width, 3), (0, 0, height))])


def _rectangle(left: float, right: float, width: float) -> Array:
    return np.array([(left, 0.0), (right, 0.0), (right, width), (left, width)])


@settings(max_examples=examples(3))
@given(st.floats(25, 38), st.integers(0, 2**32 - 1))
def test_a_slope_between_two_walls_is_found_in_all_layers(angle: float, seed: int) -> None:
    reach = 8.0
    rise = reach * np.tan(np.deg2rad(angle))
    profile = np.array([[0.0, 6.0], [0.0, 16.0], [-reach, 16.0], [-reach, 6.0 + rise]])
    roof = trimesh.convex.convex_hull([(x, y, z) for x in (2.0, 10.0) for y, z in profile])
    walls = [trimesh.creation.box(bounds=[(x, -reach, 0), (x + 3, 0, 16)]) for x in (0.0, 9.0)]
    back = trimesh.creation.box(bounds=[(0, -1, 0), (12, 2, 16)])
    part = solid(trimesh.boolean.union([roof, back, *walls], engine="manifold"))
    heights = np.random.default_rng(seed).uniform(0.1, 0.3, 200)
    tops = np.cumsum(heights)
    area = seen_from_above(found(part, tops[tops < 16]))
    assert area == pytest.approx(6.0 * (reach - 1), rel=0.08)


def sphere_at(x: Array, y: Array) -> tuple[Array, Array]:
    """Slope in degrees and height of the lower half of a sphere of 12 mm that stands at z = 0."""
    away = np.hypot(x, y) / 12
    return np.rad2deg(np.arcsin(np.minimum(away, 1))), 12 - 12 * np.sqrt(np.maximum(1 - away**2, 0))


def torus_at(x: Array, y: Array) -> tuple[Array, Array]:
    """Slope in degrees and height of the lower half of a ring of 6 mm about a circle of 14 mm."""
    away = np.abs(np.hypot(x, y) - 14) / 6
    return np.rad2deg(np.arcsin(np.minimum(away, 1))), 6 - 6 * np.sqrt(np.maximum(1 - away**2, 0))


def crown_at(x: Array, y: Array) -> tuple[Array, Array]:
    """Slope in degrees and height of the crown of a tunnel of 20 mm along y, from y = -10 to 10."""
    away = np.where(np.abs(y) < 9.9, np.abs(x) / 10, 1)
    return np.rad2deg(np.arcsin(np.minimum(away, 1))), 10 * np.sqrt(np.maximum(1 - away**2, 0))


def tunnel() -> Mesh:
    """A block of 30 x 20 x 16 mm with half a cylinder of 20 mm cut out along y."""
    block = trimesh.creation.box(bounds=[(-15, -10, 0), (15, 10, 16)])
    across = trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
    return solid(
        trimesh.boolean.difference(
            [block, trimesh.creation.cylinder(10, 60, sections=360, transform=across)], engine="manifold"
        )
    )


def turned_ring() -> Mesh:
    """The ring of `torus_at`, 6 mm above the bed."""
    ring = trimesh.creation.torus(14, 6, major_sections=180, minor_sections=180)
    ring.apply_translation((0, 0, 6))
    return solid(ring)


def ball() -> Mesh:
    """The sphere of `sphere_at`."""
    made = trimesh.creation.icosphere(5, 12.0)
    made.apply_translation((0, 0, 12))
    return solid(made)


CURVED = {"ball": (ball(), sphere_at), "ring": (turned_ring(), torus_at), "tunnel": (tunnel(), crown_at)}


@settings(max_examples=examples(1))
@given(st.sampled_from([*CURVED]), st.one_of(st.sampled_from([0.3, 0.2, 0.1]), st.integers(0, 2**32 - 1)))
@example("ball", 0.2)
@example("ring", 1)
@example("tunnel", 0.1)
def test_a_curved_surface_is_found_up_to_the_threshold(name: str, layers: float) -> None:
    part, surface = CURVED[name]
    n, top = 250, float(part.bounds[1, 2])
    uneven = isinstance(layers, int)
    heights = np.random.default_rng(layers).uniform(0.1, 0.3, n) if uneven else np.full(n, layers)
    tops = np.cumsum(heights)
    hanging = found(part, tops[tops < top])
    xy = np.stack(np.meshgrid(*[np.arange(-20, 20, 0.25) + 0.11] * 2), axis=-1).reshape(-1, 2)
    slope, z = surface(*xy.T)
    inside = is_within(joined_layers(hanging.area.merge(hanging.bridged)), xy)
    flat, steep = (slope < 39) & (z > 0.5), (slope > 41) & (slope < 90)
    assert inside[flat].mean() >= 0.95
    assert inside[steep].mean() <= 0.05


def test_what_bridges_carry_is_told_apart() -> None:
    overhangs = found(gate(9.0, 8.0))

    assert overhangs.bridged.area().sum() == pytest.approx(9 * 8, rel=0.01)
    assert overhangs.area.n_rings == 0


def test_ledges_and_chamfers_need_nothing() -> None:
    ledge = joined([box((10, 10, 5), (1, 1, 0)), box((10.8, 10.8, 5), (0.6, 0.6, 4))])
    ring = np.array([(0, 0), (10, 0), (10, 10), (0, 10)], dtype=float)
    chamfer = Mesh(loft([0.92 * ring + 0.4, ring, ring], [0.0, 0.2, 5.0]), "chamfer")

    assert found(ledge).n_patches == 0
    assert found(chamfer, 0.1).n_patches == 0


@pytest.mark.parametrize("reach", [10.0, 30.0])
def test_a_plate_held_at_one_end_needs_support_over_its_whole_area(reach: float) -> None:
    overhangs = found(gallows(reach), support_max_bridge=100)

    assert overhangs.area.area().sum() == pytest.approx(reach * 10, rel=0.01)
    assert overhangs.is_flat.nonzero()[0].tolist() == overhangs.area.used.nonzero()[0].tolist()
    assert overhangs.n_patches == 1


@settings(max_examples=examples(6, 200))
@given(st.lists(st.tuples(st.floats(0.5, 3), st.floats(1, 8)), min_size=1, max_size=3), st.floats(0.08, 0.3))
def test_every_icicle_has_one_island_at_its_tip(cones: list[tuple[float, float]], height: float) -> None:
    roof = joined([box((40, 8, 3), (0, -4, 10)), box((6, 8, 12), (-3, -4, 0))])
    hung = [icicle(r, length, (12.0 + 9 * i, 0.0), 10) for i, (r, length) in enumerate(cones)]
    part = joined([roof, *hung])
    placed = ps.place(part, plain().printer).bounds[0] - part.bounds[0]

    overhangs = found(part, np.append(np.arange(height, 12.9, height), 13.0))

    pieces = split_connected(overhangs.islands)
    low, high = pieces.areas.boxes()
    middle = (low + high) / 2 - placed[:2]
    begins = overhangs.plan.bottom[pieces.layer]
    order = np.argsort(middle[:, 0])
    assert middle[order] == pytest.approx(np.array([(12.0 + 9 * i, 0.0) for i in range(len(cones))]), abs=0.3)
    assert begins[order] == pytest.approx([10 - length for _, length in cones], abs=0.5)
    assert (overhangs.area.used | ~overhangs.islands.used).all()


def test_islands_that_join_are_two_and_end_where_they_stand() -> None:
    """Two inverted pyramids grow together; then their body joins a wall."""
    ring = np.array([(-3, -3), (3, -3), (3, 3), (-3, 3)], dtype=float)
    pyramids = [
        Mesh(loft([1e-3 * ring + at, ring + at, ring + at], [z, 10.0, 12.0]), "pyramid")
        for at, z in ((np.array((8.0, 0.0)), 4.0), (np.array((13.0, 0.0)), 5.0))
    ]
    overhangs = found(joined([*pyramids, box((8, 6, 14), (-1, -3, 0)), box((17, 6, 2), (-1, -3, 12))]))

    assert overhangs.plan.bottom[split_connected(overhangs.islands).layer] == pytest.approx(
        [4.0, 5.0], abs=0.21
    )


def test_a_blob_on_a_thread_is_a_tail() -> None:
    thread = box((0.6, 0.6, 8), (-0.3, -0.3, 0))
    overhangs = found(joined([thread, box((3, 3, 3), (-1.5, -1.5, 6))]))

    assert overhangs.plan.bottom[overhangs.islands.used] == pytest.approx([6.0])
    assert overhangs.area.area().sum() == pytest.approx(9 - 0.36, rel=0.01)


HUNG = joined([gallows(), icicle(2, 6, (10, 5), 10)])


@settings(max_examples=examples(4, 200))
@given(st.integers(0, 2**32 - 1))
def test_order_of_facets_does_not_matter(seed: int) -> None:
    shuffled = Mesh(np.random.default_rng(seed).permutation(HUNG.triangles), HUNG.name)

    one, other = found_as_it_is(HUNG), found(shuffled)

    assert other.area.area() == pytest.approx(one.area.area(), abs=1e-4)
    assert other.islands.area() == pytest.approx(one.islands.area(), abs=1e-4)


def stack(mask: np.ndarray, gap: float) -> Sections:
    """Sections of full cells (L, X, Y): neighbours by a side are joined, those by a corner only if there is no gap."""
    square = np.array([(gap, gap), (CELL - gap, gap), (CELL - gap, CELL - gap), (gap, CELL - gap)])
    rings: list[list[np.ndarray]] = [[square + CELL * at for at in np.argwhere(one)] for one in mask]
    for axis in (1, 2):
        pair = mask[:, :-1] & mask[:, 1:] if axis == 1 else mask[:, :, :-1] & mask[:, :, 1:]
        longer = square + np.where(square > CELL / 2, CELL, 0.0) * np.eye(2)[axis - 1]
        for k, *at in np.argwhere(pair):
            rings[k].append(longer + CELL * np.array(at))
    plan = LayerPlan.from_tops(0.2 * np.arange(1.0, len(mask) + 1))
    return Sections(plan, normalize(Areas.from_rings(rings)))


def overhangs_of(sections: Sections, **changes: object) -> Overhangs:
    """The overhangs of sections without bridges."""
    none = Areas.empty(sections.plan.n_layers)
    regions = Regions(sections.plan, none, none, none, none, none, np.zeros(0))
    return find_overhangs(sections, regions, plain(support_max_bridge=0, **changes))


def pieces_of(one: np.ndarray) -> list[set[tuple[int, int]]]:
    """The cells of a layer, connected by sides."""
    left: set[tuple[int, int]] = {(x, y) for x, y in np.argwhere(one).tolist()}
    result = []
    while left:
        piece: set[tuple[int, int]] = set()
        new = {left.pop()}
        while new:
            x, y = new.pop()
            piece.add((x, y))
            near = {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)} & left
            left -= near
            new |= near
        result.append(piece)
    return result


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 0.7))
def test_islands_of_random_cells_are_those_of_brute_force(seed: int, share: float) -> None:
    mask = np.random.default_rng(seed).random((6, 5, 5)) < share
    begins = np.zeros_like(mask)
    for k in range(1, 6):
        for piece in pieces_of(mask[k]):
            if not any(mask[k - 1][at] for at in piece):
                begins[k][tuple(np.array(list(piece)).T)] = True

    overhangs = overhangs_of(stack(mask, 0.1))

    assert overhangs.islands.area() == pytest.approx(stack(begins, 0.1).solid.area(), abs=1e-3)
    assert intersection(overhangs.islands, overhangs.area).area() == pytest.approx(
        overhangs.islands.area(), abs=1e-3
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 0.7))
def test_areas_of_random_cells_are_those_of_brute_force(seed: int, share: float) -> None:
    mask = np.random.default_rng(seed).random((6, 5, 5)) < share

    overhangs = overhangs_of(stack(mask, 0.0))

    free = (mask[1:] & ~mask[:-1]).sum(axis=(1, 2))
    assert overhangs.area.area()[1:] == pytest.approx(CELL**2 * free, rel=0.01, abs=0.01)
    assert overhangs.area.area()[0] == 0


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_a_thin_wall_that_is_held_at_one_end_needs_a_support(angle: float) -> None:
    post = trimesh.creation.box(bounds=[(0, 0, 0), (5, 20, 20)])
    fin = trimesh.creation.box(bounds=[(4, 9.6, 10), (15, 10.4, 20)])
    part = trimesh.boolean.union([post, fin])
    part.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(angle), [0, 0, 1]))

    hanging = found(solid(part))

    assert hanging.n_patches == 1
    assert seen_from_above(hanging) == pytest.approx(0.8 * 10, rel=0.05)


def test_a_thin_rib_along_a_wall_needs_nothing() -> None:
    wall = trimesh.creation.box(bounds=[(0, 0, 0), (5, 40, 20)])
    rib = trimesh.creation.box(bounds=[(4, 5, 10), (5.8, 35, 12)])

    assert found(solid(trimesh.boolean.union([wall, rib]))).n_patches == 0
