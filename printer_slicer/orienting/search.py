"""Find the best ways to turn a part, from estimates."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from printer_slicer.orienting.body import Body, measure_body
from printer_slicer.orienting.directions import drop_near, list_directions
from printer_slicer.orienting.orientations import Orientation, Orientations
from printer_slicer.orienting.prices import Prices
from printer_slicer.orienting.ratings import rate_frame
from printer_slicer.orienting.rough_ratings import rate_roughly
from printer_slicer.orienting.stability import is_stable, may_stand
from printer_slicer.orienting.turning import find_upright_frame
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["find_fast_orientations", "sort_orientations"]

_N_RATED: Final = 12
_NEARLY: Final = 0.02  # share of rough cost and height; directions that differ by less resemble each other
_MOST_ALIKE: Final = 2  # such as the sides of a round part
_ALIKE: Final = 0.005  # share of the cost; orientations that differ by less count as equal
_SAME: Final = np.cos(np.radians(0.02))
# A part that can stand on a flat does not stand on something almost like it.
_ALMOST_FLAT: Final = np.cos(np.radians(1.5))
_NEAR: Final = np.cos(np.radians(4.0))
_DOWN: Final = np.array([0.0, 0.0, -1.0])


def find_fast_orientations(mesh: Mesh, profile: Profile, *, keep_up: float) -> Orientations:
    """Return the best ways to turn a part, from estimates.

    Args:
        mesh: the part.
        profile: printer, material and quality.
        keep_up: largest angle by which the upper side may be turned away from the vertical, degrees.

    Raises:
        MeshError: no facet has an area.
    """
    body = measure_body(mesh.triangles, mesh.name)
    prices = Prices(profile)
    given = body.axes @ _DOWN
    down = list_directions(body)
    down = down[down @ given >= np.cos(np.radians(keep_up)) - 1e-9]
    rated = [_rate(body, one, profile, prices) for one in _choose_directions(body, down, profile, prices)]
    as_given = replace(rate_frame(body, body.axes.T, profile, prices), rotate=(0.0, 0.0, 0.0), is_given=True)
    return Orientations(sort_orientations([as_given, *rated]))


def _choose_directions(body: Body, down: Float, profile: Profile, prices: Prices) -> Float:
    """Return the directions (n, 3) that deserve a better rating: those with the least cost in which the part stands.

    Directions near a better one, and the part as given, are left out. If the part stands in none, all are compared.

    Args:
        body: the part.
        down: (D, 3) unit vectors.
        profile: gives the width of a brim.
        prices: of time, support and deviation.
    """
    given, brim = body.axes @ _DOWN, profile.quality.brim_width
    ways = drop_near(down[may_stand(body, down, brim)], _ALMOST_FLAT)
    found = _take_best(body, ways[ways @ given <= _SAME], brim, prices, only_stable=True)
    return (
        found if len(found) else _take_best(body, down[down @ given <= _SAME], 0.0, prices, only_stable=False)
    )


def _take_best(body: Body, down: Float, brim: float, prices: Prices, *, only_stable: bool) -> Float:
    """Return the directions (n, 3) with the least cost, none near a better one, and few of the same cost and height.

    Args:
        body: the part.
        down: (D, 3) unit vectors.
        brim: width of a brim, mm.
        prices: of time, support and deviation.
        only_stable: leave out those in which the part does not stand safely.
    """
    best: list[Float] = []
    figures: list[Float] = []
    costs = rate_roughly(body, down, prices) if len(down) else np.zeros(0)
    for index in np.argsort(costs, kind="stable").tolist():
        one = down[index]
        is_new = not best or float((np.array(best) @ one).max()) < _NEAR
        own = np.array([costs[index], np.ptp(body.hull @ one)])
        same = sum(bool((np.abs(own - other) <= _NEARLY * other).all()) for other in figures)
        if is_new and same < _MOST_ALIKE and (not only_stable or is_stable(body, one, brim)):
            best.append(one)
            figures.append(own)
        if len(best) == _N_RATED:
            break
    return np.array(best).reshape(-1, 3)


def _rate(body: Body, down: Float, profile: Profile, prices: Prices) -> Orientation:
    """Rate a direction (3,) of a body that points down; turn it by 90 degrees if only then it fits the bed."""
    frame = find_upright_frame(body, down)
    rated = rate_frame(body, frame, profile, prices)
    if rated.fits:
        return rated
    quarter = rate_frame(body, np.stack([-frame[1], frame[0], frame[2]]), profile, prices)
    return quarter if quarter.fits else rated


def sort_orientations(rows: list[Orientation]) -> tuple[Orientation, ...]:
    """Return rows in the order of their cost, usable ones first.

    Of the rows that cost about as little as the first, the one with the largest foot comes first.
    """
    ordered = sorted(rows, key=lambda row: (not row.is_usable, row.cost))
    best = ordered[0]
    alike = [row for row in ordered if row.is_usable and row.cost <= (1 + _ALIKE) * best.cost]
    first = max(alike, key=lambda row: row.foot, default=best)
    return (first, *(row for row in ordered if row is not first))
