"""What a simulated print did: counted while it happens, in memory that does not grow with its length."""

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
    from printer_slicer.sim.track import Track

__all__ = ["MOST_LAYERS", "Report", "Tally", "Violation", "kind_of"]

_KIND: Final = re.compile(r"[:,]| \d")

MOST_VIOLATIONS: Final = 1000
MOST_LAYERS: Final = 20_000
"""Lists end here so that memory stays bounded; counts go on. A spiral vase has a new z in every line."""

BATCH: Final = 512
"""Texts hashed together: one call of the hash per line would cost more than the hashing."""


MOST_KINDS: Final = 100


def kind_of(what: str) -> str:
    """What a violation says in front of its first colon, comma or number."""
    return _KIND.split(what, maxsplit=1)[0].strip()


class Violation(NamedTuple):
    """Something a real machine would have refused, clipped or suffered.

    Attributes:
        line: which executed command it was, counted from 1.
        text: what happened, with the command.
    """

    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Report:
    """What was executed so far. Times are simulated seconds.

    Attributes:
        lines: executed commands, numbered on the wire or not.
        digest: SHA-256 over the executed commands, each followed by a newline, without line number and
            checksum.
        unnumbered_moves: moves executed from lines without a number after numbered lines had come: what is
            left of a line whose beginning was lost looks like that.
        motion_seconds: sum of the durations of all moves that were begun; a running one counts whole.
        dwell_seconds: asked for with G4.
        homing_seconds: in G28 and G29.
        heating_seconds: in M109 and M190.
        starved: executed command -> s, the first 1000 times of that.
        starvations, starved_seconds: how often and how long the machine stood still only because the next
            move had not come (up to 2 s each; after a command that waits for standstill it does not count).
        filament_fed: mm pushed forward, prime and deretraction included.
        filament_retracted: mm pulled back.
        filament_missing: mm of the filament fed that did not come out: the nozzle was clogged, the spool empty.
        runouts: how often the filament ended.
        layers: z (mm, to 0.0001) at which plastic was laid while moving in x or y, in order of the first
            time.
        laid_min, laid_max: corners of the box around all such moves, mm; None when there were none.
        peak_flow: mm³/s, the highest at the cruise speed of a move.
        peak_hotend, peak_bed: °C.
        violations, n_violations: the first 1000, and how many there were.
        violation_counts: the same by what they say in front of the first colon or number.
        line_errors, resends: lines refused, and answered with a resend.
        repeats_dropped: repeated lines that were dropped without an answer.
        bytes_lost: bytes that found the receive buffer full.
        bytes_flushed: bytes thrown away after an error.
        resets: how often the printer started again.
        killed: why the firmware halted; empty while it lives.
    """

    lines: int
    digest: str
    unnumbered_moves: int
    motion_seconds: float
    dwell_seconds: float
    homing_seconds: float
    heating_seconds: float
    starvations: int
    starved_seconds: float
    starved: tuple[tuple[int, float], ...]
    filament_fed: float
    filament_retracted: float
    filament_missing: float
    runouts: int
    layers: tuple[float, ...]
    laid_min: Position | None
    laid_max: Position | None
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
        """Time spent moving and dwelling: what a time estimate of the program should give."""
        return self.motion_seconds + self.dwell_seconds

    @property
    def filament(self) -> float:
        """Filament used, mm: fed less retracted."""
        return self.filament_fed - self.filament_retracted


class Tally:
    """The counters behind a `Report`; same names, same units.

    Attributes:
        track: is told every move; None if nobody wants to know.
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
        "n_violations",
        "peak_feed",
        "repeats_dropped",
        "resends",
        "resets",
        "runouts",
        "starvations",
        "starved",
        "starved_seconds",
        "track",
        "unnumbered_moves",
        "violation_counts",
        "violations",
    )

    def __init__(self, track: Track | None = None) -> None:
        self.track = track
        self.lines = self.unnumbered_moves = 0
        self.motion_seconds = self.dwell_seconds = self.homing_seconds = self.heating_seconds = 0.0
        self.starvations = 0
        self.starved: list[tuple[int, float]] = []
        self.starved_seconds = 0.0
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
        """At how many heights plastic was laid."""
        return len(self._layers)

    @property
    def z(self) -> float:
        """The last of them, mm; below everything before the first."""
        return self._z if self._layers else -inf

    def executed(self, text: str) -> None:
        """One more command."""
        self.lines += 1
        self._text = text
        self._batch.append(text)
        if len(self._batch) >= BATCH:
            self._flush()

    def executed_all(self, texts: Sequence[str]) -> None:
        """Many more commands."""
        self.lines += len(texts)
        self._text = texts[-1]
        self._batch += texts
        self._flush()

    def waited(self, seconds: float, command: int) -> None:
        """The machine stood still for so long only because the move of a command, counted from 1, had not come."""
        self.starvations += 1
        self.starved_seconds += seconds
        if len(self.starved) < MOST_VIOLATIONS:
            self.starved.append((command, seconds))

    def violated(self, what: str) -> None:
        """The command being executed did `what`, which it should not."""
        self.n_violations += 1
        kind = kind_of(what)
        if kind in self.violation_counts or len(self.violation_counts) < MOST_KINDS:
            self.violation_counts[kind] = self.violation_counts.get(kind, 0) + 1
        if len(self.violations) < MOST_VIOLATIONS:
            self.violations.append(Violation(self.lines, f"{what}: {self._text}"))

    def laid(self, start: Axes, end: Axes) -> None:
        """Plastic was laid from one place to another, mm."""
        if end[2] != self._z:
            self._z = end[2]
            if len(self._layers) < MOST_LAYERS:
                self._layers[round(end[2], 4)] = None
            self._grow(end)
        low, high = self.low, self.high
        for x, y, z, e in (start, end):
            # Nearly every bead lies inside the box, and this question is cheaper than growing it.
            if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
                self._grow((x, y, z, e))

    def laid_within(self, low: Position, high: Position, heights: Sequence[float]) -> None:
        """Plastic was laid at some heights, all of it within a box, mm."""
        self._grow((*low, 0.0))
        self._grow((*high, 0.0))
        for z in heights:
            if len(self._layers) >= MOST_LAYERS:
                break
            self._layers[round(z, 4)] = None
        self._z = heights[-1]

    def _grow(self, place: Axes) -> None:
        """Make the box around everything laid hold `place`."""
        self.low = [min(low, at) for low, at in zip(self.low, place, strict=False)]
        self.high = [max(high, at) for high, at in zip(self.high, place, strict=False)]

    def report(self, *, filament_area: float, peak_hotend: float, peak_bed: float) -> Report:
        """The counters as they stand; cross-section of the filament in mm², peaks of the heaters in °C."""
        self._flush()
        empty = self.low[0] == inf
        return Report(
            digest=self._hash.hexdigest(),
            layers=tuple(self._layers),
            laid_min=None if empty else (self.low[0], self.low[1], self.low[2]),
            laid_max=None if empty else (self.high[0], self.high[1], self.high[2]),
            peak_flow=self.peak_feed * filament_area,
            peak_hotend=peak_hotend,
            peak_bed=peak_bed,
            violations=tuple(self.violations),
            violation_counts=dict(self.violation_counts),
            starved=tuple(self.starved),
            **{name: getattr(self, name) for name in _COUNTERS},
        )

    def _flush(self) -> None:
        if self._batch:
            # Latin-1 turns the text back into the bytes that came.
            self._hash.update(("\n".join(self._batch) + "\n").encode("latin-1"))
            self._batch.clear()


_COUNTERS: Final = tuple(
    name
    for name in Report.__dataclass_fields__
    if name in Tally.__slots__ and name not in {"violations", "violation_counts", "starved"}
)
