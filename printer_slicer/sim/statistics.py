"""Statistics of a simulated print, in memory that does not grow with its length."""

from __future__ import annotations

import re
from dataclasses import dataclass
from hashlib import sha256
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from printer_slicer.motion.rules import Axes
    from printer_slicer.sim.machine import Position
    from printer_slicer.sim.move_log import MoveLog

__all__ = ["MOST_LAYERS", "Report", "Statistics", "Violation", "kind_of"]

_KIND: Final = re.compile(r"[:,]| \d")

MOST_VIOLATIONS: Final = 1000
MOST_LAYERS: Final = 20_000
"""Lengths of lists are bounded, counts are not. A spiral vase has a new z in every line."""

BATCH: Final = 512
"""Lines hashed together: one call per line would cost more than the hashing."""


MOST_KINDS: Final = 100


def kind_of(what: str) -> str:
    """Return the kind of a violation: its text before the first colon, comma or number."""
    return _KIND.split(what, maxsplit=1)[0].strip()


class Violation(NamedTuple):
    """Something that a real printer would reject, clip or suffer from.

    Attributes:
        line: number of the executed command, from 1.
        text: what happened, with the command.
    """

    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Report:
    """Summary of everything executed so far. Times are simulated seconds.

    Attributes:
        lines: executed commands, numbered on the wire or not.
        digest: SHA-256 over the executed commands, each followed by a newline, without line number and
            checksum.
        unnumbered_moves: moves without a line number after numbered lines: likely remains of a damaged line.
        motion_seconds: total duration of all started moves; a running one counts fully.
        dwell_seconds: total of G4.
        homing_seconds: total of G28 and G29.
        heating_seconds: total of M109 and M190.
        underrun_list: executed command -> s, the first 1000 times of that.
        underruns, underrun_seconds: how often and how long the machine stood still only because the next
            move had not come (up to 2 s each; after a command that waits for standstill it does not count).
        filament_fed: mm fed, including priming and deretraction.
        filament_retracted: mm retracted.
        filament_missing: mm of the filament fed that did not come out (clogged nozzle, empty spool).
        runouts: number of filament runouts.
        layers: z (mm, to 0.0001) at which plastic was laid while moving in x or y, in order of the first
            time.
        extrusion_min, extrusion_max: corners of the box around all such moves, mm; None when there were none.
        peak_flow: highest flow at the cruise speed of a move, mm³/s.
        peak_hotend, peak_bed: °C.
        violations, n_violations: the first 1000, and their total number.
        violation_counts: number by kind, see `kind_of`.
        line_errors, resends: rejected lines, and resend requests.
        repeats_dropped: repeated lines that were dropped silently.
        bytes_lost: bytes that found the receive buffer full.
        bytes_flushed: bytes discarded after an error.
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
        """Time of motion and dwells, comparable to the time estimate of the program."""
        return self.motion_seconds + self.dwell_seconds

    @property
    def filament(self) -> float:
        """Filament used, mm: fed less retracted."""
        return self.filament_fed - self.filament_retracted


class Statistics:
    """The counters behind a `Report`, with the same names and units.

    Attributes:
        move_log: is told every move; None if nobody wants to know.
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
    def z(self) -> float:
        """The last height with extrusion, mm; -infinity before the first."""
        return self._z if self._layers else -inf

    def executed(self, text: str) -> None:
        """Count an executed command."""
        self.lines += 1
        self._text = text
        self._batch.append(text)
        if len(self._batch) >= BATCH:
            self._flush()

    def executed_many(self, texts: Sequence[str]) -> None:
        """Count many executed commands."""
        self.lines += len(texts)
        self._text = texts[-1]
        self._batch += texts
        self._flush()

    def waited(self, seconds: float, command: int) -> None:
        """Count a buffer underrun that ended with the move of a command, numbered from 1."""
        self.underruns += 1
        self.underrun_seconds += seconds
        if len(self.underrun_list) < MOST_VIOLATIONS:
            self.underrun_list.append((command, seconds))

    def record_violation(self, what: str) -> None:
        """Record a violation by the current command."""
        self.n_violations += 1
        kind = kind_of(what)
        if kind in self.violation_counts or len(self.violation_counts) < MOST_KINDS:
            self.violation_counts[kind] = self.violation_counts.get(kind, 0) + 1
        if len(self.violations) < MOST_VIOLATIONS:
            self.violations.append(Violation(self.lines, f"{what}: {self._text}"))

    def add_extrusion(self, start: Axes, end: Axes) -> None:
        """Record an extrusion from `start` to `end`, mm."""
        if end[2] != self._z:
            self._z = end[2]
            if len(self._layers) < MOST_LAYERS:
                self._layers[round(end[2], 4)] = None
            self._grow(end)
        low, high = self.low, self.high
        for x, y, z, e in (start, end):
            # Nearly every extrusion is inside the box already; this test is cheaper than growing it.
            if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
                self._grow((x, y, z, e))

    def add_extrusions_within(self, low: Position, high: Position, heights: Sequence[float]) -> None:
        """Record extrusions at several heights, all within a box, mm."""
        self._grow((*low, 0.0))
        self._grow((*high, 0.0))
        for z in heights:
            if len(self._layers) >= MOST_LAYERS:
                break
            self._layers[round(z, 4)] = None
        self._z = heights[-1]

    def _grow(self, place: Axes) -> None:
        """Grow the box around all extrusions to include a place."""
        self.low = [min(low, at) for low, at in zip(self.low, place, strict=False)]
        self.high = [max(high, at) for high, at in zip(self.high, place, strict=False)]

    def report(self, *, filament_area: float, peak_hotend: float, peak_bed: float) -> Report:
        """Return the current counters; `filament_area` in mm², peak temperatures in °C."""
        self._flush()
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

    def _flush(self) -> None:
        if self._batch:
            # Latin-1 restores the received bytes.
            self._hash.update(("\n".join(self._batch) + "\n").encode("latin-1"))
            self._batch.clear()


_COUNTERS: Final = tuple(
    name
    for name in Report.__dataclass_fields__
    if name in Statistics.__slots__ and name not in {"violations", "violation_counts", "underrun_list"}
)
