"""Find defects of the extrusion, height by height, with a height map of everything printed before.

defect              condition
head                a shape of the print head touches the print, see `deposition.head_contacts`
unsupported         extrusion with nothing below it, see `deposition.unsupported`
collision           the nozzle, extruding or not, is more than 0.12 mm below the print in its path
on the bed          extrusion less than 0.04 mm above the bed
flow                more volume per second than the material allows
pressed             plastic of the same layer under the nozzle, see `deposition.nozzle_contacts`
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.inspection.deposition.head_contacts import HeadContactFinder
from printer_slicer.inspection.deposition.height_map import (
    NEGLIGIBLE,
    HeightMap,
    MoveBatch,
    MovePieces,
    split_moves,
)
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.inspection.deposition.nozzle_contacts import NozzleContactFinder
from printer_slicer.inspection.deposition.unsupported import (
    MIN_REPORTED_LENGTH,
    add_to_height_map,
    find_unsupported_pieces,
)

__all__ = ["COLLISION_DEPTH", "DefectFinder"]

COLLISION_DEPTH: Final = 0.12
"""A nozzle that moves deeper than this below the top of the print collides with it, mm."""

_PLUNGE_DEPTH: Final = 0.5  # mm; moving straight down this far into the print, or beside it, is a collision
_MIN_BED_CLEARANCE: Final = 0.04  # mm; least distance between an extruding nozzle and the bed
_FLOW_TOLERANCE: Final = 1.01  # factor on the highest flow
_MAX_DEFECTS: Final = 200


class DefectFinder:
    """Finds the defects of a print from batches of moves, each at one height.

    Args:
        height_map: everything printed so far; checked moves are added to it.
        max_flow: highest flow of the material, mm³/s.
        marks: layers and roles from the comments.
        head: finds contacts of the print head; None: its shape is unknown.
        nozzle: finds plastic under the nozzle; None: none is searched for.

    Attributes:
        defects: one defect of each kind per layer, in order; the first 200.
        counts: number of layers with each kind of defect.
        peak: the highest flow; None without extrusion.
    """

    def __init__(
        self,
        height_map: HeightMap,
        max_flow: float,
        marks: Marks,
        head: HeadContactFinder | None = None,
        nozzle: NozzleContactFinder | None = None,
    ) -> None:
        self._height_map, self._max_flow, self._marks, self._head = height_map, max_flow, marks, head
        self._nozzle = nozzle
        self.defects: list[Defect] = []
        self.counts: dict[str, int] = {}
        self.peak: Defect | None = None

    def check(self, batch: MoveBatch, layers: Int) -> None:
        """Check moves of one height; `layers` (n,) are their layer numbers."""
        self._check_flow(batch, layers)
        self._find_head_contacts(batch, layers)
        pieces = split_moves(batch.start, batch.end)
        cell = self._height_map.cells(pieces)
        self._find_collisions(batch, pieces, cell, layers)
        extruding = np.flatnonzero(batch.extrudes[pieces.move])
        if len(extruding):
            extruding_pieces = pieces.take(extruding)
            self._find_unsupported(batch, extruding_pieces, cell[extruding], layers)
            if self._nozzle is not None and (found := self._nozzle.check(batch, extruding_pieces, layers)):
                self._record(found)
            add_to_height_map(self._height_map, batch, extruding_pieces, cell[extruding], self._marks)

    def _check_flow(self, batch: MoveBatch, layers: Int) -> None:
        """Record the highest flow so far, and defects where the flow exceeds the maximum of the material."""
        if not len(batch.flow):
            return
        index = int(batch.flow.argmax())
        flow = float(batch.flow[index])
        if flow <= 0:
            return
        defect = batch.make_defect("flow", index, layers, flow)
        if self.peak is None or flow > self.peak.amount:
            self.peak = defect
        if flow > self._max_flow * _FLOW_TOLERANCE:
            first = int(np.flatnonzero(batch.flow > self._max_flow * _FLOW_TOLERANCE)[0])
            self._record(batch.make_defect("flow", first, layers, flow))

    def _find_head_contacts(self, batch: MoveBatch, layers: Int) -> None:
        """Find contacts of the print head with the print."""
        if self._head is None:
            return
        moves = batch.start, batch.end, batch.extrudes
        for contact in self._head.check(moves, lambda _: None, lambda: self._height_map):
            defect = batch.make_defect("head", int(contact.moves[0]), layers, contact.height)
            self._record(defect._replace(x=contact.x, y=contact.y, z=contact.z, depth=contact.depth))

    def _find_collisions(self, batch: MoveBatch, pieces: MovePieces, cell: Int, layers: Int) -> None:
        """Find collisions of the nozzle with the print."""
        depth = self._height_map.depth_below_print(cell, pieces.z)
        upright = pieces.length <= NEGLIGIBLE
        sinks = (batch.end[:, 2] < batch.start[:, 2] - NEGLIGIBLE)[pieces.move]
        deep = np.flatnonzero((pieces.z < self._height_map.highest - _PLUNGE_DEPTH) & (~upright | sinks))
        if len(deep):  # a nozzle gets wider upwards, so deep in the print it touches the neighbouring cells
            around = self._height_map.max_depth_below_print_around(cell[deep], pieces.z[deep])
            depth[deep] = np.where(around > _PLUNGE_DEPTH, around, depth[deep])
        hit = np.flatnonzero(
            (~upright & (depth > COLLISION_DEPTH)) | (upright & sinks & (depth > _PLUNGE_DEPTH))
        )
        if not len(hit):
            return
        length = float(pieces.length[hit].sum())
        if length < MIN_REPORTED_LENGTH and not upright[hit].any():
            return
        worst = float(depth[hit].max())
        self._record(
            batch.make_defect("crash", int(pieces.move[hit[0]]), layers, length)._replace(depth=worst)
        )

    def _find_unsupported(self, batch: MoveBatch, pieces: MovePieces, cell: Int, layers: Int) -> None:
        """Find unsupported extrusion."""
        low = batch.end[pieces.move, 2] < _MIN_BED_CLEARANCE
        if float(pieces.length[low].sum()) > MIN_REPORTED_LENGTH:
            first = int(pieces.move[np.flatnonzero(low)[0]])
            self._record(batch.make_defect("bed", first, layers, float(batch.end[first, 2])))
        unsupported = find_unsupported_pieces(self._height_map, batch, pieces, cell, self._marks)
        length = float(pieces.length[unsupported].sum())
        if length > MIN_REPORTED_LENGTH:
            piece = unsupported[0]
            defect = batch.make_defect("unsupported", int(pieces.move[piece]), layers, length)
            self._record(defect._replace(x=float(pieces.x[piece]), y=float(pieces.y[piece])))

    def _record(self, defect: Defect) -> None:
        """Record a defect; merge it with an earlier defect of its kind in its layer."""
        previous = next(
            (i for i in range(len(self.defects) - 1, -1, -1) if self.defects[i].kind == defect.kind), None
        )
        if previous is not None and self.defects[previous].layer == defect.layer:
            old = self.defects[previous]
            merge = max if defect.kind in {"flow", "crash", "head", "pressed"} else float.__add__
            self.defects[previous] = old._replace(
                amount=merge(old.amount, defect.amount), depth=max(old.depth, defect.depth)
            )
            return
        self.counts[defect.kind] = self.counts.get(defect.kind, 0) + 1
        if len(self.defects) < _MAX_DEFECTS:
            self.defects.append(defect)
