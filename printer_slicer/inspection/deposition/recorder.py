"""Record the extrusion of a print while it is executed, in memory that does not grow with the job.

Moves arrive in chunks. Extrusions of one height are checked together, see `defects`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.deposition.defects import COLLISION_DEPTH, DefectFinder
from printer_slicer.inspection.deposition.head_contacts import HeadContactFinder
from printer_slicer.inspection.deposition.height_map import (
    COMMAND,
    END,
    FED,
    NEGLIGIBLE,
    START,
    HeightMap,
    MoveBatch,
    find_height_changes,
)
from printer_slicer.inspection.deposition.marks import Marks
from printer_slicer.inspection.deposition.nozzle_contacts import NozzleContactFinder
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.inspection.deposition.timeline import TimelineRecorder
from printer_slicer.inspection.deposition.underextrusion import MissingExtrusionFinder
from printer_slicer.profile.print_head import HeadShape

__all__ = ["DepositionRecorder"]

_MAX_WAITING: Final = 65_536  # number of moves that are queued before they are checked
_MAX_LAYERS: Final = 20_000

_MEDIAN_SHARE, _THICK_SHARE = 0.5, 0.05
_SPEED_BINS: Final = np.geomspace(1e-3, 1e4, 1400)
"""Limits of speed ranges, mm/s, fine enough for a median."""


class DepositionRecorder:
    """Records layers, times, volumes and defects of a print.

    Args:
        box: corners of the area that the nozzle can reach, x and y, mm.
        area: cross-section of the filament, mm².
        max_flow: highest flow of the material, mm³/s.
        marks: layers and roles from the comments.
        shapes: of the print head.
        nozzle_flat: mm, diameter of the level underside of the nozzle; 0: unknown.
    """

    def __init__(
        self,
        box: tuple[tuple[float, float], tuple[float, float]],
        area: float,
        max_flow: float,
        marks: Marks,
        shapes: Sequence[HeadShape] = (),
        *,
        nozzle_flat: float = 0.0,
    ) -> None:
        self._height_map = HeightMap(*box)
        self._defects = DefectFinder(
            self._height_map,
            max_flow,
            marks,
            HeadContactFinder(shapes, box) if shapes else None,
            NozzleContactFinder(self._height_map, nozzle_flat) if nozzle_flat else None,
        )
        self._area, self._marks = area, marks
        # Filament fed by each tool so far, and its maximum, mm.
        self._fed_by_tool: dict[int, tuple[float, float]] = {}
        self._queue: list[tuple[Float, Float, Float]] = []
        self._n_queued = 0
        self._batch_z, self._extruded_z, self._is_below = np.nan, np.nan, False
        self._layers: dict[int, LayerDeposition] = {}
        self._heights: dict[float, int] = {}
        self._number = 0
        self._seconds = np.zeros(len(marks.labels))
        self._travel = self._extruder = self._volume = self._standing = 0.0
        self._speeds = np.zeros(len(_SPEED_BINS) + 1)
        self._first_extrusion: int | None = None
        self._first_missing: int | None = None
        self._missing_extrusion = MissingExtrusionFinder()
        self._timeline = TimelineRecorder()

    def add_moves(self, rows: Float, seconds: Float, clogged_share: float = 0.0) -> None:
        """Add executed moves to the record.

        Args:
            rows: (n, 9) rows of `sim.move_log`.
            seconds: (n,) s, duration of each move.
            clogged_share: share of the fed filament that does not come out of the nozzle.
        """
        self._timeline.add_moves(rows, seconds)
        pushed = self._new_filament(rows) * self._area
        new_volume = pushed * (1.0 - clogged_share)
        xy_length = np.hypot(*(rows[:, END] - rows[:, START])[:, :2].T)
        extrudes = (new_volume > NEGLIGIBLE) & (xy_length > NEGLIGIBLE)
        self._standing += float(new_volume[~extrudes].sum())
        if self._first_extrusion is None and extrudes.any():
            self._first_extrusion = int(rows[extrudes.argmax(), COMMAND])
        if self._first_missing is None and clogged_share and (pushed > NEGLIGIBLE).any():
            self._first_missing = int(rows[(pushed > NEGLIGIBLE).argmax(), COMMAND])
        if clogged_share:
            rows = rows.copy()
            rows[:, FED] *= 1.0 - clogged_share
        self._missing_extrusion.add_moves(rows, extrudes)
        self._split_by_height(rows, seconds, (new_volume, extrudes))

    def _split_by_height(self, rows: Float, seconds: Float, volumes: tuple[Float, Bool]) -> None:
        """Split moves into batches of one height; `volumes` are new mm³ and a mask of extruding moves."""
        new_volume, extrudes = volumes
        z = rows[:, 6]
        # Split where extrusion continues at another height, or the nozzle sinks below the last extrusion.
        heights = np.where(extrudes, z, np.nan)
        below = np.minimum(z, rows[:, 3]) < _last_known_before(heights, self._extruded_z) - COLLISION_DEPTH
        sinks = below & ~np.append(self._is_below, below[:-1])
        self._is_below, self._extruded_z = (
            bool(below[-1]),
            float(_last_known_before(np.append(heights, 0.0), self._extruded_z)[-1]),
        )
        indices = np.flatnonzero(extrudes | sinks)
        begin = 0
        for first, height in zip(*find_height_changes(indices, z[indices], self._batch_z), strict=True):
            if first > begin or self._queue:
                self._queue_moves(rows[begin:first], seconds[begin:first], new_volume[begin:first])
                self._check_queue()
            begin, self._batch_z = first, height
        self._queue_moves(rows[begin:], seconds[begin:], new_volume[begin:])

    def close(self) -> Deposition:
        """Finish the record, and return the recorded extrusion."""
        self._check_queue()
        names = self._marks.labels
        return Deposition(
            layers=tuple(self._layers.values()),
            by_role={names[i]: float(s) for i, s in enumerate(self._seconds) if s > 0},
            travel=self._travel,
            extruder=self._extruder,
            volume=self._volume,
            standing=self._standing,
            length=sum(layer.length for layer in self._layers.values()),
            speed=_median_speed(self._speeds),
            peak=self._defects.peak,
            defects=tuple(self._defects.defects),
            counts=dict(self._defects.counts),
            first_extrusion=self._first_extrusion,
            first_missing=self._first_missing,
            missing_extrusion=self._missing_extrusion.first,
            plate=self._height_map.plate_heights(),
            timeline=self._timeline.close(),
        )

    def _new_filament(self, rows: Float) -> Float:
        """Return the new filament (n,), mm, that each move feeds; each tool has its own filament."""
        if not len(self._marks.tools):
            return self._new_filament_of_tool(rows[:, FED], 0)
        tool = self._marks.tool_at(rows[:, COMMAND].astype(np.int64))
        result = np.zeros(len(rows))
        for one in np.unique(tool).tolist():
            result[tool == one] = self._new_filament_of_tool(rows[tool == one, FED], one)
        return result

    def _new_filament_of_tool(self, fed: Float, tool: int) -> Float:
        """Return the filament (n,), mm, that a tool feeds beyond its maximum; the rest is deretraction."""
        before, reached = self._fed_by_tool.get(tool, (0.0, 0.0))
        total = np.round(before + np.cumsum(fed), 7)
        peak = np.maximum.accumulate(np.maximum(total, reached))
        if len(total):
            self._fed_by_tool[tool] = float(total[-1]), float(peak[-1])
        return np.asarray(np.diff(peak, prepend=reached))

    def _queue_moves(self, rows: Float, seconds: Float, new_volume: Float) -> None:
        """Queue moves of one height, and check them if the queue is full."""
        if len(rows):
            self._queue.append((rows, seconds, new_volume))
            self._n_queued += len(rows)
            if self._n_queued > _MAX_WAITING:
                self._check_queue()

    def _check_queue(self) -> None:
        """Check the queued moves for defects, and empty the queue."""
        if not self._queue:
            return
        rows, seconds, new_volume = (np.concatenate(parts) for parts in zip(*self._queue, strict=True))
        self._queue, self._n_queued = [], 0
        batch = MoveBatch.from_rows(rows, seconds, new_volume, self._marks)
        layer_numbers = self._number_layers(batch)
        self._add_totals(batch, layer_numbers)
        self._defects.check(batch, layer_numbers)

    def _number_layers(self, batch: MoveBatch) -> Int:
        """Return the layer number (n,) of each move."""
        if len(self._marks.layers):
            return self._marks.layer_at(batch.command)
        if not batch.extrudes.any():
            return np.full(len(batch.command), self._number)
        z = round(float(batch.end[batch.extrudes, 2].max()), 3)
        if len(self._heights) < _MAX_LAYERS:
            self._heights.setdefault(z, len(self._heights) + 1)
        self._number = self._heights.get(z, len(self._heights))
        return np.full(len(batch.command), self._number)

    def _add_totals(self, batch: MoveBatch, layer_numbers: Int) -> None:
        """Add the times, volumes and lengths of moves to the totals and to their layers."""
        extrudes = batch.extrudes
        self._seconds += np.bincount(batch.role[extrudes], batch.seconds[extrudes], len(self._seconds))
        stays = batch.xy_length <= NEGLIGIBLE
        upright = np.abs(batch.end[:, 2] - batch.start[:, 2]) > NEGLIGIBLE
        alone = stays & ~upright
        self._extruder += float(batch.seconds[alone].sum())
        self._travel += float(batch.seconds[~extrudes & ~alone].sum())
        self._volume += float(batch.volume[extrudes].sum())
        speeds = batch.xy_length[extrudes] / np.maximum(batch.seconds[extrudes], 1e-9)
        self._speeds += np.bincount(
            np.searchsorted(_SPEED_BINS, speeds), batch.xy_length[extrudes], len(_SPEED_BINS) + 1
        )
        for number in np.unique(layer_numbers).tolist():
            if number in self._layers or len(self._layers) < _MAX_LAYERS:
                self._add_to_layer(number, batch, layer_numbers == number)

    def _add_to_layer(self, number: int, batch: MoveBatch, selected: Bool) -> None:
        """Add the selected moves (n,) to a layer."""
        layer = self._layers.setdefault(
            number, LayerDeposition(number, int(batch.command[selected.argmax()]))
        )
        extruding = selected & batch.extrudes
        lengths, volumes = batch.xy_length[extruding], batch.volume[extruding]
        length = float(lengths.sum())
        layer.seconds += float(batch.seconds[selected].sum())
        layer.volume += float(volumes.sum())
        layer.length += length
        layer.peak_flow = max(layer.peak_flow, float(batch.flow[extruding].max(initial=0.0)))
        moving = selected & (batch.xy_length > NEGLIGIBLE)
        layer.retracted_length += float(batch.xy_length[moving & (batch.fed < -NEGLIGIBLE)].sum())
        in_vain = moving & batch.feeds_without_extruding
        if in_vain.any():
            layer.empty_length += float(batch.xy_length[in_vain].sum())
            layer.first_empty = layer.first_empty or int(batch.command[in_vain.argmax()])
        if length > layer._longest:  # noqa: SLF001 - only this module uses it
            layer._longest, layer.z = length, float(batch.end[extruding, 2].max())  # noqa: SLF001
            layer.median_section, layer.thick_section = _exceeded_values(
                volumes / lengths, lengths, (_MEDIAN_SHARE, _THICK_SHARE)
            )


def _exceeded_values(values: Float, weights: Float, shares: tuple[float, ...]) -> list[float]:
    """Return, for each share, the value that this share of the total weight exceeds."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    places = np.searchsorted(total, (1.0 - np.array(shares)) * total[-1])
    return list(values[order][np.minimum(places, len(values) - 1)].tolist())


def _last_known_before(values: Float, before: float) -> Float:
    """Return, for each value, the last known value (n,) before it; nan means unknown."""
    values = np.append(before, values[:-1])
    known = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[known])


def _median_speed(bins: Float) -> float:
    """Return the median speed, mm/s, from the length in each speed range; 0 without any length."""
    total = np.cumsum(bins)
    return (
        float(np.append(_SPEED_BINS, _SPEED_BINS[-1])[np.searchsorted(total, total[-1] / 2)])
        if total[-1] > 0
        else 0.0
    )
