"""Run one print over a bad cable on a simulated clock, and judge it; the reliability matrix consists of such prints.

Faults of the cable are functions of the bytes on their way. They are drawn from the seed, so a trial can be repeated.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from math import cos, sin
from random import Random  # noqa: TID251 - seeded

from printer_slicer.motion.rules import MotionLimits
from printer_slicer.sim.firmwares import SimulatedFirmware
from printer_slicer.sim.link import Direction, VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Finished, Halted, Probe, ResendRequested
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

__all__ = ["QUICK", "Fault", "Setup", "Trial", "count_queries", "job_of", "print_over"]

Fault = Callable[[bytes, Direction], bytes]

QUICK = Machine(
    limits=MotionLimits(
        max_speed=(1000.0, 1000.0, 50.0, 500.0),
        max_acceleration=(1e5, 1e5, 1e4, 1e5),
        acceleration=1e5,
        travel_acceleration=1e5,
        retract_acceleration=1e5,
        corner="junction_deviation",
        junction_deviation=0.1,
        jerk=(10.0, 10.0, 0.4, 5.0),
        square_corner_velocity=5.0,
    ),
    coldest_extrusion=0.0,
    probe_points=9,
)
"""A machine so fast that only the cable limits the rate of lines."""

_OURS = {"M105", "M110", "M115", "M400", "M114"}
"""Commands that the host sends on its own; the jobs here do not contain them."""

_FLIPPED = 4  # largest number of changed letters in one line
_COMMAND = re.compile(r"[GMT]\d")
_LONGEST = 5000.0
"""Simulated time, s, after which a print is assumed to go on for ever."""

_MEASURED_FROM = 50
"""Number of accepted entries of the job at which the measurement of the rate starts."""


class NeverEndsError(Exception):
    """The print goes on for ever."""


@dataclass(frozen=True, slots=True)
class Setup:
    """Everything that defines a trial, besides its seed.

    Attributes:
        firmware: firmware of the printer.
        job: commands of the job.
        fault: the fault of the cable.
        on_event: called with the trial and each event of the host.
        before_send: called with the trial before the host sends; unlike `on_event`, also when nothing happens.
        machine: machine of the printer.
        baud, latency: baud rate and latency (s) of the cable.
        told_baud: baud rate that the host assumes; None if it has no meaning.
        limits: whether the host knows the limits of the machine.
        longest_wait: time, s, after which the caller wakes the host at the latest.
    """

    firmware: SimulatedFirmware
    job: Sequence[bytes]
    fault: Fault | None = None
    on_event: Callable[[Trial, Event], None] = lambda _trial, _event: None
    before_send: Callable[[Trial], None] = lambda _trial: None
    machine: Machine = QUICK
    baud: int | None = 115_200
    latency: float = 0.001
    assumed_baud: int | None = None
    limits: bool = True
    longest_wait: float = 60.0


@dataclass
class Trial:
    """One print and its result.

    Attributes:
        executed: every command that the printer started.
        events: all events of the host.
        spoken: bytes written to the printer, and the time, s, by number of acknowledged entries.
        moments: times that a fault or a user recorded, by name, s.
    """

    setup: Setup
    executed: list[str] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    moments: dict[str, float] = field(default_factory=dict)
    most_in_flight: int = 0
    written: int = 0
    _from: tuple[float, int] | None = None
    _to: tuple[float, int] = (0.0, 0)

    def __post_init__(self) -> None:
        setup = self.setup
        self.printer = SimulatedPrinter(setup.machine, setup.firmware, on_executed=self.executed.append)
        self.port = VirtualPort(self.printer, baud=setup.baud, latency=setup.latency, noise=self._damage)
        limits = setup.machine.limits if setup.limits else None
        self.streamer = Streamer(setup.job, limits=limits, baud=setup.assumed_baud)

    def run(self) -> Trial:
        """Print to the end, whatever it is."""
        with suppress(NeverEndsError):
            self.print_over_port(self.setup.longest_wait)
        return self

    def print_over_port(self, longest_wait: float) -> None:
        """Print over `port`, and wake the host after `longest_wait` seconds at the latest."""
        run(
            self.streamer,
            self.port,
            self.port.now,
            on_event=self._note,
            before_send=lambda _: self.setup.before_send(self),
            longest_wait=longest_wait,
        )

    def _damage(self, data: bytes, way: Direction) -> bytes:
        if self.port.now() > _LONGEST:
            raise NeverEndsError
        if way == "to printer":
            self.written += len(data)
        return self.setup.fault(data, way) if self.setup.fault else data

    def _note(self, event: Event) -> None:
        self.events.append(event)
        done, now = self.streamer.acknowledged, self.port.now()
        if self._from is None and done >= min(_MEASURED_FROM, len(self.setup.job)):
            self._from = (now, self.written)
        if done < len(self.setup.job) - _MEASURED_FROM:
            self._to = (now, self.written)
        self.setup.on_event(self, event)

    @property
    def end(self) -> Event:
        """The last event."""
        return self.events[-1]

    @property
    def job_lines(self) -> list[str]:
        """Return the executed commands without the host's own; where repeats are allowed by design, without repeats."""
        lines = [line for line in self._not_of_the_host if _COMMAND.match(line)]
        if self.setup.firmware.accepted_lines == "next":
            return lines
        # Without line numbers, a command may be repeated if this has no effect; an extruding move never is.
        return [
            line
            for i, line in enumerate(lines)
            if i == 0 or line != lines[i - 1] or (line.startswith("G1 ") and " E" in line)
        ]

    @property
    def _not_of_the_host(self) -> list[str]:
        """Return the executed commands, damaged or not, without the host's own queries."""
        return [line for line in self.executed if line[:4] not in _OURS]

    @property
    def wanted(self) -> list[str]:
        """The commands of the job."""
        return [line.decode() for line in self.setup.job]

    def count(self, *kinds: type) -> int:
        """Count events of these kinds."""
        return sum(isinstance(event, kinds) for event in self.events)

    @property
    def rate(self) -> float:
        """Return the share of the wire's speed at which lines went out, in the middle of the job."""
        if self._from is None:
            return 0.0
        seconds, size = self._to[0] - self._from[0], self._to[1] - self._from[1]
        return size * 10 / (self.setup.baud or 1) / seconds if seconds > 0 else 0.0

    def verdict(self) -> str:
        """Return `exact`, `altered` (by damage that the checksum cannot detect), `stopped: why`, or `WRONG: ...`."""
        lines, wanted = self.job_lines, self.wanted
        strays = self.printer.report().unnumbered_moves
        if isinstance(self.end, Halted):
            done = self.end.acknowledged
            queued = self.setup.firmware.queue_places + 1 if self.setup.firmware.ok_when_read else 0
            if not done - queued <= len(lines) <= len(wanted) + strays:
                return f"WRONG: {len(lines)} lines were executed, {done} acknowledged"
            if strays == 0 and _count_changed_lines(lines, wanted[: len(lines)]) is None:
                return "WRONG: stopped, and before that lines were lost, repeated or out of order"
            return f"stopped: {self.end.reason}"
        if not isinstance(self.end, Finished) or self.end.acknowledged != len(wanted):
            return f"WRONG: ended with {self.end}"
        seen = self._not_of_the_host if self.setup.firmware.accepted_lines == "next" else lines
        different = 0 if lines == wanted else _count_changed_lines(seen, wanted)
        if strays or different is None:
            return f"WRONG: {strays} unexpected lines, {len(lines)} of {len(wanted)} lines"
        return "altered" if different else "exact"


def _count_changed_lines(lines: Sequence[str], wanted: Sequence[str]) -> int | None:
    """Return how many of the wanted lines were executed with a few letters changed; None if one was lost or repeated.

    A line that damage has turned into an unknown command is harmless unless it replaces a wanted one. In this case, the
    checksum hid the damage, or the line lost its number and was requested again.
    """
    changed = 0
    for tag, first, last, begin, end in SequenceMatcher(None, wanted, lines, autojunk=False).get_opcodes():
        if tag == "equal":
            continue
        missing = list(wanted[first:last])
        for line in lines[begin:end]:
            if missing and _is_similar(line, missing[0]):
                missing.pop(0)
                changed += 1
            elif _COMMAND.match(line):
                return None
        if missing:
            return None
    return changed


def _is_similar(a: str, b: str) -> bool:
    """Return whether one line equals the other apart from a few changed or lost letters."""
    # RepRapFirmware reads a line with a damaged star as a line without checksum, including the digits after it. If a
    # letter became a star or a semicolon, it reads the line up to there.
    if len(a) <= len(b) and sum(one != other for one, other in zip(a, b, strict=False)) <= _FLIPPED:
        return True
    same = sum(block.size for block in SequenceMatcher(None, a, b, autojunk=False).get_matching_blocks())
    return max(len(a), len(b)) - same <= 10


def job_of(chance: Random, lines: int) -> list[bytes]:
    """Return short moves, all different, with relative E as slicers write it, and a setting now and then."""
    job = [b"G28", b"G90", b"M83", b"G92 E0", b"G1 X100 Y100 Z0.2 F30000"]
    x, y, heading = 100.0, 100.0, 0.0
    for i in range(len(job), lines - 3):
        if i % 97 == 0:
            job.append(b"M106 S%d" % (i % 255))
        elif i % 199 == 0:
            job.append(b"G1 Z%.2f" % (0.2 + i / 1000))
        else:
            heading += chance.uniform(0.0, 0.2)
            x, y = x + 0.5 * cos(heading), y + 0.5 * sin(heading)
            job.append(b"G1 X%.3f Y%.3f E0.%05d" % (x, y, i))
    return [*job, b"M107", b"G1 X0 Y200 F9000", b"M84"]


def print_over(setup: Setup, **changes: object) -> Trial:
    """Run one trial."""
    return Trial(replace(setup, **changes) if changes else setup).run()  # type: ignore[arg-type]


def count_queries(trial: Trial) -> int:
    """Return how often the host had to query or to repeat."""
    return trial.count(Probe, ResendRequested)
