"""Print a job on the simulated printer under an invented clock, over the real protocol, and judge what came out."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256

from printer_slicer.errors import VerificationError
from printer_slicer.gcode import read_moves, spoken
from printer_slicer.jobs import Job
from printer_slicer.motion.machine import limits_of
from printer_slicer.profile import Printer, Profile
from printer_slicer.sim.front_end import MARLIN_2_1, FrontEnd
from printer_slicer.sim.heater import HeaterSpec
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.tally import MOST_LAYERS, Report
from printer_slicer.stream.events import Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

__all__ = ["Comparison", "Verdict", "dry_run", "front_end_of", "judge", "machine_of"]

TIME_TOLERANCE = 0.01  # share by which simulated and modelled time may differ
_LATENCY = 0.001  # s that an answer takes over USB
_LONGEST = 30 * 86400.0  # s; no print takes that long, but a slip in a file may
_PROBED = 16  # points that a machine with a probe touches
_PERSON = 60.0  # s until somebody answers a file that waits for a person
_PATIENCE = 60.0  # s of invented time that one read may wait: nobody else wants to speak meanwhile
_OURS = (b"M105", b"M110", b"M114", b"M115", b"M155", b"M400")  # what the host asks on its own account
_OTHERS = (b"M20", b"M21", b"M27", b"M113")  # what other hosts ask on theirs
_SHOWN = 20  # problems told in full


def machine_of(printer: Printer) -> Machine:
    """The machine that a printer's profile describes; what profiles do not say is that of a common printer."""
    (left, front), (right, back) = printer.corners
    return Machine(
        limits=limits_of(printer),
        box_min=(left - printer.reach, front - printer.reach, 0.0),
        box_max=(right + printer.reach, back + printer.reach, printer.bed_z + 10),
        home=(left, front, 0.0),
        person_seconds=_PERSON,
        probe_points=_PROBED if printer.probe else 0,
        hotend=HeaterSpec(
            power=40.0, heat_capacity=12.0, loss=0.1, fan_loss=0.03, highest=printer.max_nozzle_temperature
        ),
        bed=HeaterSpec(
            power=max(220.0, 0.006 * printer.bed_x * printer.bed_y),
            heat_capacity=0.0155 * printer.bed_x * printer.bed_y,
            loss=1.6 * printer.bed_x * printer.bed_y / 220**2,
            fan_loss=0.2,
            highest=printer.max_bed_temperature,
        ),
    )


def front_end_of(printer: Printer) -> FrontEnd:
    """How the simulated firmware answers: as Marlin does, but commands mean what they do in the printer's flavour."""
    extended = printer.firmware.extended_commands
    return replace(MARLIN_2_1, flavour=printer.flavour, ignores_extended=extended)


class Comparison:
    """Compares what a printer executes with what a job holds, command by command.

    Attributes:
        executed: commands of the job that were executed in their order.
        strays: the first few commands that were executed and were not next in the job: (how many had been
            executed before, the command).
        digest: SHA-256 over the executed commands of the job, each followed by a newline.
    """

    def __init__(self, commands: tuple[bytes, ...] = ()) -> None:
        self._commands = commands
        self._hash = sha256()
        self._begun = 0
        self._own: list[int] = []
        self.executed = 0
        self.n_strays = 0
        self.strays: list[tuple[int, str]] = []

    def __call__(self, text: str) -> None:
        """One more executed command."""
        self._begun += 1
        command = text.encode("latin-1")
        due = self.executed < len(self._commands) and command == self._commands[self.executed]
        if due or not (self._commands or command.startswith(_OURS)):
            self.executed += 1
            self._hash.update(command + b"\n")
        elif command.startswith(_OURS + _OTHERS):
            self._own.append(self._begun)
        else:
            self._own.append(self._begun)
            self.n_strays += 1
            if len(self.strays) < _SHOWN:
                self.strays.append((self.executed, text))

    def of_job(self, executed: int) -> bool:
        """Whether the command that was executed as number `executed`, counted from 1, is one of the job."""
        at = bisect_right(self._own, executed)
        return not at or self._own[at - 1] != executed

    def command_of(self, executed: int) -> int:
        """Index in the job of the command that was executed as number `executed`, counted from 1."""
        return executed - 1 - bisect_right(self._own, executed)

    @property
    def digest(self) -> str:
        """SHA-256 so far, in hexadecimal."""
        return self._hash.hexdigest()


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a simulated print came to. Times in s, lengths in mm.

    Attributes:
        job: its name.
        commands: in the job.
        executed: of these, executed in order.
        identical: every command was executed once, in order, and nothing else.
        heights: z values at which the printer laid plastic, in order.
        primed: those of them that the start G-code laid plastic at.
        heights_equal: they are those of the job and, where it was sliced here, of the layer plan.
        modelled_seconds: of the time model.
        simulated_seconds: of the simulated printer.
        total_seconds: with homing and heating.
        report: the printer's own account.
        problems: everything that should not be, in words; empty when all is well.
    """

    job: str
    commands: int
    executed: int
    identical: bool
    heights: tuple[float, ...]
    primed: tuple[float, ...]
    heights_equal: bool
    modelled_seconds: float
    simulated_seconds: float
    total_seconds: float
    report: Report
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the job would print as intended."""
        return not self.problems

    def __repr__(self) -> str:
        state = "ok" if self.ok else f"{len(self.problems)} problems"
        return f"<Verdict {self.job!r}: {state}, {self.executed} of {self.commands} commands>"

    def _repr_svg_(self) -> str:
        """What notebooks ask for."""
        from printer_slicer.drawing import card  # noqa: PLC0415 - only where it is looked at

        return card(*_told(self)).svg()


def _told(verdict: Verdict) -> tuple[str, dict[str, str], tuple[str, ...]]:
    """Headline, facts and problems of a verdict, for a picture."""
    laid = len(verdict.heights) - len(verdict.primed)
    facts = {
        "executed": f"{verdict.executed} of {verdict.commands} commands, "
        + ("each once and in order" if verdict.identical else "NOT what was sent"),
        "layers": f"plastic at {laid} heights, "
        + ("as planned" if verdict.heights_equal else "NOT as planned"),
        "motion": f"{spoken(verdict.simulated_seconds)} simulated, {spoken(verdict.modelled_seconds)} modelled",
        "in all": f"{spoken(verdict.total_seconds)} with homing and heating",
        "filament": f"{verdict.report.filament / 1000:.2f} m",
    }
    how = "would print as intended" if verdict.ok else f"has {len(verdict.problems)} problems"
    return f"{verdict.job} {how}", facts, verdict.problems


def dry_run(job: Job, profile: Profile, *, on_event: Callable[[Event], None] = lambda _: None) -> Verdict:
    """Print a job on the simulated printer that the profile describes.

    Args:
        job: what to print.
        profile: its printer part makes the machine, the speed of the port and the window of the host.
        on_event: is told what the host is told, as it happens.

    Raises:
        VerificationError: the job would take more than 30 days.
    """
    printer = profile.printer
    if job.seconds > _LONGEST:
        raise VerificationError(
            f"{job.name}: {job.seconds / 86400:.0f} days of motion and waiting are not simulated",
            remedy="look for dwells (G4) and speed limits (M203, M220) that are far too large or small",
        )
    comparison = Comparison(job.commands)
    simulated = SimulatedPrinter(machine_of(printer), front_end_of(printer), on_executed=comparison)
    port = VirtualPort(simulated, baud=printer.baud, latency=_LATENCY)
    streamer = Streamer(job.commands, limits=limits_of(printer), window_bytes=printer.receive_buffer - 1)
    ends: list[Event] = []

    def listen(event: Event) -> None:
        """Keep how it ended; pass everything on."""
        if isinstance(event, (Finished, Halted)):
            ends.append(event)
        on_event(event)

    run(streamer, port, port.now, on_event=listen, longest_wait=_PATIENCE)
    return judge(job, profile, simulated.report(), comparison, ends=ends, total_seconds=port.now())


def judge(
    job: Job,
    profile: Profile,
    report: Report,
    comparison: Comparison,
    *,
    ends: Sequence[Event] = (),
    total_seconds: float | None = None,
) -> Verdict:
    """What a simulated print of a job came to, however its lines reached the printer.

    Args:
        job: what was to be printed.
        profile: with which it was made.
        report: the printer's own account.
        comparison: was told every command that the printer executed.
        ends: what the host said at its end, where it was asked.
        total_seconds: from the first byte to the last; None adds up what the printer did.
    """
    waited = report.homing_seconds + report.heating_seconds
    return Verdict(
        job=job.name,
        commands=len(job.commands),
        executed=comparison.executed,
        identical=comparison.executed == len(job.commands) and comparison.n_strays == 0,
        heights=report.layers,
        primed=tuple(z for z in report.layers if z in set(_heights_before(job))),
        heights_equal=_same_heights(job, report.layers),
        modelled_seconds=job.seconds,
        simulated_seconds=report.print_seconds,
        total_seconds=report.print_seconds + waited if total_seconds is None else total_seconds,
        report=report,
        problems=tuple(_problems(job, profile, report, comparison, ends)),
    )


def _same_heights(job: Job, seen: tuple[float, ...]) -> bool:
    """Whether the printer laid plastic at the heights of the text, and those are the plan's.

    The start G-code may lay a line at a height of its own; such heights are left out of the comparison with the plan.
    """
    if tuple(seen) != job.heights[: len(seen)] or len(seen) != min(len(job.heights), MOST_LAYERS):
        return False
    if job.program is None or job.program.climbs:
        return True
    # Heights of the start G-code: those of the moves before the first layer comment.
    primed = set(_heights_before(job))
    planned = [round(float(z), 4) for z in job.program.plan.top[job.program.printed]]
    return set(seen) - primed <= set(planned) and [z for z in seen if z not in primed] == [
        z for z in planned if z not in primed
    ]


def _heights_before(job: Job) -> list[float]:
    """z at which the start G-code lays plastic."""
    first = min(job.marks, default=0)
    return read_moves(job.commands[:first]).heights()


def _located(job: Job, comparison: Comparison, executed: int, text: str) -> str:
    """What happened at the command that was executed as number `executed`, with its place in the file."""
    command = comparison.command_of(executed)
    line, layer = job.line_of(command), job.layer_of(command)
    return f"line {line}: {text}{f' (layer {layer})' if layer else ''}" if line else text


def _problems(
    job: Job, profile: Profile, report: Report, comparison: Comparison, ends: Sequence[Event]
) -> list[str]:
    """Everything that should not be, in words."""
    problems = [f"the host gave up: {end.reason}" for end in ends if isinstance(end, Halted)]
    if report.killed:
        problems.append(f"the printer halted: {report.killed}")
    violations = [one for one in report.violations if comparison.of_job(one.line)]
    problems += [_located(job, comparison, *violation) for violation in violations[:_SHOWN]]
    if (more := report.n_violations - len(report.violations) + len(violations) - _SHOWN) > 0:
        problems.append(f"... and {more} more")
    if comparison.executed != len(job.commands):
        problems.append(f"{comparison.executed} of {len(job.commands)} commands were executed")
    problems += [f"executed out of turn after command {after}: {text}" for after, text in comparison.strays]
    if not _same_heights(job, report.layers):
        problems.append(
            f"the printer laid plastic at {len(report.layers)} heights, the job has {len(job.heights)}"
        )
    # Files of others may change limits in ways that the time model does not follow.
    if job.program and job.seconds and abs(report.print_seconds / job.seconds - 1) > TIME_TOLERANCE:
        problems.append(f"{report.print_seconds:.1f} s were simulated, {job.seconds:.1f} s modelled")
    most = profile.material.max_flow
    if job.program is None and report.peak_flow > most * 1.5:
        problems.append(
            f"{report.peak_flow:.1f} mm3/s of plastic at most; {profile.material.name} melts {most:g}"
        )
    return problems
