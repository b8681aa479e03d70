"""Find which stretches of the beads of supports lie on something, layer by layer from the bed upwards.

Beads are sampled along their centre lines. A raster of cells holds what the beads of one layer cover. A sample of the
layer above is carried if at least half of its width lies over covered cells, over the part, or on the bed.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry import contain_points
from printer_slicer.geometry.raster import CellGrid, Float32
from printer_slicer.kernel import load_kernel
from printer_slicer.model import LayerPlan, Sections, Toolpaths
from printer_slicer.values import Struct

__all__ = [
    "BeadMap",
    "BeadSamples",
    "PartBelow",
    "find_carried",
    "find_gapless_layers",
    "find_repeated_layers",
    "sample_beads",
]

_CELL: Final = 0.05  # mm
_STEP: Final = 0.18  # mm between samples along a bead
_SIDE: Final = 1 / 3  # widths from the middle of a bead to the points that stand for its sides
_BEYOND: Final = 1.5  # mm, margin of the grid
_ROUNDING: Final = 1e-6  # mm
_INSIDE: Final = 1 / 6  # widths from the middle of a bead to points that must both lie over the part
_MAX_ABOVE: Final = 0.25  # mm above the gap, up to which supports lie on the part
_BELOW: Final = 0.02  # mm; a bead lies on beads whose top is this little lower

_SKIPPED, _ON_BED, _OVER_LAYER, _OVER_GAP = range(4)  # kinds of layers; kernel/bead_samples.cpp has the same

_Int32 = NDArray[np.int32]


class BeadSamples(Struct, frozen=True, eq=False):
    """Points along the middles of beads, in the order of the paths.

    Attributes:
        grid: the cells.
        x, y: (n,) position in cells from the corner of the grid.
        across: (B, 2) for each bead (line segment), its width as a vector to the left, in cells.
        bead: (n,) the bead of each sample.
        path: (n,) its path.
        length: (n,) length for which the sample stands, mm.
        layer_start: (S + 1,) the samples of layer `i` are `layer_start[i]:layer_start[i + 1]`.
    """

    grid: CellGrid
    x: Float32
    y: Float32
    across: Float32
    bead: Int
    path: Int
    length: Float
    layer_start: Int

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.x)

    def points(self, which: Int, aside: float = 0.0) -> Float:
        """Return the positions (k, 2) of samples (k,), mm, moved by `aside` widths to the left."""
        place = np.column_stack([self.x[which], self.y[which]]) + aside * self.across[self.bead[which]]
        return np.asarray(place.astype(np.float64) * self.grid.cell + (self.grid.x, self.grid.y))

    def measure_distances(self, some: Int, others: Int) -> Float:
        """Return the distances (k,) of samples (k,) from others (k,), mm."""
        x, y = self.x[some] - self.x[others], self.y[some] - self.y[others]
        return np.asarray(np.hypot(x, y) * self.grid.cell, np.float64)

    def cells(self, some: slice | Int, aside: float = 0.0) -> _Int32:
        """Return the cells (k,) of some samples, moved by `aside` widths to the left."""
        x, y = self.x[some], self.y[some]
        if aside:
            way = self.across[self.bead[some]]
            x, y = x + np.float32(aside) * way[:, 0], y + np.float32(aside) * way[:, 1]
        return np.asarray(y.astype(np.int32) * np.int32(self.grid.n_columns) + x.astype(np.int32))


def sample_beads(
    paths: Toolpaths, of_layers: Bool | None = None, cell: float = _CELL, step: float = _STEP
) -> BeadSamples:
    """Return samples of all paths (at least one), or of those in the layers of a mask (S,).

    Cells are `cell` mm wide, and samples at most `step` mm apart.
    """
    begin, end = paths.ends_of_beads
    n_beads, path = len(begin), paths.path_of_bead
    which = np.arange(n_beads) if of_layers is None else np.flatnonzero(of_layers[paths.layer].take(path))
    if of_layers is not None:
        begin, end, path = begin.take(which), end.take(which), path.take(which)
    grid = CellGrid.around(paths.xy.min(axis=0) - _BEYOND, paths.xy.max(axis=0) + _BEYOND, cell)
    corner = paths.xy.take(begin, axis=0)
    way = (paths.xy.take(end, axis=0) - corner) / grid.cell
    length = np.hypot(*way.T)
    count = np.maximum(np.ceil(length * (cell / step)), 1.0)
    across = np.zeros((n_beads, 2), np.float32)
    across[which] = (
        np.column_stack([-way[:, 1], way[:, 0]])
        * (paths.width.take(begin) / grid.cell / np.maximum(length, 1e-9))[:, None]
    )
    x, y, own = _place_samples((corner - (grid.x, grid.y)) / grid.cell, way, count)
    of_path = path.take(own)
    return BeadSamples(
        grid,
        x,
        y,
        across,
        which.take(own),
        of_path,
        (length * (grid.cell / count)).take(own),
        np.searchsorted(paths.layer.take(of_path), np.arange(paths.plan.n_layers + 1)),
    )


def _place_samples(first: Float, way: Float, count: Float) -> tuple[Float32, Float32, Int]:
    """Return x and y (n,) of samples, in cells, and the bead (n,) of each.

    Args:
        first: (B, 2) begin of each bead, in cells.
        way: (B, 2) from its begin to its end, in cells.
        count: (B,) samples of each.
    """
    times = count.astype(np.int64)
    own = np.repeat(np.arange(len(times)), times)
    each = (way / count[:, None]).astype(np.float32)
    place = (first + way / (2 * count)[:, None]).astype(np.float32)
    number = consecutive(np.zeros(len(times), np.int64), times).astype(np.float32)
    x, y = (place[:, axis].take(own) + number * each[:, axis].take(own) for axis in range(2))
    return x, y, own


def find_repeated_layers(paths: Toolpaths) -> Bool:
    """Return a mask (S,) of layers with the same paths as the layer below them, on which they lie."""
    layers = paths.plan
    point_layer = np.repeat(paths.layer, np.diff(paths.start))
    start = np.searchsorted(point_layer, np.arange(layers.n_layers + 1))
    count = np.diff(start)
    same = np.append(False, (count[1:] == count[:-1]) & (count[1:] > 0))
    same &= find_gapless_layers(layers)
    candidate = np.flatnonzero(same[point_layer])
    differs = (paths.xy[candidate] != paths.xy[candidate - count[point_layer[candidate]]]).any(axis=1)
    same[point_layer[candidate[differs]]] = False
    return same


class PartBelow(Struct, frozen=True, eq=False):
    """The part right below each support layer.

    Attributes:
        sections: the part.
        first, last: (S,) range of layers of the part whose tops carry beads of each support layer.
    """

    sections: Sections
    first: Int
    last: Int

    @classmethod
    def of(cls, sections: Sections, layers: LayerPlan, gap: float) -> PartBelow:
        """Find the layers of the part; supports lie at most `gap` and 0.25 mm above it."""
        reach = gap + _MAX_ABOVE + _ROUNDING
        top, bottom = sections.plan.top, layers.bottom
        first = np.searchsorted(top, bottom - reach)
        return cls(sections, first, np.searchsorted(top, bottom + _ROUNDING, side="right"))

    def carries(self, samples: BeadSamples, which: Int, layer: Int) -> Bool:
        """Return which (k,) of some samples (k,) on support layers (k,), ascending, have half their width over it."""
        result = np.zeros(len(which), np.bool_)
        first, last = self.first[layer], self.last[layer]
        for step in range(int((last - first).max(initial=0))):
            left = np.flatnonzero(~result & (first + step < last))
            for aside in (-_INSIDE, _INSIDE):
                left = left[self._contains(samples.points(which[left], aside), first[left] + step)]
            result[left] = True
        return result

    def _contains(self, points: Float, layer: Int) -> Bool:
        """Return which points (k, 2) lie in the section of their layer (k,), ascending."""
        if not len(points):
            return np.zeros(0, np.bool_)
        low, high = int(layer[0]), int(layer[-1]) + 1
        solid = self.sections.solid.copy_layers(np.arange(low, high))
        return contain_points(solid, points, layer - low)


def find_carried(samples: BeadSamples, paths: Toolpaths) -> Bool:
    """Return which samples (n,) lie on beads of the layer below or on the bed.

    Layers with beads, but without samples, count as equal to the layer below, see `find_repeated_layers`.
    """
    is_empty = np.bincount(paths.layer, minlength=paths.plan.n_layers) == 0
    kind = np.where(find_gapless_layers(paths.plan), _OVER_LAYER, _OVER_GAP)
    kind[_find_layers_on_bed(paths.plan)] = _ON_BED
    kind[(np.diff(samples.layer_start) == 0) & ~is_empty] = _SKIPPED
    kernel = load_kernel()
    if kernel:
        arrays = samples.x.data, samples.y.data, samples.across.data, samples.bead.data
        size = samples.grid.n_rows, samples.grid.n_columns
        found = kernel.find_carried_samples(
            arrays, samples.layer_start.data, kind.astype(np.uint8).tobytes(), size
        )
        return np.frombuffer(found, np.bool_).copy()
    carried, covered = np.zeros(samples.count, np.bool_), BeadMap(samples)
    for layer, (first, last) in enumerate(pairwise(samples.layer_start.tolist())):
        if kind[layer] == _SKIPPED:
            continue
        some = slice(first, last)
        carried[some] = kind[layer] == _ON_BED or (kind[layer] == _OVER_LAYER and covered.carries(some))
        covered.mark(some)
    return carried


def _find_layers_on_bed(layers: LayerPlan) -> Bool:
    """Return a mask (S,) of support layers that lie on the bed."""
    return np.asarray(layers.bottom <= _ROUNDING)


def find_gapless_layers(layers: LayerPlan) -> Bool:
    """Return a mask (S,) of support layers that begin where the layer before ends."""
    return np.append(False, np.abs(layers.bottom[1:] - layers.top[:-1]) <= _BELOW)[: layers.n_layers]


class BeadMap:
    """Cells that the beads of one layer cover.

    Args:
        samples: of the beads of all layers.
    """

    def __init__(self, samples: BeadSamples) -> None:
        self._samples = samples
        self.covered = np.zeros(samples.grid.n_cells, np.bool_)
        self._marked = np.zeros(0, np.int64)

    def mark(self, some: slice | Int) -> None:
        """Mark the cells whose middles lie within half a width of some samples, and nothing else."""
        self.covered[self._marked] = False
        samples, grid = self._samples, self._samples.grid
        x, y = samples.x[some].astype(np.float64), samples.y[some].astype(np.float64)
        across = samples.across[samples.bead[some]].astype(np.float64)
        square = (across[:, 0] ** 2 + across[:, 1] ** 2) / 4
        radius = np.sqrt(square)
        low = np.maximum(np.ceil(y - radius - 0.5), 0).astype(np.int64)
        high = np.minimum(np.floor(y + radius - 0.5), grid.n_rows - 1).astype(np.int64)
        count = np.maximum(high - low + 1, 0)
        of, row = np.repeat(np.arange(len(x)), count), consecutive(low, count)
        half = np.sqrt(np.maximum(square[of] - (row + 0.5 - y[of]) ** 2, 0.0))
        first = np.maximum(np.ceil(x[of] - half - 0.5), 0).astype(np.int64)
        last = np.minimum(np.floor(x[of] + half - 0.5), grid.n_columns - 1).astype(np.int64)
        self._marked = consecutive(row * grid.n_columns + first, np.maximum(last - first + 1, 0))
        self.covered[self._marked] = True

    def carries(self, some: slice) -> Bool:
        """Return which (k,) of some samples lie on the marked beads with at least half of their width."""
        carried = self.covered[self._samples.cells(some)]
        left = np.flatnonzero(~carried)
        sides = [self.covered[self._samples.cells(left + some.start, aside)] for aside in (-_SIDE, _SIDE)]
        carried[left] = np.logical_and(*sides)
        return carried
