"""One layer after the other on the raster: how full it is, and which beads hang in the air."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.geometry import Areas, normalize
from printer_slicer.inspection.coverage.beads import Beads, Purpose
from printer_slicer.inspection.coverage.ground import Air, Ground, air_of
from printer_slicer.inspection.coverage.raster import (
    Window,
    cell_for,
    cells_covered,
    filled,
    mean_around,
    rows_of,
)
from printer_slicer.inspection.coverage.stack import Stack, through_layers

__all__ = ["Fill", "overlap_cells", "rasterised"]

_LEAST: Final = 1.0  # mm² of shell, under which its mean fill says nothing
_NEAR: Final = 30.0  # mm around a part: supports farther away carry nothing of it
_LEAST_MARGIN, _WIDEST_MARGIN = 1.0, 5.0  # mm of cells around beads: their width, within reason


@dataclass(frozen=True, slots=True, eq=False)
class Fill:
    """What the raster tells of each layer.

    Attributes:
        overlap: (L,) mm² filled more than `Rules.too_often` times, in the mean over a window as wide as a bead.
        most: (L,) the largest of these means.
        place: (L, 2) where that is, mm.
        shell: (L,) material in the shell by what it needs; nan where there is hardly any shell.
        cell: mm, width of the cells.
    """

    overlap: Float
    most: Float
    place: Float
    shell: Float
    cell: float

    def __post_init__(self) -> None:
        n = len(self.overlap)
        for name, shape in (("overlap", (n,)), ("most", (n,)), ("place", (n, 2)), ("shell", (n,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, shape))


def rasterised(stack: Stack, of_part: Bool, core: Areas, wanted: Float, too_often: float) -> tuple[Fill, Air]:
    """How full each layer is, and which stretches of beads hang.

    Args:
        stack: all beads.
        of_part: (B,) which of them make up the part; supports carry it, the rest is left out.
        core: of each section, inside the shell.
        wanted: (L,) mm² of each layer outside the core that are to be filled.
        too_often: see `Fill`.

    Returns:
        The fill, and the stretches over air; ironing is left out.
    """
    n, height = stack.n_layers, stack.height
    overlap, most, place, shell = np.zeros(n), np.zeros(n), np.full((n, 2), np.nan), np.full(n, np.nan)
    # Ironing levels what is there already.
    order = np.flatnonzero(of_part & (stack.beads.purpose != Purpose.IRONING))
    order = order[np.argsort(stack.layer[order], kind="stable")]
    beads = stack.beads.take(order)
    bounds = np.searchsorted(stack.layer[order], np.arange(n + 1)).tolist()
    ground, airs, slabs = _Ground(stack, beads), list[Air](), _Slabs(stack, of_part)
    cell = ground.cell
    reach, rows = _reach(beads, cell), rows_of(core, cell)
    for k in range(n):
        some = beads.take(np.arange(bounds[k], bounds[k + 1]))
        ground.support_up_to(k)
        whole = slabs.of_layer(k) if slabs.deep[k] else some
        if not whole.n_beads:
            continue
        window = _window(cell, some, whole)
        fill = filled(some, window, float(height[k]))
        if some.n_beads:
            air = air_of(some, k, ground.cells.pieces(some, window))
            airs.append(replace(air, bead=order[bounds[k] : bounds[k + 1]][air.bead]))
            ground.cells.lay(fill, window, float(stack.top[k]))
        if slabs.deep[k]:  # what is laid later, down to here, fills it too
            fill = filled(whole, window, float(height[k]))
        mean = mean_around(fill, reach)
        overlap[k] = float((mean > too_often).sum()) * cell**2
        i, j = divmod(int(mean.argmax()), window.wide)
        most[k], place[k] = mean[i, j], window.middle(i, j)
        if wanted[k] > _LEAST:
            laid = fill * (1 - cells_covered(rows, k, window))
            shell[k] = float(laid.sum()) * cell**2 / wanted[k]
    return Fill(overlap, most, place, shell, cell), Air.joined(airs)


def overlap_cells(beads: Beads, layer_height: float, too_often: float, cell: float) -> Areas:
    """Where beads of one layer overlap, as a stack of one: the cells of each row side by side as a rectangle."""
    window = _window(cell, beads)
    high = mean_around(filled(beads, window, layer_height), _reach(beads, cell)) > too_often
    steps = np.diff(np.pad(high, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(steps > 0)
    last = np.nonzero(steps < 0)[1]
    x0, x1 = (window.left + first) * cell, (window.left + last) * cell
    y0, y1 = (window.front + row) * cell, (window.front + row + 1) * cell
    corners = np.stack([x0, y0, x1, y0, x1, y1, x0, y1], axis=1).reshape(-1, 2)
    n_rings = len(row)
    return normalize(Areas(corners, np.arange(n_rings + 1) * 4, np.zeros(n_rings, np.int64), 1))


class _Slabs:
    """What fills each layer, whenever it is laid; `deep` (L,) is whether some of it is part of a deeper bead."""

    def __init__(self, stack: Stack, of_part: Bool) -> None:
        """Take all beads, and which make up the part."""
        parts, source = through_layers(stack)
        n = stack.n_layers
        cut = np.bincount(source, minlength=stack.beads.n_beads)[source] > 1
        self.deep = np.bincount(parts.layer[cut & of_part[source]], minlength=n) > 0
        kept = of_part[source] & (parts.beads.purpose != Purpose.IRONING) & (parts.layer >= 0)
        kept &= self.deep[parts.layer]
        own = np.flatnonzero(kept)
        own = own[np.argsort(parts.layer[own], kind="stable")]
        self._beads = parts.beads.take(own)
        self._bounds = np.searchsorted(parts.layer[own], np.arange(n + 1))

    def of_layer(self, k: int) -> Beads:
        """All that fills layer k, one of the deep ones."""
        return self._beads.take(np.arange(self._bounds[k], self._bounds[k + 1]))


class _Ground:
    """The ground of a part, with the supports that grow before each of its layers."""

    def __init__(self, stack: Stack, beads: Beads) -> None:
        """Take all beads, and those of the part, which say how much room is needed."""
        ends = np.concatenate([np.zeros((1, 2)), beads.begin, beads.end][bool(beads.n_beads) :])
        low, high = ends.min(axis=0), ends.max(axis=0)
        support = stack.beads.purpose == Purpose.SUPPORT
        for end in (stack.beads.begin, stack.beads.end):
            support &= ((end > low - _NEAR) & (end < high + _NEAR)).all(axis=1)
        self._supports = stack.beads.take(support)
        self.cell = cell_for(low, high)
        self.cells = Ground(_window(self.cell, beads, self._supports))
        self._layer = np.searchsorted(stack.top, self._supports.z_top + 1e-3)

    def support_up_to(self, layer: int) -> None:
        """Lay the supports whose upper side is over the layer below this one, and under its own."""
        now = np.flatnonzero(self._layer == layer)
        if not len(now):
            return
        height = self._supports.z_top[now]
        for z in np.unique(height).tolist():
            some = self._supports.take(now[height == z])
            window = _window(self.cell, some)
            self.cells.lay(filled(some, window), window, z, support=True)


def _reach(beads: Beads, cell: float) -> int:
    """Cells to either side of the one in the middle of a window as wide as a usual bead."""
    return max(round((beads.usual_width / cell - 1) / 2), 1)


def _window(cell: float, *several: Beads) -> Window:
    """The cells around beads."""
    ends = np.concatenate([end for beads in several for end in (beads.begin, beads.end)])
    widest = max(float(beads.width.max(initial=0.0)) for beads in several)
    if not len(ends):
        return Window(0, 0, 1, 1, cell)
    margin = min(max(widest, _LEAST_MARGIN), _WIDEST_MARGIN)
    return Window.around(ends.min(axis=0), ends.max(axis=0), margin, cell)
