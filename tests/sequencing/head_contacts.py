"""An independent search for contacts of the print head with finished objects, by shapely, from the moves alone."""

from __future__ import annotations

import numpy as np
import shapely

import printer_slicer as ps
from printer_slicer.roles import Role

__all__ = ["find_contacts", "list_objects"]

_DEPTH = 0.6  # mm; contacts that are not deeper may be differences between outlines and extrusions
_STEP = 2.0  # mm, between positions of the nozzle that are tested


def list_objects(stages: ps.Stages) -> list[int]:
    """Return the objects in the order in which they are printed; each is printed in one go."""
    assert stages.labels is not None
    numbers = stages.labels.object_id[stages.labels.object_id >= 0]
    return numbers[np.append(True, np.diff(numbers) != 0)].tolist()


def find_contacts(stages: ps.Stages, printer: ps.Printer) -> int:
    """Return the number of moves at which a shape of the head is in a finished object."""
    assert stages.labels is not None
    program, owner = stages.program, stages.labels.object_id
    lays = program.role != Role.TRAVEL
    n = 0
    done: list[tuple[shapely.Geometry, float]] = []
    for number in list_objects(stages):
        own = np.flatnonzero(lays & (owner == number))
        first, last = int(own[0]), int(own[-1])
        while first > 0 and not lays[first - 1]:
            first -= 1
        n += sum(_count(program, slice(first, last + 1), one, printer) for one in done)
        done += _list_slabs(program, own)
    return n


def _list_slabs(program: ps.Program, own: np.ndarray) -> list[tuple[shapely.Geometry, float]]:
    """Return the extrusions of an object above some heights, as seen from above, and its top there."""
    z, slabs = program.xyz[own, 2], []
    for height in np.unique(np.linspace(z.min(), z.max(), 6)):
        here = own[(z >= height - 1e-6)]
        ends = np.stack([program.xyz[here - 1, :2], program.xyz[here, :2]], axis=1)
        slabs.append((shapely.union_all(shapely.linestrings(ends)), float(height)))
    return slabs


def _count(
    program: ps.Program, moves: slice, slab: tuple[shapely.Geometry, float], printer: ps.Printer
) -> int:
    """Count positions of the nozzle at which a shape of the head touches a slab."""
    begin, end = program.start[moves], program.xyz[moves]
    steps = np.maximum(np.ceil(np.hypot(*(end - begin)[:, :2].T) / _STEP), 1).astype(int)
    at = np.concatenate([np.linspace(a, b, k + 1) for a, b, k in zip(begin, end, steps, strict=True)])
    plastic, top = slab
    shapely.prepare(plastic)
    n = 0
    for shape in printer.head_shapes:
        low = at[at[:, 2] + shape.height < top - 1e-3]
        outline = shapely.Polygon(shape.corners).buffer(-_DEPTH)
        head = [
            shapely.transform(outline, lambda xy, by=by: xy + by)
            for by in np.unique(low[:, :2].round(1), axis=0)
        ]
        n += int(shapely.intersects(plastic, head).sum())
    return n
