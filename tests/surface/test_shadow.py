"""The shadow of the surface against adding it up directly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from printer_slicer.surface.shadow import Shadow, project_surface
from tests.parts import box, cone, joined, pyramid, shapely, sheared_prism, sphere, step_pyramid, without

PARTS: Final[Mapping[str, Mesh]] = {
    "box": box((3, 2, 1)),
    "pyramid": pyramid(4, 2),
    "steps": step_pyramid([4, 2, 1], [0.31, 0.42, 0.27]),
    "sphere": sphere(1.5),
    "leaning": sheared_prism(2, 2, 1.5),
    "two": joined([cone(1, 2, 7), box((1, 1, 0.5), (3, 0, 0.7))]),
    "open": without(sphere(1), 3, 50, 51),
}


def clipped_area(triangle: Float, z: float) -> float:
    """The area, seen from above, of what of a triangle lies at z or below, by cutting its outline."""
    kept: list[tuple[float, float]] = []
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if a[2] <= z:
            kept.append((a[0], a[1]))
        if (a[2] <= z) != (b[2] <= z):
            share = (z - a[2]) / (b[2] - a[2])
            kept.append((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
    return float(shapely.Polygon(kept).area) if len(kept) >= 3 else 0.0


def signs(mesh: Mesh) -> Float:
    """(F,) 1 for facets that face up, -1 down, 0 upright."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return np.asarray(np.sign(np.round(np.cross(b - a, c - a)[:, 2], 12)))


def direct(mesh: Mesh, side: int, planes: Float) -> Float:
    """(n,) the shadow at and below each plane of the facets that face up (1) or down (-1)."""
    chosen = mesh.triangles[signs(mesh) == side]
    return np.array([sum(clipped_area(triangle, z) for triangle in chosen) for z in planes])


def clear_of_corners(mesh: Mesh, planes: Float) -> Float:
    """The planes that no flat lies in, where below and at differ."""
    return np.array([z for z in planes if np.abs(mesh.triangles[:, :, 2] - z).min() > 1e-9])


def integrated(shadow: Shadow, z: float) -> float:
    """The integral of the shadow up to z, facet by facet, by Gauss points between its corners."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    total = 0.0
    for low, middle, high, area in zip(shadow.low, shadow.middle, shadow.high, shadow.area, strict=True):
        one = Shadow(*(np.array([value]) for value in (low, middle, high, area)))
        for begin, end in ((low, middle), (middle, high), (high, max(z, high))):
            until = min(end, z)
            if until > begin:
                places = begin + (until - begin) * (nodes + 1) / 2
                total += float((weights * one.area_below(places, including=True)).sum()) * (until - begin) / 2
    return total


def lattice(cell: float, n_cells: int) -> Float:
    return np.arange(n_cells + 1, dtype=np.float64) * cell


def thrown(z: Float, rng: np.random.Generator) -> Shadow:
    """Facets with these heights of corners (n, 3), ascending in each row, and any areas."""
    low, middle, high = z.T
    return Shadow(low, middle, high, rng.uniform(0.1, 2, len(z)))


each_part = pytest.mark.parametrize("name", PARTS)


@each_part
def test_the_shadow_under_a_plane_is_the_area_of_the_clipped_facets(name: str) -> None:
    mesh = PARTS[name]
    planes = clear_of_corners(mesh, np.sort(np.random.default_rng(1).uniform(-0.2, mesh.height + 0.2, 25)))
    up, down = project_surface(mesh)

    assert up.area_below(planes) == pytest.approx(direct(mesh, 1, planes), abs=1e-9)
    assert down.area_below(planes) == pytest.approx(direct(mesh, -1, planes), abs=1e-9)


@each_part
def test_at_the_corners_a_plane_may_count_what_lies_in_it_or_not(name: str) -> None:
    mesh = PARTS[name]
    planes = np.unique(mesh.triangles[:, :, 2])[-6:]
    for side, shadow in zip((1, -1), project_surface(mesh), strict=True):
        a_hair_below = direct(mesh, side, planes - 1e-9)
        assert shadow.area_below(planes) == pytest.approx(a_hair_below, abs=1e-6)
        assert shadow.area_below(planes, including=True) == pytest.approx(
            direct(mesh, side, planes), abs=1e-6
        )


@each_part
def test_closed_parts_throw_as_much_shadow_up_as_down(name: str) -> None:
    up, down = project_surface(PARTS[name])

    if name != "open":
        assert up.area.sum() == pytest.approx(down.area.sum(), rel=1e-12)
    assert (up.low <= up.middle).all()
    assert (up.middle <= up.high).all()
    assert (up.area > 0).all()
    assert (down.area > 0).all()


@each_part
def test_the_integral_is_that_of_the_shadow_under_every_plane_below(name: str) -> None:
    mesh = PARTS[name]
    levels = np.unique(mesh.triangles[:, :, 2])
    planes = np.sort(np.append(np.random.default_rng(2).uniform(-0.2, mesh.height + 0.3, 6), levels[[0, -1]]))
    for shadow in project_surface(mesh):
        expected = [integrated(shadow, float(z)) for z in planes]
        assert shadow.area_integral(planes) == pytest.approx(expected, abs=1e-9)


def test_the_integral_over_a_closed_part_is_its_volume() -> None:
    """What lies over the shadow that faces down and under the one that faces up is the part."""
    for mesh in (pyramid(4, 2), sphere(1.5), sheared_prism(2, 2, 1.5)):
        up, down = project_surface(mesh)
        top = np.array([mesh.height])
        assert (down.area_integral(top) - up.area_integral(top))[0] == pytest.approx(mesh.volume, rel=1e-9)


@given(st.integers(0, 10**6), st.integers(1, 40), st.sampled_from(["any", "tied", "far", "on the lattice"]))
def test_many_planes_at_once_are_the_same_as_one_by_one(seed: int, n: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    z = np.sort(rng.uniform(0, 2, (8, 3)), axis=1)
    if kind == "tied":
        z = np.round(z, 1)
    elif kind == "far":
        z += 150
    elif kind == "on the lattice":
        z = np.round(z * 4) / 4
    shadow = thrown(z, rng)
    planes = np.sort(rng.uniform(z.min() - 0.3, z.max() + 0.3, n))
    planes[rng.random(n) < 0.3] = rng.choice(z.ravel(), 1)
    planes.sort()

    for read in (shadow.area_below, shadow.area_integral, partial_including(shadow)):
        together = read(planes)
        alone = np.concatenate([read(planes[i : i + 1]) for i in range(n)])
        assert together == pytest.approx(alone, abs=1e-9)
        assert (np.diff(together) >= -1e-9).all()


def partial_including(shadow: Shadow) -> Callable[[Float], Float]:
    return lambda planes: shadow.area_below(planes, including=True)


def test_no_planes_and_no_facets_are_nothing() -> None:
    up, _ = project_surface(pyramid(4, 2))
    nothing: Any = np.zeros(0)
    empty = Shadow(nothing, nothing, nothing, nothing)

    assert up.area_below(nothing).shape == up.area_integral(nothing).shape == (0,)
    assert empty.area_below(np.array([1.0, 2.0])).tolist() == [0, 0]
    assert empty.area_integral(np.array([1.0, 2.0])).tolist() == [0, 0]
    assert empty.area_integral_on_lattice(0.1, 3).tolist() == [0] * 4


@each_part
@pytest.mark.parametrize("cell", [0.005, 0.02, 0.13])
def test_on_a_lattice_the_integral_is_exact_within_the_rule_of_its_steps(name: str, cell: float) -> None:
    """The trapezoidal rule errs by up to cell³/12 of the greatest bend, for each cell that a facet passes."""
    mesh = PARTS[name]
    n_cells = int(mesh.height / cell) + 3
    planes = lattice(cell, n_cells)
    for shadow in project_surface(mesh):
        exact = shadow.area_integral(planes)
        sloped = shadow.high > shadow.low
        share = shadow.area[sloped].sum()
        # A parabola over less than a cell errs by no more than its area times a cell.
        allowed = cell * share + 1e-9
        assert np.abs(shadow.area_integral_on_lattice(cell, n_cells) - exact).max() <= allowed


@each_part
def test_on_a_finer_lattice_the_integral_comes_as_near_as_one_likes(name: str) -> None:
    mesh = PARTS[name]
    for shadow in project_surface(mesh):
        errors = []
        for cell in (0.1, 0.01, 0.001):
            n_cells = int(mesh.height / cell) + 1
            planes = lattice(cell, n_cells)
            errors.append(
                float(
                    np.abs(
                        shadow.area_integral_on_lattice(cell, n_cells) - shadow.area_integral(planes)
                    ).max()
                )
            )
        assert errors[2] <= 1e-5 * max(float(shadow.area.sum()), 1.0) + 1e-9
        assert errors[2] <= errors[0] + 1e-9


@given(st.integers(0, 10**6))
def test_what_lies_between_two_planes_of_the_lattice_is_exact_on_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell = 0.1
    z = np.sort((rng.integers(0, 18, 12)[:, None] + rng.uniform(0.01, 0.99, (12, 3))) * cell, axis=1)
    shadow = thrown(z, rng)
    planes = lattice(cell, 20)

    assert shadow.area_integral_on_lattice(cell, 20) == pytest.approx(shadow.area_integral(planes), abs=1e-9)


def test_a_tall_part_of_many_facets_keeps_its_digits_on_the_lattice() -> None:
    """Sums of parabolas over 200 mm must not leave their rounding behind."""
    mesh = cone(20, 200, 400)
    up, _ = project_surface(mesh)
    n_cells = 40_000
    planes = lattice(0.005, n_cells)
    error = np.abs(up.area_integral_on_lattice(0.005, n_cells) - up.area_integral(planes))

    assert error.max() <= 1e-6 * up.area.sum()
