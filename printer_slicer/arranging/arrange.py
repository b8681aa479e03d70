"""Arrange the outlines of parts on few plates."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np

from printer_slicer.arranging.arrangement import Arrangement, FreeArea
from printer_slicer.arranging.footprints import (
    Footprint,
    find_touched_cells,
    list_footprints,
    rotate_outline,
)
from printer_slicer.arranging.packing import Packer, Packing, PlateCells
from printer_slicer.arranging.spacing import find_smallest_distance
from printer_slicer.arrays import Float, Int
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas, intersection, offset
from printer_slicer.geometry.raster import CellGrid
from printer_slicer.values import replace

__all__ = ["ROTATIONS", "arrange_outlines"]

ROTATIONS: Final = tuple(float(angle) for angle in range(0, 360, 45))
"""Rotations about z that are tried, degrees."""

_MAX_CELLS: Final = 250  # along the longer side of a plate
_SMALLEST_CELL: Final = 0.5  # mm
_RANDOM_ORDERS: Final = 5
_FINAL_ORDERS: Final = 2  # that are tried on the fine raster
_CENTERING_SHARES: Final = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way to the middle of a plate
_AREA_SPREAD: Final = 0.15  # standard deviation of the random changes of areas, relative to the largest
_SEED: Final = 1


def arrange_outlines(
    outlines: Sequence[Areas],
    names: Sequence[str],
    free_area: FreeArea,
    gap: float,
    *,
    one_per_plate: frozenset[int] = frozenset(),
    remedy: str = "Choose a larger printer, or scale the part",
) -> Arrangement:
    """Find places for parts on few plates.

    Parts may stand in holes of others. Several orders are tried, the largest parts first, and the same parts always get
    the same places. The parts of a plate stand in its middle, as far as excluded areas allow.

    Args:
        outlines: of each part as seen from above, one layer each, mm; copies may be the same object.
        names: of the parts, for messages, such as `lid: the part with its brim`.
        free_area: where parts may stand; the same for all plates.
        gap: smallest distance between parts, mm.
        one_per_plate: indices of parts of which each plate gets at most one.
        remedy: what helps if a part does not fit.

    Raises:
        PartError: a part does not fit an empty plate.
    """
    cell = max(float(free_area.size.max()) / _MAX_CELLS, _SMALLEST_CELL)
    coarse = _list_footprints(outlines, gap, 2 * cell)
    for name, own in zip(names, coarse, strict=True):
        _check_size(name, own, free_area, remedy)
    orders = _list_best_orders(coarse, _make_plate(free_area, 2 * cell), one_per_plate)
    fine, plate = _list_footprints(outlines, gap, cell), _make_plate(free_area, cell)
    packer = Packer(plate, fine, one_per_plate)
    packings = [packer.pack(order) for order in orders]
    best = min(
        (one for one in packings if one), key=lambda one: (one.n_plates, one.last_plate_share), default=None
    )
    if best is None:
        raise PartError(_describe_unplaced(names, outlines, plate), remedy=remedy)
    arrangement = _center(_read_places(best, fine, free_area, cell), outlines, free_area)
    _check_spacing(arrangement, outlines, gap)
    return arrangement


def _list_footprints(outlines: Sequence[Areas], gap: float, cell: float) -> list[list[Footprint]]:
    """Return the footprints of all parts; copies share theirs."""
    known: dict[int, list[Footprint]] = {}
    for outline in outlines:
        if id(outline) not in known:
            known[id(outline)] = list_footprints(outline, ROTATIONS, gap, cell)
    return [known[id(outline)] for outline in outlines]


def _make_plate(free_area: FreeArea, cell: float) -> PlateCells:
    """Return the cells of a plate, and in which of them nothing may stand."""
    columns, rows = np.ceil(free_area.size / cell - 1e-9).astype(np.int64).tolist()
    grid = CellGrid(float(free_area.low[0]), float(free_area.low[1]), cell, rows, columns)
    has_excluded = free_area.excluded.n_rings > 0
    excluded = (
        find_touched_cells(free_area.excluded, grid) if has_excluded else np.zeros((rows, columns), np.bool_)
    )
    return PlateCells(excluded, free_area.size, cell)


def _check_size(name: str, footprints: Sequence[Footprint], free_area: FreeArea, remedy: str) -> None:
    """Check that a part fits the rectangle of the plate in one of its rotations.

    Raises:
        PartError: it does not; the message tells by how much it is too large.
    """
    best = min(footprints, key=lambda one: float((one.size - free_area.size).max()))
    excess = best.size - free_area.size
    if not excess.max() > 0:
        return
    axes = " and ".join(
        f"{value:.3g} mm in {axis}" for axis, value in zip("xy", excess, strict=True) if value > 0
    )
    turned = f", even if it is rotated by {best.angle:g} degrees" if best.angle else ""
    width, depth = free_area.size.tolist()
    raise PartError(
        f"{name} is {axes} too large for the free area of the bed, {width:g} x {depth:g} mm{turned}",
        remedy=remedy,
    )


def _list_best_orders(
    footprints: Sequence[Sequence[Footprint]], plate: PlateCells, one_per_plate: frozenset[int]
) -> list[Int]:
    """Return the orders that need the fewest plates on a coarse raster, the best first."""
    orders, ranks = _list_orders(footprints), list[tuple[int, float]]()
    packer = Packer(plate, footprints, one_per_plate)
    for order in orders:
        found = packer.pack(order)
        ranks.append((found.n_plates, found.last_plate_share) if found else (len(order) + 1, 0.0))
        if ranks[-1][0] == 1:
            break
    best = sorted(range(len(ranks)), key=ranks.__getitem__)
    return [orders[at] for at in best[:_FINAL_ORDERS]]


def _list_orders(footprints: Sequence[Sequence[Footprint]]) -> list[Int]:
    """Return orders of the parts: the largest first by area, box or longer side, and random changes of the first."""
    area = np.array([own[0].touched.sum() for own in footprints], np.float64)
    box = np.array([own[0].size.prod() for own in footprints])
    longest = np.array([own[0].size.max() for own in footprints])
    random = np.random.default_rng(_SEED)
    shuffled = [area + random.normal(0, _AREA_SPREAD * area.max(), len(area)) for _ in range(_RANDOM_ORDERS)]
    orders: dict[tuple[int, ...], Int] = {}
    for key in (area, box, longest, *shuffled):
        order = np.argsort(-key, kind="stable")
        # Orders that differ only in the numbers of copies give the same places.
        orders.setdefault(tuple(id(footprints[part]) for part in order.tolist()), order)
    return list(orders.values())


def _read_places(
    packing: Packing, footprints: Sequence[Sequence[Footprint]], free_area: FreeArea, cell: float
) -> Arrangement:
    """Return the places of a packing in mm."""
    chosen = [own[place.rotation] for own, place in zip(footprints, packing.places, strict=True)]
    cells = np.array([(place.column, place.row) for place in packing.places], np.float64).reshape(-1, 2)
    corners = np.array([one.corner for one in chosen]).reshape(-1, 2)
    plates = np.array([place.plate for place in packing.places], np.int64)
    return Arrangement(
        plates, np.array([one.angle for one in chosen]), free_area.low + cells * cell - corners
    )


def _center(arrangement: Arrangement, outlines: Sequence[Areas], free_area: FreeArea) -> Arrangement:
    """Move the parts of each plate together toward its middle, as far as excluded areas allow."""
    placed = [_place_outline(arrangement, outlines, part) for part in range(len(outlines))]
    shift = arrangement.shift.copy()
    for plate in range(arrangement.n_plates):
        here = np.flatnonzero(arrangement.plate == plate)
        boxes = [placed[part].boxes() for part in here.tolist()]
        low, high = (np.concatenate([box[side] for box in boxes]) for side in (0, 1))
        wanted = (free_area.low + free_area.high) / 2 - (low.min(axis=0) + high.max(axis=0)) / 2
        shift[here] += _shorten(wanted, [placed[part] for part in here.tolist()], free_area.excluded)
    return replace(arrangement, shift=shift)


def _shorten(wanted: Float, placed: Sequence[Areas], excluded: Areas) -> Float:
    """Return the longest of a few shares of a shift (2,) that moves no part into an excluded area, mm."""
    shares = sorted(product(_CENTERING_SHARES, repeat=2), key=sum, reverse=True)
    for share in shares if excluded.n_rings else shares[:1]:
        by = wanted * share
        moved = (replace(one, xy=one.xy + by) for one in placed)
        if not (excluded.n_rings and any(intersection(one, excluded).n_rings for one in moved)):
            return np.asarray(by)
    return np.zeros(2)


def _place_outline(arrangement: Arrangement, outlines: Sequence[Areas], part: int) -> Areas:
    """Return the outline of a part at its place."""
    turned = rotate_outline(outlines[part], float(arrangement.angle[part]))
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


def _describe_unplaced(names: Sequence[str], outlines: Sequence[Areas], plate: PlateCells) -> str:
    """Describe the first part that fits nowhere beside the excluded areas, and by how much it is too large."""
    known = {id(outline): outline for outline in outlines}
    fits = {key: _fits_alone(outline, plate) for key, outline in known.items()}
    at = next(at for at, outline in enumerate(outlines) if not fits[id(outline)])
    low, high = 0.0, float(plate.size.min()) / 2
    while high - low > plate.cell / 2:
        middle = (low + high) / 2
        smaller = offset(outlines[at], -middle, join="round")
        low, high = (low, middle) if _fits_alone(smaller, plate) else (middle, high)
    return f"{names[at]} is about {2 * high:.2g} mm too large to fit beside the excluded areas of the bed"


def _fits_alone(outline: Areas, plate: PlateCells) -> bool:
    """Return whether an outline fits the empty plate; one without area does."""
    if not outline.n_rings:
        return True
    packer = Packer(plate, [list_footprints(outline, ROTATIONS, 0.0, plate.cell)])
    return packer.pack(np.zeros(1, np.int64)) is not None
