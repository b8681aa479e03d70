"""What would go wrong, where, and what helps: from the printer's account and that of its material."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from printer_slicer.commands import find_lines
from printer_slicer.diagnostics import Diagnostic, Severity
from printer_slicer.gcode.commands import heater_of
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import uses_inches
from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.deposition.record import Deposition
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.lint.motion import MELTS
from printer_slicer.jobs import Job
from printer_slicer.printer_macros import match_end_macro, match_start_macro
from printer_slicer.profile import Profile
from printer_slicer.sim.tally import Report, kind_of

__all__ = [
    "Places",
    "left_on",
    "made_ready",
    "of_machine",
    "of_material",
    "rule_of",
    "starved",
]

_SLOW: Final = 2.0  # mm/s; nobody prints like that
_ENOUGH: Final = 50.0  # mm of beads before a whole file is judged by how fast they are laid
_STANDS: Final = 0.25  # s in all that a machine may stand still for want of lines
_AS_LONG: Final = 1e-3  # s; of stops that differ by less, the first is named

_KNOWN: Final = re.compile(
    r"G(?:[0-6]|1[0-2]|1[7-9]|2[0-9]|3[0-8]|42|5[3-9]|6[01]|76|80|9[0-2])\b"
    r"|M(?:\d|1\d|2[0-9]|3[0-4]|4[238]|7[2-8]|8[0-6]|92|9[38]|1[0-6]\d|19[1-3]|2\d\d|30[0-9]|3[567]\d|38[0-2]|4[0-3]\d"
    r"|48[0-9]|49[0-9]|5[0-9]\d|6[0-7]\d|7[01]\d|8[01]\d|85\d|86\d|87\d|88\d|89\d|9\d\d|100\d)\b|T\d|@"
)
"""Commands that some firmware has: what the simulated one does not know of them, real ones may, or pass over."""


_TURNS_OFF: Final = "TURN_OFF_HEATERS"
_BEFORE_LAYERS: Final = 1000  # commands in which a file without comments makes the printer ready


_INCHES: Final = "the file counts in inches (G20): is it in mm?"


class _Rule(NamedTuple):
    """How a violation that the printer tells is said: its code, and what helps."""

    code: str
    remedy: str


_LIFTED: Final = "raised the nozzle before homing"

_RULES: Final[Mapping[str, _Rule]] = {
    "cold extrusion prevented": _Rule("cold", "heat the nozzle first: M109 S and a temperature"),
    "too long extrusion prevented": _Rule("extrusion", "look at M82, M83 and G92 E0 before it"),
    "out of the machine": _Rule(
        "box", "move the part, or name the printer that it was made for with --printer"
    ),
    "moved before homing": _Rule("homing", "begin with G28"),
    _LIFTED: _Rule("homing", "home first, if the nozzle may stand at the top"),
    "probed before homing": _Rule("homing", "put G28 before G29"),
    "unknown command": _Rule("unknown", "the printer passes over it; is the file made for this firmware?"),
    "hotend asked for": _Rule("temperature", "choose a temperature that the printer stands"),
    "bed asked for": _Rule("temperature", "choose a temperature that the printer stands"),
    "no such extruder": _Rule("tool", "slice for one extruder, or say how many there are: --extruders N"),
    "move that cannot be parsed": _Rule("unreadable", "write a number after every letter of this line"),
    "arc without a centre": _Rule("arc", "switch arcs off in the slicer"),
}

_MACHINE: Final = _Rule("machine", "")


def rule_of(what: str) -> str:
    """Return the code of a violation."""
    return _RULES.get(kind_of(what), _MACHINE).code


def _severity(harmless: bool) -> Severity:
    return "warning" if harmless else "error"


class Places:
    """Where in its text a command of a job stands, and in which layer at which height.

    Args:
        job: the commands.
        account: of their material, if it was kept.
    """

    def __init__(self, job: Job, account: Deposition | None) -> None:
        self._job = job
        layers = account.layers if account is not None else ()
        self._marks, self._numbers = list(job.marks), list(job.marks.values())
        self._heights = {layer.number: layer.z for layer in layers if layer.length > 0}
        self._begins = [layer.first - 1 for layer in layers]
        self._layers = [layer.number for layer in layers]

    def put(self, faults: Iterable[tuple[int, Diagnostic]]) -> list[Diagnostic]:
        """Faults with line, layer and height, in the order of the commands told with them (from 0; -1: of none)."""
        found = sorted(faults, key=lambda one: (one[0] < 0, one[0]))
        lines = find_lines(self._job.text, [max(command, 0) for command, _ in found])
        return [
            fault if command < 0 else self._put(command, line, fault)
            for (command, fault), line in zip(found, lines, strict=True)
        ]

    def _put(self, command: int, line: int, fault: Diagnostic) -> Diagnostic:
        layer = self._layer(command)
        height = self._heights.get(layer) if layer else None
        return replace(fault, line=line, layer=layer, z=height if fault.z is None else fault.z)

    def _layer(self, command: int) -> int:
        begins, numbers = (self._marks, self._numbers) if self._marks else (self._begins, self._layers)
        at = bisect_right(begins, command)
        return numbers[at - 1] if at else 0


def of_machine(job: Job, report: Report, comparison: Comparison) -> Iterator[tuple[int, Diagnostic]]:
    """What the firmware refused or clipped; the same thing in several commands is told once."""
    told: set[str] = set()
    inches = bool(report.violations) and uses_inches(job.commands)
    for violation in report.violations:
        what = violation.text
        kind = kind_of(what)
        rule = _RULES.get(kind, _MACHINE)
        code = what.partition(": ")[2].partition(" ")[0]
        key = f"{kind} {code}" if rule.code == "unknown" else kind
        if key in told or not comparison.of_job(violation.line):
            continue
        if rule.code == "extrusion" and inches and "out of the machine" in told:
            continue  # too far and too much come from the same slip
        told.add(key)
        same = sum(kind_of(one.text) == kind and code in one.text for one in report.violations)
        times = same if rule.code == "unknown" else report.violation_counts.get(kind, 1)
        remedy = _INCHES if rule.code == "box" and inches else rule.remedy
        harmless = kind == _LIFTED or (rule.code == "unknown" and _KNOWN.match(code) is not None)
        yield (
            comparison.command_of(violation.line),
            Diagnostic(rule.code, _severity(harmless), what, remedy=remedy, times=times),
        )


def of_material(
    profile: Profile, account: Deposition, mishaps: Sequence[Defect]
) -> Iterator[tuple[int, Diagnostic]]:
    """The first fault of each kind, and in how many layers there are such.

    Args:
        profile: with the material.
        account: of it.
        mishaps: those of the account that follow from nothing else.
    """
    say: Mapping[str, Callable[[Defect], tuple[str, str]]] = {
        "unsupported": lambda one: (
            f"{one.amount:.0f} mm of beads lie in the air, at x {one.x:.1f} y {one.y:.1f}: nothing there holds them",
            "is a layer missing below, or support?",
        ),
        "crash": lambda one: (
            f"the nozzle goes {one.depth:.2f} mm deep through what is printed, at x {one.x:.1f} y {one.y:.1f}",
            "raise the nozzle before it goes there; look at the z of this line and those before it",
        ),
        "bed": lambda one: (
            f"beads lie {one.z:.3g} mm over the bed: the nozzle scrapes it",
            "are z offset and units right? A file in inches needs G20",
        ),
    }
    for kind, words in say.items():
        own = [one for one in mishaps if one.kind == kind]
        if own:
            what, remedy = words(own[0])
            count = _how_often(account, own)
            yield (
                own[0].command - 1,
                Diagnostic(
                    kind,
                    "error",
                    what,
                    remedy=remedy,
                    z=own[0].z,
                    times=count,
                    place=(own[0].x, own[0].y),
                    amount=own[0].amount,
                ),
            )
    yield from _of_flow(profile, [one for one in mishaps if one.kind == "flow"])
    if account.length > _ENOUGH and 0 < account.speed < _SLOW and account.laid is not None:
        what = f"half of everything is laid slower than {account.speed:.2g} mm/s: F counts mm/min"
        yield account.laid - 1, Diagnostic("speed", "error", what)


def _how_often(account: Deposition, own: Sequence[Defect]) -> int:
    """How many layers have mishaps of one kind: more than are listed, if none of the list is left out."""
    listed = sum(one.kind == own[0].kind for one in account.mishaps)
    return account.counts[own[0].kind] if len(own) == listed else len(own)


def _of_flow(profile: Profile, own: Sequence[Defect]) -> Iterator[tuple[int, Diagnostic]]:
    """More plastic per second than the material melts."""
    if not own:
        return
    most = profile.max_flow
    far = [one for one in own if one.amount > most * MELTS]
    first, worst = (far or own)[0], max(own, key=lambda one: one.amount)
    what = f"{first.amount:.1f} mm3/s of plastic; {profile.material.name} melts {most:g}"
    what += f"; {worst.amount:.1f} in layer {worst.layer}" if worst.amount > first.amount * 1.05 else ""
    remedy = "print slower or thinner, or set material.max_flow to what yours melts"
    yield (
        first.command - 1,
        Diagnostic(
            "flow",
            _severity(not far),
            what,
            remedy=remedy,
            z=first.z,
            times=len(far or own),
            place=(first.x, first.y),
            amount=first.amount,
            limit=most,
        ),
    )


def left_on(job: Job, profile: Profile, targets: Mapping[str, float]) -> Iterator[tuple[int, Diagnostic]]:
    """Heaters that are still on when all is done, and the command that had the last word.

    A macro of the printer that ends prints may switch them off. Its contents are unknown, so the fault says so.

    Args:
        job: that was executed.
        profile: its firmware may have macros.
        targets: °C, by "nozzle" and "bed".
    """
    off = {"nozzle": "M104 S0", "bed": "M140 S0"}
    for heater, target in targets.items():
        if target <= 0:
            continue
        last = next(
            (
                index
                for index in range(len(job.commands) - 1, -1, -1)
                if heater_of(parse(job.commands[index])[0].decode()) == heater
            ),
            -1,
        )
        what = f"the {heater} stays on at {target:.0f} °C when all is done"
        macro = _macro_behind(job, last) if profile.printer.firmware.dialect.extended_commands else ""
        if macro.upper() == _TURNS_OFF:
            continue
        if macro:
            what += f", unless the printer's macro {macro} switches it off"
            remedy = f"check that the macro contains {off[heater]} or {_TURNS_OFF}"
        else:
            remedy = f"end with {off[heater]}"
        yield last, Diagnostic("heater", _severity(bool(macro)), what, remedy=remedy)


def _macro_behind(job: Job, last: int) -> str:
    """Return the last macro after a command whose name suggests that it ends prints or cools; empty if none."""
    for command in reversed(job.commands[last + 1 :]):
        if macro := match_end_macro(command.decode("latin-1")):
            return macro
    return ""


def made_ready(job: Job, profile: Profile) -> Iterator[tuple[int, Diagnostic]]:
    """The macro of the printer's own that is trusted to home and to heat, for nothing before it homes.

    Args:
        job: that was executed.
        profile: whose firmware may have macros.
    """
    if not profile.printer.firmware.dialect.extended_commands:
        return
    for index, command in enumerate(job.commands[: min(job.marks, default=_BEFORE_LAYERS)]):
        if parse(command)[0] == b"G28":
            return
        if macro := match_start_macro(command.decode("latin-1")):
            what = f"{macro} is a macro of the printer's own; it is taken to home all axes and to heat"
            yield index, Diagnostic("homing", "warning", what, remedy="see that it does")
            return


def starved(
    report: Report, comparison: Comparison, baud: int, *, asked: bool
) -> Iterator[tuple[int, Diagnostic]]:
    """Standing still, with the nozzle on the part, because lines did not come in time."""
    if report.starved_seconds <= _STANDS:
        return
    most = max(seconds for _, seconds in report.starved)
    first = next(command for command, seconds in report.starved if seconds >= most - _AS_LONG)
    what = (
        f"the machine runs out of moves at {baud} Bd, {report.starved_seconds:.1f} s in all, most of it here"
    )
    remedy = "use a faster link, or let the slicer suit it: printer.link_lines_per_second, arc_tolerance, resolution"
    yield (
        comparison.command_of(first),
        Diagnostic("underrun", _severity(not asked), what, remedy=remedy, times=report.starvations),
    )
