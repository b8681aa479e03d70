"""Parts that need supports, made of few facets: one mesh each, so that results of it can be stored."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from tests.parts import box, joined, loft

__all__ = [
    "bracket",
    "hook",
    "inverted_cone",
    "mushroom",
    "ramp_in_a_room",
    "round_body",
    "shelf_and_arm",
    "slope_under_a_ceiling",
    "sphere_on_bed",
    "table",
    "tee",
    "tip_over_a_ridge",
    "tub",
]


def round_body(
    profile: list[tuple[float, float]], sides: int = 64, at: tuple[float, float] = (0.0, 0.0)
) -> Mesh:
    """A body of revolution through (radius, z), from its lowest to its highest point; closed by flats."""
    turn = 2 * np.pi * np.arange(sides) / sides
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [np.column_stack([max(r, 1e-3) * circle + at, np.full(sides, z)]) for r, z in profile]
    facets = []
    for low, high in pairwise(rings):
        after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        facets += [np.stack([low, after_low, after_high], axis=1), np.stack([low, after_high, high], axis=1)]
    for ring, way in ((rings[0], -1), (rings[-1], 1)):
        fan = np.stack([np.broadcast_to(ring[0], (sides - 2, 3)), ring[1:-1], ring[2:]], axis=1)
        facets.append(fan[:, ::way])
    return Mesh(np.concatenate(facets), "round body")


@cache
def tee(arm: float = 25.0, height: float = 40.0, width: float = 10.0, thick: float = 4.0) -> Mesh:
    """A stem with an arm to each side at its top."""
    stem = box((10.0, width, height), (-5.0, -width / 2, 0.0))
    bar = box((10.0 + 2 * arm, width, thick), (-5.0 - arm, -width / 2, height))
    return joined([stem, bar], "tee")


@cache
def bracket() -> Mesh:
    """Two plates of 60 x 40, one over the other, with a wall between them."""
    plates = [box((60.0, 40.0, 4.0), (-30.0, -20.0, z)) for z in (0.0, 40.0)]
    return joined([*plates, box((60.0, 5.0, 42.0), (-30.0, -20.0, 1.0))], "bracket")


@cache
def sphere_on_bed(radius: float = 20.0, sides: int = 96) -> Mesh:
    """A ball that touches the bed."""
    angle = np.linspace(0, np.pi, sides // 2)
    return round_body([(radius * np.sin(t), radius * (1 - np.cos(t))) for t in angle], sides)


@cache
def mushroom(cap: float = 20.0, height: float = 30.0) -> Mesh:
    """A stalk with a flat cap."""
    return round_body([(4.0, 0.0), (4.0, height), (cap, height), (cap, height + 3)])


@cache
def table(x: float = 80.0, y: float = 60.0, height: float = 38.0) -> Mesh:
    """Four legs with a plate."""
    legs = [box((6.0, 6.0, height + 1), (a, b, 0.0)) for a in (0.0, x - 6) for b in (0.0, y - 6)]
    return joined([*legs, box((x, y, 3.0), (0.0, 0.0, height))], "table")


@cache
def inverted_cone(radius: float = 8.0, height: float = 15.0) -> Mesh:
    """A cone on its tip, at the end of an arm."""
    cone = round_body([(0.0, 0.0), (radius, height)], at=(20.0, 0.0)).moved((0.0, 0.0, 15.0))
    post, arm = box((6.0, 6.0, 34.0), (-3.0, -3.0, 0.0)), box((31.0, 6.0, 4.0), (-3.0, -3.0, 30.0))
    return joined([cone, post, arm.moved((0.0, 0.0, -0.5))], "hanging cone")


@cache
def shelf_and_arm() -> Mesh:
    """A wide plate 8 mm above the bed, and an arm 60 mm above it, on the same base."""
    base, leg = box((80.0, 10.0, 2.0), (-70.0, 0.0, 0.0)), box((6.0, 40.0, 9.0), (-30.0, -15.0, 0.0))
    plate, post = box((46.0, 40.0, 3.0), (-70.0, -15.0, 8.0)), box((10.0, 10.0, 61.0))
    return joined([base, leg, plate, post, box((35.0, 10.0, 4.0), (0.0, 0.0, 60.0))], "shelf and arm")


@cache
def hook() -> Mesh:
    """A post with an arm, from which a cone of 15 mm hangs down."""
    return inverted_cone()


@cache
def tub() -> Mesh:
    """A tub with a shelf inside, under which supports can only stand on the floor of the tub."""
    walls = [
        *(box((50.0, 4.0, 30.0), (-25.0, y, 0.0)) for y in (-25.0, 21.0)),
        *(box((4.0, 50.0, 30.0), (x, -25.0, 0.0)) for x in (-25.0, 21.0)),
    ]
    floor, shelf = box((50.0, 50.0, 3.0), (-25.0, -25.0, 0.0)), box((20.0, 44.0, 3.0), (-23.0, -22.0, 20.0))
    return joined([*walls, floor, shelf], "tub")


@cache
def tip_over_a_ridge() -> Mesh:
    """A cone that hangs over a ridge of 4 mm, so steep that columns below its tip find nothing to stand on."""
    foot: Float = np.array([(-11.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-11.0, 2.0)])
    top: Float = np.array([(-0.01, -2.0), (3.0, -2.0), (3.0, 2.0), (-0.01, 2.0)])
    ridge = Mesh(loft([foot, top], [0.0, 30.0]), "ridge")
    cone = round_body([(0.0, 0.0), (5.0, 8.0)], at=(-5.5, 0.0)).moved((0.0, 0.0, 35.0))
    post, arm = box((4.0, 4.0, 46.0), (2.0, -2.0, 0.0)), box((13.5, 4.0, 3.0), (-7.5, -2.0, 42.5))
    return joined([ridge, cone, post, arm], "tip over a ridge")


_WALLS = [
    ((1.0, 22.0, 22.0), (-1.0, -1.0, 0.0)),
    ((1.0, 22.0, 22.0), (20.0, -1.0, 0.0)),
    ((22.0, 1.0, 22.0), (-1.0, -1.0, 0.0)),
    ((22.0, 1.0, 22.0), (-1.0, 20.0, 0.0)),
]


def ramp_in_a_room() -> Mesh:
    """A ceiling over a ramp of 31 degrees, with walls on all sides."""
    low: Float = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)])
    ramp = Mesh(loft([low, low * (0.01, 1.0)], [0.0, 12.0]), "ramp")
    walls = [box(size, at) for size, at in _WALLS]
    return joined([ramp, *walls, box((22.0, 22.0, 3.0), (-1.0, -1.0, 20.0))], "ramp_in_a_room")


@cache
def slope_under_a_ceiling(degrees: float) -> Mesh:
    """A slope that falls towards a wall, and a ceiling of 120 mm² at the wall that hangs over it."""
    rise = 10 * float(np.tan(np.deg2rad(degrees)))
    low, high = rise + 5, rise + 12
    rings: list[Float] = [
        np.array([(0, 0), (10.5, 0), (10.5, 1), (0, 1.3 + rise)], np.float64),
        np.array([(10, 0), (13, 0), (13, high), (10, high)], np.float64),
        np.array([(0, low + 4), (10.5, low), (10.5, high), (0, high)], np.float64),
    ]
    return joined([Mesh(loft([one, one], [0.0, 12.0])[:, :, [2, 0, 1]], "prism") for one in rings], "slope")
