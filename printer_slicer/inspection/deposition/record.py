"""What became of the material of a print as a printer executed it: layers, times, volumes, mishaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from printer_slicer.inspection.deposition.height_map import PlateHeights
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.timeline import Timeline

__all__ = ["Deposition", "LayerDeposition", "MissingExtrusion"]


@dataclass(slots=True)
class LayerDeposition:
    """What was done in a layer.

    Attributes:
        number: see `Marks.layer`.
        first: its first command.
        z: mm, the height of most of its beads so far.
        seconds: of all its moves.
        volume: mm³ laid while moving.
        peak_flow: mm³/s.
        length: mm of beads.
        empty: mm that the nozzle went and filament was pushed, but none came out: it had been pulled back farther.
        back: mm that it went while filament was pulled back.
        wrong: the first command of what is `empty`; None without any.
        middle, thick: mm², cross-sections of beads that half of the length at height z exceeds, and a twentieth.
    """

    number: int
    first: int
    z: float = 0.0
    seconds: float = 0.0
    volume: float = 0.0
    peak_flow: float = 0.0
    length: float = 0.0
    empty: float = 0.0
    back: float = 0.0
    wrong: int | None = None
    middle: float = 0.0
    thick: float = 0.0
    _longest: float = 0.0


class MissingExtrusion(NamedTuple):
    """A stretch in which the nozzle climbs layer by layer, or filament is pushed, but nothing is laid.

    Attributes:
        command, last: its first and its last.
        shows: the command by which there was no doubt; 0 before that.
        length: mm gone in the plane.
        low, high: mm, the heights gone through.
        pushed, back: mm of the length on which filament is pushed, in vain, and pulled back.
        wrong: the first command that pushes in vain; 0 without any.
    """

    command: int
    last: int
    shows: int
    length: float
    low: float
    high: float
    pushed: float = 0.0
    back: float = 0.0
    wrong: int = 0


@dataclass(frozen=True, slots=True)
class Deposition:
    """What the material came to. Times in s.

    Attributes:
        layers: in the order in which they were begun.
        by_role: seconds of laying, by the names of beads.
        travel, extruder: seconds of moves without filament, and of the extruder alone.
        volume: mm³ laid while moving.
        standing: mm³ that came out while standing.
        length: mm of beads.
        speed: mm/s, that half of all length is laid slower than.
        peak: the highest flow, as a mishap tells it; None without any.
        defects: the worst of each kind in each layer, in order.
        counts: how many layers have each kind of them.
        first_extrusion: the first command that lays; None if none does.
        first_missing: the first command of whose filament some did not come out; None if there is none.
        missing_extrusion: the first long stretch in which the print goes on but nothing is laid; None without.
        plate: what stands on it at the end.
        timeline: speed over the time in motion.
    """

    layers: Sequence[LayerDeposition]
    by_role: Mapping[str, float]
    travel: float
    extruder: float
    volume: float
    standing: float
    length: float
    speed: float
    peak: Defect | None
    defects: Sequence[Defect]
    counts: Mapping[str, int]
    first_extrusion: int | None
    first_missing: int | None
    missing_extrusion: MissingExtrusion | None
    plate: PlateHeights = field(compare=False)
    timeline: Timeline = field(compare=False)
