"""Make jobs of G-code files and texts, with what the rules find in them."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path

from printer_slicer.commands import lines_of, read_text
from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode import pieces_of
from printer_slicer.inspection.deposition.marks import marks_of
from printer_slicer.inspection.deposition.unsupported import UnsupportedTracker
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.jobs import Job, JobSummary, sendable
from printer_slicer.motion.machine import limits_of
from printer_slicer.profile import Profile

__all__ = ["lint_file", "lint_text"]


def lint_file(path: Path, profile: Profile, *, streamed: bool = True) -> Job:
    """Read a G-code file as a job, with what is found in it.

    Args:
        path: of the file.
        profile: the machine and its material, with their limits.
        streamed: whether it goes to the printer line by line; what is uploaded may hold longer lines.

    Raises:
        PrinterSlicerError: the file cannot be read or sent.
    """
    return lint_text(path.name, read_text(path), profile, streamed=streamed)


def lint_text(
    name: str, text: bytes, profile: Profile, *, streamed: bool = True, flavour: Dialect | None = None
) -> Job:
    """Make a job of a text, with what is found in it.

    Args:
        name: what to call it.
        text: the G-code.
        profile: the machine and its material, with their limits.
        streamed: whether it goes to the printer line by line; what is uploaded may hold longer lines.
        flavour: whose meanings commands have; the printer's where it is not given.

    Raises:
        UsageError: there is nothing in it, or something that can never be sent.
    """
    printer = profile.printer
    told = sendable(name, text, streamed=streamed)
    pieces = pieces_of(told.commands, printer.corners[0], flavour or FLAVOURS[printer.flavour])
    summary = JobSummary(limits_of(printer))
    marks = marks_of(told.commands, text, told.marks, told.roles)
    tracker = UnsupportedTracker(printer.corners, pi * profile.material.filament_diameter**2 / 4, marks)
    moves = map(summary.add, pieces)
    findings = scan(told.commands, profile, moves=moves, marks=told.marks, whole=True, tracker=tracker)
    lines = lines_of(text, [one.index for one in findings])
    placed = tuple(replace(one, line=line) for one, line in zip(findings, lines, strict=True))
    return replace(summary.job(name, text, told), findings=placed)
