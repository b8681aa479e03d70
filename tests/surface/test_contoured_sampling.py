"""Sampled wrong points of contoured layers on random terrain: none is farther from the surface than the bound."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.model import ContourRule, LayerPlan, Mesh
from printer_slicer.surface import layer_bounds, read_surface
from printer_slicer.surface.contoured_tops import ShallowFacets
from printer_slicer.values import replace
from tests.surface.distances import distance_to_mesh

SIDE, N = 6.0, 7  # mm, and points along a side of the terrain
RULE = ContourRule(0.05, 0.45, 0.0, 0.0, 1.0)  # extrusions are as high as the surface, exactly


def terrain(z: Float) -> Mesh:
    """A solid with a square foot under a terrain of heights (N, N), mm."""
    x, y = np.meshgrid(np.linspace(0, SIDE, N), np.linspace(0, SIDE, N), indexing="ij")
    top, foot = np.stack([x, y, z], axis=2), np.stack([x, y, 0 * z], axis=2)
    facets = []
    for grid, turn in ((top, 1), (foot, -1)):
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        facets += [np.stack(one[::turn], axis=2).reshape(-1, 3, 3) for one in ((a, b, c), (a, c, d))]
    borders = [(top[:, 0], foot[:, 0]), (top[-1], foot[-1])]
    borders += [(top[::-1, -1], foot[::-1, -1]), (top[0, ::-1], foot[0, ::-1])]
    for high, low in borders:
        facets.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        facets.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return Mesh(np.concatenate(facets), "terrain")


def even_layers(height: float, n: int, rule: ContourRule) -> LayerPlan:
    """Contoured layers of one height, mm, on a first one of 0.2 mm."""
    tops: Float = np.asarray(0.2 + height * np.arange(n), np.float64)
    return replace(LayerPlan.from_tops(tops), contour_rule=rule)


def height_at(z: Float, xy: Float) -> Float:
    """The height (n,) of a terrain at points (n, 2)."""
    at = xy / SIDE * (N - 1)
    cell = np.floor(at).astype(np.int64).clip(0, N - 2)
    x, y = (at - cell).T
    a, b, c, d = (z[cell[:, 0] + i, cell[:, 1] + j] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.asarray(np.where(x >= y, a + x * (b - a) + y * (c - b), a + x * (c - d) + y * (d - a)))


def sample_wrong_points(z: Float, plan: LayerPlan, n: int, rng: np.random.Generator) -> tuple[Float, Int]:
    """Points (m, 3) between the surface and the top of an extrusion beside them, and their layers (m,)."""
    place = rng.uniform(0, SIDE, (n, 2))
    angle, away = rng.uniform(0, 2 * np.pi, n), RULE.width / 2 * np.sqrt(rng.random(n))
    centre = place + away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    inside = ((centre > 0) & (centre < SIDE)).all(axis=1)
    place, centre = place[inside], centre[inside]
    surface, followed = height_at(z, place), height_at(z, centre)
    layer = np.searchsorted(plan.top, surface).clip(0, plan.n_layers - 1)
    bottom, top = plan.bottom[layer], plan.top[layer]
    is_filled = surface >= bottom + RULE.min_height / 2
    end = np.clip(followed, np.minimum(bottom + RULE.min_height, top), top)
    end = np.where(is_filled, end, bottom)
    share = np.where(rng.random(len(end)) < 0.5, 1.0, rng.random(len(end)))
    points = np.column_stack([place, surface + share * (end - surface)])
    printed = ~is_filled | (followed >= bottom + RULE.min_height / 2)
    some = printed & (layer > 0)
    return points[some], layer[some]


@given(st.integers(0, 2**32 - 1))
def test_no_sampled_point_exceeds_the_bound_of_layers_that_are_followed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steepest = rng.uniform(0.02, 0.35)
    steps = rng.uniform(-1, 1, (2, N, N)) * steepest / np.sqrt(2) * SIDE / (N - 1) / 2
    z = 1.0 + np.cumsum(steps[0], axis=0) + np.cumsum(steps[1], axis=1) * rng.random()
    z += 0.3 - min(float(z.min()) - 0.6, 0.0)
    mesh = terrain(z)
    height = rng.uniform(0.2, 0.6)
    n_layers = int((z.max() - 0.2) / height) + 2
    plan = even_layers(height, n_layers, replace(RULE, max_slope=1.0))
    bounds = layer_bounds(read_surface(mesh), plan)
    points, layer = sample_wrong_points(z, plan, 4000, rng)
    distance = distance_to_mesh(points, mesh, 1.0)
    assert (distance <= bounds[layer] + 1e-9).all()
    steepest_found = np.array([ShallowFacets.of_triangles(mesh.triangles, 1.0).slope.max()])
    assert (
        bounds[layer].max() <= RULE.bound_deviations(steepest_found)[0] + 1e-9
    )  # whatever the layer height is


def test_points_beside_extrusions_come_close_to_the_bound() -> None:
    z = 1.0 + np.linspace(0, SIDE * 0.4, N)[:, None] + np.zeros((1, N))
    mesh, plan = terrain(z), even_layers(0.3, 12, replace(RULE, max_slope=0.5))
    bounds = layer_bounds(read_surface(mesh), plan)
    points, layer = sample_wrong_points(z, plan, 20_000, np.random.default_rng(1))
    share = distance_to_mesh(points, mesh, 1.0) / bounds[layer]
    assert 0.98 < share.max() <= 1 + 1e-9
    assert bounds[layer] == pytest.approx(RULE.width / 2 * np.sin(np.arctan(0.4)))
