"""The recorded extrusion of a print: layers, times, volumes and defects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from printer_slicer.deprecation import accept_former_fields
from printer_slicer.inspection.deposition.height_map import PlateHeights
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.timeline import Timeline
from printer_slicer.values import Struct

__all__ = ["Deposition", "LayerDeposition", "MissingExtrusion"]


@accept_former_fields(
    empty="empty_length",
    back="retracted_length",
    wrong="first_empty",
    middle="median_section",
    thick="thick_section",
)
class LayerDeposition(Struct):
    """Times, volumes and lengths of the moves of a layer.

    Attributes:
        number: see `Marks.layer_at`.
        first: the first command of the layer.
        z: mm, the height of most of its extrusion so far.
        seconds: s, total time of its moves.
        volume: mm³ extruded while moving.
        peak_flow: highest flow, mm³/s.
        length: mm of extrusion.
        empty_length: mm moved while filament was fed but did not come out, because it was still retracted.
        retracted_length: mm moved while filament was retracted.
        first_empty: the first command that feeds filament without extruding; None if there is none.
        median_section, thick_section: mm², cross-sections that half and a twentieth of the length at height z exceed.
    """

    number: int
    first: int
    z: float = 0.0
    seconds: float = 0.0
    volume: float = 0.0
    peak_flow: float = 0.0
    length: float = 0.0
    empty_length: float = 0.0
    retracted_length: float = 0.0
    first_empty: int | None = None
    median_section: float = 0.0
    thick_section: float = 0.0
    _longest: float = 0.0


class MissingExtrusion(NamedTuple):
    """A range of commands in which the nozzle climbs by layers, or filament is fed, without extrusion.

    Attributes:
        command, last: the first and the last command.
        proven_at: the command at which it became certain; 0 before that.
        length: mm moved in x and y.
        low, high: mm, range of heights.
        empty_length, retracted_length: mm of the length on which filament is fed in vain, or retracted.
        first_empty: the first command that feeds filament in vain; 0 if there is none.
    """

    command: int
    last: int
    proven_at: int
    length: float
    low: float
    high: float
    empty_length: float = 0.0
    retracted_length: float = 0.0
    first_empty: int = 0


@accept_former_fields(
    mishaps="defects", laid="first_extrusion", lost="first_missing", drought="missing_extrusion"
)
class Deposition(Struct, frozen=True, eq=False):
    """The recorded extrusion of a whole print; all times are in s.

    Attributes:
        layers: in the order in which they were started.
        by_role: extrusion time by role name.
        travel, extruder: time of travel moves, and of moves of only the extruder.
        volume: mm³ extruded while moving.
        standing: mm³ extruded while standing.
        length: mm, total length of the extrusions.
        speed: mm/s, median over the extruded length.
        peak: the highest flow, as a defect; None without extrusion.
        defects: one defect of each kind per layer, in order.
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
    plate: PlateHeights
    timeline: Timeline

    def __eq__(self, other: object) -> bool:
        """Compare all attributes except the arrays that are only for pictures."""
        names = [name for name in self.__struct_fields__ if name not in {"plate", "timeline"}]
        return isinstance(other, Deposition) and all(
            getattr(self, one) == getattr(other, one) for one in names
        )

    def __hash__(self) -> int:
        return hash((self.volume, self.length, self.travel))
