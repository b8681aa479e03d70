"""Meshes of several blocks of facets: whether nothing is wrong with them must not depend on where a block ends."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.healing.soundness import is_sound
from tests.parts import box, loft

CORNERS, RINGS = 300, 120


def barrel() -> Float:
    """(72 000, 3, 3) one closed surface of several blocks, with neighbours on either side of every border."""
    angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = np.linspace(0, 20, RINGS)
    return loft([(8 + np.sin(z / 3)) * circle for z in heights], heights)


def shuffled(triangles: Float, seed: int) -> Float:
    """Neighbours stand far apart, and begin at any corner."""
    rng = np.random.default_rng(seed)
    mixed = triangles[rng.permutation(len(triangles))]
    turn = (np.arange(3) + rng.integers(0, 3, len(mixed))[:, None]) % 3
    return np.take_along_axis(mixed, turn[:, :, None], axis=1)


either = pytest.mark.parametrize("order", ["as made", "shuffled"])


def in_order(triangles: Float, order: str) -> Float:
    return triangles if order == "as made" else shuffled(triangles, 1)


@either
def test_a_large_closed_surface_is_sound(order: str) -> None:
    assert len(barrel()) > 70_000
    assert is_sound(in_order(barrel(), order))


@either
def test_inside_out_it_is_not(order: str) -> None:
    assert not is_sound(in_order(barrel()[:, ::-1], order))


@either
@pytest.mark.parametrize("facet", [0, 32_767, 32_768, 40_000, 71_000])
@pytest.mark.parametrize("fault", ["missing", "turned", "twice"])
def test_one_wrong_facet_anywhere_is_found(order: str, facet: int, fault: str) -> None:
    triangles = barrel()
    if fault == "missing":
        triangles = np.delete(triangles, facet, axis=0)
    elif fault == "turned":
        triangles[facet] = triangles[facet, ::-1]
    else:
        triangles = np.concatenate([triangles, triangles[facet : facet + 1]])

    assert not is_sound(in_order(triangles, order))


@either
def test_two_bodies_are_not_one_however_they_stand_in_the_file(order: str) -> None:
    """Each alone is sound."""
    other = barrel() + np.array([100.0, 0, 0])
    assert is_sound(other)
    assert not is_sound(in_order(np.concatenate([barrel(), other]), order))


def test_bodies_that_touch_along_an_edge_are_not_one() -> None:
    one, other = box((10, 10, 4)).triangles, box((10, 10, 4), (10, 10, 0)).triangles

    assert is_sound(one)
    assert is_sound(other)
    assert not is_sound(np.concatenate([one, other]))
