"""Print a job on the simulated printer, in simulated time, with the protocol of a real print."""

from __future__ import annotations

import os
import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from pathlib import Path
from types import NoneType

from printer_slicer.arguments import PATH, check_arguments
from printer_slicer.deprecation import accept_former_arguments
from printer_slicer.errors import PortError, UsageError, VerificationError
from printer_slicer.input_files import is_gcode
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.deposition_observer import DepositionObserver
from printer_slicer.inspection.dry_run.fast_runner import (
    LONGEST_COMMAND,
    LONGEST_PRINT,
    EndlessPrintError,
    FastRunner,
)
from printer_slicer.inspection.dry_run.judging import RunContext, Verdict, judge
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.inspection.lint.scan import lint_file
from printer_slicer.jobs import Job
from printer_slicer.link_model import SerialLink
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile
from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, load_profile_from_gcode
from printer_slicer.sim.faults import Faults
from printer_slicer.sim.firmwares import SimulatedFirmware
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Accepted, Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.send_queue import POSITION_TOLERANCE
from printer_slicer.stream.session import run
from printer_slicer.values import Struct, replace

__all__ = ["dry_run", "make_layer_counter"]

_POSITION = re.compile(r"X:(\S+) Y:(\S+) Z:(\S+)")
_LATENCY = 0.001  # s; latency of a reply over USB
_MAX_SHOWN = 60  # characters; longer commands are shortened in messages
_LONGEST_WAIT = 60.0  # s; simulated time that one read may take


class _Simulation(Struct, eq=False):
    """A simulated print: printer, cable and host, with the observers that record it."""

    job: Job
    profile: Profile
    baud: int
    baud_given: bool
    comparison: Comparison
    observer: DepositionObserver
    printer: SimulatedPrinter
    port: VirtualPort

    @classmethod
    def of(
        cls,
        job: Job,
        profile: Profile,
        baud: int | None,
        printer: tuple[Machine, SimulatedFirmware | None],
        faults: Faults | None,
    ) -> _Simulation:
        """Connect printer, cable and observers; `baud` and firmware default to the profile's values."""
        comparison = Comparison(job.commands)
        observer = DepositionObserver(job, profile, comparison)
        machine, firmware = printer
        simulated = SimulatedPrinter(
            machine,
            firmware or simulated_firmware_for(profile.printer),
            faults=faults,
            on_executed=comparison,
            move_log=observer.move_log,
        )
        if faults is not None:
            faults.current_layer = make_layer_counter(job, comparison)
        used = baud or profile.printer.baud
        port = VirtualPort(simulated, baud=used, latency=_LATENCY, faults=faults)
        return cls(job, profile, used, baud is not None, comparison, observer, simulated, port)

    def make_streamer(self, commands: Sequence[bytes]) -> Streamer:
        """Return a host that sends these commands."""
        printer = self.profile.printer
        return Streamer(commands, limits=limits_of(printer), window_bytes=printer.receive_buffer - 1)

    def make_verdict(self, end: Event | None, total_seconds: float) -> Verdict:
        """Return the verdict on the simulated print."""
        state = self.printer.state
        return judge(
            self.job,
            self.profile,
            self.printer.report(),
            self.comparison,
            RunContext(
                self.observer.finish(),
                {"nozzle": max(one.target for one in state.heaters.hotends), "bed": state.bed.target},
                (self.baud, self.baud_given),
                end,
                total_seconds,
            ),
        )


def make_layer_counter(job: Job, comparison: Comparison) -> Callable[[], int] | None:
    """Make a function that returns the current layer of a run; return None without layer comments."""
    if not job.marks:
        return None
    begins, numbers = list(job.marks), list(job.marks.values())

    def layer_now() -> int:
        """Return the layer of the command that was started last; 0 before the first layer."""
        at = bisect_right(begins, comparison.due - 1)
        return numbers[at - 1] if at else 0

    return layer_now


@accept_former_arguments(front_end="firmware")
@check_arguments(job=(Job, *PATH), baud=(int, NoneType), extruders=(int, NoneType))
def dry_run(  # noqa: PLR0913 - all but two have a good default
    job: Job | str | os.PathLike[str],
    profile: Profile | None = None,
    *,
    on_event: Callable[[Event], None] = lambda _: None,
    baud: int | None = None,
    every_byte: bool = False,
    firmware: SimulatedFirmware | None = None,
    faults: Faults | None = None,
    extruders: int | None = None,
    one_hotend: bool = False,
) -> Verdict:
    """Print a job on the simulated printer that the profile describes.

    Args:
        job: the job to print, or a G-code file.
        profile: its printer section sets the machine, the baud rate and the window of the host; None: that of the job,
            or that in a file of this program.
        on_event: function that is called with each event of the host.
        baud: baud rate; buffer underruns are errors then. None uses that of the profile, with underruns as warnings.
        every_byte: simulate every byte on the cable. Otherwise whole lines are sent, with the same timing and the same
            result, ten times as fast.
        firmware: simulated firmware; None chooses one for the dialect of the profile. With a firmware or with faults,
            every byte is sent.
        faults: faults to inject.
        extruders: number of extruders; None: as many as the tool of the profile needs.
        one_hotend: the extruders share one hotend.

    Raises:
        VerificationError: the job would take more than 30 days.
        UsageError: neither `profile` nor the job has a profile, or the file cannot be read.
    """
    if not isinstance(job, Job):
        job = _read_job(Path(job), profile)
    profile = job.require_profile(profile)
    if job.seconds > LONGEST_PRINT:
        raise VerificationError(
            f"{job.name}: {job.seconds / 86400:.0f} days of motion and waiting are too long to simulate",
            remedy="Check dwells (G4) and speed limits (M203, M220)",
        )
    machine = machine_of(profile.printer, extruders, one_hotend=one_hotend)
    simulation = _Simulation.of(job, profile, baud, (machine, firmware), faults)
    if every_byte or firmware is not None or faults is not None:
        return _run_over_port(simulation, on_event)
    return _run_fast(simulation, on_event)


def _read_job(path: Path, profile: Profile | None) -> Job:
    """Read the job in a G-code file; without a profile, the file must contain the settings of this program.

    Raises:
        UsageError: the file cannot be read, is not G-code, or contains no settings.
    """
    if not is_gcode(path):
        raise UsageError(
            f"{path}: is not G-code", remedy=f"Slice it first: ps.dry_run(ps.slice({str(path)!r}))"
        )
    if profile is None:
        if not path.is_file():
            raise UsageError(f"{path}: no such file", remedy="Check the path")
        if not is_printer_slicer_gcode(path):
            raise UsageError(
                f"{path}: contains no settings of this program",
                remedy='Pass a profile: ps.dry_run(path, ps.load_profile("Ender 3"))',
            )
        profile = load_profile_from_gcode(path)
    return replace(lint_file(path, profile), profile=profile)


def _run_over_port(simulation: _Simulation, on_event: Callable[[Event], None]) -> Verdict:
    """Print the job and simulate every byte on the cable."""
    ends: list[Event] = []

    def listen(event: Event) -> None:
        """Store an event as the last event so far, and pass it on."""
        if isinstance(event, (Finished, Halted)):
            ends.append(event)
        on_event(event)

    port = simulation.port
    streamer = simulation.make_streamer(simulation.job.commands)
    progress = -1, 0.0

    def stop_if_endless(now: float) -> None:
        """Raise an error if a command or the print never ends."""
        nonlocal progress
        if simulation.comparison.executed != progress[0]:
            progress = simulation.comparison.executed, now
        if now > min(progress[1] + LONGEST_COMMAND, LONGEST_PRINT):
            raise EndlessPrintError

    try:
        run(
            streamer, port, port.now, on_event=listen, before_send=stop_if_endless, longest_wait=_LONGEST_WAIT
        )
    except EndlessPrintError:
        listen(_endless_event(simulation))
    except PortError as error:  # an injected fault disconnected the cable
        listen(Halted(str(error).partition("\n")[0], streamer.acknowledged))
    return simulation.make_verdict(ends[-1] if ends else None, port.now())


def _run_fast(simulation: _Simulation, on_event: Callable[[Event], None]) -> Verdict:
    """Print the job line by line; each line arrives when it would over the cable."""
    window = simulation.profile.printer.receive_buffer - 1
    link = SerialLink(simulation.baud, _LATENCY, _LATENCY, window_bytes=window)
    runner = FastRunner(simulation.printer, simulation.port, link, simulation.comparison.add_batch)
    commands = simulation.job.commands
    for event in runner.run_handshake(simulation.make_streamer(commands[:1])):
        on_event(event)
    end: Event
    try:
        done = runner.execute(commands, lambda count: on_event(Accepted(count)))
        killed = simulation.printer.state.killed
        end = (
            Halted(f"the printer stopped: {killed}", done)
            if killed
            else _finished_event(runner.close(), simulation.job)
        )
    except EndlessPrintError:
        end = _endless_event(simulation)
    on_event(end)
    return simulation.make_verdict(end, runner.now)


def _endless_event(simulation: _Simulation) -> Halted:
    """Return the event for a print that never ends."""
    at = max(simulation.comparison.due - 1, 0)
    command = simulation.job.commands[at].decode("latin-1")[:_MAX_SHOWN]
    return Halted(
        f"line {simulation.job.line_of(at)} takes longer than a day, or the print longer than 30 days: {command}",
        at,
    )


def _finished_event(reply: str, job: Job) -> Finished:
    """Return the event for a complete job, with the position from the printer's last reply."""
    found = _POSITION.match(reply)
    position = (float(found[1]), float(found[2]), float(found[3])) if found else None
    misses = [abs(at - to) for at, to in zip(position or (), job.end, strict=False)]
    return Finished(
        acknowledged=len(job.commands),
        cancelled=False,
        position=position,
        expected=job.end,
        verified=max(misses) <= POSITION_TOLERANCE if misses else None,
    )
