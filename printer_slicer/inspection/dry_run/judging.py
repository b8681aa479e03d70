"""What a simulated print came to: the verdict, from everything that was told about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, NamedTuple

from printer_slicer.diagnostics import Diagnostic, sentence
from printer_slicer.gcode import read_moves
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.dry_run.causes import Cause, causes_of, explained, layer_of, left_over
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.faults import (
    Places,
    left_on,
    made_ready,
    of_machine,
    of_material,
    starved,
)
from printer_slicer.inspection.dry_run.feeding import clogged, misread, short_of
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.sim.tally import MOST_LAYERS, Report
from printer_slicer.stream.events import Event, Halted
from printer_slicer.texts import format_duration

__all__ = ["Seen", "Verdict", "judge"]

TIME_TOLERANCE: Final = 0.01
"""Share by which simulated and modelled time may differ."""


@dataclass(frozen=True, slots=True)
class Verdict(SvgRepr):
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
        baud: of the link.
        report: the printer's own account.
        account: that of the material; None where nobody kept it.
        faults: everything that would go wrong, and what is worth knowing all the same, in the order of the commands.
        problems: what would go wrong, in words, and what is wrong with the run as a whole; empty when all is well.
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
    baud: int
    report: Report
    account: Deposition | None
    faults: tuple[Diagnostic, ...]
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the job would print as intended."""
        return not self.problems

    @property
    def notes(self) -> tuple[str, ...]:
        """What is worth knowing, in words, though the print comes out all the same."""
        return tuple(sentence(fault) for fault in self.faults if not fault.is_error)

    def __repr__(self) -> str:
        state = "ok" if self.ok else f"{len(self.problems)} problems"
        return f"<Verdict {self.job!r}: {state}, {self.executed} of {self.commands} commands>"

    @property
    def drawable(self) -> Summary:
        """Headline, facts and problems."""
        laid = len(self.heights) - len(self.primed)
        facts = {
            "executed": f"{self.executed} of {self.commands} commands, "
            + ("each once and in order" if self.identical else "NOT what was sent"),
            "layers": f"plastic at {laid} heights, "
            + ("as planned" if self.heights_equal else "NOT as planned"),
            "motion": f"{format_duration(self.simulated_seconds)} simulated, "
            f"{format_duration(self.modelled_seconds)} modelled",
            "in all": f"{format_duration(self.total_seconds)} with homing and heating",
            "filament": f"{self.report.filament / 1000:.2f} m",
        }
        how = "would print as intended" if self.ok else f"has {len(self.problems)} problems"
        return Summary(f"{self.job} {how}", facts, self.problems)


class Seen(NamedTuple):
    """What is known of a run besides the account of the printer.

    Attributes:
        account: of the material, if it was kept.
        targets: °C of "nozzle" and "bed" when all was done.
        link: bits/s, and whether somebody asked what it can do; None where it does not matter.
        end: what the host said at its end, where it was asked.
        total_seconds: from the first byte to the last; None adds up what the printer did.
    """

    account: Deposition | None = None
    targets: Mapping[str, float] = MappingProxyType({})
    link: tuple[int, bool] | None = None
    end: Event | None = None
    total_seconds: float | None = None


def judge(
    job: Job, profile: Profile, report: Report, comparison: Comparison, seen: Seen | None = None
) -> Verdict:
    """What a simulated print of a job came to, however its lines reached the printer.

    Args:
        job: what was to be printed.
        profile: with which it was made.
        report: the printer's own account.
        comparison: was told every command that the printer executed.
        seen: what else is known; None where a host prints that is not ours.
    """
    account, targets, link, end, total_seconds = seen or Seen()
    waited = report.homing_seconds + report.heating_seconds
    before = set(_heights_before(job))
    found = [*made_ready(job, profile), *of_machine(job, report, comparison)]
    if account is not None:
        found = _with_material(job, profile, report, comparison, (account, found))
        if "unsupported" in job.allowed:
            found = [
                (at, replace(one, severity="warning") if one.code == "unsupported" else one)
                for at, one in found
            ]
    if not report.killed and comparison.executed == len(job.commands):
        found += left_on(job, profile, targets)
    if link is not None:
        found += starved(report, comparison, link[0], asked=link[1])
    faults = tuple(Places(job, account).put(found))
    said = [sentence(fault) for fault in faults if fault.is_error]
    return Verdict(
        job=job.name,
        commands=len(job.commands),
        executed=comparison.executed,
        identical=comparison.executed == len(job.commands) and comparison.n_strays == 0,
        heights=report.layers,
        primed=tuple(z for z in report.layers if z in before),
        heights_equal=_same_heights(job, report.layers),
        modelled_seconds=job.seconds,
        simulated_seconds=report.print_seconds,
        total_seconds=report.print_seconds + waited if total_seconds is None else total_seconds,
        baud=link[0] if link else 0,
        report=report,
        account=account,
        faults=faults,
        problems=(*said, *_problems(job, report, comparison, end, explained=bool(said))),
    )


def _with_material(
    job: Job,
    profile: Profile,
    report: Report,
    comparison: Comparison,
    known: tuple[Deposition, list[tuple[int, Diagnostic]]],
) -> list[tuple[int, Diagnostic]]:
    """What the firmware did not do, and what is wrong with the material and does not follow from that."""
    account, of_firmware = known
    causes = causes_of(job, report, comparison, account)
    found: list[tuple[int, Diagnostic]] = []
    for several in (
        clogged(job, profile, account, report.filament_missing),
        misread(job, account),
        short_of(job, profile, account),
    ):
        for one in several:
            if not explained(causes, one.fault.code, one.shows, layer_of(account, one.command)):
                found.append((one.command, one.fault))
                causes.append(Cause(one.fault.code, one.since, one.last + 1))
    # What is refused for being too long comes of E that is misread, too.
    misreads = [command for command, fault in found if fault.code == "extrusion"]
    of_firmware = [
        (command, fault)
        for command, fault in of_firmware
        if fault.code != "extrusion" or not any(since <= command for since in misreads)
    ]
    # What a command that was clipped or refused then lays is no fault of its own.
    told = {command for command, _ in of_firmware}
    left = [one for one in left_over(account.mishaps, causes) if one.command - 1 not in told]
    return [*of_firmware, *found, *of_material(profile, account, left)]


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


def _problems(
    job: Job, report: Report, comparison: Comparison, end: Event | None, *, explained: bool
) -> list[str]:
    """What is wrong with the run as a whole, in words; what follows from something that is told already is not."""
    problems = [f"the host gave up: {end.reason}"] if isinstance(end, Halted) else []
    if report.killed:
        problems.append(f"the printer halted: {report.killed}")
    if report.filament_missing and not explained:
        problems.append(f"{report.filament_missing:.1f} mm of filament were fed and did not come out")
    if comparison.executed != len(job.commands):
        problems.append(f"{comparison.executed} of {len(job.commands)} commands were executed")
    problems += [f"executed out of turn after command {after}: {text}" for after, text in comparison.strays]
    problems += [
        f"line {job.line_of(at)} was never executed: {job.commands[at].decode('latin-1')}"
        for at in comparison.missed
    ]
    if not (explained or _same_heights(job, report.layers)):
        problems.append(
            f"the printer laid plastic at {len(report.layers)} heights, the job has {len(job.heights)}"
        )
    # Files of others may change limits in ways that the time model does not follow.
    if (
        not explained
        and job.program
        and job.seconds
        and abs(report.print_seconds / job.seconds - 1) > TIME_TOLERANCE
    ):
        problems.append(f"{report.print_seconds:.1f} s were simulated, {job.seconds:.1f} s modelled")
    return problems
