"""Find the best orientations of a part, from estimates."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from printer_slicer.orienting.cost_model import CostModel
from printer_slicer.orienting.directions import drop_near, list_directions
from printer_slicer.orienting.orientations import Orientation, Orientations
from printer_slicer.orienting.part_shape import PartShape, measure_shape
from printer_slicer.orienting.ratings import rate_frame
from printer_slicer.orienting.rough_ratings import rate_roughly
from printer_slicer.orienting.stability import is_stable, may_stand
from printer_slicer.orienting.turning import find_upright_frame, turn_for_infill
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["find_fast_orientations", "sort_orientations"]

_N_CANDIDATES: Final = 12
_SIMILAR_SHARE: Final = (
    0.02  # share of rough cost and height; directions that differ by less resemble each other
)
_MAX_SIMILAR: Final = 2  # such as the sides of a round part
_EQUAL_COST_SHARE: Final = 0.005  # share of the cost; orientations that differ by less count as equal
_SAME_COSINE: Final = np.cos(np.radians(0.02))
# A part that can stand on a flat does not stand on something almost like it.
_ALMOST_FLAT_COSINE: Final = np.cos(np.radians(1.5))
_NEAR_COSINE: Final = np.cos(np.radians(4.0))
_DOWN: Final = np.array([0.0, 0.0, -1.0])


def find_fast_orientations(mesh: Mesh, profile: Profile, *, keep_up: float) -> Orientations:
    """Return the best orientations of a part, from estimates.

    Args:
        mesh: the part.
        profile: printer, material and quality.
        keep_up: largest angle by which the upper side may be turned away from the vertical, degrees.

    Raises:
        MeshError: no facet has an area.
    """
    shape = measure_shape(mesh.triangles, mesh.name)
    cost_model = CostModel(profile)
    given = shape.axes @ _DOWN
    down = list_directions(shape)
    down = down[down @ given >= np.cos(np.radians(keep_up)) - 1e-9]
    rated = [
        _rate(shape, one, profile, cost_model) for one in _choose_directions(shape, down, profile, cost_model)
    ]
    as_given = replace(
        rate_frame(shape, shape.axes.T, profile, cost_model), rotate=(0.0, 0.0, 0.0), is_original=True
    )
    return Orientations(sort_orientations([as_given, *rated]))


def _choose_directions(shape: PartShape, down: Float, profile: Profile, cost_model: CostModel) -> Float:
    """Return the directions (n, 3) that deserve a better rating: those with the least cost in which the part stands.

    Directions near a better one, and the part as given, are left out. If the part stands in none, all are compared.

    Args:
        shape: the part.
        down: (D, 3) unit vectors.
        profile: gives the width of a brim.
        cost_model: of time, support and deviation.
    """
    given, brim = shape.axes @ _DOWN, profile.quality.brim_width
    standing = drop_near(down[may_stand(shape, down, brim)], _ALMOST_FLAT_COSINE)
    found = _take_best(shape, standing[standing @ given <= _SAME_COSINE], brim, cost_model, only_stable=True)
    return (
        found
        if len(found)
        else _take_best(shape, down[down @ given <= _SAME_COSINE], 0.0, cost_model, only_stable=False)
    )


def _take_best(
    shape: PartShape, down: Float, brim: float, cost_model: CostModel, *, only_stable: bool
) -> Float:
    """Return the directions (n, 3) with the least cost, none near a better one, and few of the same cost and height.

    Args:
        shape: the part.
        down: (D, 3) unit vectors.
        brim: width of a brim, mm.
        cost_model: of time, support and deviation.
        only_stable: leave out those in which the part does not stand safely.
    """
    best: list[Float] = []
    figures: list[Float] = []
    rough = rate_roughly(shape, down, cost_model) if len(down) else np.zeros(0)
    for index in np.argsort(rough, kind="stable").tolist():
        one = down[index]
        is_new = not best or float((np.array(best) @ one).max()) < _NEAR_COSINE
        own = np.array([rough[index], np.ptp(shape.hull @ one)])
        same = sum(bool((np.abs(own - other) <= _SIMILAR_SHARE * other).all()) for other in figures)
        if is_new and same < _MAX_SIMILAR and (not only_stable or is_stable(shape, one, brim)):
            best.append(one)
            figures.append(own)
        if len(best) == _N_CANDIDATES:
            break
    return np.array(best).reshape(-1, 3)


def _rate(shape: PartShape, down: Float, profile: Profile, cost_model: CostModel) -> Orientation:
    """Rate a direction (3,) of a part that points down, turned about z so that it prints quickly and fits the bed."""
    along_x = find_upright_frame(shape, down)
    along_y = np.stack([-along_x[1], along_x[0], along_x[2]])
    frames = (turn_for_infill(shape, along_x, profile.quality.infill_angle_deg), along_x, along_y)
    rated = (rate_frame(shape, frame, profile, cost_model) for frame in frames)
    first = next(rated)
    return first if first.fits else next((one for one in rated if one.fits), first)


def sort_orientations(rows: list[Orientation]) -> tuple[Orientation, ...]:
    """Return rows in the order of their cost, usable ones first.

    Of the rows that cost about as little as the first, the one with the largest contact area comes first.
    """
    ordered = sorted(rows, key=lambda row: (not row.is_usable, row.cost))
    best = ordered[0]
    alike = [row for row in ordered if row.is_usable and row.cost <= (1 + _EQUAL_COST_SHARE) * best.cost]
    first = max(alike, key=lambda row: row.contact_area, default=best)
    return (first, *(row for row in ordered if row is not first))
