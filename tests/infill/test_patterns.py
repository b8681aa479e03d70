"""Patterns are what they are called, and line up through layers of different heights."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.infill import PATTERNS, infill_paths
from printer_slicer.infill.gyroid import CHORD_ERROR, gyroid_lines
from printer_slicer.infill.infill_task import InfillTask
from printer_slicer.model import Toolpaths
from tests.infill.stacks import UNEVEN, rectangle, rows, sparse_only
from tests.parts import layers, plain

FINE = layers(40, 0.08).top
MIXED = np.cumsum([0.2, 0.08, 0.32, 0.12, 0.3, 0.1, 0.2, 0.28, 0.08, 0.3])


def laid(pattern: str, tops: Float, side: float = 40.0, **changes: object) -> Toolpaths:
    wanted: dict[str, object] = {"infill_density": 0.15, "infill_anchor_max": 0, "infill_angle_deg": 20}
    return infill_paths(
        sparse_only([rectangle(side, side)], tops), plain(infill=pattern, **(wanted | changes))
    )


def lines_of(paths: Toolpaths, layer: int) -> shapely.MultiLineString:
    return shapely.MultiLineString([paths.path(int(i)) for i in np.flatnonzero(paths.layer == layer)])


def crossing_point(one: tuple[float, float], another: tuple[float, float]) -> Float:
    """Where rows (angle, place across) meet."""
    normals = np.array([[-np.sin(angle), np.cos(angle)] for angle, _ in (one, another)])
    return np.linalg.solve(normals, np.array([one[1], another[1]]))


# --- straight lines ---


@pytest.mark.parametrize(("pattern", "angles"), [("grid", (20, 110)), ("triangles", (20, 80, 140))])
def test_walls_stand_on_each_other_through_layers_of_any_height(
    pattern: str, angles: tuple[float, ...]
) -> None:
    paths = laid(pattern, MIXED)

    for angle in angles:
        first = rows(paths, 0, np.deg2rad(angle))
        assert len(first) >= 3
        for layer in range(1, len(MIXED)):
            assert rows(paths, layer, np.deg2rad(angle)) == pytest.approx(first, abs=1e-3)


def test_rectilinear_lines_turn_by_a_right_angle_and_stand_on_those_of_two_layers_below() -> None:
    paths = laid("rectilinear", MIXED)

    for layer in range(len(MIXED)):
        own, other = np.deg2rad(20 + 90 * (layer % 2)), np.deg2rad(110 - 90 * (layer % 2))
        assert len(rows(paths, layer, own)) > 8
        assert len(rows(paths, layer, other)) == 0
        assert rows(paths, layer, own) == pytest.approx(rows(paths, layer % 2, own), abs=1e-3)


@pytest.mark.parametrize("density", [0.05, 0.15, 0.3])
def test_no_three_lines_of_triangles_cross_in_one_point(density: float) -> None:
    """The three crossings at a corner lie more than a bead apart."""
    paths = laid("triangles", MIXED[:1], 90.0, infill_density=density)

    angles = np.deg2rad([20, 80, 140])
    places = [rows(paths, 0, float(angle)) for angle in angles]
    third = np.array([-np.sin(angles[2]), np.cos(angles[2])])
    points = [crossing_point((angles[0], a), (angles[1], b)) for a in places[0] for b in places[1]]
    aside = np.abs((np.array(points) @ third)[:, None] - places[2]).min(axis=1)
    assert aside.min() > 0.45


def test_lines_of_cubic_move_by_the_height_over_the_root_of_two() -> None:
    """The heights at which a plane's lines are found say how steep it is, whatever the layers' heights."""
    paths = laid("cubic", MIXED)
    middle = paths.plan.top - paths.plan.height / 2

    for angle, way in ((20, -1), (80, 1), (140, -1)):
        first = rows(paths, 0, np.deg2rad(angle))
        step = float(np.diff(first).mean())
        for layer in range(1, len(MIXED)):
            moved = rows(paths, layer, np.deg2rad(angle)) - way * (middle[layer] - middle[0]) / np.sqrt(2)
            off = (moved - first[0] + step / 2) % step - step / 2
            assert off == pytest.approx(0, abs=2e-3)


def test_the_planes_of_cubic_are_at_right_angles() -> None:
    """Their lines turn by 60° and move by 1 / √2 of the height: three normals without a common component."""
    normals = [
        np.array([-np.sin(angle), np.cos(angle), way * -np.sqrt(0.5)])
        for angle, way in zip(np.deg2rad([20, 80, 140]), (-1, 1, -1), strict=True)
    ]

    assert [float(normals[i] @ normals[j]) for i, j in ((0, 1), (0, 2), (1, 2))] == pytest.approx([0, 0, 0])


# --- waves ---


def gyroid(z: Float, spacing: float = 3.0) -> tuple[list[Float], Float]:
    """The lines of the gyroid at these z, each (n, 3); and the scale in radians per mm."""
    area = Areas.from_rings([[rectangle(40, 40)] for _ in z])
    nothing = sparse_only([], z)
    task = InfillTask(
        area, spacing, 0.4, 0.0, 0.0, z, 0 * z + 0.2, np.arange(len(z)), np.arange(len(z)), nothing, 1.0
    )
    lines, _ = gyroid_lines(task)
    height = np.repeat(z[lines.layer], lines.size)[:, None]
    return np.split(np.concatenate([lines.xy, height], axis=1), lines.start[1:-1]), z


def test_every_point_of_a_gyroid_lies_on_its_surface() -> None:
    """The value of the level set over its gradient is the distance from the surface."""
    z = np.linspace(0.04, 30, 61)
    lines, _ = gyroid(z)
    points = np.concatenate([line[1:-1] for line in lines])
    # The period is not asked from the pattern but taken from its lines: at z = 0 they repeat after it.
    scale = best_scale(points)

    assert surface_distance(points, scale).max() < 1e-3


def test_the_straight_lines_between_points_of_a_gyroid_keep_to_the_chord_error() -> None:
    z = np.linspace(0.04, 30, 61)
    lines, _ = gyroid(z)
    scale = best_scale(np.concatenate([line[1:-1] for line in lines]))
    middles = np.concatenate([(line[1:] + line[:-1]) / 2 for line in lines])

    distance = surface_distance(middles, scale, within_layer=True)

    assert np.quantile(distance, 0.99) < 1.5 * CHORD_ERROR
    assert distance.max() < 5 * CHORD_ERROR  # next to where lines change partners their bend is sharpest


def level(points: Float, scale: float) -> tuple[Float, Float]:
    x, y, z = points.T * scale
    value = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    gradient = scale * np.stack(
        [
            np.cos(x) * np.cos(y) - np.sin(z) * np.sin(x),
            np.cos(y) * np.cos(z) - np.sin(x) * np.sin(y),
            np.cos(z) * np.cos(x) - np.sin(y) * np.sin(z),
        ],
        axis=1,
    )
    return value, gradient


def surface_distance(points: Float, scale: float, *, within_layer: bool = False) -> Float:
    value, gradient = level(points, scale)
    steep = np.sqrt((gradient[:, : 2 if within_layer else 3] ** 2).sum(axis=1))
    return np.abs(value) / np.maximum(steep, 0.2 * scale)


def best_scale(points: Float) -> float:
    """Radians per mm with which the points fit the level set best."""
    tried = np.linspace(0.5, 1.5, 2001)
    some = points[:: max(len(points) // 400, 1)]
    errors = [float(np.abs(level(some, scale)[0]).mean()) for scale in tried]
    start = float(tried[int(np.argmin(errors))])
    finer = np.linspace(start - 1e-3, start + 1e-3, 2001)
    errors = [float(np.abs(level(some, scale)[0]).mean()) for scale in finer]
    return float(finer[int(np.argmin(errors))])


@pytest.mark.parametrize("pattern", ["gyroid", "cubic"])
def test_lines_lean_out_gently_from_layer_to_layer(pattern: str) -> None:
    """Nearly all of a layer's line lies within its own height and a half of the line below."""
    paths = laid(pattern, FINE)

    near = []
    for layer in range(1, len(FINE)):
        below = shapely.buffer(lines_of(paths, layer - 1), 1.5 * 0.08)
        here = lines_of(paths, layer)
        near.append(shapely.length(shapely.intersection(here, below)) / shapely.length(here))
    assert np.mean(near) > 0.85
    assert np.min(near) > 0.6


def test_honeycomb_is_the_same_on_every_layer_and_prints_no_wall_twice() -> None:
    paths = laid("honeycomb", UNEVEN)

    first = lines_of(paths, 0)
    spacing = float(paths.width[0] - paths.height[0] * (1 - np.pi / 4))
    for layer in range(1, len(UNEVEN)):
        assert shapely.hausdorff_distance(lines_of(paths, layer), first) < 1e-3
    apart = [
        one.distance(another)
        for i, one in enumerate(first.geoms)
        for another in list(first.geoms)[:i]
        if one.distance(another) < 2
    ]
    assert min(apart) == pytest.approx(spacing, rel=0.03)


def test_the_cells_of_a_honeycomb_are_hexagons() -> None:
    """All whole cells are equal, with six sides in three directions about 60° apart."""
    paths = laid("honeycomb", UNEVEN[:1], 60.0)

    walls = shapely.buffer(lines_of(paths, 0), 0.5, join_style="mitre")
    cells = shapely.difference(shapely.box(5, 5, 55, 55), walls).geoms
    size = float(np.median([cell.area for cell in cells]))
    whole = [cell for cell in cells if cell.area == pytest.approx(size, rel=1e-4)]
    assert len(whole) > 30
    for cell in whole:
        side = np.diff(np.array(cell.simplify(0.05).exterior.coords), axis=0)
        turn = (np.rad2deg(np.arctan2(side[:, 1], side[:, 0])) - 20 + 30) % 60 - 30
        assert len(side) == 6
        assert np.abs(turn).max() < 5


def test_concentric_loops_are_closed_and_evenly_apart() -> None:
    paths = laid("concentric", UNEVEN[:1])

    assert paths.closed.all()
    sides = np.sort([np.ptp(paths.path(i)[:, 0]) for i in range(paths.n_paths)])
    assert np.diff(sides) == pytest.approx(np.diff(sides).mean(), rel=1e-3)


@pytest.mark.parametrize("pattern", [name for name in PATTERNS if name not in ("concentric", "lightning")])
def test_a_quarter_turn_of_the_angle_turns_the_pattern(pattern: str) -> None:
    one = laid(pattern, UNEVEN, infill_angle_deg=10)
    turned = laid(pattern, UNEVEN, infill_angle_deg=100)

    length = [sum(shapely.length(lines_of(paths, k)) for k in range(len(UNEVEN))) for paths in (one, turned)]
    assert length[0] == pytest.approx(length[1], rel=0.03)
    assert not shapely.equals(lines_of(one, 0), lines_of(turned, 0))
