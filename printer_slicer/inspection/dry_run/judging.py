"""Judge a simulated print: combine all its records into a `Verdict`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from printer_slicer.deprecation import accept_former_fields
from printer_slicer.diagnostics import Diagnostic, sentence
from printer_slicer.gcode import read_moves
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.dry_run.causes import (
    Cause,
    drop_consequences,
    find_causes,
    is_explained,
    layer_of,
)
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.faults import (
    FaultLocator,
    deposition_faults,
    firmware_faults,
    heaters_left_on,
    start_macro_note,
    underrun_faults,
)
from printer_slicer.inspection.dry_run.feeding import find_clog, find_misread_e, find_missing_material
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.sim.statistics import MAX_LAYERS, Report
from printer_slicer.stream.events import Event, Halted
from printer_slicer.texts import format_count, format_duration
from printer_slicer.values import Struct, replace

__all__ = ["RunContext", "Verdict", "judge", "summarize"]

TIME_TOLERANCE: Final = 0.01
"""Maximum accepted difference between simulated and estimated time, as a share of the estimated time."""


@accept_former_fields(account="deposition")
class Verdict(SvgRepr, Struct, frozen=True):
    """The result of a dry run. Times in s, lengths in mm.

    Attributes:
        job: name of the job.
        commands: number of commands in the job.
        executed: number of them that were executed in order.
        identical: whether all commands were executed once and in order, and no other commands.
        heights: z values with extrusion, in order.
        primed: the heights at which the start G-code extrudes.
        heights_equal: whether `heights` equals the heights of the job and, if it was sliced here, of the layer plan.
        modelled_seconds: time estimate of the motion model.
        simulated_seconds: time on the simulated printer.
        total_seconds: with homing and heating.
        baud: baud rate of the serial link.
        report: counters of the simulated printer.
        deposition: the recorded extrusion; None if it was not recorded.
        faults: errors and warnings, in the order of the commands.
        problems: the errors as text, and problems of the whole run; empty if there are none.
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
    deposition: Deposition | None
    faults: tuple[Diagnostic, ...]
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the job would print as intended."""
        return not self.problems

    @property
    def notes(self) -> tuple[str, ...]:
        """The warnings of the dry run as text."""
        return tuple(sentence(fault) for fault in self.faults if not fault.is_error)

    def __repr__(self) -> str:
        state = "ok" if self.ok else f"{len(self.problems)} problem(s)"
        return f"<Verdict {self.job!r}: {state}, {self.executed} of {self.commands} commands>"

    @property
    def drawable(self) -> Summary:
        """The headline, facts and problems of this verdict, for its picture."""
        n_layers = len(self.heights) - len(self.primed)
        facts = {
            "executed": f"{self.executed} of {self.commands} commands, "
            + ("in order" if self.identical else "NOT identical to the job"),
            "layers": f"{n_layers} layer heights, "
            + ("as planned" if self.heights_equal else "NOT as planned"),
            "motion": f"{format_duration(self.simulated_seconds)} simulated, "
            f"{format_duration(self.modelled_seconds)} estimated from these commands",
            "total": f"{format_duration(self.total_seconds)} with homing and heating",
            "filament": f"{self.report.filament / 1000:.2f} m",
        }
        state = summarize(len(self.problems), has_warnings=bool(self.notes))
        return Summary(f"{self.job}: {state}", facts, self.problems)


def summarize(n_errors: int, *, has_warnings: bool) -> str:
    """Return the result of a dry run in a few words, for headlines."""
    if n_errors:
        return f"do not print, {format_count(n_errors, 'error')}"
    return "no errors, only warnings" if has_warnings else "no problems"


class RunContext(NamedTuple):
    """Records of a simulated print, in addition to the report of the printer.

    Attributes:
        deposition: the recorded extrusion; None if it was not recorded.
        targets: °C of "nozzle" and "bed" at the end.
        link: baud rate, and whether the user gave it; None if it does not matter.
        end: the last event of the host, if known.
        total_seconds: from the first byte to the last; None adds up the times of the printer.
    """

    deposition: Deposition | None = None
    targets: Mapping[str, float] = MappingProxyType({})
    link: tuple[int, bool] | None = None
    end: Event | None = None
    total_seconds: float | None = None


def judge(
    job: Job, profile: Profile, report: Report, comparison: Comparison, seen: RunContext | None = None
) -> Verdict:
    """Judge a simulated print of a job.

    Args:
        job: the job.
        profile: the profile that the job was made with.
        report: counters of the simulated printer.
        comparison: comparison of all executed commands with the job.
        seen: other records; None if another host printed.
    """
    deposition, targets, link, end, total_seconds = seen or RunContext()
    waited = report.homing_seconds + report.heating_seconds
    start_heights = set(_heights_of_start_gcode(job))
    found = [*start_macro_note(job, profile), *firmware_faults(job, report, comparison)]
    if deposition is not None:
        found = _add_material_faults(job, profile, report, comparison, (deposition, found))
        tolerated = job.allowed & {"unsupported", "head"}
        found = [
            (at, replace(one, severity="warning") if one.code in tolerated else one) for at, one in found
        ]
    if not report.killed and comparison.executed == len(job.commands):
        found += heaters_left_on(job, profile, targets)
    if link is not None:
        found += underrun_faults(report, comparison, link[0], baud_given=link[1])
    faults = tuple(FaultLocator(job, deposition).locate(found))
    errors = [sentence(fault) for fault in faults if fault.is_error]
    return Verdict(
        job=job.name,
        commands=len(job.commands),
        executed=comparison.executed,
        identical=comparison.executed == len(job.commands) and comparison.n_unexpected == 0,
        heights=report.layers,
        primed=tuple(z for z in report.layers if z in start_heights),
        heights_equal=_has_planned_heights(job, report.layers),
        modelled_seconds=job.seconds,
        simulated_seconds=report.print_seconds,
        total_seconds=report.print_seconds + waited if total_seconds is None else total_seconds,
        baud=link[0] if link else 0,
        report=report,
        deposition=deposition,
        faults=faults,
        problems=(*errors, *_list_problems(job, report, comparison, end, is_explained=bool(errors))),
    )


def _add_material_faults(
    job: Job,
    profile: Profile,
    report: Report,
    comparison: Comparison,
    known: tuple[Deposition, list[tuple[int, Diagnostic]]],
) -> list[tuple[int, Diagnostic]]:
    """Return the faults that the firmware found, and extrusion faults that are not their consequences."""
    deposition, from_firmware = known
    causes = find_causes(job, report, comparison, deposition)
    found: list[tuple[int, Diagnostic]] = []
    for faults in (
        find_clog(job, profile, deposition, report.filament_missing),
        find_misread_e(job, deposition),
        find_missing_material(job, profile, deposition),
    ):
        for one in faults:
            if not is_explained(causes, one.fault.code, one.proven_at, layer_of(deposition, one.command)):
                found.append((one.command, one.fault))
                causes.append(Cause(one.fault.code, one.since, one.last + 1))
    # Extrusion that the firmware rejects as too long may be a consequence of misread E values.
    misreads = [command for command, fault in found if fault.code == "extrusion"]
    from_firmware = [
        (command, fault)
        for command, fault in from_firmware
        if fault.code != "extrusion" or not any(since <= command for since in misreads)
    ]
    # A defect caused by a clipped or rejected command is no separate fault.
    reported = {command for command, _ in from_firmware}
    remaining = [
        one for one in drop_consequences(deposition.defects, causes) if one.command - 1 not in reported
    ]
    return [*from_firmware, *found, *deposition_faults(profile, deposition, remaining)]


def _has_planned_heights(job: Job, extruded: tuple[float, ...]) -> bool:
    """Return whether the printed heights equal the job's, and these equal the heights of its layer plan.

    The comparison with the plan leaves out the heights of the start G-code.
    """
    if tuple(extruded) != job.heights[: len(extruded)] or len(extruded) != min(len(job.heights), MAX_LAYERS):
        return False
    if job.program is None or job.program.climbs:
        return True
    # The start G-code consists of the commands before the first layer comment.
    primed = set(_heights_of_start_gcode(job))
    tops = job.program.plan.top[job.program.printed]
    planned = list(dict.fromkeys(round(float(z), 4) for z in tops))
    return set(extruded) - primed <= set(planned) and [z for z in extruded if z not in primed] == [
        z for z in planned if z not in primed
    ]


def _heights_of_start_gcode(job: Job) -> list[float]:
    """Return the z values at which the start G-code extrudes."""
    first = min(job.marks, default=0)
    return read_moves(job.commands[:first]).heights()


def _list_problems(
    job: Job, report: Report, comparison: Comparison, end: Event | None, *, is_explained: bool
) -> list[str]:
    """Return the problems of the whole run as text; leave out problems that reported faults explain."""
    problems = [f"the host stopped: {end.reason}"] if isinstance(end, Halted) else []
    if report.killed:
        problems.append(f"the printer halted: {report.killed}")
    if report.filament_missing and not is_explained:
        problems.append(f"{report.filament_missing:.1f} mm of filament were fed but did not come out")
    if comparison.executed != len(job.commands):
        problems.append(f"only {comparison.executed} of {len(job.commands)} commands were executed")
    problems += [
        f"unexpected command executed after command {after}: {text}" for after, text in comparison.unexpected
    ]
    problems += [
        f"line {job.line_of(at)} was never executed: {job.commands[at].decode('latin-1')}"
        for at in comparison.skipped
    ]
    if not (is_explained or _has_planned_heights(job, report.layers)):
        problems.append(
            f"the printer extruded at {len(report.layers)} heights, the job has {len(job.heights)}"
        )
    # Files of other slicers may change limits in ways that the time estimate does not support.
    if (
        not is_explained
        and job.program
        and job.seconds
        and abs(report.print_seconds / job.seconds - 1) > TIME_TOLERANCE
    ):
        problems.append(
            f"motion takes {report.print_seconds:.1f} s, but {job.seconds:.1f} s were estimated from these commands"
        )
    return problems
