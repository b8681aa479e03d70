"""Every layer that a plan may have, as an arc between two heights, with what it costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.geometry.slabs import BESIDE
from printer_slicer.model import Mesh
from printer_slicer.planning.height_grid import HeightGrid, HeightRow, event_planes, list_layers
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.planning.shortest_path import ArcGraph
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface, read_surface
from printer_slicer.surface.runs import runs_by_length

__all__ = ["CandidateLayers"]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateLayers:
    """Layers by where they end, and at each end by height.

    Attributes:
        grid: heights and ends.
        graph: where each layer begins and ends, in units.
        listed: (A,) whether its height is allowed where it is.
        free: (A,) whether it is, or the layer touches an event plane.
        bound: (A,) mm, certified error as tables have it.
        volume: (A,) mm³, wrongly filled or empty at most.
        seconds: (A,) s, modelled.
        per_mm3: modelled time per mm³ of the part in layers of `layer_height`, s.
        uniform: (U, 2) s and mm³ of the plans of the planner `uniform`, of each height of the list that leaves no other
            ones than that to be the last.
    """

    grid: HeightGrid
    graph: ArcGraph
    listed: Bool
    free: Bool
    bound: Float
    volume: Float
    seconds: Float
    per_mm3: float
    uniform: Float

    def __post_init__(self) -> None:
        for name, kind in (
            ("listed", np.bool_),
            ("free", np.bool_),
            ("bound", np.float64),
            ("volume", np.float64),
            ("seconds", np.float64),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), kind, (len(self.graph.start),)))
        object.__setattr__(self, "uniform", frozen_array(self.uniform, np.float64, (-1, 2)))

    @classmethod
    def for_part(
        cls, mesh: Mesh, grid: HeightGrid, steps: ZSteps, profile: Profile, *, everywhere: bool = False
    ) -> CandidateLayers:
        """The layers for a part; with `everywhere` those of any height that the printer can print."""
        surface, planes = read_surface(mesh), event_planes(mesh, profile)
        rows = list_layers(planes, grid, steps, profile, everywhere=everywhere)
        containment = profile.quality.containment
        middles: Float = np.arange(2 * grid.n + 1, dtype=np.float64) * (grid.unit / 2)
        times, wrong = LayerTimes(surface, profile, middles), _Volumes(surface, grid, containment)
        seconds = (times.seconds(2 * row.end - row.height, row.height * grid.unit) for row in rows)
        end = _concatenate((row.end for row in rows), np.int64)
        start = _concatenate((row.end - row.height for row in rows), np.int64)
        # By where they end, and as rows are at each end: from the lowest height up.
        order = _by_end(end, grid.n)
        begin = np.append(0, np.cumsum(np.bincount(end, minlength=grid.n + 1)))
        return cls(
            grid,
            ArcGraph(begin, start.take(order)),
            _concatenate((row.listed for row in rows), np.bool_).take(order),
            _concatenate((row.free for row in rows), np.bool_).take(order),
            _concatenate(_bounds(surface, grid, containment, rows), np.float64).take(order),
            _concatenate((wrong.between(row.end - row.height, row.end) for row in rows), np.float64).take(
                order
            ),
            _concatenate(seconds, np.float64).take(order),
            times.per_mm3(profile.quality.layer_height),
            np.reshape([_cost_of(layers, times, wrong, grid) for layers in _uniform_layers(steps)], (-1, 2)),
        )

    def with_bounds(self, layers: Int, bounds: Float) -> CandidateLayers:
        """The same with other bounds, mm, of some of the layers."""
        bound = self.bound.copy()
        bound[layers] = bounds
        return replace(self, bound=bound)


def _by_end(end: Int, n: int) -> Int:
    """(A,) the order by end, of equal ones as they are: by counting where numbers are small enough for it."""
    return np.argsort(end.astype(np.uint16) if n < 1 << 16 else end, kind="stable")


def _concatenate(parts: Iterable[Bool | Float | Int], kind: type) -> NDArray[Any]:
    """One column of what all rows say."""
    return np.concatenate([np.zeros(0, kind), *parts]).astype(kind, copy=False)


def _bounds(surface: Surface, grid: HeightGrid, containment: str, rows: list[HeightRow]) -> Iterable[Float]:
    """Certified errors, row by row."""
    n_cells, contained = grid.cells * grid.n, containment != "mid"
    # From the cut in the middle to either end, or through the whole layer.
    share = grid.cells if contained else grid.cells // 2
    length = [share * row.height for row in rows]
    rising = runs_by_length(surface.contacts, grid.cell, n_cells, length, contained=contained)
    falling = runs_by_length(
        surface.turned, grid.cell, n_cells, length, bottom=-n_cells * grid.cell, contained=contained
    )
    for row, cells, up, down in zip(rows, length, rising, falling, strict=True):
        end = grid.cells * row.end
        first = end - grid.cells * row.height
        # Both runs begin where the section is taken, or at the far end where the layer is contained.
        start, turned = (first, n_cells - end) if contained else (first + cells, n_cells - first - cells)
        yield np.maximum(up.take(start), down.take(turned)) + (2 * BESIDE if contained else 0.0)


class _Volumes:
    """Upper bounds of the volume error of layers between two nodes."""

    def __init__(self, surface: Surface, grid: HeightGrid, containment: str) -> None:
        self._lattice, self._containment = grid, containment
        n_cells = grid.cells * grid.n
        up, down = (shadow.on_lattice(grid.cell, n_cells) for shadow in (surface.up, surface.down))
        self._both = up + down
        self._over, self._under = (up, down) if containment != "negative" else (down, up)

    def between(self, first: Int, last: Int) -> Float:
        """(m,) mm³, volume error of layers between nodes (m,)."""
        start, end = self._lattice.cells * first, self._lattice.cells * last
        if self._containment == "mid":
            both = self._both
            volume = both.take(start) + both.take(end) - 2 * both.take((start + end) // 2)
        else:
            over, under, cell = self._over, self._under, self._lattice.cell
            # Shadows just above and just below each end, from the nearest cell, because flats at the end belong to one
            # side only.
            above, below = np.append(np.diff(over), 0.0) / cell, np.append(0.0, np.diff(under)) / cell
            thick = (end - start) * cell
            volume = over[end] - over[start] - thick * above[start]
            volume += thick * below[end] - under[end] + under[start]
        return np.asarray(np.maximum(volume, 0.0))


def _uniform_layers(steps: ZSteps) -> Iterable[Int]:
    """Yield uniform plans as layer heights in z steps; only the last layer may have a height outside the list."""
    first, rest = steps.begin()
    for height in steps.allowed.tolist():
        layers = fill_with_layers(rest, height, steps.lowest, steps.highest)
        if np.isin(layers[:-1], steps.allowed).all():
            yield np.append([first] if first else [], layers).astype(np.int64)


def _cost_of(layers: Int, times: LayerTimes, wrong: _Volumes, grid: HeightGrid) -> tuple[float, float]:
    """Return time, s, and volume error, mm³, of a plan given as heights in z steps, to the nearest grid node."""
    end = np.rint(np.cumsum(layers) / grid.steps).astype(np.int64).clip(0, grid.n)
    start = np.append(0, end[:-1])
    thick = end - start
    seconds = sum(
        float(times.seconds((start + end)[thick == one], one * grid.unit).sum())
        for one in set(thick.tolist()) - {0}
    )
    return seconds, float(wrong.between(start, end).sum())
