"""All layers that a plan may contain, as arcs of a graph between heights, with their costs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.model import Mesh
from printer_slicer.planning.height_grid import (
    HeightGrid,
    HeightRow,
    find_event_planes,
    list_candidate_layers,
)
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile
from printer_slicer.shortest_path import ArcGraph
from printer_slicer.surface import Surface, read_surface
from printer_slicer.surface.vertical_runs import bound_runs_by_length
from printer_slicer.values import Struct, force_setattr, replace

if TYPE_CHECKING:
    from printer_slicer.planning.contoured_candidates import ContouredCandidates

__all__ = ["CandidateLayers"]


class CandidateLayers(Struct, frozen=True, eq=False):
    """All candidate layers, sorted by their top, then by height.

    Attributes:
        grid: the grid of heights.
        graph: bottom and top of each layer, in units.
        listed: (A,) whether the height is allowed at this position.
        free: (A,) whether the height is allowed, or the layer touches an event plane.
        bound: (A,) mm, upper bound of the surface deviation.
        volume: (A,) mm³, upper bound of the volume error.
        seconds: (A,) s, modelled time.
        seconds_per_mm3: modelled time per mm³ of the part in layers of `layer_height`, s.
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
    seconds_per_mm3: float
    uniform: Float

    def __post_init__(self) -> None:
        for name, kind in (
            ("listed", np.bool_),
            ("free", np.bool_),
            ("bound", np.float64),
            ("volume", np.float64),
            ("seconds", np.float64),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), kind, (len(self.graph.start),)))
        force_setattr(self, "uniform", frozen_array(self.uniform, np.float64, (-1, 2)))

    @classmethod
    def for_part(
        cls, mesh: Mesh, grid: HeightGrid, steps: ZSteps, profile: Profile, *, everywhere: bool = False
    ) -> CandidateLayers:
        """List the candidate layers of a part; with `everywhere`, layers of every printable height anywhere."""
        surface, planes = read_surface(mesh), find_event_planes(mesh, profile, grid.unit)
        rows = list_candidate_layers(planes, grid, steps, profile, everywhere=everywhere)
        containment = profile.quality.containment
        middles: Float = np.arange(2 * grid.n + 1, dtype=np.float64) * (grid.unit / 2)
        contours = _list_contours(surface, grid, profile, rows)
        times, volumes = (
            LayerTimes(surface, profile, middles),
            _VolumeErrors(surface, grid, containment, contours),
        )
        times.prepare(np.array([row.height * grid.unit for row in rows], np.float64))
        seconds = (times.seconds(2 * row.end - row.height, row.height * grid.unit) for row in rows)
        end = _concatenate((row.end for row in rows), np.int64)
        start = _concatenate((row.end - row.height for row in rows), np.int64)
        # Sort by top; the sort is stable, so layers with equal tops stay sorted by height.
        order = _sort_by_end(end, grid.n)
        begin = np.append(0, np.cumsum(np.bincount(end, minlength=grid.n + 1)))
        return cls(
            grid,
            ArcGraph(begin, start.take(order)),
            _concatenate((row.listed for row in rows), np.bool_).take(order),
            _concatenate((row.free for row in rows), np.bool_).take(order),
            _concatenate(_compute_bounds(surface, grid, containment, rows, contours), np.float64).take(order),
            volumes.bound_errors(start, end).take(order),
            _concatenate(seconds, np.float64).take(order),
            times.seconds_per_mm3(profile.quality.layer_height),
            np.reshape(
                [_estimate_plan_cost(layers, times, volumes, grid) for layers in _list_uniform_plans(steps)],
                (-1, 2),
            ),
        )

    def with_bounds(self, layers: Int, bounds: Float) -> CandidateLayers:
        """Return a copy in which the given layers have new deviation bounds, mm."""
        bound = self.bound.copy()
        bound[layers] = bounds
        return replace(self, bound=bound)


def _sort_by_end(end: Int, n: int) -> Int:
    """Return the indices (A,) that sort layers stably by their end; numpy sorts 16-bit integers in linear time."""
    return np.argsort(end.astype(np.uint16) if n < 1 << 16 else end, kind="stable")


def _concatenate(parts: Iterable[Bool | Float | Int], kind: type) -> NDArray[Any]:
    """Concatenate the parts of a column; if there are none, return an empty array of type `kind`."""
    return np.concatenate([np.zeros(0, kind), *parts]).astype(kind, copy=False)


def _list_contours(
    surface: Surface, grid: HeightGrid, profile: Profile, rows: list[HeightRow]
) -> ContouredCandidates | None:
    """Return what contouring changes in the candidate layers of a profile; None if it changes nothing."""
    if not profile.quality.z_contouring:
        return None
    from printer_slicer.planning.contoured_candidates import list_contoured_candidates  # noqa: PLC0415 - off by default

    return list_contoured_candidates(surface, grid, profile, [row.height for row in rows])


def _compute_bounds(
    surface: Surface,
    grid: HeightGrid,
    containment: str,
    rows: list[HeightRow],
    contours: ContouredCandidates | None,
) -> Iterable[Float]:
    """Yield for each row the upper bounds of the deviation of its layers, mm."""
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
        bound = np.maximum(up.take(start), down.take(turned)) + (2 * BESIDE if contained else 0.0)
        yield contours.bound_deviations(row, bound) if contours else bound


class _VolumeErrors:
    """Upper bounds of the volume error of layers between two nodes."""

    def __init__(
        self, surface: Surface, grid: HeightGrid, containment: str, contours: ContouredCandidates | None
    ) -> None:
        self._grid, self._containment, self._contours = grid, containment, contours
        n_cells = grid.cells * grid.n
        up, down = (
            shadow.area_integral_on_lattice(grid.cell, n_cells) for shadow in (surface.up, surface.down)
        )
        self._both = up + down
        self._over, self._under = (up, down) if containment != "negative" else (down, up)

    def bound_errors(self, first: Int, last: Int) -> Float:
        """Return upper bounds (m,) of the volume errors of layers between nodes (m,), mm³."""
        start, end = self._grid.cells * first, self._grid.cells * last
        if self._containment == "mid":
            both = self._both
            volume = both.take(start) + both.take(end) - 2 * both.take((start + end) // 2)
            if self._contours:
                volume += self._contours.compute_volume_changes(first, last)
        else:
            over, under, cell = self._over, self._under, self._grid.cell
            # Shadows just above and just below each end, from the nearest cell, because flats at the end belong to one
            # side only.
            above, below = np.append(np.diff(over), 0.0) / cell, np.append(0.0, np.diff(under)) / cell
            thick = (end - start) * cell
            volume = over[end] - over[start] - thick * above[start]
            volume += thick * below[end] - under[end] + under[start]
        return np.asarray(np.maximum(volume, 0.0))


def _list_uniform_plans(steps: ZSteps) -> Iterable[Int]:
    """Yield uniform plans as layer heights in z steps; only the last layer may have a height that is not allowed."""
    first, rest = steps.split_first_layer()
    for height in steps.allowed.tolist():
        layers = fill_with_layers(rest, height, steps.lowest, steps.highest)
        if np.isin(layers[:-1], steps.allowed).all():
            yield np.append([first] if first else [], layers).astype(np.int64)


def _estimate_plan_cost(
    layers: Int, times: LayerTimes, volumes: _VolumeErrors, grid: HeightGrid
) -> tuple[float, float]:
    """Return time, s, and volume error, mm³, of a plan of layer heights in z steps; tops are rounded to grid nodes."""
    end = np.rint(np.cumsum(layers) / grid.steps).astype(np.int64).clip(0, grid.n)
    start = np.append(0, end[:-1])
    thick = end - start
    seconds = sum(
        float(times.seconds((start + end)[thick == one], one * grid.unit).sum())
        for one in set(thick.tolist()) - {0}
    )
    return seconds, float(volumes.bound_errors(start, end).sum())
