"""Report what went wrong in a simulated print as diagnostics."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from printer_slicer.commands import find_lines
from printer_slicer.diagnostics import Diagnostic, Severity
from printer_slicer.gcode.commands import find_heater
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import uses_inches
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.lint.motion import SHORT_TERM_FLOW
from printer_slicer.inspection.lint.syntax import is_known_to_a_firmware
from printer_slicer.jobs import Job
from printer_slicer.printer_macros import match_end_macro, match_start_macro
from printer_slicer.profile import Profile
from printer_slicer.sim.statistics import Report, violation_kind
from printer_slicer.values import replace

__all__ = [
    "FaultLocator",
    "code_of_violation",
    "deposition_faults",
    "firmware_faults",
    "heaters_left_on",
    "start_macro_note",
    "underrun_faults",
]

_MIN_SPEED: Final = 2.0  # mm/s; a slower print has wrong units of F
_MIN_LENGTH: Final = 50.0  # mm of extrusion; the speed of a shorter print is not checked
_MAX_STANDSTILL: Final = 0.25  # s; a shorter total of buffer underruns is tolerated
_SAME_DURATION: Final = 1e-3  # s; if the longest stops differ by less, the first of them is reported

_TURN_OFF_MACRO: Final = "TURN_OFF_HEATERS"
_MAX_START_COMMANDS: Final = 1000  # start G-code of a file without layer comments


_INCHES_REMEDY: Final = "The file switches to inches (G20): check that its values are inches, not mm"


class _ViolationRule(NamedTuple):
    """How to report a violation that the simulated printer has recorded: code and remedy."""

    code: str
    remedy: str


_LIFT_BEFORE_HOMING: Final = "raised the nozzle before homing"

_VIOLATION_RULES: Final[Mapping[str, _ViolationRule]] = {
    "cold extrusion prevented": _ViolationRule("cold", "Heat the nozzle first (for example M109 S210)"),
    "too long extrusion prevented": _ViolationRule("extrusion", "Check M82, M83 and G92 E0 before this line"),
    "out of the machine": _ViolationRule(
        "box", "Move the part, or set `printer` to the one that the file was sliced for"
    ),
    "moved before homing": _ViolationRule("homing", "Start with G28"),
    _LIFT_BEFORE_HOMING: _ViolationRule("homing", "Home first, in case the nozzle is at the top"),
    "probed before homing": _ViolationRule("homing", "Put G28 before G29"),
    "unknown command": _ViolationRule(
        "unknown", "The printer ignores this command. Check that the file was sliced for this firmware"
    ),
    "hotend target": _ViolationRule("temperature", "Choose a temperature within the limits of the printer"),
    "bed target": _ViolationRule("temperature", "Choose a temperature within the limits of the printer"),
    "no such extruder": _ViolationRule("tool", "Slice for one extruder, or set `extruders`"),
    "move that cannot be parsed": _ViolationRule(
        "unreadable", "Write a number after every letter of this line"
    ),
    "arc without a centre": _ViolationRule("arc", "Switch arcs off in the slicer"),
}

_OTHER_VIOLATION: Final = _ViolationRule("machine", "")


def code_of_violation(what: str) -> str:
    """Return the diagnostic code for the text of a violation."""
    return _VIOLATION_RULES.get(violation_kind(what), _OTHER_VIOLATION).code


def _severity(harmless: bool) -> Severity:
    return "warning" if harmless else "error"


class FaultLocator:
    """Finds the line, layer and height of the command that caused a fault.

    Args:
        job: the job.
        deposition: its recorded extrusion; None if it was not recorded.
    """

    def __init__(self, job: Job, deposition: Deposition | None) -> None:
        self._job = job
        layers = deposition.layers if deposition is not None else ()
        self._marks, self._numbers = list(job.marks), list(job.marks.values())
        self._heights = {layer.number: layer.z for layer in layers if layer.length > 0}
        self._begins = [layer.first - 1 for layer in layers]
        self._layers = [layer.number for layer in layers]

    def locate(self, faults: Iterable[tuple[int, Diagnostic]]) -> list[Diagnostic]:
        """Add line, layer and height to faults; sort them by command index, -1 without a command."""
        found = sorted(faults, key=lambda one: (one[0] < 0, one[0]))
        lines = find_lines(self._job.text, [max(command, 0) for command, _ in found])
        return [
            fault if command < 0 else self._add_location(command, line, fault)
            for (command, fault), line in zip(found, lines, strict=True)
        ]

    def _add_location(self, command: int, line: int, fault: Diagnostic) -> Diagnostic:
        layer = self._layer_of(command)
        height = self._heights.get(layer) if layer else None
        return replace(fault, line=line, layer=layer, z=height if fault.z is None else fault.z)

    def _layer_of(self, command: int) -> int:
        begins, numbers = (self._marks, self._numbers) if self._marks else (self._begins, self._layers)
        at = bisect_right(begins, command)
        return numbers[at - 1] if at else 0


def firmware_faults(job: Job, report: Report, comparison: Comparison) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a diagnostic for each kind of violation that the printer recorded; count repetitions."""
    reported: set[str] = set()
    known = {(one.code, one.index): one for one in job.findings if one.is_error}
    # If a rule rejects a command for what it does, "unknown: ignored" would contradict it.
    rejected = {
        one.command.partition(" ")[0]
        for one in job.findings
        if one.is_error and one.code not in {"unknown", "unreadable"} and is_known_to_a_firmware(one.command)
    }
    inches = bool(report.violations) and uses_inches(job.commands)
    for violation in report.violations:
        what = violation.text
        kind = violation_kind(what)
        rule = _VIOLATION_RULES.get(kind, _OTHER_VIOLATION)
        code = what.partition(": ")[2].partition(" ")[0]
        key = f"{kind} {code}" if rule.code == "unknown" else kind
        if key in reported or not comparison.is_job_command(violation.line):
            continue
        if rule.code == "unknown" and code in rejected:
            continue
        if rule.code == "extrusion" and inches and "out of the machine" in reported:
            continue  # both may be caused by wrong units
        reported.add(key)
        same = sum(violation_kind(one.text) == kind and code in one.text for one in report.violations)
        times = same if rule.code == "unknown" else report.violation_counts.get(kind, 1)
        remedy = _INCHES_REMEDY if rule.code == "box" and inches else rule.remedy
        harmless = kind == _LIFT_BEFORE_HOMING or (rule.code == "unknown" and is_known_to_a_firmware(code))
        fault = Diagnostic(rule.code, _severity(harmless), what, remedy=remedy, times=times)
        index = comparison.command_of(violation.line)
        yield index, _use_lint_wording(fault, known.get((rule.code, index)))


def _use_lint_wording(fault: Diagnostic, finding: Diagnostic | None) -> Diagnostic:
    """Return a fault with the text of the lint finding for this command, so that both have one wording."""
    if finding is None or not fault.is_error:
        return fault
    times = max(fault.times, finding.times)
    return replace(
        fault, message=finding.message, reason=finding.reason, command=finding.command, times=times
    )


_DEFECT_TEXTS: Final[Mapping[str, Callable[[Defect], tuple[str, str]]]] = {
    "unsupported": lambda one: (
        f"{one.amount:.0f} mm of unsupported extrusion at x {one.x:.1f} y {one.y:.1f}",
        "Check for missing layers below, or add supports",
    ),
    "crash": lambda one: (
        f"the nozzle collides with the print, {one.depth:.2f} mm deep, at x {one.x:.1f} y {one.y:.1f}",
        "Raise the nozzle before this move: check z of this line and the lines before",
    ),
    "head": lambda one: (
        f"the head touches a printed part, {one.depth:.1f} mm deep, with its shape {one.amount:g} mm above the nozzle",
        "Print the parts farther apart or layer by layer, or correct printer.head",
    ),
    "bed": lambda one: (
        f"extrusion only {one.z:.3g} mm above the bed: the nozzle scrapes it",
        "Check the z offset and the units (a file in inches needs G20)",
    ),
    "pressed": lambda one: (
        (
            f"the nozzle presses {one.depth:.2f} mm into higher extrusions of its layer, on {one.amount:.0f} mm,"
            f" at x {one.x:.1f} y {one.y:.1f}"
        ),
        "Lay lower extrusions before higher ones",
    ),
}
"""Kind of defect -> functions that return message and remedy."""


def deposition_faults(
    profile: Profile, deposition: Deposition, defects: Sequence[Defect]
) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a diagnostic for the first defect of each kind, with the number of affected layers.

    Args:
        profile: the profile with the material.
        deposition: recorded extrusion of the print.
        defects: the defects that are not consequences of other faults.
    """
    for kind, make_text in _DEFECT_TEXTS.items():
        of_kind = [one for one in defects if one.kind == kind]
        if of_kind:
            what, remedy = make_text(of_kind[0])
            count = _count_layers(deposition, of_kind)
            yield (
                of_kind[0].command - 1,
                Diagnostic(
                    kind,
                    "warning" if kind == "pressed" else "error",
                    what,
                    remedy=remedy,
                    z=of_kind[0].z,
                    times=count,
                    place=(of_kind[0].x, of_kind[0].y),
                    amount=of_kind[0].amount,
                ),
            )
    yield from _flow_faults(profile, [one for one in defects if one.kind == "flow"])
    if (
        deposition.length > _MIN_LENGTH
        and 0 < deposition.speed < _MIN_SPEED
        and deposition.first_extrusion is not None
    ):
        what = f"half of all extrusion is slower than {deposition.speed:.2g} mm/s: F must be in mm/min"
        yield deposition.first_extrusion - 1, Diagnostic("speed", "error", what)


def _count_layers(deposition: Deposition, defects: Sequence[Defect]) -> int:
    """Return the number of layers with this kind of defect, including layers whose defects are not listed."""
    listed = sum(one.kind == defects[0].kind for one in deposition.defects)
    return deposition.counts[defects[0].kind] if len(defects) == listed else len(defects)


def _flow_faults(profile: Profile, defects: Sequence[Defect]) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a diagnostic if the flow exceeds the maximum of the material."""
    if not defects:
        return
    maximum = profile.max_flow
    errors = [one for one in defects if one.amount > maximum * SHORT_TERM_FLOW]
    first, worst = (errors or defects)[0], max(defects, key=lambda one: one.amount)
    what = f"flow {first.amount:.1f} mm³/s, {profile.material.name} allows {maximum:g} mm³/s"
    what += f", {worst.amount:.1f} mm³/s in layer {worst.layer}" if worst.amount > first.amount * 1.05 else ""
    remedy = "Print slower or thinner, or set material.max_flow for your material"
    yield (
        first.command - 1,
        Diagnostic(
            "flow",
            _severity(not errors),
            what,
            remedy=remedy,
            z=first.z,
            times=len(errors or defects),
            place=(first.x, first.y),
            amount=first.amount,
            limit=maximum,
        ),
    )


def heaters_left_on(
    job: Job, profile: Profile, targets: Mapping[str, float]
) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a diagnostic for each heater that is on at the end, at the last command that set its target.

    An end macro of the printer may switch them off. Its contents are unknown, so with one this is only a warning.

    Args:
        job: the executed job.
        profile: the profile with the firmware, which may have macros.
        targets: target temperature of "nozzle" and "bed", °C.
    """
    off = {"nozzle": "M104 S0", "bed": "M140 S0"}
    for heater, target in targets.items():
        if target <= 0:
            continue
        last = next(
            (
                index
                for index in range(len(job.commands) - 1, -1, -1)
                if find_heater(parse(job.commands[index])[0].decode()) == heater
            ),
            -1,
        )
        what = f"the {heater} stays on at {target:.0f} °C at the end"
        macro = _find_end_macro(job, last) if profile.printer.firmware.dialect.extended_commands else ""
        if macro.upper() == _TURN_OFF_MACRO:
            continue
        if macro:
            what += f", unless the macro {macro} of the printer switches it off"
            remedy = f"Check that the macro contains {off[heater]} or {_TURN_OFF_MACRO}"
        else:
            remedy = f"End with {off[heater]}"
        yield last, Diagnostic("heater", _severity(bool(macro)), what, remedy=remedy)


def _find_end_macro(job: Job, last: int) -> str:
    """Return the name of the last end macro after the command with index `last`; empty without one."""
    for command in reversed(job.commands[last + 1 :]):
        if macro := match_end_macro(command.decode("latin-1")):
            return macro
    return ""


def start_macro_note(job: Job, profile: Profile) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a note if a start macro is assumed to home and heat, because no earlier command homes.

    Args:
        job: the executed job.
        profile: the profile with the firmware, which may have macros.
    """
    if not profile.printer.firmware.dialect.extended_commands:
        return
    for index, command in enumerate(job.commands[: min(job.marks, default=_MAX_START_COMMANDS)]):
        if parse(command)[0] == b"G28":
            return
        if macro := match_start_macro(command.decode("latin-1")):
            what = f"the macro {macro} of the printer is assumed to home all axes and to heat"
            yield index, Diagnostic("homing", "warning", what, remedy="Check that the macro does this")
            return


def underrun_faults(
    report: Report, comparison: Comparison, baud: int, *, baud_given: bool
) -> Iterator[tuple[int, Diagnostic]]:
    """Yield a diagnostic if the printer stands still on the part because lines arrive too late."""
    if report.underrun_seconds <= _MAX_STANDSTILL:
        return
    longest = max(seconds for _, seconds in report.underrun_list)
    first = next(command for command, seconds in report.underrun_list if seconds >= longest - _SAME_DURATION)
    what = f"{baud} baud is too slow: buffer underruns of {report.underrun_seconds:.1f} s in total, the longest here"
    remedy = "Use a higher baud rate, or set printer.link_lines_per_second, arc_tolerance or resolution"
    yield (
        comparison.command_of(first),
        Diagnostic("underrun", _severity(not baud_given), what, remedy=remedy, times=report.underruns),
    )
