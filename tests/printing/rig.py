"""A print controller with a simulated printer on a simulated clock, and a record of the printer's motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from printer_slicer.inspection.dry_run.machines import machine_of
from printer_slicer.motion.rules import Axes
from printer_slicer.printing import commands
from printer_slicer.printing.host_settings import HostSettings, make_host_settings
from printer_slicer.printing.journal import Journal
from printer_slicer.printing.objects import LiveJob, find_object_spans
from printer_slicer.printing.print_controller import PrintController, Request
from printer_slicer.printing.reattach import ResumePlan
from printer_slicer.profile import load_profile
from printer_slicer.sim import firmware_state
from printer_slicer.sim.firmwares import MARLIN_2_1, SimulatedFirmware
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.motion_queue import MotionQueue
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Accepted, Event
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

PROFILE = load_profile("marlin_220", "pla", "standard")
SETUP = make_host_settings(PROFILE)
OWN = ("M105", "M110", "M114", "M115", "M155", "M400")
Piece = tuple[Axes, Axes]
Point = tuple[float, float, float]


class RecordingMotionQueue(MotionQueue):
    """A planner that remembers what the motors made."""

    made: list[Piece]

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self.made = []

    def advance(self, now: float) -> None:
        while self.ends <= now:
            before = self._rest_position, self.targets[0] if self._running else None
            super().advance(self.ends)
            if before[1] is not None:
                self.made.append((before[0], before[1]))

    def stop(self, now: float) -> tuple[Axes, float]:
        self.advance(now)
        start = self._rest_position
        stopped = super().stop(now)
        self.made.append((start, stopped[0]))
        return stopped


@contextmanager
def recording() -> Iterator[None]:
    """Printers made within the block remember their motion."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(firmware_state, "MotionQueue", RecordingMotionQueue)
        yield


def laid(made: list[Piece]) -> list[Piece]:
    """The beads: pieces that move in x or y while filament goes forward; pieces of one line are one bead."""
    beads: list[Piece] = []
    for start, end in made:
        if end[3] - start[3] <= 1e-9 or (start[0], start[1]) == (end[0], end[1]):
            continue
        if beads and _continues(beads[-1], (start, end)):
            first, last = beads[-1]
            beads[-1] = first, (*end[:3], last[3] + end[3] - start[3])
        else:
            beads.append((start, end))
    return beads


def _continues(one: Piece, other: Piece) -> bool:
    (ax, ay, az, _), (bx, by, bz, _) = one
    (cx, cy, cz, _), (dx, dy, _, _) = other
    if max(abs(bx - cx), abs(by - cy), abs(bz - cz), abs(az - bz)) > 2e-3:
        return False
    ux, uy, vx, vy = bx - ax, by - ay, dx - cx, dy - cy
    size = (ux * ux + uy * uy) ** 0.5 * (vx * vx + vy * vy) ** 0.5
    # ConnectedAreas of a hundredth of a millimetre have the direction of their rounding.
    short = min((ux * ux + uy * uy) ** 0.5, (vx * vx + vy * vy) ** 0.5)
    return size > 0 and ux * vx + uy * vy > size * (1 - 1e-5 if short > 0.5 else 0.9)


def assert_same_beads(one: list[Piece], other: list[Piece], tolerance: float = 1e-3) -> None:
    """Places and filament of all beads agree."""
    for first, second in zip(one, other, strict=False):
        for a, b in zip(first, second, strict=True):
            assert a[:3] == pytest.approx(b[:3], abs=tolerance)
        assert first[1][3] - first[0][3] == pytest.approx(second[1][3] - second[0][3], abs=tolerance)
    assert len(one) == len(other)


def off_path(one: list[Piece], other: list[Piece]) -> float:
    """Greatest distance of an end of one's beads from the other's, mm."""
    return max(min(_distance(place[:3], bead) for bead in other) for piece in one for place in piece)


def _distance(point: Point, bead: Piece) -> float:
    start, end = bead[0][:3], bead[1][:3]
    along = [q - p for p, q in zip(start, end, strict=True)]
    length = sum(d * d for d in along)
    share = sum(d * (q - p) for d, p, q in zip(along, start, point, strict=True)) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return sum((p + share * d - q) ** 2 for p, d, q in zip(start, along, point, strict=True)) ** 0.5


def way(beads: list[Piece]) -> float:
    """Length of all beads, mm."""
    return sum(
        sum((q - p) ** 2 for p, q in zip(start[:3], end[:3], strict=True)) ** 0.5 for start, end in beads
    )


@dataclass
class Rig:
    """One print."""

    text: str
    firmware: SimulatedFirmware = MARLIN_2_1
    setup: HostSettings = SETUP
    folder: Path | None = None
    baud: int | None = 250_000
    machine: Machine = field(default_factory=lambda: machine_of(PROFILE.printer))
    events: list[Event] = field(default_factory=list)
    executed: list[str] = field(default_factory=list)
    answers: list[object] = field(default_factory=list)

    def __post_init__(self) -> None:
        with recording():
            self.printer = SimulatedPrinter(self.machine, self.firmware, on_executed=self.executed.append)
        self.port = VirtualPort(self.printer, baud=self.baud, latency=0.001)
        self.commands = tuple(
            line.encode() for line in self.text.split("\n") if line.partition(";")[0].strip()
        )
        self.journal = Journal(self.folder) if self.folder else None

    def connect(self, found: ResumePlan | None = None) -> PrintController:
        """A host at the port, from the beginning or from where another one was."""
        job = (
            found.job
            if found
            else LiveJob(self.commands, find_object_spans(self.text.encode()), flavour=self.setup.flavour)
        )
        self.streamer = Streamer(
            job,
            limits=self.setup.limits,
            window_bytes=self.setup.window_bytes,
            handle_actions=False,
            first=found.entries if found else 0,
        )
        self.controller = PrintController(
            self.streamer, job, self.setup, journal=self.journal, listen=self.hear
        )
        if self.journal:
            self.journal.record_restart(self.streamer.acknowledged)
        if found and (found.parked or found.replay):
            self.controller.restore_print(
                found.parked, found.extruded, found.replay, stays_paused=found.is_paused
            )
        return self.controller

    on_event: Callable[[Event], None] = lambda _: None

    def hear(self, event: Event) -> None:
        """Everything that the host tells."""
        self.events.append(event)
        self.on_event(event)

    def run(self, before_send: Callable[[float], None] = lambda _: None) -> None:
        """Print until the end."""

        def turn(now: float) -> None:
            """The test has its say first."""
            before_send(now)
            self.controller.advance(now)

        run(
            self.streamer,
            self.port,
            self.port.now,
            on_event=self.controller.on_event,
            before_send=turn,
            record=self.controller.record_events,
            longest_wait=0.25,
        )

    def submit(self, command: commands.PrintCommand) -> None:
        """Somebody wants something."""
        self.controller.submit(Request(command, self.answers.append))

    @property
    def made(self) -> list[Piece]:
        """What the motors made."""
        mover = self.printer._state.motion_queue
        assert isinstance(mover, RecordingMotionQueue)
        mover.advance(self.port.now())
        return mover.made

    @property
    def beads(self) -> list[Piece]:
        """What lies on the bed."""
        return laid(self.made)

    def of_job(self) -> list[str]:
        """Executed commands without what the host asks on its own account."""
        return [line for line in self.executed if not line.startswith(OWN)]


def accepted(event: Event) -> int:
    """Commands that an event says are accepted, 0 for other events."""
    return event.acknowledged if isinstance(event, Accepted) else 0


def warm(machine: Machine) -> Machine:
    """A machine that extrudes at any temperature."""
    return replace(machine, coldest_extrusion=0.0)
