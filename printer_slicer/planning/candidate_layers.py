"""All layers that a plan may contain, as arcs of a graph between heights, with their costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.model import Mesh
from printer_slicer.planning.height_grid import HeightGrid, HeightRow, event_planes, list_layers
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.planning.shortest_path import ArcGraph
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface, read_surface
from printer_slicer.surface.vertical_runs import bound_runs_by_length

__all__ = ["CandidateLayers"]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateLayers:
    """All candidate layers, sorted by their top, then by height.

    Attributes:
        grid: the grid of heights.
        graph: bottom and top of each layer, in units.
        listed: (A,) whether the height is allowed at this position.
        free: (A,) whether the height is allowed, or the layer touches an event plane.
        bound: (A,) mm, upper bound of the surface deviation.
        volume: (A,) mm³, upper bound of the volume error.
        seconds: (A,) s, modelled time.
        per_mm3: modelled time per mm³ of the part in layers of `layer_height`, s.
        uniform: (U, 2) s and mm³ of uniform plans, one for each allowed height; only the last layer may have another
            height.
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
        """List the candidate layers of a part; with `everywhere` of all heights that the printer can print."""
        surface, planes = read_surface(mesh), event_planes(mesh, profile)
        rows = list_layers(planes, grid, steps, profile, everywhere=everywhere)
        containment = profile.quality.containment
        middles: Float = np.arange(2 * grid.n + 1, dtype=np.float64) * (grid.unit / 2)
        times, volumes = LayerTimes(surface, profile, middles), _Volumes(surface, grid, containment)
        seconds = (times.seconds(2 * row.end - row.height, row.height * grid.unit) for row in rows)
        end = _concatenate((row.end for row in rows), np.int64)
        start = _concatenate((row.end - row.height for row in rows), np.int64)
        # Sort by top; the sort is stable, so layers with equal tops stay sorted by height.
        order = _by_end(end, grid.n)
        begin = np.append(0, np.cumsum(np.bincount(end, minlength=grid.n + 1)))
        return cls(
            grid,
            ArcGraph(begin, start.take(order)),
            _concatenate((row.listed for row in rows), np.bool_).take(order),
            _concatenate((row.free for row in rows), np.bool_).take(order),
            _concatenate(_bounds(surface, grid, containment, rows), np.float64).take(order),
            _concatenate((volumes.between(row.end - row.height, row.end) for row in rows), np.float64).take(
                order
            ),
            _concatenate(seconds, np.float64).take(order),
            times.per_mm3(profile.quality.layer_height),
            np.reshape(
                [_cost_of(layers, times, volumes, grid) for layers in _uniform_layers(steps)], (-1, 2)
            ),
        )

    def with_bounds(self, layers: Int, bounds: Float) -> CandidateLayers:
        """Return the candidates with new bounds, mm, for some of the layers."""
        bound = self.bound.copy()
        bound[layers] = bounds
        return replace(self, bound=bound)


def _by_end(end: Int, n: int) -> Int:
    """Return a stable sort order (A,) by end; numpy sorts 16-bit integers in linear time."""
    return np.argsort(end.astype(np.uint16) if n < 1 << 16 else end, kind="stable")


def _concatenate(parts: Iterable[Bool | Float | Int], kind: type) -> NDArray[Any]:
    """Concatenate the parts of a column."""
    return np.concatenate([np.zeros(0, kind), *parts]).astype(kind, copy=False)


def _bounds(surface: Surface, grid: HeightGrid, containment: str, rows: list[HeightRow]) -> Iterable[Float]:
    """Yield the deviation bounds of each row."""
    n_cells, contained = grid.cells * grid.n, containment != "mid"
    # Runs go from the cut in the middle to either end, or through the whole layer if it is contained.
    share = grid.cells if contained else grid.cells // 2
    length = [share * row.height for row in rows]
    rising = bound_runs_by_length(surface.contacts, grid.cell, n_cells, length, contained=contained)
    falling = bound_runs_by_length(
        surface.turned, grid.cell, n_cells, length, bottom=-n_cells * grid.cell, contained=contained
    )
    for row, cells, up, down in zip(rows, length, rising, falling, strict=True):
        end = grid.cells * row.end
        first = end - grid.cells * row.height
        # Both runs start at the cut, or at the far end if the layer is contained.
        start, turned = (first, n_cells - end) if contained else (first + cells, n_cells - first - cells)
        yield np.maximum(up.take(start), down.take(turned)) + (2 * BESIDE if contained else 0.0)


class _Volumes:
    """Upper bounds of the volume error of layers between two nodes."""

    def __init__(self, surface: Surface, grid: HeightGrid, containment: str) -> None:
        self._grid, self._containment = grid, containment
        n_cells = grid.cells * grid.n
        up, down = (shadow.integral_on_lattice(grid.cell, n_cells) for shadow in (surface.up, surface.down))
        self._both = up + down
        self._over, self._under = (up, down) if containment != "negative" else (down, up)

    def between(self, first: Int, last: Int) -> Float:
        """Return the volume errors (m,), mm³, of layers between nodes (m,)."""
        start, end = self._grid.cells * first, self._grid.cells * last
        if self._containment == "mid":
            both = self._both
            volume = both.take(start) + both.take(end) - 2 * both.take((start + end) // 2)
        else:
            over, under, cell = self._over, self._under, self._grid.cell
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


def _cost_of(layers: Int, times: LayerTimes, volumes: _Volumes, grid: HeightGrid) -> tuple[float, float]:
    """Return time, s, and volume error, mm³, of a plan given as heights in z steps, to the nearest grid node."""
    end = np.rint(np.cumsum(layers) / grid.steps).astype(np.int64).clip(0, grid.n)
    start = np.append(0, end[:-1])
    thick = end - start
    seconds = sum(
        float(times.seconds((start + end)[thick == one], one * grid.unit).sum())
        for one in set(thick.tolist()) - {0}
    )
    return seconds, float(volumes.between(start, end).sum())
