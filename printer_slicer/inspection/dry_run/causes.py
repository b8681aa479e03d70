"""Find which faults cause other faults, so that these consequences are not reported as well."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from printer_slicer.gcode.state import uses_inches
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.faults import code_of_violation
from printer_slicer.jobs import Job
from printer_slicer.sim.statistics import Report
from printer_slicer.values import Struct

__all__ = ["Cause", "drop_consequences", "find_causes", "is_explained", "layer_of"]

_CONSEQUENCES: Final[Mapping[str, frozenset[str]]] = {
    "cold": frozenset({"unsupported", "lack"}),
    "tool": frozenset({"unsupported", "lack", "flow", "extrusion"}),
    "arc": frozenset({"unsupported", "lack"}),
    "extrusion": frozenset({"unsupported", "flow", "lack"}),
    "clog": frozenset({"unsupported", "flow", "lack"}),
    "box": frozenset({"unsupported", "bed", "crash", "head", "flow", "lack", "extrusion"}),
    "bed": frozenset({"unsupported"}),
    "lack": frozenset({"unsupported"}),
    "crash": frozenset({"bed", "unsupported"}),
}
"""Kind of fault -> kinds of faults that may follow from it."""

_ALL_LAYERS: Final = 1 << 30  # last layer of a fault that affects all later layers
_LAYERS_AFTER: Final = 1  # layers after a fault in which consequences are possible


class Cause(Struct):
    """A fault from which other faults may follow.

    Attributes:
        kind: a key of `CODES`.
        command: index of the command, from 0.
        last: the last layer in which a consequence is possible.
    """

    kind: str
    command: int
    last: int

    def explains(self, kind: str, command: int, layer: int) -> bool:
        """Return whether a fault follows from this cause; if so, more may follow in the layer after it."""
        is_consequence = kind in _CONSEQUENCES[self.kind] and command >= self.command and layer <= self.last
        if is_consequence:
            self.last = max(self.last, layer + _LAYERS_AFTER)
        return is_consequence


def find_causes(job: Job, report: Report, comparison: Comparison, deposition: Deposition) -> list[Cause]:
    """Return a cause for each layer and kind of command that the firmware rejected or clipped."""
    inches = bool(report.violations) and uses_inches(job.commands)
    found: dict[tuple[str, int], Cause] = {}
    # Violations that the list is too short for may be in any layer.
    is_truncated = len(report.violations) < report.n_violations
    for violation in report.violations:
        kind = code_of_violation(violation.text)
        if kind in _CONSEQUENCES and comparison.is_job_command(violation.line):
            command = comparison.command_of(violation.line)
            layer = layer_of(deposition, command)
            last = _ALL_LAYERS if is_truncated or (kind == "box" and inches) else layer + _LAYERS_AFTER
            found.setdefault((kind, layer), Cause(kind, command, last))
    return list(found.values())


def drop_consequences(defects: Sequence[Defect], causes: list[Cause]) -> list[Defect]:
    """Return the defects that are not consequences of other faults."""
    remaining = []
    for one in sorted(defects, key=lambda one: one.command):
        if is_explained(causes, one.kind, one.command - 1, one.layer):
            continue
        remaining.append(one)
        if one.kind in {"bed", "crash"}:
            causes.append(Cause(one.kind, one.command - 1, one.layer + _LAYERS_AFTER))
    # A nozzle that sinks into the print brings the head so low that it touches the print, too.
    crashes = {one.layer for one in remaining if one.kind == "crash"}
    remaining = [one for one in remaining if one.kind != "head" or one.layer not in crashes]
    # With absolute E, the first extrusion after missing lines gets all the filament of the missing lines.
    unsupported_layers = {
        one.layer - layers_back for one in remaining if one.kind == "unsupported" for layers_back in (0, 1)
    }
    return [one for one in remaining if one.kind != "flow" or one.layer not in unsupported_layers]


def is_explained(causes: Iterable[Cause], kind: str, command: int, layer: int) -> bool:
    """Return whether a fault follows from any cause; update the causes from which it follows."""
    return sum(cause.explains(kind, command, layer) for cause in causes) > 0


def layer_of(deposition: Deposition, command: int) -> int:
    """Return the layer of a command, with the recorder's layer numbers; 0 before the first layer."""
    return max((one.number for one in deposition.layers if one.first <= command + 1), default=0)
