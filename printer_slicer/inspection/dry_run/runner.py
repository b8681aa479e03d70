"""Print a job on the simulated printer under an invented clock, over the real protocol."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from printer_slicer.errors import PortError, VerificationError
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.fast_runner import (
    LONGEST_COMMAND,
    LONGEST_PRINT,
    FastRunner,
    NeverDoneError,
)
from printer_slicer.inspection.dry_run.judging import Seen, Verdict, judge
from printer_slicer.inspection.dry_run.machines import front_end_of, machine_of
from printer_slicer.inspection.dry_run.materials import Materials
from printer_slicer.jobs import Job
from printer_slicer.link_model import SerialLink
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile
from printer_slicer.sim.faults import Faults
from printer_slicer.sim.front_end import FrontEnd
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Accepted, Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.send_queue import POSITION_TOLERANCE
from printer_slicer.stream.session import run

__all__ = ["dry_run", "layer_counter"]

_PLACE = re.compile(r"X:(\S+) Y:(\S+) Z:(\S+)")
_LATENCY = 0.001  # s that an answer takes over USB
_SHOWN = 60  # characters of a command
_PATIENCE = 60.0  # s of invented time that one read may wait: nobody else wants to speak meanwhile


@dataclass(slots=True, eq=False)
class _Rig:
    """Printer, cable and host, and who looks at what is executed."""

    job: Job
    profile: Profile
    baud: int
    asked: bool
    front_end: FrontEnd | None
    trouble: Faults | None
    machine: Machine
    comparison: Comparison = field(init=False)
    materials: Materials = field(init=False)
    printer: SimulatedPrinter = field(init=False)
    port: VirtualPort = field(init=False)

    def __post_init__(self) -> None:
        self.comparison = Comparison(self.job.commands)
        self.materials = Materials(self.job, self.profile, self.comparison)
        self.printer = SimulatedPrinter(
            self.machine,
            self.front_end or front_end_of(self.profile.printer),
            faults=self.trouble,
            on_executed=self.comparison,
            track=self.materials.track,
        )
        if self.trouble is not None:
            self.trouble.layer_now = layer_counter(self.job, self.comparison)
        self.port = VirtualPort(self.printer, baud=self.baud, latency=_LATENCY, faults=self.trouble)

    def streamer(self, commands: Sequence[bytes]) -> Streamer:
        """The host with something to say."""
        printer = self.profile.printer
        return Streamer(commands, limits=limits_of(printer), window_bytes=printer.receive_buffer - 1)

    def verdict(self, end: Event | None, total_seconds: float) -> Verdict:
        """What it came to."""
        board = self.printer.board
        return judge(
            self.job,
            self.profile,
            self.printer.report(),
            self.comparison,
            Seen(
                self.materials.account(),
                {"nozzle": max(one.target for one in board.heaters.hotends), "bed": board.bed.target},
                (self.baud, self.asked),
                end,
                total_seconds,
            ),
        )


def layer_counter(job: Job, comparison: Comparison) -> Callable[[], int] | None:
    """What tells the layer that is executed, as the comments of the job have it; None without such comments."""
    if not job.marks:
        return None
    begins, numbers = list(job.marks), list(job.marks.values())

    def layer_now() -> int:
        """That of the command begun last; 0 before the first."""
        at = bisect_right(begins, comparison.due - 1)
        return numbers[at - 1] if at else 0

    return layer_now


def dry_run(  # noqa: PLR0913 - all but two have a good default
    job: Job,
    profile: Profile,
    *,
    on_event: Callable[[Event], None] = lambda _: None,
    baud: int | None = None,
    every_byte: bool = False,
    front_end: FrontEnd | None = None,
    faults: Faults | None = None,
    extruders: int | None = None,
    one_hotend: bool = False,
) -> Verdict:
    """Print a job on the simulated printer that the profile describes.

    Args:
        job: what to print.
        profile: its printer part makes the machine, the speed of the port and the window of the host.
        on_event: is told what the host is told, as it happens.
        baud: of the link, if a link that is too slow shall count as a fault; None takes the profile's and only tells.
        every_byte: send every byte over the simulated cable. Else lines take their times, but not their bytes: ten
            times as fast, and with the same outcome.
        front_end: the firmware; None takes one that understands what the printer's profile writes. With one, and with
            faults, every byte is sent.
        faults: what shall go wrong.
        extruders: how many the printer has; None: up to the tool that its profile prints with.
        one_hotend: they share one.

    Raises:
        VerificationError: the job would take more than 30 days.
    """
    if job.seconds > LONGEST_PRINT:
        raise VerificationError(
            f"{job.name}: {job.seconds / 86400:.0f} days of motion and waiting are not simulated",
            remedy="look for dwells (G4) and speed limits (M203, M220) that are far too large or small",
        )
    machine = machine_of(profile.printer, extruders, one_hotend=one_hotend)
    rig = _Rig(job, profile, baud or profile.printer.baud, baud is not None, front_end, faults, machine)
    if every_byte or front_end is not None or faults is not None:
        return _over_the_wire(rig, on_event)
    return _by_express(rig, on_event)


def _over_the_wire(rig: _Rig, on_event: Callable[[Event], None]) -> Verdict:
    """Send every byte."""
    ends: list[Event] = []

    def listen(event: Event) -> None:
        """Keep how it ended; pass everything on."""
        if isinstance(event, (Finished, Halted)):
            ends.append(event)
        on_event(event)

    port = rig.port
    streamer = rig.streamer(rig.job.commands)
    begun = -1, 0.0

    def watch(now: float) -> None:
        """Give up what never ends."""
        nonlocal begun
        if rig.comparison.executed != begun[0]:
            begun = rig.comparison.executed, now
        if now > min(begun[1] + LONGEST_COMMAND, LONGEST_PRINT):
            raise NeverDoneError

    try:
        run(streamer, port, port.now, on_event=listen, on_turn=watch, longest_wait=_PATIENCE)
    except NeverDoneError:
        listen(_endless(rig))
    except PortError as error:  # a planted fault pulled the plug
        listen(Halted(str(error).partition("\n")[0], streamer.acknowledged))
    return rig.verdict(ends[-1] if ends else None, port.now())


def _by_express(rig: _Rig, on_event: Callable[[Event], None]) -> Verdict:
    """Give every line to the printer when it would have come."""
    window = rig.profile.printer.receive_buffer - 1
    link = SerialLink(rig.baud, _LATENCY, _LATENCY, window_bytes=window)
    express = FastRunner(rig.printer, rig.port, link, rig.comparison.many)
    commands = rig.job.commands
    for event in express.greet(rig.streamer(commands[:1])):
        on_event(event)
    end: Event
    try:
        done = express.execute(commands, lambda count: on_event(Accepted(count)))
        killed = rig.printer.board.killed
        end = (
            Halted(f"the printer stopped: {killed}", done) if killed else _finished(express.close(), rig.job)
        )
    except NeverDoneError:
        end = _endless(rig)
    on_event(end)
    return rig.verdict(end, express.now)


def _endless(rig: _Rig) -> Halted:
    """What ends a print that would never end by itself."""
    at = max(rig.comparison.due - 1, 0)
    said = rig.job.commands[at].decode("latin-1")[:_SHOWN]
    return Halted(f"line {rig.job.line_of(at)} is not done after a day, or the print after 30: {said}", at)


def _finished(said: str, job: Job) -> Finished:
    """The end of a job, from what the printer says to the question where it is."""
    found = _PLACE.match(said)
    position = (float(found[1]), float(found[2]), float(found[3])) if found else None
    misses = [abs(at - to) for at, to in zip(position or (), job.end, strict=False)]
    return Finished(
        acknowledged=len(job.commands),
        cancelled=False,
        position=position,
        expected=job.end,
        verified=max(misses) <= POSITION_TOLERANCE if misses else None,
    )
