"""Small closed meshes and profiles with known results, for tests of the slicer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from importlib import import_module
from itertools import pairwise
from math import cos, pi, sin
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Areas, LayerPlan, Mesh
from printer_slicer.profile import Profile, load_profile

__all__ = [
    "CASE_STUDY_LEVELS",
    "box",
    "box_with_hole",
    "case_study",
    "cone",
    "fin_on_a_box",
    "joined",
    "layers",
    "loft",
    "plain",
    "prism",
    "profile",
    "pyramid",
    "shape",
    "shapely",
    "sheared_prism",
    "sphere",
    "sphere_area",
    "step_pyramid",
    "turned",
    "two_boxes",
    "without",
]

shapely: Final[Any] = import_module("shapely")
"""Its functions have no types; this way the tests that use them need not say so at every call."""

Size = tuple[float, float, float]
CASE_STUDY_LEVELS = (0.0, 30.0, 52.5, 82.5)


def loft(rings: Sequence[Float], heights: Sequence[float]) -> Float:
    """(F, 3, 3) closed surface through convex rings (n, 2), counter-clockwise, one above the other."""
    levels = [np.column_stack([ring, np.full(len(ring), z)]) for ring, z in zip(rings, heights, strict=True)]
    facets = [*_fan(levels[0])[:, ::-1], *_fan(levels[-1])]
    for low, high in pairwise(levels):
        after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        facets += [
            *np.stack([low, after_low, after_high], axis=1),
            *np.stack([low, after_high, high], axis=1),
        ]
    return np.array(facets)


def _fan(ring: Float) -> Float:
    return np.stack([np.broadcast_to(ring[0], (len(ring) - 2, 3)), ring[1:-1], ring[2:]], axis=1)


def _rectangle(x: float, y: float, at: tuple[float, float] = (0.0, 0.0)) -> Float:
    corners: Float = np.array([(0, 0), (x, 0), (x, y), (0, y)], dtype=np.float64) + np.array(at)
    return corners


def box(size: Size = (10.0, 10.0, 10.0), at: Size = (0.0, 0.0, 0.0)) -> Mesh:
    """Twelve facets; `at` is the lowest corner."""
    ring = _rectangle(size[0], size[1])
    return Mesh(loft([ring, ring], [0.0, size[2]]), "box").moved(at)


def prism(ring: Sequence[tuple[float, float]] | Float, height: float) -> Mesh:
    """Upright walls over a convex outline."""
    outline = np.asarray(ring, dtype=np.float64)
    return Mesh(loft([outline, outline], [0.0, height]), "prism")


def pyramid(side: float = 20.0, height: float = 20.0) -> Mesh:
    """Square foot, one tip: the section at z is a square of side (1 - z / height) * side."""
    return _tipped(_rectangle(side, side, (-side / 2, -side / 2)), height, "pyramid")


def cone(radius: float = 10.0, height: float = 20.0, sides: int = 64) -> Mesh:
    """A pyramid over a regular polygon."""
    turn = 2 * pi * np.arange(sides) / sides
    return _tipped(radius * np.column_stack([np.cos(turn), np.sin(turn)]), height, "cone")


def _tipped(ring: Float, height: float, name: str) -> Mesh:
    foot = np.column_stack([ring, np.zeros(len(ring))])
    tip = np.broadcast_to((0, 0, height), foot.shape)
    walls = np.stack([foot, np.roll(foot, -1, axis=0), tip], axis=1)
    return Mesh(np.concatenate([walls, _fan(foot)[:, ::-1]]), name)


_PARALLELS, _MERIDIANS = 16, 24


def sphere(radius: float = 10.0) -> Mesh:
    """Rings of 24 corners at 16 parallels; the poles are cut off flat at a quarter of a parallel."""
    angles = _parallels()
    turn = 2 * pi * np.arange(_MERIDIANS) / _MERIDIANS
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [radius * sin(angle) * circle for angle in angles]
    return Mesh(loft(rings, _heights(radius)), "sphere")


def sphere_area(z: float, radius: float = 10.0) -> float:
    """Exact area of the section of `sphere` at z: between two parallels the radius changes linearly."""
    radii = [radius * sin(angle) for angle in _parallels()]
    return float(_MERIDIANS / 2 * np.interp(z, _heights(radius), radii) ** 2 * sin(2 * pi / _MERIDIANS))


def _heights(radius: float) -> list[float]:
    angles = _parallels()
    return [radius * (cos(angles[0]) - cos(angle)) for angle in angles]


def _parallels() -> list[float]:
    return [pi * (i + 0.25) / (_PARALLELS - 0.5) for i in range(_PARALLELS)]


def step_pyramid(sides: Sequence[float], heights: Sequence[float]) -> Mesh:
    """Square blocks of these sides and heights, one on the other, as one surface with flats between them.

    The sides must become smaller upward.
    """
    facets: list[Float] = []
    z = 0.0
    for i, (side, height) in enumerate(zip(sides, heights, strict=True)):
        ring = _rectangle(side, side, (-side / 2, -side / 2))
        low, high = np.column_stack([ring, np.full(4, z)]), np.column_stack([ring, np.full(4, z + height)])
        facets += _band(low, high)
        z += height
        if i == 0:
            facets += [*_fan(low)[:, ::-1]]
        if i + 1 < len(sides):
            smaller = sides[i + 1]
            facets += _band(
                high, np.column_stack([_rectangle(smaller, smaller, (-smaller / 2,) * 2), np.full(4, z)])
            )
        else:
            facets += [*_fan(high)]
    return Mesh(np.array(facets), "step pyramid")


def _band(low: Float, high: Float) -> list[Float]:
    after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    return [*np.stack([low, after_low, after_high], axis=1), *np.stack([low, after_high, high], axis=1)]


def joined(meshes: Iterable[Mesh], name: str = "parts") -> Mesh:
    """Several surfaces as one part; nothing is merged."""
    return Mesh(np.concatenate([mesh.triangles for mesh in meshes]), name)


def two_boxes(size: Size = (10.0, 10.0, 4.0), gap: float = 10.0) -> Mesh:
    """The same box twice, side by side along x."""
    return joined([box(size), box(size, (size[0] + gap, 0.0, 0.0))], "two boxes")


def box_with_hole(outer: Size = (20.0, 20.0, 10.0), hole: tuple[float, float] = (8.0, 6.0)) -> Mesh:
    """An upright rectangular hole through the middle of a box."""
    x, y, z = outer
    big = _rectangle(x, y)
    small = _rectangle(*hole, ((x - hole[0]) / 2, (y - hole[1]) / 2))
    low, high = (np.column_stack([big, np.full(4, level)]) for level in (0.0, z))
    in_low, in_high = (np.column_stack([small, np.full(4, level)]) for level in (0.0, z))
    walls = [*_band(low, high), *(facet[::-1] for facet in _band(in_low, in_high))]
    top, bottom = _band(high, in_high), [facet[::-1] for facet in _band(low, in_low)]
    return Mesh(np.array([*walls, *top, *bottom]), "box with hole")


def sheared_prism(side: float = 10.0, height: float = 20.0, shift: float = 20.0) -> Mesh:
    """Every section is the same square, `shift` / `height` mm farther along x for each mm of z."""
    ring = _rectangle(side, side)
    return Mesh(loft([ring, ring + np.array([shift, 0.0])], [0.0, height]), "sheared prism")


def fin_on_a_box() -> Mesh:
    """A box of 10 mm with a sheet of no thickness beside it: one facet and its reverse."""
    sheet = np.array([[(12.0, 0.0, 0.0), (12.0, 8.0, 1.0), (12.0, 3.0, 9.0)]])
    return Mesh(np.concatenate([box().triangles, sheet, sheet[:, ::-1]]), "fin")


def case_study() -> Mesh:
    """The paper's part: prism 50 x 50 x 30, frustum 22.5 high, prism 5 x 5 x 30."""
    rings = [_rectangle(side, side, (-side / 2, -side / 2)) for side in (50.0, 50.0, 5.0, 5.0)]
    return Mesh(loft(rings, CASE_STUDY_LEVELS), "case study")


def layers(count: int, height: float) -> LayerPlan:
    """A plan of so many layers of this height."""
    return LayerPlan.from_tops(np.linspace(height, count * height, count))


def turned(mesh: Mesh, quarters: int = 1) -> Mesh:
    """The part turned about z by quarter turns, without rounding."""
    triangles = mesh.triangles
    for _ in range(quarters % 4):
        triangles = np.stack([-triangles[..., 1], triangles[..., 0], triangles[..., 2]], axis=-1)
    return Mesh(triangles, mesh.name)


def without(mesh: Mesh, *facets: int) -> Mesh:
    """The part with some facets missing."""
    return Mesh(np.delete(mesh.triangles, facets, axis=0), mesh.name)


@cache
def _profile(names: tuple[str, str, str], changes: tuple[tuple[str, object], ...]) -> Profile:
    return load_profile(*names, dict(changes))


def profile(
    printer: str = "marlin_220", material: str = "pla", quality: str = "standard", **changes: object
) -> Profile:
    """A shipped profile with changes; `__` in a keyword stands for the dot: `planner__kind="area"`.

    Its z step is 0.01 mm unless asked for, so that heights in tests are short numbers.
    """
    usual: dict[str, object] = {} if "z_step" in changes else {"z_step": 0.01}
    named = tuple((key.replace("__", "."), value) for key, value in (usual | changes).items())
    return _profile((printer, material, quality), named)


def plain(**changes: object) -> Profile:
    """A profile with uniform layers, without skirt, start and end G-code, and without slowing down."""
    still: dict[str, object] = {
        "skirt_loops": 0,
        "start_gcode": "",
        "end_gcode": "",
        "min_layer_time": 0,
        "printer.origin": "centre",
        "printer.z_step": 0.01,
    }
    named = tuple((key.replace("__", "."), value) for key, value in (still | changes).items())
    return _profile(("marlin_220", "pla", "standard"), named)


def shape(areas: Areas, layer: int) -> Any:
    """The area of one layer as shapely sees it: rings put on or cut out from the largest to the smallest."""
    rings = sorted(
        (shapely.LinearRing(ring) for ring in areas.rings(layer)),
        key=lambda r: -shapely.area(shapely.Polygon(r)),
    )
    result = shapely.Polygon()
    for ring in rings:
        one = shapely.Polygon(ring)
        result = shapely.union(result, one) if shapely.is_ccw(ring) else shapely.difference(result, one)
    return result
