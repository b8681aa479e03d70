"""Check the commands and moves of G-code text, and make a job from the text."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from printer_slicer.commands import find_lines, read_text
from printer_slicer.diagnostics import Diagnostic, Severity
from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode import Moves, read_moves_in_pieces
from printer_slicer.gcode.commands import Effect, find_codes_as_text
from printer_slicer.gcode.lexer import LintCommand, read_commands
from printer_slicer.inspection.deposition.marks import marks_of
from printer_slicer.inspection.deposition.support_gaps import SupportGaps
from printer_slicer.inspection.deposition.unsupported import UnsupportedTracker
from printer_slicer.inspection.lint.heat import HeaterRules
from printer_slicer.inspection.lint.motion import MoveChecker
from printer_slicer.inspection.lint.readiness import ReadinessChecker
from printer_slicer.inspection.lint.syntax import (
    describe_lower_case_fault,
    describe_number_faults,
    is_known_to_a_firmware,
)
from printer_slicer.inspection.lint.table import RULES, Rule
from printer_slicer.jobs import Job, JobSummary, split_sendable
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["lint_file", "lint_text", "scan"]

_RULES: Final[Mapping[str, tuple[Rule, ...]]] = {
    code: tuple(rule for rule in RULES if code in rule.codes) for rule in RULES for code in rule.codes
}
_SCRIPT_KEYWORDS: Final = frozenset({"IF", "ELIF", "ELSE", "WHILE", "VAR", "GLOBAL", "SET", "ABORT"})
_STATE_COMMANDS: Final = find_codes_as_text(
    Effect.MOVES | Effect.HOMES | Effect.SETS_POSITION | Effect.MODE | Effect.UNITS
)
_PLAIN_WORD: Final = r" *[XYZEFIJR] *[-+]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)"
_UNUSUAL_LINE: Final = re.compile(rf"(?m)^(?!G[0-3](?:{_PLAIN_WORD})++ *$).+$".encode())
"""Matches a line that is not a plain move, or has a word that is not a letter and a number."""

_BLOCK_SIZE: Final = 1 << 15
_ProblemKey = tuple[str, Severity, str, str]


def scan(
    commands: Sequence[bytes],
    profile: Profile,
    *,
    moves: Iterable[Moves] | None = None,
    marks: Mapping[int, int] | None = None,
    whole: bool = False,
    tracker: UnsupportedTracker | None = None,
) -> tuple[Diagnostic, ...]:
    """Find dangerous and suspicious commands and moves in a job.

    Args:
        commands: one per entry, without comments, as they are sent.
        profile: the printer and its material, with their limits.
        moves: of the commands, batch by batch; None reads them from the commands.
        marks: command index at which a layer begins -> layer, ascending.
        whole: whether the commands are a complete print, which must home and heat by itself.
        tracker: finds unsupported extrusion; None if the commands are not a complete print.

    Returns:
        Diagnostics in the order of the commands; repetitions are counted.
    """
    if moves is None:
        dialect = FLAVOURS[profile.printer.flavour]
        moves = read_moves_in_pieces(commands, profile.printer.corners[0], dialect)
    found: dict[_ProblemKey, Diagnostic] = {}
    factors: list[tuple[int, float]] = []
    heat, readiness = HeaterRules(profile), ReadinessChecker(profile.printer.flavour)
    for index, line in _find_unusual_commands(commands):
        for command in read_commands(line):
            readiness.process_command(index, command)
            if command.code == "M221" and (ratio := command.find_largest_number("S")):
                factors.append((index, ratio / 100))
            for name, severity, message, reason in _check_command(command, line, profile, heat):
                # Files may contain an unknown command many times, each time with other words.
                shown = command.code if name == "unknown" else line.decode("latin-1")
                key = (name, severity, message, shown)
                old = found.get(key)
                found[key] = (
                    replace(old, times=old.times + 1)
                    if old
                    else Diagnostic(name, severity, message, reason, index=index, command=shown)
                )
    move_checker = MoveChecker(profile, factors, tracker)
    for piece in moves:
        move_checker.check(piece)
        if whole:
            readiness.check_moves(piece)
    everything = [*found.values(), *move_checker.findings(commands), *readiness.findings(commands)]
    return _sort_by_command(everything, marks or {})


def _find_unusual_commands(commands: Sequence[bytes]) -> Iterator[tuple[int, bytes]]:
    """Yield the index and text of each command that is not a plain move."""
    for begin in range(0, len(commands), _BLOCK_SIZE):
        text = b"\n".join(commands[begin : begin + _BLOCK_SIZE])
        index, at = begin, 0
        for found in _UNUSUAL_LINE.finditer(text):
            index += text.count(b"\n", at, found.start())
            at = found.start()
            yield index, found.group()


def _sort_by_command(findings: Iterable[Diagnostic], marks: Mapping[int, int]) -> tuple[Diagnostic, ...]:
    """Add the layer to each diagnostic, and sort the diagnostics by command."""
    begins, layers = list(marks), list(marks.values())
    placed = (
        replace(one, layer=layers[at - 1] if (at := bisect_right(begins, one.index)) else 0)
        for one in findings
    )
    return tuple(sorted(placed, key=lambda one: (one.index, not one.is_error, one.code)))


def _check_command(
    command: LintCommand, line: bytes, profile: Profile, heat: HeaterRules
) -> Iterator[_ProblemKey]:
    """Yield the diagnostic code, severity, message and reason of each problem of a command."""
    if message := heat.check_command(command):
        yield "temperature", "error", message, "The heater may overheat"
    for rule in _RULES.get(command.code, ()):
        result = rule.check(command, profile.printer)
        if result is not None:
            is_error, message = result
            yield rule.name, "error" if is_error else "warning", message, rule.reason
    if not command.further and (message := describe_lower_case_fault(line, profile.printer.flavour)):
        yield "unreadable", "error", message, "The firmware ignores unknown commands"
    for message in describe_number_faults(command, profile.printer.flavour):
        yield "unreadable", "error", message, "Firmwares interpret it differently"
    if command.code[:1] == "D" and command.code[1:].lstrip("-").isdigit():
        yield "debug", "error", "is a debug command", "It may read and write memory and pins"
    if not command.further and _is_unknown(command, profile):
        yield "unknown", "warning", "unknown command", "The printer ignores this command"
    scripted = command.code in _SCRIPT_KEYWORDS and "_" not in command.code
    if scripted or (command.code in _STATE_COMMANDS and (command.further or "{" in command.text)):
        yield "unreadable", "error", "cannot be interpreted", "Its effect depends on the firmware"


def _is_unknown(command: LintCommand, profile: Profile) -> bool:
    """Return whether no firmware of this kind knows a command; macros (`PRINT_START`) and scripts do not count."""
    code = command.code
    if "_" in code or "=" in command.text:
        return False
    if FLAVOURS[profile.printer.flavour].extended_commands or code in _SCRIPT_KEYWORDS or code in _RULES:
        return False
    is_debug = code[:1] == "D" and code[1:].lstrip("-").isdigit()
    return bool(code) and not is_debug and not is_known_to_a_firmware(code)


def lint_file(path: Path, profile: Profile, *, streamed: bool = True) -> Job:
    """Read and check a G-code file.

    Args:
        path: of the file.
        profile: the printer and its material, with their limits.
        streamed: whether the file is sent line by line; uploaded files may have longer lines.

    Raises:
        PrinterSlicerError: the file cannot be read or sent.
    """
    return lint_text(path.name, read_text(path), profile, streamed=streamed)


def lint_text(
    name: str, text: bytes, profile: Profile, *, streamed: bool = True, dialect: Dialect | None = None
) -> Job:
    """Make a job from G-code text and check it.

    Args:
        name: of the job.
        text: the G-code.
        profile: the printer and its material, with their limits.
        streamed: whether the file is sent line by line; uploaded files may have longer lines.
        dialect: of the G-code; None: that of the printer.

    Raises:
        UsageError: the text has no commands, or a line that cannot be sent.
    """
    printer = profile.printer
    content = split_sendable(name, text, streamed=streamed)
    pieces = read_moves_in_pieces(content.commands, printer.corners[0], dialect or FLAVOURS[printer.flavour])
    summary = JobSummary(limits_of(printer))
    marks = marks_of(content.commands, text, content.marks, content.roles, SupportGaps.of(profile))
    tracker = UnsupportedTracker(printer.corners, profile.material.filament_area, marks)
    moves = map(summary.add, pieces)
    findings = scan(content.commands, profile, moves=moves, marks=content.marks, whole=True, tracker=tracker)
    lines = find_lines(text, [one.index for one in findings])
    placed = tuple(replace(one, line=line) for one, line in zip(findings, lines, strict=True))
    return replace(summary.make_job(name, text, content), findings=placed)
