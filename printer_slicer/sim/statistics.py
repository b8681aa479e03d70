"""Statistics of a simulated print; their size does not grow with the length of the print."""

from __future__ import annotations

import re
from hashlib import sha256
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from printer_slicer.motion.rules import Axes
    from printer_slicer.sim.machine import Position
    from printer_slicer.sim.move_log import MoveLog

from printer_slicer.deprecation import accept_former_fields

__all__ = ["MAX_LAYERS", "Report", "Statistics", "Violation", "violation_kind"]

_KIND_END: Final = re.compile(r"[:,]| \d")

MAX_VIOLATIONS: Final = 1000
MAX_LAYERS: Final = 20_000
"""Maximum length of each list; counts are not limited. A spiral vase would add a z in every line."""

HASH_BATCH: Final = 512
"""Number of lines that are hashed together; a call for each line would cost more than the hashing."""


MAX_KINDS: Final = 100


def violation_kind(text: str) -> str:
    """Return the kind of a violation: the text before the first colon, comma or number."""
    return _KIND_END.split(text, maxsplit=1)[0].strip()


class Violation(NamedTuple):
    """An action that a real printer would reject or clip, or that would harm it.

    Attributes:
        line: number of the executed command, from 1.
        text: what happened, with the command.
    """

    line: int
    text: str


@accept_former_fields(
    starvations="underruns",
    starved_seconds="underrun_seconds",
    starved="underrun_list",
    laid_min="extrusion_min",
    laid_max="extrusion_max",
)
class Report(Struct, frozen=True):
    """Summary of all commands executed so far; times are in simulated seconds.

    Attributes:
        lines: number of executed commands, with and without line number.
        digest: SHA-256 over the executed commands, each followed by a newline, without line number and
            checksum.
        unnumbered_moves: number of moves without a line number after numbered lines, probably parts of damaged lines.
        motion_seconds: total duration of all started moves; a running one counts fully.
        dwell_seconds: total duration of G4.
        homing_seconds: total duration of G28 and G29.
        heating_seconds: total duration of the waits of M109 and M190.
        underrun_list: number of the executed command and duration, s, of the first 1000 buffer underruns.
        underruns, underrun_seconds: number and total duration of the buffer underruns: standstills of up to 2 s only
            because the next move had not arrived, without a command that waits for standstill.
        filament_fed: filament fed, mm, including priming and deretraction.
        filament_retracted: filament retracted, mm.
        filament_missing: filament fed that did not come out, mm (clogged nozzle, empty spool).
        runouts: number of filament runouts.
        layers: heights z of moves in x or y that extruded, mm, to 0.0001 mm, in the order of their first extrusion.
        extrusion_min, extrusion_max: corners of the box around all such moves, mm; None if there were none.
        peak_flow: highest flow at the cruise speed of a move, mm³/s.
        peak_hotend, peak_bed: highest temperatures, °C.
        violations, n_violations: the first 1000 violations, and the total number.
        violation_counts: number of violations of each kind, see `violation_kind`.
        line_errors, resends: number of rejected lines and of resend requests.
        repeats_dropped: number of repeated lines that were dropped silently.
        bytes_lost: number of bytes lost because the receive buffer was full.
        bytes_flushed: number of bytes discarded after an error.
        resets: number of resets.
        killed: why the firmware halted; empty while it runs.
    """

    lines: int
    digest: str
    unnumbered_moves: int
    motion_seconds: float
    dwell_seconds: float
    homing_seconds: float
    heating_seconds: float
    underruns: int
    underrun_seconds: float
    underrun_list: tuple[tuple[int, float], ...]
    filament_fed: float
    filament_retracted: float
    filament_missing: float
    runouts: int
    layers: tuple[float, ...]
    extrusion_min: Position | None
    extrusion_max: Position | None
    peak_flow: float
    peak_hotend: float
    peak_bed: float
    violations: tuple[Violation, ...]
    n_violations: int
    violation_counts: Mapping[str, int]
    line_errors: int
    resends: int
    repeats_dropped: int
    bytes_lost: int
    bytes_flushed: int
    resets: int
    killed: str

    @property
    def print_seconds(self) -> float:
        """Time of motion and dwells, s, comparable to the time estimate of the program."""
        return self.motion_seconds + self.dwell_seconds

    @property
    def filament(self) -> float:
        """Filament used, mm: filament fed minus filament retracted."""
        return self.filament_fed - self.filament_retracted


class Statistics:
    """Counters from which a `Report` is made; their names and units are those of the report.

    Attributes:
        move_log: log of all moves; None: moves are not logged.
    """

    __slots__ = (
        "_batch",
        "_hash",
        "_layers",
        "_text",
        "_z",
        "bytes_flushed",
        "bytes_lost",
        "dwell_seconds",
        "filament_fed",
        "filament_missing",
        "filament_retracted",
        "heating_seconds",
        "high",
        "homing_seconds",
        "killed",
        "line_errors",
        "lines",
        "low",
        "motion_seconds",
        "move_log",
        "n_violations",
        "peak_feed",
        "repeats_dropped",
        "resends",
        "resets",
        "runouts",
        "underrun_list",
        "underrun_seconds",
        "underruns",
        "unnumbered_moves",
        "violation_counts",
        "violations",
    )

    def __init__(self, move_log: MoveLog | None = None) -> None:
        self.move_log = move_log
        self.lines = self.unnumbered_moves = 0
        self.motion_seconds = self.dwell_seconds = self.homing_seconds = self.heating_seconds = 0.0
        self.underruns = 0
        self.underrun_list: list[tuple[int, float]] = []
        self.underrun_seconds = 0.0
        self.filament_fed = self.filament_retracted = self.filament_missing = 0.0
        self.runouts = 0
        self.peak_feed = 0.0  # mm/s of filament
        self.low: list[float] = [inf, inf, inf]
        self.high: list[float] = [-inf, -inf, -inf]
        self.violations: list[Violation] = []
        self.violation_counts: dict[str, int] = {}
        self.n_violations = self.line_errors = self.resends = self.repeats_dropped = 0
        self.bytes_lost = self.bytes_flushed = self.resets = 0
        self.killed = ""
        self._hash = sha256()
        self._text = ""
        self._batch: list[str] = []
        self._layers: dict[float, None] = {}
        self._z = inf

    @property
    def n_layers(self) -> int:
        """Number of heights with extrusion."""
        return len(self._layers)

    @property
    def last_extrusion_z(self) -> float:
        """Height of the last extrusion, mm; -infinity before the first one."""
        return self._z if self._layers else -inf

    def count_command(self, text: str) -> None:
        """Count an executed command, and add it to the digest."""
        self.lines += 1
        self._text = text
        self._batch.append(text)
        if len(self._batch) >= HASH_BATCH:
            self._hash_commands()

    def count_commands(self, texts: Sequence[str]) -> None:
        """Count executed commands, and add them to the digest."""
        self.lines += len(texts)
        self._text = texts[-1]
        self._batch += texts
        self._hash_commands()

    def count_underrun(self, seconds: float, command: int) -> None:
        """Count a buffer underrun of `seconds`; a move of `command`, counted from 1, ended the underrun."""
        self.underruns += 1
        self.underrun_seconds += seconds
        if len(self.underrun_list) < MAX_VIOLATIONS:
            self.underrun_list.append((command, seconds))

    def record_violation(self, text: str) -> None:
        """Record a violation by the current command."""
        self.n_violations += 1
        kind = violation_kind(text)
        if kind in self.violation_counts or len(self.violation_counts) < MAX_KINDS:
            self.violation_counts[kind] = self.violation_counts.get(kind, 0) + 1
        if len(self.violations) < MAX_VIOLATIONS:
            self.violations.append(Violation(self.lines, f"{text}: {self._text}"))

    def add_extrusion(self, start: Axes, end: Axes) -> None:
        """Record an extrusion from `start` to `end`, x, y, z, e in mm."""
        if end[2] != self._z:
            self._z = end[2]
            if len(self._layers) < MAX_LAYERS:
                self._layers[round(end[2], 4)] = None
            self._extend_box(end)
        low, high = self.low, self.high
        for x, y, z, e in (start, end):
            # Nearly every extrusion is inside the box already; this test is faster than extending the box.
            if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
                self._extend_box((x, y, z, e))

    def add_extrusions_within(self, low: Position, high: Position, heights: Sequence[float]) -> None:
        """Record extrusions at several heights, all within the box from corner `low` to `high`, mm."""
        self._extend_box((*low, 0.0))
        self._extend_box((*high, 0.0))
        for z in heights:
            if len(self._layers) >= MAX_LAYERS:
                break
            self._layers[round(z, 4)] = None
        self._z = heights[-1]

    def _extend_box(self, position: Axes) -> None:
        """Extend the box around all extrusions to a position."""
        self.low = [min(low, at) for low, at in zip(self.low, position, strict=False)]
        self.high = [max(high, at) for high, at in zip(self.high, position, strict=False)]

    def report(self, *, filament_area: float, peak_hotend: float, peak_bed: float) -> Report:
        """Return the report; `filament_area` is in mm², peak temperatures are in °C."""
        self._hash_commands()
        empty = self.low[0] == inf
        return Report(
            digest=self._hash.hexdigest(),
            layers=tuple(self._layers),
            extrusion_min=None if empty else (self.low[0], self.low[1], self.low[2]),
            extrusion_max=None if empty else (self.high[0], self.high[1], self.high[2]),
            peak_flow=self.peak_feed * filament_area,
            peak_hotend=peak_hotend,
            peak_bed=peak_bed,
            violations=tuple(self.violations),
            violation_counts=dict(self.violation_counts),
            underrun_list=tuple(self.underrun_list),
            **{name: getattr(self, name) for name in _COUNTERS},
        )

    def _hash_commands(self) -> None:
        """Add the commands of the current batch to the digest."""
        if self._batch:
            # Encoding as Latin-1 restores the received bytes.
            self._hash.update(("\n".join(self._batch) + "\n").encode("latin-1"))
            self._batch.clear()


_COUNTERS: Final = tuple(
    name
    for name in Report.__struct_fields__
    if name in Statistics.__slots__ and name not in {"violations", "violation_counts", "underrun_list"}
)
