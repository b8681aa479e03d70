"""Reference for unsupported extrusion: judge each piece of 0.25 mm separately, on cells of 0.1 mm.

It also finds short unsupported pieces. The program only reports extrusion that is more than 5 mm away from everything
supported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array, run_starts
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.measurement import Coverage
from printer_slicer.inspection.coverage.raster import CellWindow, rasterize_fill
from printer_slicer.inspection.coverage.zones import path_numbers

CELL: Final = 0.1  # mm
MARGIN: Final = 2.0  # mm of cells around all beads
_PIECE: Final = 0.25  # mm: pieces of beads that are judged as one
_FULL: Final = 0.25  # of a cell rasterize_fill: it carries
_SLACK: Final = 0.5  # of its own height a bead may sink
_CONTACT: Final = 0.25  # mm that slicers leave between supports and part
_STRAIGHT: Final = 0.95  # chord by length, from which a bead between two supports is a bridge
_SEAM: Final = 0.5  # mm between the ends of a closed path


@dataclass(frozen=True, slots=True, eq=False)
class ConnectedAreas:
    """Beads cut into pieces of 0.25 mm or less, in order.

    Attributes:
        bead: (P,) index of the bead of each.
        middle: (P, 2) mm.
        length: (P,) mm.
        hanging: (P,) whether nothing is below within reach.
    """

    bead: Int
    middle: Float
    length: Float
    hanging: Bool

    def __post_init__(self) -> None:
        n = len(self.bead)
        for name, dtype, shape in (
            ("bead", np.int64, (n,)),
            ("middle", np.float64, (n, 2)),
            ("length", np.float64, (n,)),
            ("hanging", np.bool_, (n,)),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))


@dataclass(frozen=True, slots=True, eq=False)
class Air:
    """Stretches of beads over air.

    Attributes:
        bead: (A,) index of the first bead of each.
        layer: (A,) of each.
        length: (A,) mm.
        place: (A, 2) mm, where each begins.
        bridge: (A,) whether it is straight and held at both ends.
    """

    bead: Int
    layer: Int
    length: Float
    place: Float
    bridge: Bool

    def __post_init__(self) -> None:
        n = len(self.bead)
        for name, dtype, shape in (
            ("bead", np.int64, (n,)),
            ("layer", np.int64, (n,)),
            ("length", np.float64, (n,)),
            ("place", np.float64, (n, 2)),
            ("bridge", np.bool_, (n,)),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    @classmethod
    def joined(cls, parts: Sequence[Air]) -> Air:
        """The stretches of several values, one after the other."""
        if not parts:
            none = np.zeros(0, np.int64)
            return cls(none, none, np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.bool_))
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))


class Ground:
    """The height of what was laid so far, cell by cell; the bed at the beginning."""

    def __init__(self, window: CellWindow) -> None:
        """Take the cells that all beads to come lie in."""
        self._window = window
        self._top = np.zeros((window.deep, window.wide))

    def pieces(self, beads: Extrusions, window: CellWindow) -> ConnectedAreas:
        """The beads, all with their height and within the window, in pieces that know whether they hang.

        A piece rests where plastic or bed lies at most half its height under its lower side, under it or within a
        usual width of its centre line.
        """
        count = np.maximum(np.ceil(beads.length / _PIECE), 1).astype(np.int64)
        bead = np.repeat(np.arange(beads.n_beads), count)
        share = (consecutive(np.zeros(beads.n_beads, np.int64), count) + 0.5) / count[bead]
        middle = beads.begin[bead] + share[:, None] * (beads.end - beads.begin)[bead]
        lowest = beads.z_top - np.maximum(beads.rise, 0) - beads.height * (1 + _SLACK)
        reach = max(round(beads.usual_width / window.cell), 1)
        around = highest_around(self._top[window.slices_in(self._window)], reach)
        hanging = around[window.rows_and_columns(middle)] < lowest[bead]
        return ConnectedAreas(bead, middle, (beads.length / count)[bead], hanging)

    def lay(self, fill: Float, window: CellWindow, z: float, *, support: bool = False) -> None:
        """Cells that are rasterize_fill hold plastic up to z now; on supports the part begins a little higher."""
        here = self._top[window.slices_in(self._window)]
        np.maximum(here, np.where(fill > _FULL, z + _CONTACT * support, 0.0), out=here)


def air_of(beads: Extrusions, layer: int, pieces: ConnectedAreas) -> Air:
    """The stretches over air in one layer, and which of them are bridges.

    Args:
        beads: in the order in which they are laid.
        layer: of all of them.
        pieces: of these beads.
    """
    path = path_numbers(beads, np.zeros(beads.n_beads, np.int64))
    own = path[pieces.bead]
    new_path = run_starts(own)
    begins = pieces.hanging & (new_path | ~np.append(False, pieces.hanging)[: len(own)])
    first = np.flatnonzero(begins)
    last_of_path = np.append(np.diff(own) != 0, True)[: len(own)]
    ends = pieces.hanging & (last_of_path | ~np.append(pieces.hanging[1:], False)[: len(own)])
    last = np.flatnonzero(ends)
    reached = np.append(0.0, np.cumsum(pieces.length))
    length = reached[last + 1] - reached[first]
    step = pieces.middle[last] - pieces.middle[first]
    chord = np.hypot(*step.T) + (pieces.length[first] + pieces.length[last]) / 2
    n_paths = int(path.max(initial=-1)) + 1
    begin, end = (
        np.searchsorted(path, np.arange(n_paths)),
        np.searchsorted(path, np.arange(n_paths), side="right") - 1,
    )
    closed = (np.hypot(*(beads.begin[begin] - beads.end[end]).T) < _SEAM) & (end - begin >= 2)
    rests = np.bincount(own, weights=~pieces.hanging, minlength=n_paths) > 0
    round_again = (closed & rests)[own[first]]
    held = (~new_path[first] | round_again) & (~last_of_path[last] | round_again)
    bead = pieces.bead[first]
    bridge = held & (chord >= _STRAIGHT * length)
    return Air(bead, np.full(len(bead), layer), length, pieces.middle[first], bridge)


def highest_around(field: Float, reach: int) -> Float:
    """The highest value in the square of 2 · reach + 1 cells around each cell."""
    for _ in range(2):  # along x, then, turned over, along y
        field = np.pad(field, ((0, 0), (reach, reach)), mode="edge")
        done, wanted = 1, 2 * reach + 1
        while done < wanted:
            step = min(done, wanted - done)
            field = np.maximum(field[:, :-step], field[:, step:])
            done += step
        field = field.T
    return field


def beads_over_air(coverage: Coverage) -> Air:
    """All stretches of the beads of a part that nothing is under; files without supports only."""
    stack = coverage.stack
    found = list[Air]()
    ends = np.concatenate([stack.beads.begin, stack.beads.end])
    window = CellWindow.around(ends.min(axis=0), ends.max(axis=0), MARGIN, CELL)
    ground = Ground(window)
    for k in range(stack.n_layers):
        index = np.flatnonzero(coverage.of_part & (stack.layer == k))
        beads = stack.beads.take(index)
        if len(index):
            air = air_of(beads, k, ground.pieces(beads, window))
            found.append(replace(air, bead=index[air.bead]))
            ground.lay(rasterize_fill(beads, window, float(stack.height[k])), window, float(stack.top[k]))
    return Air.joined(found)
