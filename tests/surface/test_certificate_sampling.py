"""The certificate against points: no wrong point of any stack of layers lies farther from the surface than proven.

The parts are random closed meshes; the points are tried where they are likely to be wrong, and the worst of them are
moved about to find worse ones. The helpers that find them are tested first, against formulas and brute force.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.errors import PartError
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.slicing import cut
from printer_slicer.surface import Certificate, certify, read_surface
from tests.effort import crossed, examples
from tests.parts import box, joined, layers, loft, pyramid, sheared_prism, sphere
from tests.surface.distances import (
    distance_to_mesh,
    distance_to_triangles,
    in_stack,
    winding,
    wrong_among,
    wrong_points,
)

ConvexHull: Final[Any] = import_module("scipy.spatial").ConvexHull  # it has no types
SAMPLES = Path(__file__).parents[2] / "sample_parts"
ROUNDING = 2e-9  # mm; wrong points are known to that
CONTOUR_ROUNDING = 1e-5  # mm; sections are rounded to a lattice this wide

Rng = np.random.Generator


# --- random closed meshes ---


def turned_at_random(triangles: Float, rng: Rng) -> Float:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn[:, 0] *= np.linalg.det(turn)  # a mirror would turn the part inside out
    return np.asarray(triangles @ turn.T)


def hull(points: Float) -> Float:
    triangles = points[ConvexHull(points).simplices]
    out = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = ((triangles.mean(axis=1) - points.mean(axis=0)) * out).sum(axis=1) < 0
    triangles[inward] = triangles[inward, ::-1]
    return np.asarray(triangles)


def convex(rng: Rng) -> Float:
    return hull(rng.normal(size=(int(rng.integers(5, 14)), 3)))


def tetrahedron(rng: Rng) -> Float:
    return hull(rng.uniform(-1, 1, (4, 3)))


def tilted_box(rng: Rng) -> Float:
    x, y, z = rng.uniform(0.3, 3, 3)
    return turned_at_random(box((x, y, z)).triangles, rng)


def tilted_sphere(rng: Rng) -> Float:
    return turned_at_random(sphere(rng.uniform(0.5, 1.5)).triangles, rng)


def quads(corners: Float, rng: Rng) -> Float:
    """(F, 3, 3) two facets for each mesh of a net (m, n, 3), divided along either diagonal."""
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    straight = rng.random(a.shape[:2]) < 0.5
    one = np.where(straight[..., None, None], np.stack([a, b, c], 2), np.stack([a, b, d], 2))
    two = np.where(straight[..., None, None], np.stack([a, c, d], 2), np.stack([b, c, d], 2))
    return np.concatenate([one.reshape(-1, 3, 3), two.reshape(-1, 3, 3)])


def star(rng: Rng) -> Float:
    """Corners at random distances all around a middle: dents, spikes and saddles."""
    rows, columns = int(rng.integers(3, 8)), int(rng.integers(4, 9))
    down = np.pi * np.arange(1, rows + 1) / (rows + 1)
    around = 2 * np.pi * np.arange(columns) / columns
    radius = rng.uniform(0.4, 2, (rows, columns))
    flat = radius * np.sin(down)[:, None]
    net = np.stack([flat * np.cos(around), flat * np.sin(around), radius * np.cos(down)[:, None]], axis=2)
    net = np.concatenate([net, net[:, :1]], axis=1)
    tips = np.zeros((2, columns, 3))
    tips[:, :, 2] = np.array([[1], [-1]]) * rng.uniform(0.4, 2, (2, 1))
    caps = [
        np.stack([tips[0], net[0, :-1], net[0, 1:]], axis=1),
        np.stack([tips[1], net[-1, 1:], net[-1, :-1]], axis=1),
    ]
    body = np.concatenate([quads(net, rng), *caps])
    return turned_at_random(body, rng) if rng.random() < 0.7 else body


def leaning_prism(rng: Rng) -> Float:
    """Sheared, twisted and tapered, in several pieces one on the other."""
    around = 2 * np.pi * np.arange(n := int(rng.integers(3, 7))) / n
    ring = np.column_stack([np.cos(around), np.sin(around)]) * rng.uniform(1, 3)
    rings, heights = [], np.cumsum(rng.uniform(0.05, 1, int(rng.integers(2, 5))))
    for twist in rng.uniform(-0.6, 0.6, len(heights)):
        turn = np.array([[np.cos(twist), np.sin(twist)], [-np.sin(twist), np.cos(twist)]])
        rings.append(ring @ turn * rng.uniform(0.3, 1.5) + rng.normal(size=2))
    return loft(rings, heights.tolist())


def terrain(rng: Rng) -> Float:
    """Hills and pits over a flat bottom; some have terraces."""
    n, rise = int(rng.integers(3, 7)), rng.choice([0.1, 0.5, 2.0])
    x, y = np.meshgrid(*[np.arange(n) * rng.uniform(0.1, 1)] * 2, indexing="ij")
    z = rise * rng.uniform(0.5, 1.5, x.shape)
    z = np.round(z * 4) / 4 + 0.2 if rng.random() < 0.3 else z
    top, bottom = np.stack([x, y, z], axis=2), np.stack([x, y, 0 * z], axis=2)
    sides = [
        np.stack([low, high])
        for low, high in (
            (bottom[:, 0], top[:, 0]),
            (bottom[-1], top[-1]),
            (bottom[::-1, -1], top[::-1, -1]),
            (bottom[0, ::-1], top[0, ::-1]),
        )
    ]
    skirt = np.concatenate([quads(side.swapaxes(0, 1), rng) for side in sides])
    body = np.concatenate([quads(top, rng), quads(bottom, rng)[:, ::-1], skirt])
    return turned_at_random(body, rng) if rng.random() < 0.5 else body


def shells(rng: Rng) -> Float:
    """Two or three bodies that overlap or do not."""
    kinds = (convex, tetrahedron, tilted_box, star, leaning_prism)
    return np.concatenate(
        [kinds[rng.integers(len(kinds))](rng) + 0.7 * rng.normal(size=3) for _ in range(rng.integers(2, 4))]
    )


def flanges(rng: Rng) -> Float:
    """A block with thin plates through it and perhaps a thin slot in it, perhaps tilted by a little."""
    parts = [box((2, 2, 2)).triangles]
    parts += [
        box((4, 3, thickness(rng)), (-1, -0.5, rng.uniform(0.1, 1.5))).triangles
        for _ in range(int(rng.integers(1, 3)))
    ]
    if rng.random() < 0.6:
        parts.append(box((1, 1, thickness(rng)), (0.5, 0.5, rng.uniform(0.1, 1.5))).triangles[:, ::-1])
    return leant(np.concatenate(parts), rng) if rng.random() < 0.4 else np.concatenate(parts)


def thickness(rng: Rng) -> float:
    return float(10 ** rng.uniform(-3, -0.5))


def leant(triangles: Float, rng: Rng) -> Float:
    """Turned about y by an angle of any order of size."""
    angle = 10 ** rng.uniform(-4, 0)
    along, up = np.cos(angle), np.sin(angle)
    return np.asarray(triangles @ np.array([[along, 0, up], [0, 1, 0], [-up, 0, along]]))


def needles(rng: Rng) -> Float:
    """Corners nearly on one line and nearly on each other: facets a thousand times longer than wide."""
    points = rng.normal(size=(int(rng.integers(5, 20)), 3))
    points[rng.random(len(points)) < 0.5] *= [1, 1e-3, 1e-3]
    twins = points[:4] + 1e-4 * rng.normal(size=(4, 3))
    return turned_at_random(hull(np.concatenate([points, twins])), rng)


def slab(rng: Rng) -> Float:
    """Thin and nearly level."""
    return leant(hull(rng.normal(size=(int(rng.integers(5, 12)), 3)) * [2, 2, 0.1]), rng)


KINDS: Final[tuple[Callable[[Rng], Float], ...]] = (
    convex,
    tetrahedron,
    tilted_box,
    tilted_sphere,
    star,
    leaning_prism,
    terrain,
    shells,
    flanges,
    needles,
    slab,
)
"""All of them keep what they enclose to their left: a random number from each seed decides the rest."""


def body(kind: Callable[[Rng], Float], rng: Rng) -> Mesh:
    """A part on the bed, at most 2.5 mm high, some with the rounding of files, some far from the middle."""
    triangles = kind(rng)
    if rng.random() < 0.5:
        triangles = triangles.astype(np.float32).astype(np.float64)
    triangles = triangles - np.array([0, 0, triangles[:, :, 2].min()])
    triangles *= min(1.0, rng.uniform(0.4, 2.5) / triangles[:, :, 2].max())
    if rng.random() < 0.3:
        triangles += np.array([100.0, 80.0, 0.0])
    return Mesh(triangles, kind.__name__)


def on_the_bed(path: Path) -> Mesh:
    """A part from a file, its middle over the origin."""
    mesh = load_mesh(path)
    low, high = mesh.bounds
    return mesh.moved(-np.array([*(low + high)[:2] / 2, low[2]]))


def random_plan(height: float, rng: Rng, containment: str = "mid") -> LayerPlan:
    """Even layers of any height, or layers of random heights; the last one ends below, at, or over the part."""
    most = int(height / 0.05) + 2
    tops: Float
    if rng.random() < 0.5:
        tops = np.arange(1.0, most + 1) * float(rng.uniform(0.05, 0.4))
    elif rng.random() < 0.5:
        tops = np.cumsum(rng.uniform(0.05, 0.4, most))
    else:
        tops = np.cumsum(rng.choice([0.05, 0.1, 0.2, 0.3, 0.4], most))
    tops = tops[: max(1, int(np.searchsorted(tops, height)) + int(rng.integers(2)))]
    if rng.random() < 0.3:
        tops *= height / tops[-1]
    plan = LayerPlan.from_tops(tops)
    return LayerPlan(plan.top, plan.cut, "random", containment)


# --- the search ---


def bounds_of(certificate: Certificate, layer: Int) -> Float:
    """(n,) what is proven for points of each layer; what is over the last one is `missing`."""
    return np.append(certificate.bound, certificate.missing)[layer]


def worst_excess(mesh: Mesh, stack: LayerPlan | Sections, n: int, rng: Rng, *, rounds: int = 3) -> float:
    """Largest distance over the bound of any wrong point found, mm; -inf if none is wrong."""
    plan = stack if isinstance(stack, LayerPlan) else stack.plan
    certificate = certify(read_surface(mesh), plan)
    points, layer = wrong_points(mesh, stack, n, rng)
    best = np.zeros((0, 3))
    excess = np.zeros(0)
    for _ in range(rounds + 1):
        if len(points):
            bound = bounds_of(certificate, layer)
            over = distance_to_mesh(points, mesh, bound + 0.02) - bound
            best, excess = np.concatenate([best, points]), np.concatenate([excess, over])
            chosen = np.argsort(-excess)[:60]
            best, excess = best[chosen], excess[chosen]
        # Near the worst ones there may be worse ones.
        near = np.repeat(best, 12, axis=0)
        step = plan.height.max() * 10.0 ** -rng.uniform(0.3, 5, (len(near), 1))
        moved = near + step * rng.normal(size=near.shape) * rng.integers(2, size=near.shape)
        points, layer = wrong_among(moved, mesh, stack)
    return float(excess.max(initial=-np.inf))


# --- the helpers ---


@given(st.integers(0, 10**6), st.sampled_from(["any", "needle", "point", "line"]))
def test_the_distance_to_a_triangle_is_that_of_its_nearest_point(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    triangle, points = rng.normal(size=(3, 3)), rng.normal(size=(5, 3)) * 2
    if kind == "needle":
        triangle[2] = triangle[1] + 1e-9 * rng.normal(size=3)
    elif kind == "point":
        triangle[1:] = triangle[0]
    elif kind == "line":
        triangle[2] = (triangle[0] + triangle[1]) / 2
    s, t = np.meshgrid(np.linspace(0, 1, 120), np.linspace(0, 1, 120))
    first, second = np.sqrt(s) * (1 - t), np.sqrt(s) * t
    weights = np.stack([1 - np.sqrt(s), first, second], axis=2).reshape(-1, 3)
    sampled = np.linalg.norm(points[:, None] - weights @ triangle, axis=2).min(axis=1)
    found = distance_to_triangles(points, np.broadcast_to(triangle, (5, 3, 3)))

    assert (found <= sampled + 1e-12).all()
    assert (sampled <= found + 0.1).all()
    assert found == pytest.approx(sampled, abs=0.1)


def test_the_distance_to_a_box_is_known_inside_and_outside() -> None:
    points = np.random.default_rng(1).uniform(-3, 5, (2000, 3))
    beyond = np.abs(points - 1) - 1
    outside, inside = np.linalg.norm(np.maximum(beyond, 0), axis=1), -beyond.max(axis=1)
    expected = np.maximum(outside, inside)

    found = distance_to_mesh(points, box((2, 2, 2)), 1.5)

    assert (found[expected > 1.5] == np.inf).all()
    assert found[expected <= 1.5] == pytest.approx(expected[expected <= 1.5], abs=1e-12)


def test_the_distance_to_a_mesh_is_that_to_the_nearest_of_all_its_facets() -> None:
    rng = np.random.default_rng(2)
    mesh = body(star, rng)
    low, high = mesh.bounds
    points = rng.uniform(low - 1, high + 1, (300, 3))
    each = [distance_to_triangles(points, np.broadcast_to(t, (300, 3, 3))) for t in mesh.triangles]

    assert distance_to_mesh(points, mesh, 20.0) == pytest.approx(np.min(each, axis=0), abs=0)


def test_winding_counts_the_shells_around_a_point_and_the_voids() -> None:
    void = Mesh(box((2, 2, 2), (4, 4, 4)).triangles[:, ::-1])
    mesh = joined([box(), box((10, 10, 10), (5, 0, 0)), void])
    points = np.array(
        [[2, 3, 5], [7.5, 1, 5], [5.5, 5.2, 5], [4.5, 5.2, 5], [1, 2, 11], [1, 2, -1], [20, 1, 1.0]]
    )
    least, greatest, sure = winding(points, mesh, points[:, 2], points[:, 2])

    assert sure.all()
    assert least.tolist() == greatest.tolist() == [1, 2, 1, 0, 0, 0, 0]


def test_winding_over_a_stretch_of_heights_tells_the_least_and_the_greatest() -> None:
    mesh = joined([box((4, 4, 1)), box((4, 4, 1), (0, 0, 2)), box((4, 4, 1), (0, 0, 2.5))])
    stretches = np.array([(0.1, 0.9), (0.5, 1.5), (1.2, 1.8), (0.5, 2.7), (-1, 9), (2.6, 2.7), (3.1, 3.2)])
    least, greatest, sure = winding(np.tile([1.0, 2.0, 0.0], (7, 1)), mesh, *stretches.T)

    assert sure.all()
    assert least.tolist() == [1, 0, 0, 0, 0, 2, 1]
    assert greatest.tolist() == [1, 1, 0, 2, 2, 2, 1]


def test_points_in_line_with_an_edge_or_on_the_surface_are_left_open() -> None:
    points = np.array([[5, 5, 5], [5, 2, 10], [0, 2, 5], [5, 2, 5.0]])  # diagonal, top, wall, plain

    assert winding(points, box(), points[:, 2], points[:, 2])[2].tolist() == [False, False, False, True]


@given(st.sampled_from(KINDS), st.integers(0, 10**6))
def test_sections_and_mesh_agree_on_what_the_stack_holds(kind: Callable[[Rng], Float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = body(kind, rng)
    plan = random_plan(mesh.height, rng)
    low, high = mesh.bounds
    points = rng.uniform(low - 0.1, high + 0.1, (500, 3)).clip(min=[-np.inf, -np.inf, 0.001])
    try:
        sections = cut(mesh, plan, 0.0)
    except PartError:  # no layer is cut where there is material
        return
    by_mesh, layer, sure = in_stack(points, mesh, plan)
    by_section, same_layer, sure_too = in_stack(points, mesh, sections)

    assert (layer == same_layer).all()
    differ = (by_mesh != by_section) & sure & sure_too
    at_cut = np.column_stack([points[:, :2], np.append(plan.cut, 0.0)[layer]])
    assert (distance_to_mesh(at_cut[differ], mesh, 1.0) < CONTOUR_ROUNDING).all()


def test_nothing_is_wrong_in_a_box_of_whole_layers() -> None:
    points, _ = wrong_points(box((3, 2, 1)), layers(5, 0.2), 4000, np.random.default_rng(3))

    assert len(points) == 0


def test_what_is_wrong_in_a_box_without_its_top_is_over_the_last_layer() -> None:
    mesh = box((3, 2, 1))
    points, layer = wrong_points(mesh, layers(4, 0.24), 4000, np.random.default_rng(3))

    assert len(points) > 500
    assert (layer == 4).all()
    assert ((points[:, 2] > 0.96) & (points[:, 2] < 1)).all()
    assert distance_to_mesh(points, mesh, 1.0).max() == pytest.approx(0.04, abs=1e-3)


@pytest.mark.parametrize("shift", [0.5, 1.0, 3.0])
def test_the_worst_of_a_leaning_prism_is_found(shift: float) -> None:
    mesh = sheared_prism(2, 1, shift)
    points, _ = wrong_points(mesh, layers(5, 0.2), 6000, np.random.default_rng(4))

    worst = 0.1 * np.sin(np.arctan(shift))  # half a layer, along the normal of the leaning face
    assert distance_to_mesh(points, mesh, 1.0).max() == pytest.approx(worst, rel=0.01)


def test_a_lost_flange_is_wrongly_empty_up_to_its_middle() -> None:
    mesh = joined([box((2, 2, 2)), box((6, 6, 0.08), (-2, -2, 1.01))])
    points, layer = wrong_points(mesh, layers(10, 0.2), 4000, np.random.default_rng(5))

    assert set(layer.tolist()) == {5}
    assert ((points[:, 2] > 1.01) & (points[:, 2] < 1.09)).all()
    assert 0.035 < distance_to_mesh(points, mesh, 1.0).max() <= 0.04


# --- the certificate ---


@given(st.sampled_from(KINDS), st.integers(0, 10**6))
def test_no_wrong_point_of_any_part_lies_over_the_bound(kind: Callable[[Rng], Float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = body(kind, rng)

    assert worst_excess(mesh, random_plan(mesh.height, rng), 800, rng) <= ROUNDING


@pytest.mark.parametrize("containment", ["positive", "negative"])
@settings(max_examples=examples(5, 64))
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 10**6))
def test_no_wrong_point_lies_over_the_bound_when_layers_hold_all_or_only_what_is_common(
    containment: str, kind: Callable[[Rng], Float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    mesh = body(kind, rng)
    plan = random_plan(mesh.height, rng, containment)

    assert worst_excess(mesh, plan, 800, rng) <= ROUNDING


@pytest.mark.parametrize(("path", "height"), crossed(sorted(SAMPLES.glob("*.stl")), [0.0, 0.31]))
def test_no_wrong_point_of_a_sample_part_lies_over_the_bound(path: Path, height: float) -> None:
    rng = np.random.default_rng(7)
    mesh = on_the_bed(path)
    plan = layers(int(mesh.height / height), height) if height else random_plan(mesh.height, rng)

    assert worst_excess(mesh, plan, 2000, rng, rounds=2) <= ROUNDING


@pytest.mark.parametrize("name", ["case_study", "sphere", "vase"])
def test_no_wrong_point_of_the_sections_as_cut_lies_over_the_bound(name: str) -> None:
    rng = np.random.default_rng(8)
    mesh = on_the_bed(SAMPLES / f"{name}.stl")
    sections = cut(mesh, random_plan(mesh.height, rng), 0.0)

    assert worst_excess(mesh, sections, 2000, rng, rounds=2) <= ROUNDING + CONTOUR_ROUNDING


@settings(max_examples=examples(6, 120))
@given(st.sampled_from(KINDS), st.integers(0, 10**6))
def test_no_more_than_the_certified_volume_is_wrong(kind: Callable[[Rng], Float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = body(kind, rng)
    plan = random_plan(mesh.height, rng)
    certificate = certify(read_surface(mesh), plan)
    low, high = mesh.bounds.copy()
    high[2] = max(high[2], plan.top[-1])
    n = 8000
    points = rng.uniform(low, high, (n, 3))
    wrong, layer = wrong_among(points, mesh, plan)

    room, last = float((high - low).prod()), plan.n_layers - 1
    found = np.bincount(np.minimum(layer, last), minlength=last + 1) / n
    doubt = np.sqrt(np.maximum(found, 3 / n) / n)
    assert ((found - 5 * doubt) * room <= certificate.volume).all()
    share = len(wrong) / n
    assert (share - 5 * np.sqrt(max(share, 3 / n) / n)) * room <= certificate.volume_error


def test_the_search_reaches_what_is_proven_where_a_corner_is_steeper_than_its_faces() -> None:
    mesh, plan = pyramid(2, 1), layers(5, 0.2)  # the faces rise at 45°, the edges between them are worse
    certificate = certify(read_surface(mesh), plan)
    points, layer = wrong_points(mesh, plan, 8000, np.random.default_rng(9))
    distance = distance_to_mesh(points, mesh, 1.0)

    facets_alone = 0.1 * np.sqrt(0.5)
    assert distance[layer < 4].max() > facets_alone * 1.1
    share = distance / bounds_of(certificate, layer)
    assert 0.95 < share[layer < 4].max() <= 1 + 1e-6


def test_the_bounds_of_convex_parts_are_hardly_more_than_what_is_found() -> None:
    shares = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        mesh = body((tilted_box, convex, tetrahedron)[seed % 3], rng)
        plan = layers(max(2, int(mesh.height / 0.11)), 0.11)
        bound = certify(read_surface(mesh), plan).bound
        points, layer = wrong_points(mesh, plan, 3000, rng)
        distance = distance_to_mesh(points, mesh, 1.0)[layer < plan.n_layers]
        shares.append((distance / bound[layer[layer < plan.n_layers]]).max())

    assert np.median(shares) > 0.95
    assert min(shares) > 0.6
