"""Arrange the outlines of parts on as few plates as possible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arranging.arrangement import Arrangement, PlateRoom
from printer_slicer.arranging.footprints import (
    Footprint,
    find_touched_cells,
    list_footprints,
    turn_outline,
)
from printer_slicer.arranging.packing import Packing, pack
from printer_slicer.arranging.spacing import find_smallest_distance
from printer_slicer.arrays import Bool, Int
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas
from printer_slicer.geometry.raster import CellGrid
from printer_slicer.values import replace

__all__ = ["TURNS", "arrange_outlines"]

TURNS: Final = tuple(float(angle) for angle in range(0, 360, 45))
"""Turns about z that are tried, degrees."""

_CELLS: Final = 250  # along the longer side of a plate
_FINEST: Final = 0.5  # mm
_RANDOM_ORDERS: Final = 5
_FINAL_ORDERS: Final = 2  # that are tried on the fine raster
_SWAPPED: Final = 0.15  # of the largest size; parts that differ by less may change places in a random order
_SEED: Final = 1


def arrange_outlines(
    outlines: Sequence[Areas],
    names: Sequence[str],
    room: PlateRoom,
    gap: float,
    turns: Sequence[float] = TURNS,
) -> Arrangement:
    """Find places for parts on as few plates as possible.

    Parts may stand in holes of others. Several orders are tried, the largest parts first, and the same parts always get
    the same places. Parts on a plate without excluded areas stand in its middle.

    Args:
        outlines: of each part as seen from above, one layer each, mm; copies may be the same object.
        names: of the parts, for messages.
        room: where parts may stand; the same for all plates.
        gap: smallest distance between parts, mm.
        turns: turns about z that are allowed, degrees.

    Raises:
        PartError: a part does not fit an empty plate.
    """
    cell = max(float(room.size.max()) / _CELLS, _FINEST)
    coarse = _list_footprints(outlines, turns, gap, 2 * cell)
    for name, own in zip(names, coarse, strict=True):
        _check_size(name, own, room)
    orders = _list_best_orders(coarse, _find_excluded_cells(room, 2 * cell))
    fine, excluded = _list_footprints(outlines, turns, gap, cell), _find_excluded_cells(room, cell)
    packings = [pack(fine, order, excluded) for order in orders]
    best = min((one for one in packings if one), key=lambda one: (one.n_plates, one.last_share), default=None)
    if best is None:
        raise PartError(
            f"{_name_unplaced(names, fine, excluded)}: the part fits nowhere beside the excluded areas of the bed",
            remedy="Use a larger printer, or scale or turn the part",
        )
    arrangement = _center(_read_places(best, fine, room, cell), outlines, room)
    _check_spacing(arrangement, outlines, gap)
    return arrangement


def _list_footprints(
    outlines: Sequence[Areas], turns: Sequence[float], gap: float, cell: float
) -> list[list[Footprint]]:
    """Return the footprints of all parts; copies share theirs."""
    known: dict[int, list[Footprint]] = {}
    for outline in outlines:
        if id(outline) not in known:
            known[id(outline)] = list_footprints(outline, turns, gap, cell)
    return [known[id(outline)] for outline in outlines]


def _find_excluded_cells(room: PlateRoom, cell: float) -> Bool:
    """Return the mask of the cells of a plate in which nothing may stand."""
    columns, rows = np.floor(room.size / cell + 1e-9).astype(np.int64).tolist()
    grid = CellGrid(float(room.low[0]), float(room.low[1]), cell, rows, columns)
    if not room.excluded.n_rings:
        return np.zeros((rows, columns), np.bool_)
    return find_touched_cells(room.excluded, grid)


def _check_size(name: str, footprints: Sequence[Footprint], room: PlateRoom) -> None:
    """Check that a part fits the rectangle of the plate in one of its turns.

    Raises:
        PartError: it does not; the message names the missing mm.
    """
    missing = [np.maximum(one.size - room.size, 0.0) for one in footprints]
    least = min(missing, key=lambda one: float(one.max()))
    if not least.max() > 0:
        return
    size = footprints[0].size
    axes = " and ".join(
        f"{value:.3g} mm in {axis}" for axis, value in zip("xy", least, strict=True) if value > 0
    )
    raise PartError(
        f"{name}: {size[0]:.5g} x {size[1]:.5g} mm does not fit the plate in any turn; {axes} are missing",
        remedy="Choose a larger printer, scale the part, or make brim and margins narrower",
    )


def _list_best_orders(footprints: Sequence[Sequence[Footprint]], excluded: Bool) -> list[Int]:
    """Return the orders that need the fewest plates on a coarse raster, the best first."""
    orders, ranks = _list_orders(footprints), list[tuple[int, float]]()
    for order in orders:
        found = pack(footprints, order, excluded)
        ranks.append((found.n_plates, found.last_share) if found else (len(order) + 1, 0.0))
        if ranks[-1][0] == 1:
            break
    best = sorted(range(len(ranks)), key=ranks.__getitem__)
    return [orders[at] for at in best[:_FINAL_ORDERS]]


def _list_orders(footprints: Sequence[Sequence[Footprint]]) -> list[Int]:
    """Return orders of the parts: the largest first by area, box or longer side, and random changes of the first."""
    area = np.array([own[0].own.sum() for own in footprints], np.float64)
    box = np.array([own[0].size.prod() for own in footprints])
    longest = np.array([own[0].size.max() for own in footprints])
    random = np.random.default_rng(_SEED)
    shuffled = [area + random.normal(0, _SWAPPED * area.max(), len(area)) for _ in range(_RANDOM_ORDERS)]
    return [np.argsort(-key, kind="stable") for key in (area, box, longest, *shuffled)]


def _read_places(
    packing: Packing, footprints: Sequence[Sequence[Footprint]], room: PlateRoom, cell: float
) -> Arrangement:
    """Return the places of a packing in mm."""
    chosen = [own[place.turn] for own, place in zip(footprints, packing.places, strict=True)]
    cells = np.array([(place.column, place.row) for place in packing.places], np.float64).reshape(-1, 2)
    corners = np.array([one.corner for one in chosen]).reshape(-1, 2)
    plates = np.array([place.plate for place in packing.places], np.int64)
    return Arrangement(plates, np.array([one.angle for one in chosen]), room.low + cells * cell - corners)


def _center(arrangement: Arrangement, outlines: Sequence[Areas], room: PlateRoom) -> Arrangement:
    """Move the parts of each plate together to its middle, if nothing on it is excluded."""
    if room.excluded.n_rings or not len(outlines):
        return arrangement
    boxes = [_place_outline(arrangement, outlines, part).boxes() for part in range(len(outlines))]
    low, high = (np.concatenate([box[side] for box in boxes]) for side in (0, 1))
    shift = arrangement.shift.copy()
    for plate in range(arrangement.n_plates):
        here = arrangement.plate == plate
        middle = (low[here].min(axis=0) + high[here].max(axis=0)) / 2
        shift[here] += (room.low + room.high) / 2 - middle
    return replace(arrangement, shift=shift)


def _place_outline(arrangement: Arrangement, outlines: Sequence[Areas], part: int) -> Areas:
    """Return the outline of a part at its place."""
    turned = turn_outline(outlines[part], float(arrangement.angle[part]))
    return replace(turned, xy=turned.xy + arrangement.shift[part])


def _check_spacing(arrangement: Arrangement, outlines: Sequence[Areas], gap: float) -> None:
    """Check the exact distances of all parts.

    Raises:
        ValueError: two parts are too near, which the raster should not allow.
    """
    for plate in range(arrangement.n_plates):
        here = np.flatnonzero(arrangement.plate == plate).tolist()
        found = find_smallest_distance([_place_outline(arrangement, outlines, part) for part in here], gap)
        if found < gap:
            raise ValueError(f"parts on plate {plate + 1} are {found:g} mm apart instead of {gap:g} mm")


def _name_unplaced(names: Sequence[str], footprints: Sequence[Sequence[Footprint]], excluded: Bool) -> str:
    """Return the name of the first part that fits nowhere."""
    nowhere = (
        name
        for name, own in zip(names, footprints, strict=True)
        if pack([own], np.zeros(1, np.int64), excluded) is None
    )
    return next(nowhere)
