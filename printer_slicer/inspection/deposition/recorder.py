"""Record the extrusion of a print while it is executed, in memory that does not grow with the job.

Moves come in chunks. Extrusions of one height are checked together, see `defects`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.deposition.defects import DEEP, DefectFinder
from printer_slicer.inspection.deposition.height_map import (
    COMMAND,
    END,
    FED,
    NOTHING,
    START,
    HeightMap,
    MoveBatch,
    runs_of,
)
from printer_slicer.inspection.deposition.marks import Marks
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.inspection.deposition.timeline import TimelineRecorder
from printer_slicer.inspection.deposition.underextrusion import MissingExtrusionFinder

__all__ = ["DepositionRecorder"]

_MOST: Final = 65_536  # moves that are kept before they are looked at
_MOST_LAYERS: Final = 20_000

_MIDDLE, _THICK = 0.5, 0.05
_BINS: Final = np.geomspace(1e-3, 1e4, 1400)
"""mm/s, finely enough for a median."""


class DepositionRecorder:
    """Records layers, times, volumes and defects of a print.

    Args:
        box: corners of what the nozzle can reach, x and y, mm.
        area: cross-section of the filament, mm².
        max_flow: highest flow of the material, mm³/s.
        marks: layers and roles from the comments.
    """

    def __init__(
        self,
        box: tuple[tuple[float, float], tuple[float, float]],
        area: float,
        max_flow: float,
        marks: Marks,
    ) -> None:
        self._height_map = HeightMap(*box)
        self._defects = DefectFinder(self._height_map, max_flow, marks)
        self._area, self._marks = area, marks
        self._reached: dict[
            int, tuple[float, float]
        ] = {}  # mm of filament of each tool, and the most that it was
        self._waiting: list[tuple[Float, Float, Float]] = []
        self._waits = 0
        self._z, self._laid, self._low = np.nan, np.nan, False
        self._layers: dict[int, LayerDeposition] = {}
        self._heights: dict[float, int] = {}
        self._number = 0
        self._seconds = np.zeros(len(marks.labels))
        self._travel = self._extruder = self._volume = self._standing = 0.0
        self._speeds = np.zeros(len(_BINS) + 1)
        self._first_extrusion: int | None = None
        self._first_missing: int | None = None
        self._missing_extrusion = MissingExtrusionFinder()
        self._timeline = TimelineRecorder()

    def feed(self, rows: Float, seconds: Float, kept_back: float = 0.0) -> None:
        """Add moves.

        Args:
            rows: (n, 9) rows of `sim.move_log`.
            seconds: (n,) s, duration of each.
            kept_back: share of the fed filament that does not come out of the nozzle.
        """
        self._timeline.feed(rows, seconds)
        pushed = self._pushed(rows) * self._area
        fresh = pushed * (1.0 - kept_back)
        flat = np.hypot(*(rows[:, END] - rows[:, START])[:, :2].T)
        extrudes = (fresh > NOTHING) & (flat > NOTHING)
        self._standing += float(fresh[~extrudes].sum())
        if self._first_extrusion is None and extrudes.any():
            self._first_extrusion = int(rows[extrudes.argmax(), COMMAND])
        if self._first_missing is None and kept_back and (pushed > NOTHING).any():
            self._first_missing = int(rows[(pushed > NOTHING).argmax(), COMMAND])
        if kept_back:
            rows = rows.copy()
            rows[:, FED] *= 1.0 - kept_back
        self._missing_extrusion.feed(rows, extrudes)
        self._share_out(rows, seconds, (fresh, extrudes))

    def _share_out(self, rows: Float, seconds: Float, laid: tuple[Float, Bool]) -> None:
        """Split moves into batches of one height, with their volumes, mm³, and whether they extrude."""
        fresh, extrudes = laid
        z = rows[:, 6]
        # Cut where something is laid at another height than before, or the nozzle goes under what was laid just now.
        heights = np.where(extrudes, z, np.nan)
        low = np.minimum(z, rows[:, 3]) < _latest(heights, self._laid) - DEEP
        sinks = low & ~np.append(self._low, low[:-1])
        self._low, self._laid = bool(low[-1]), float(_latest(np.append(heights, 0.0), self._laid)[-1])
        at = np.flatnonzero(extrudes | sinks)
        begin = 0
        for first, height in zip(*runs_of(at, z[at], self._z), strict=True):
            if first > begin or self._waiting:
                self._wait(rows[begin:first], seconds[begin:first], fresh[begin:first])
                self._check_waiting()
            begin, self._z = first, height
        self._wait(rows[begin:], seconds[begin:], fresh[begin:])

    def close(self) -> Deposition:
        """Finish, and return the results."""
        self._check_waiting()
        names = self._marks.labels
        return Deposition(
            layers=tuple(self._layers.values()),
            by_role={names[i]: float(s) for i, s in enumerate(self._seconds) if s > 0},
            travel=self._travel,
            extruder=self._extruder,
            volume=self._volume,
            standing=self._standing,
            length=sum(layer.length for layer in self._layers.values()),
            speed=_median(self._speeds),
            peak=self._defects.peak,
            defects=tuple(self._defects.defects),
            counts=dict(self._defects.counts),
            first_extrusion=self._first_extrusion,
            first_missing=self._first_missing,
            missing_extrusion=self._missing_extrusion.first,
            plate=self._height_map.plate(),
            timeline=self._timeline.close(),
        )

    def _pushed(self, rows: Float) -> Float:
        """Return the (n,) mm of filament that leave the nozzle; each tool has its own filament."""
        if not len(self._marks.tools):
            return self._fresh(rows[:, FED], 0)
        tool = self._marks.tool(rows[:, COMMAND].astype(np.int64))
        result = np.zeros(len(rows))
        for one in np.unique(tool).tolist():
            result[tool == one] = self._fresh(rows[tool == one, FED], one)
        return result

    def _fresh(self, fed: Float, tool: int) -> Float:
        """Return the (n,) mm of filament of one tool that leave the nozzle: feed beyond its maximum so far."""
        before, reached = self._reached.get(tool, (0.0, 0.0))
        total = np.round(before + np.cumsum(fed), 7)
        peak = np.maximum.accumulate(np.maximum(total, reached))
        if len(total):
            self._reached[tool] = float(total[-1]), float(peak[-1])
        return np.asarray(np.diff(peak, prepend=reached))

    def _wait(self, rows: Float, seconds: Float, fresh: Float) -> None:
        """Keep moves until all moves of their height have come."""
        if len(rows):
            self._waiting.append((rows, seconds, fresh))
            self._waits += len(rows)
            if self._waits > _MOST:
                self._check_waiting()

    def _check_waiting(self) -> None:
        """Check the moves that were kept."""
        if not self._waiting:
            return
        rows, seconds, fresh = (np.concatenate(parts) for parts in zip(*self._waiting, strict=True))
        self._waiting, self._waits = [], 0
        batch = MoveBatch.of(rows, seconds, fresh, self._marks)
        numbers = self._numbers(batch)
        self._add(batch, numbers)
        self._defects.check(batch, numbers)

    def _numbers(self, batch: MoveBatch) -> Int:
        """Return the (n,) layer of each move."""
        if len(self._marks.layers):
            return self._marks.layer(batch.command)
        if not batch.extrudes.any():
            return np.full(len(batch.command), self._number)
        z = round(float(batch.end[batch.extrudes, 2].max()), 3)
        if len(self._heights) < _MOST_LAYERS:
            self._heights.setdefault(z, len(self._heights) + 1)
        self._number = self._heights.get(z, len(self._heights))
        return np.full(len(batch.command), self._number)

    def _add(self, batch: MoveBatch, numbers: Int) -> None:
        """Add the times and volumes of moves."""
        extrudes = batch.extrudes
        self._seconds += np.bincount(batch.role[extrudes], batch.seconds[extrudes], len(self._seconds))
        still = batch.flat <= NOTHING
        upright = np.abs(batch.end[:, 2] - batch.start[:, 2]) > NOTHING
        alone = still & ~upright
        self._extruder += float(batch.seconds[alone].sum())
        self._travel += float(batch.seconds[~extrudes & ~alone].sum())
        self._volume += float(batch.volume[extrudes].sum())
        pace = batch.flat[extrudes] / np.maximum(batch.seconds[extrudes], 1e-9)
        self._speeds += np.bincount(np.searchsorted(_BINS, pace), batch.flat[extrudes], len(_BINS) + 1)
        for number in np.unique(numbers).tolist():
            if number in self._layers or len(self._layers) < _MOST_LAYERS:
                self._add_to(number, batch, numbers == number)

    def _add_to(self, number: int, batch: MoveBatch, own: Bool) -> None:
        """Add moves to a layer."""
        layer = self._layers.setdefault(number, LayerDeposition(number, int(batch.command[own.argmax()])))
        laid = own & batch.extrudes
        lengths, volumes = batch.flat[laid], batch.volume[laid]
        length = float(lengths.sum())
        layer.seconds += float(batch.seconds[own].sum())
        layer.volume += float(volumes.sum())
        layer.length += length
        layer.peak_flow = max(layer.peak_flow, float(batch.flow[laid].max(initial=0.0)))
        goes = own & (batch.flat > NOTHING)
        layer.back += float(batch.flat[goes & (batch.fed < -NOTHING)].sum())
        empty = goes & batch.empty
        if empty.any():
            layer.empty += float(batch.flat[empty].sum())
            layer.wrong = layer.wrong or int(batch.command[empty.argmax()])
        if length > layer._longest:  # noqa: SLF001 - a layer is this file's own
            layer._longest, layer.z = length, float(batch.end[laid, 2].max())  # noqa: SLF001
            layer.middle, layer.thick = _exceeded(volumes / lengths, lengths, (_MIDDLE, _THICK))


def _exceeded(values: Float, weights: Float, shares: tuple[float, ...]) -> list[float]:
    """Return the values that are exceeded by the given shares of the total weight."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    places = np.searchsorted(total, (1.0 - np.array(shares)) * total[-1])
    return list(values[order][np.minimum(places, len(values) - 1)].tolist())


def _latest(values: Float, before: float) -> Float:
    """Replace nan by the last value before it, (n,)."""
    values = np.append(before, values[:-1])
    known = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[known])


def _median(bins: Float) -> float:
    """Return the weighted median; 0 without values."""
    total = np.cumsum(bins)
    return float(np.append(_BINS, _BINS[-1])[np.searchsorted(total, total[-1] / 2)]) if total[-1] > 0 else 0.0
