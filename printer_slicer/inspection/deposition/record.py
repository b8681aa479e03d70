"""Results of recording the extrusion of a print: layers, times, volumes, defects."""

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
    """Times, volumes and lengths of a layer.

    Attributes:
        number: see `Marks.layer`.
        first: the first command of the layer.
        z: mm, the height of most of its extrusion so far.
        seconds: s, total time of its moves.
        volume: mm³ extruded while moving.
        peak_flow: highest flow, mm³/s.
        length: mm of extrusion.
        empty: mm on which filament was fed but none came out, because it was still retracted.
        back: mm travelled while filament was retracted.
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
    """A part of the print in which the nozzle climbs layer by layer, or filament is fed, but nothing is extruded.

    Attributes:
        command, last: the first and the last command.
        shows: the command that proves it; 0 before that.
        length: mm travelled in x and y.
        low, high: mm, range of heights.
        pushed, back: mm of the length on which filament is fed in vain, and retracted.
        wrong: the first command that feeds filament in vain; 0 if there is none.
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
    """The extrusion of a whole print. Times in s.

    Attributes:
        layers: in the order in which they were started.
        by_role: extrusion time by role name.
        travel, extruder: time of travel moves, and of moves of the extruder alone.
        volume: mm³ extruded while moving.
        standing: mm³ extruded while standing.
        length: mm of beads.
        speed: mm/s, median over the extruded length.
        peak: the highest flow, as a defect; None without extrusion.
        defects: the worst of each kind in each layer, in order.
        counts: number of layers with each kind of defect.
        first_extrusion: the first command that extrudes; None if none does.
        first_missing: the first command with filament that did not come out of the nozzle; None if there is none.
        missing_extrusion: the first long part of the print without extrusion; None if there is none.
        plate: heights on the plate at the end.
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
