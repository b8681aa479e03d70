"""Pack footprints onto plates: each one to the best free place of the first plate that has one.

A footprint can stand where none of its cells is kept free by another part. The number of such cells, for all places on
a plate at once, is the correlation of the plate with the footprint, computed with the fast Fourier transform. A second
correlation, with the plate's cells near what already stands there, tells how closely the part fits its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arranging.footprints import Footprint
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.raster import Float32

__all__ = ["Packer", "Packing", "PlacedPart", "PlateCells"]

_Spectrum = NDArray[np.complexfloating[Any, Any]]
_MIN_COUNT: Final = 0.5  # of cells; lower results of the transform are 0, apart from rounding
_CONTACT_REACH: Final = 3  # cells; within this distance of edges and other parts, contact counts


class PlacedPart(NamedTuple):
    """One part on a plate.

    Attributes:
        plate: number of the plate.
        rotation: index of the footprint among those of the part.
        row, column: cell of the plate at which the footprint begins.
    """

    plate: int
    rotation: int
    row: int
    column: int


class PlateCells(NamedTuple):
    """The cells of an empty plate; the last row and column may reach beyond it.

    Attributes:
        excluded: (rows, columns) mask of cells in which nothing may stand.
        size: (2,) of the plate, mm.
        cell: side of a cell, mm.
    """

    excluded: Bool
    size: Float
    cell: float

    def count_places(self, footprint: Footprint) -> tuple[int, int]:
        """Return the numbers of rows and columns at which a footprint can begin without leaving the plate."""
        columns, rows = np.floor((self.size - footprint.size) / self.cell + 1e-9).astype(np.int64).tolist()
        return max(rows + 1, 0), max(columns + 1, 0)


class Packing(NamedTuple):
    """The places of all parts.

    Attributes:
        places: of each part, in the order of the footprints.
        n_plates: number of plates.
        last_plate_share: share of the cells of the last plate that its parts touch.
    """

    places: tuple[PlacedPart, ...]
    n_plates: int
    last_plate_share: float


class _Plate:
    """A plate with the parts that are on it so far.

    Attributes:
        empty: the plate without parts.
        taken: (rows, columns) 1 in cells that are excluded or nearer than the gap to a part, else 0.
        n_touched: number of cells that parts touch.
        has_single_part: whether one of the parts is there of which a plate gets at most one.
        too_large: ids of the lists of footprints for which no free place is left.
    """

    def __init__(self, empty: PlateCells) -> None:
        self.empty = empty
        self.taken = empty.excluded.astype(np.float32)
        self.n_touched = 0
        self.has_single_part = False
        self.too_large: set[int] = set()
        self._spectrum: tuple[_Spectrum, _Spectrum] | None = None

    def compute_spectra(self) -> tuple[_Spectrum, _Spectrum]:
        """Return the spectra of the cells that are taken, and of the costs of cells."""
        if self._spectrum is None:
            self._spectrum = np.fft.rfft2(self.taken), np.fft.rfft2(_compute_cell_costs(self.taken))
        return self._spectrum

    def add(self, footprint: Footprint, row: int, column: int) -> None:
        """Mark the cells that a part keeps free as taken; those beyond the plate do not count."""
        top, left = row - footprint.margin, column - footprint.margin
        here = self.taken[max(top, 0) :, max(left, 0) :]
        kept_free = footprint.kept_free[max(-top, 0) :, max(-left, 0) :][: here.shape[0], : here.shape[1]]
        here = here[: kept_free.shape[0], : kept_free.shape[1]]
        np.maximum(here, kept_free, out=here)
        self.n_touched += int(footprint.touched.sum())
        self._spectrum = None


def _compute_cell_costs(taken: Float32) -> Float32:
    """Return the cost of each cell: lower near the corner, the edges and the taken cells of the plate."""
    rows, columns = np.indices(taken.shape, dtype=np.float32)
    near = np.zeros_like(taken)
    wide = np.pad(taken, _CONTACT_REACH, constant_values=1.0)
    for step in range(1, _CONTACT_REACH + 1):
        for axis in (0, 1):
            for by in (step, -step):
                near += np.roll(wide, by, axis)[
                    _CONTACT_REACH:-_CONTACT_REACH, _CONTACT_REACH:-_CONTACT_REACH
                ]
    return np.asarray(rows / taken.shape[0] + columns / taken.shape[1] - near / _CONTACT_REACH, np.float32)


class Packer:
    """Packs parts on plates of one kind, in any order; what does not depend on the order is computed once."""

    def __init__(
        self,
        empty: PlateCells,
        rotations: Sequence[Sequence[Footprint]],
        one_per_plate: frozenset[int] = frozenset(),
    ) -> None:
        """Prepare to pack parts, whose footprints are in `rotations`; copies have the same footprints.

        A plate gets at most one of the parts with the indices `one_per_plate`.
        """
        self._empty = empty
        self._rotations = rotations
        self._one_per_plate = one_per_plate
        self._spectra: dict[int, list[_Spectrum]] = {}

    def pack(self, order: Int) -> Packing | None:
        """Pack parts in the order of their indices (P,); return None if a part fits on no empty plate."""
        plates: list[_Plate] = []
        places: dict[int, PlacedPart] = {}
        for part in order.tolist():
            place = self._place_part(part, plates)
            if place is None:
                return None
            places[part] = place
        last_share = plates[-1].n_touched / self._empty.excluded.size if plates else 0.0
        return Packing(tuple(places[part] for part in range(len(order))), len(plates), last_share)

    def _get_spectra(self, rotations: Sequence[Footprint]) -> list[_Spectrum]:
        """Return the conjugate spectra of the footprints of a part; they are computed once."""
        if id(rotations) not in self._spectra:
            shape = self._empty.excluded.shape
            touched = (one.touched.astype(np.float32) for one in rotations)
            self._spectra[id(rotations)] = [np.fft.rfft2(one, shape).conj() for one in touched]
        return self._spectra[id(rotations)]

    def _place_part(self, part: int, plates: list[_Plate]) -> PlacedPart | None:
        """Place a part on the first plate with room for it, or on a new one; None: it fits on no empty plate."""
        rotations, is_single = self._rotations[part], part in self._one_per_plate
        for number in range(len(plates) + 1):
            plate = plates[number] if number < len(plates) else _Plate(self._empty)
            if id(rotations) in plate.too_large or (is_single and plate.has_single_part):
                continue
            found = _find_best_place(rotations, self._get_spectra(rotations), plate)
            if found is None:
                plate.too_large.add(id(rotations))
                continue
            if number == len(plates):
                plates.append(plate)
            rotation, row, column = found
            plate.add(rotations[rotation], row, column)
            plate.has_single_part |= is_single
            return PlacedPart(number, rotation, row, column)
        return None


def _find_best_place(
    rotations: Sequence[Footprint], spectra: Sequence[_Spectrum], plate: _Plate
) -> tuple[int, int, int] | None:
    """Return rotation, row and column of the best free place on a plate; None if there is none."""
    taken, cell_cost = plate.compute_spectra()
    n_free = plate.taken.size - plate.taken.sum()
    best, least = None, np.inf
    for rotation, (footprint, own) in enumerate(zip(rotations, spectra, strict=True)):
        places = plate.empty.count_places(footprint)
        n_touched = int(footprint.touched.sum())
        if min(places) <= 0 or n_touched > n_free:
            continue
        is_free = _correlate(taken * own, plate.taken.shape, places) < _MIN_COUNT
        if not is_free.any():
            continue
        cost = np.where(is_free, _correlate(cell_cost * own, plate.taken.shape, places) / n_touched, np.inf)
        at = int(cost.argmin())
        if cost.flat[at] < least:
            best, least = (rotation, *divmod(at, places[1])), float(cost.flat[at])
    return best


def _correlate(product: _Spectrum, shape: tuple[int, ...], places: tuple[int, int]) -> Float32:
    """Return the first rows and columns of the inverse transform of a product of spectra."""
    rows, columns = places
    return np.asarray(
        np.fft.irfft(np.fft.ifft(product, axis=0)[:rows], shape[1], axis=1)[:, :columns], np.float32
    )
