"""Find defects of the extrusion, height by height, against everything printed before.

defect              condition
unsupported         extrusion with nothing below it, see `deposition.unsupported`
collision           the nozzle, extruding or not, is more than 0.12 mm below the print in its path
on the bed          extrusion less than 0.04 mm above the bed
flow                more volume per second than the material melts
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.inspection.deposition.height_map import (
    NOTHING,
    HeightMap,
    MoveBatch,
    MovePieces,
    split_moves,
)
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.inspection.deposition.unsupported import MIN_REPORTED_LENGTH, deposit, unsupported_pieces

__all__ = ["DEEP", "DefectFinder"]

DEEP: Final = 0.12
"""Depth of the nozzle below the print in its path that counts as a collision, mm."""

_PLUNGE: Final = 0.5  # mm straight down into what stands there, or to the side of it
_SCRAPES: Final = 0.04  # mm over the bed
_OVER: Final = 1.01
_MOST_DEFECTS: Final = 200


class DefectFinder:
    """Finds the defects in moves of one height at a time.

    Args:
        height_map: everything printed so far; checked moves are added to it.
        max_flow: highest flow of the material, mm³/s.
        marks: layers and roles from the comments.

    Attributes:
        defects: the worst of each kind in each layer, in order, the first 200.
        counts: number of layers with each kind.
        peak: the highest flow; None without extrusion.
    """

    def __init__(self, height_map: HeightMap, max_flow: float, marks: Marks) -> None:
        self._height_map, self._max_flow, self._marks = height_map, max_flow, marks
        self.defects: list[Defect] = []
        self.counts: dict[str, int] = {}
        self.peak: Defect | None = None

    def check(self, batch: MoveBatch, numbers: Int) -> None:
        """Check moves of one height; `numbers` (n,) are their layers."""
        self._flow(batch, numbers)
        cut = split_moves(batch.start, batch.end)
        cell = self._height_map.cells(cut)
        self._crash(batch, cut, cell, numbers)
        laid = np.flatnonzero(batch.extrudes[cut.move])
        if len(laid):
            some = cut.take(laid)
            self._unsupported(batch, some, cell[laid], numbers)
            deposit(self._height_map, batch, some, cell[laid], self._marks)

    def _flow(self, batch: MoveBatch, numbers: Int) -> None:
        """Check the flow."""
        if not len(batch.flow):
            return
        at = int(batch.flow.argmax())
        flow = float(batch.flow[at])
        if flow <= 0:
            return
        defect_at = batch.defect_at("flow", at, numbers, flow)
        if self.peak is None or flow > self.peak.amount:
            self.peak = defect_at
        if flow > self._max_flow * _OVER:
            first = int(np.flatnonzero(batch.flow > self._max_flow * _OVER)[0])
            self._keep(batch.defect_at("flow", first, numbers, flow))

    def _crash(self, batch: MoveBatch, cut: MovePieces, cell: Int, numbers: Int) -> None:
        """Find collisions of the nozzle with the print."""
        depth = self._height_map.depth(cell, cut.z)
        upright = cut.length <= NOTHING
        sinks = (batch.end[:, 2] < batch.start[:, 2] - NOTHING)[cut.move]
        low = np.flatnonzero((cut.z < self._height_map.highest - _PLUNGE) & (~upright | sinks))
        if len(low):  # the deeper, the wider a nozzle is
            beside = self._height_map.deepest(cell[low], cut.z[low])
            depth[low] = np.where(beside > _PLUNGE, beside, depth[low])
        hit = np.flatnonzero((~upright & (depth > DEEP)) | (upright & sinks & (depth > _PLUNGE)))
        if not len(hit):
            return
        through = float(cut.length[hit].sum())
        if through < MIN_REPORTED_LENGTH and not upright[hit].any():
            return
        worst = float(depth[hit].max())
        self._keep(batch.defect_at("crash", int(cut.move[hit[0]]), numbers, through)._replace(depth=worst))

    def _unsupported(self, batch: MoveBatch, cut: MovePieces, cell: Int, numbers: Int) -> None:
        """Find unsupported extrusion."""
        low = batch.end[cut.move, 2] < _SCRAPES
        if float(cut.length[low].sum()) > MIN_REPORTED_LENGTH:
            first = int(cut.move[np.flatnonzero(low)[0]])
            self._keep(batch.defect_at("bed", first, numbers, float(batch.end[first, 2])))
        lost = unsupported_pieces(self._height_map, batch, cut, cell, self._marks)
        length = float(cut.length[lost].sum())
        if length > MIN_REPORTED_LENGTH:
            at = lost[0]
            defect_at = batch.defect_at("unsupported", int(cut.move[at]), numbers, length)
            self._keep(defect_at._replace(x=float(cut.x[at]), y=float(cut.y[at])))

    def _keep(self, defect_at: Defect) -> None:
        """Keep a defect, one of each kind per layer."""
        same = next(
            (i for i in range(len(self.defects) - 1, -1, -1) if self.defects[i].kind == defect_at.kind), None
        )
        if same is not None and self.defects[same].layer == defect_at.layer:
            old = self.defects[same]
            more = max if defect_at.kind in {"flow", "crash"} else float.__add__
            self.defects[same] = old._replace(
                amount=more(old.amount, defect_at.amount), depth=max(old.depth, defect_at.depth)
            )
            return
        self.counts[defect_at.kind] = self.counts.get(defect_at.kind, 0) + 1
        if len(self.defects) < _MOST_DEFECTS:
            self.defects.append(defect_at)
