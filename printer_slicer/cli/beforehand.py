"""`check` of a job before it is printed: what it holds, and where a link would be too slow for it."""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any, Final

from printer_slicer.cli.common import profile_facts, profile_from
from printer_slicer.cli.policy import finding_facts, finding_lines, refused
from printer_slicer.commands import lines_of
from printer_slicer.durations import spoken
from printer_slicer.gcode import FLAVOURS, read_moves
from printer_slicer.inspection.dry_run.feasibility import Feasibility, Link, SlowStretch, feasibility
from printer_slicer.inspection.lint.lint_jobs import lint_file
from printer_slicer.jobs import Job
from printer_slicer.motion.machine import limits_of

__all__ = ["Looked", "look"]

_TOLD: Final = 8  # stretches, without --verbose
_SPARE: Final = 0.95  # of the lines that a link carries are asked of it


@dataclass(frozen=True, slots=True)
class Looked:
    """What was seen: for programs, for people, and what is wrong."""

    facts: dict[str, Any]
    lines: list[str]
    wrong: list[str]


def look(arguments: argparse.Namespace) -> Looked:
    """Look at the job that a G-code file makes.

    Raises:
        UsageError: it is no job, or the profile or a name makes no sense.
    """
    profile = profile_from(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile).allowing(arguments.allow)
    wrong = refused(job)
    facts: dict[str, Any] = {"allowed": sorted(arguments.allow), "policy": finding_facts(job)}
    lines = [
        f"{job.name}: {len(job.commands)} commands, {spoken(job.seconds)} of motion on {profile.printer.name}"
    ]
    lines += [f"refused     {one}" for one in wrong] or ["policy      nothing is refused"]
    lines += finding_lines(arguments, job)
    if arguments.link:
        link = Link(
            arguments.link,
            latency_back=arguments.latency / 1000,
            window_lines=arguments.window,
            window_bytes=profile.printer.receive_buffer - 1,
        )
        printer = profile.printer
        moves = read_moves(job.commands, printer.corners[0], FLAVOURS[printer.flavour])
        told = _located(job, feasibility(job.commands, moves, limits_of(printer), link, job.marks))
        facts["link"] = _facts(told)
        lines += _lines(arguments, told)
        wrong += _wrong(told)
    return Looked(facts | profile_facts(arguments), lines, wrong)


def _located(job: Job, told: Feasibility) -> Feasibility:
    """The same with lines of the text."""
    firsts = lines_of(job.text, [one.first for one in told.stretches])
    lasts = lines_of(job.text, [one.last for one in told.stretches])
    stretches = zip(told.stretches, firsts, lasts, strict=True)
    return replace(
        told, stretches=tuple(replace(one, line=first, last_line=last) for one, first, last in stretches)
    )


def _facts(told: Feasibility) -> dict[str, Any]:
    return asdict(told) | {"ok": told.ok, "advice": _advice(told)}


def _lines(arguments: argparse.Namespace, told: Feasibility) -> list[str]:
    """For people."""
    link = told.link
    rate = "any number of" if told.lines_per_second == inf else f"{told.lines_per_second:.0f}"
    yes = f"{link.baud} Bd, {link.latency_back * 1000:g} ms, {link.window_lines} lines in flight: {rate} lines/s"
    if told.ok:
        return [f"link        {yes}; the machine never waits for lines"]
    lines = [f"link        {yes}", f"            {_summary(told)}"]
    most = len(told.stretches) if arguments.verbose else _TOLD
    worst = sorted(told.stretches, key=lambda one: -one.seconds)[:most]
    lines += [f"            {_sentence(one)}" for one in sorted(worst, key=lambda one: one.first)]
    if len(told.stretches) > most:
        lines.append(f"            ... and {len(told.stretches) - most} more that lose less (-v tells all)")
    return [*lines, f"            {_advice(told)}"]


def _summary(told: Feasibility) -> str:
    n = len(told.stretches)
    lost = sum(one.seconds for one in told.stretches)
    many = "1 stretch" if n == 1 else f"{n} stretches"
    stands = f"it stands still {told.stalls} times" if told.stalls else "it never stands still"
    return (
        f"the machine waits for lines in {many}: {lost:.1f} s lost, {stands}"
        f" ({spoken(told.seconds)} instead of {spoken(told.unhindered)})"
    )


def _sentence(one: SlowStretch) -> str:
    layer = f"layer {one.layer}, " if one.layer else ""
    return (
        f"{layer}lines {one.line} to {one.last_line}: {one.wanted:.0f} lines/s wanted, {one.possible:.0f} come, "
        f"{one.seconds:.1f} s lost"
    )


def _advice(told: Feasibility) -> str:
    if told.ok:
        return ""
    rate = int(told.lines_per_second * _SPARE)
    return f"slice for this link: --set printer.link_lines_per_second={rate}; or raise the speed of the port"


def _wrong(told: Feasibility) -> list[str]:
    return [] if told.ok else [f"the link is too slow: {_summary(told)}"]
