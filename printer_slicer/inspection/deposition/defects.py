"""What goes wrong with plastic while it is laid, looked for height by height against everything laid before.

what                when
in the air          beads that nothing holds, see `deposition.unsupported`
through the print   the nozzle, laying or not, is more than 0.12 mm lower than the plastic in its way
on the bed          beads lie less than 0.04 mm above it
too much            more plastic per second than the material melts
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.inspection.deposition.height_map import NOTHING, HeightMap, MoveBatch, MovePieces, cut_up
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.inspection.deposition.unsupported import MIN_REPORTED_LENGTH, deposit, unsupported_pieces

__all__ = ["DEEP", "DefectFinder"]

DEEP: Final = 0.12
"""mm lower than the plastic in its way that are a crash."""

_PLUNGE: Final = 0.5  # mm straight down into what stands there, or to the side of it
_SCRAPES: Final = 0.04  # mm over the bed
_OVER: Final = 1.01
_MOST_MISHAPS: Final = 200


class DefectFinder:
    """Looks at what is laid.

    Args:
        relief: what stands on the plate so far; what is looked at is put into it.
        max_flow: mm³/s that the material melts.
        marks: what comments tell.

    Attributes:
        mishaps: the worst of each kind in each layer, in order, the first 200.
        counts: how many layers have each kind.
        peak: the highest flow; None without any.
    """

    def __init__(self, relief: HeightMap, max_flow: float, marks: Marks) -> None:
        self._relief, self._max_flow, self._marks = relief, max_flow, marks
        self.mishaps: list[Defect] = []
        self.counts: dict[str, int] = {}
        self.peak: Defect | None = None

    def look(self, batch: MoveBatch, numbers: Int) -> None:
        """Look at moves of one height, `numbers` (n,) their layers."""
        self._flow(batch, numbers)
        cut = cut_up(batch.start, batch.end)
        cell = self._relief.cells(cut)
        self._crash(batch, cut, cell, numbers)
        laid = np.flatnonzero(batch.lays[cut.move])
        if len(laid):
            some = cut.take(laid)
            self._air(batch, some, cell[laid], numbers)
            deposit(self._relief, batch, some, cell[laid], self._marks)

    def _flow(self, batch: MoveBatch, numbers: Int) -> None:
        """Plastic per second."""
        if not len(batch.flow):
            return
        at = int(batch.flow.argmax())
        flow = float(batch.flow[at])
        if flow <= 0:
            return
        mishap = batch.mishap("flow", at, numbers, flow)
        if self.peak is None or flow > self.peak.amount:
            self.peak = mishap
        if flow > self._max_flow * _OVER:
            first = int(np.flatnonzero(batch.flow > self._max_flow * _OVER)[0])
            self._tell(batch.mishap("flow", first, numbers, flow))

    def _crash(self, batch: MoveBatch, cut: MovePieces, cell: Int, numbers: Int) -> None:
        """The nozzle, lower than what stands in its way."""
        depth = self._relief.depth(cell, cut.z)
        upright = cut.length <= NOTHING
        sinks = (batch.end[:, 2] < batch.start[:, 2] - NOTHING)[cut.move]
        low = np.flatnonzero((cut.z < self._relief.highest - _PLUNGE) & (~upright | sinks))
        if len(low):  # the deeper, the wider a nozzle is
            beside = self._relief.deepest(cell[low], cut.z[low])
            depth[low] = np.where(beside > _PLUNGE, beside, depth[low])
        hit = np.flatnonzero((~upright & (depth > DEEP)) | (upright & sinks & (depth > _PLUNGE)))
        if not len(hit):
            return
        through = float(cut.length[hit].sum())
        if through < MIN_REPORTED_LENGTH and not upright[hit].any():
            return
        worst = float(depth[hit].max())
        self._tell(batch.mishap("crash", int(cut.move[hit[0]]), numbers, through)._replace(depth=worst))

    def _air(self, batch: MoveBatch, cut: MovePieces, cell: Int, numbers: Int) -> None:
        """Beads with nothing under them that nothing holds."""
        low = batch.end[cut.move, 2] < _SCRAPES
        if float(cut.length[low].sum()) > MIN_REPORTED_LENGTH:
            first = int(cut.move[np.flatnonzero(low)[0]])
            self._tell(batch.mishap("bed", first, numbers, float(batch.end[first, 2])))
        lost = unsupported_pieces(self._relief, batch, cut, cell, self._marks)
        length = float(cut.length[lost].sum())
        if length > MIN_REPORTED_LENGTH:
            at = lost[0]
            mishap = batch.mishap("unsupported", int(cut.move[at]), numbers, length)
            self._tell(mishap._replace(x=float(cut.x[at]), y=float(cut.y[at])))

    def _tell(self, mishap: Defect) -> None:
        """Keep a mishap, one of each kind in a layer."""
        same = next(
            (i for i in range(len(self.mishaps) - 1, -1, -1) if self.mishaps[i].kind == mishap.kind), None
        )
        if same is not None and self.mishaps[same].layer == mishap.layer:
            old = self.mishaps[same]
            more = max if mishap.kind in {"flow", "crash"} else float.__add__
            self.mishaps[same] = old._replace(
                amount=more(old.amount, mishap.amount), depth=max(old.depth, mishap.depth)
            )
            return
        self.counts[mishap.kind] = self.counts.get(mishap.kind, 0) + 1
        if len(self.mishaps) < _MOST_MISHAPS:
            self.mishaps.append(mishap)
