"""Diagnostics: errors and warnings about a print, and the table of their codes.

`CODES` is the single source for the table of `docs/diagnostics.md`, the names that `--allow` takes, the remedies, and
`code` and `severity` in the JSON of `slice`, `check`, `dry-run` and `print`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

from printer_slicer.errors import PolicyError, UsageError
from printer_slicer.values import Struct, as_dict, force_setattr

__all__ = [
    "CODES",
    "NAMES",
    "Code",
    "Diagnostic",
    "Severity",
    "as_former_json",
    "as_json",
    "check_allowed_codes",
    "format_first_error",
    "format_remedies",
    "raise_on_errors",
    "sentence",
]

Severity = Literal["error", "warning"]
"""An error blocks the job, or means that the part will not print correctly. A warning has no such effect."""


class Code(NamedTuple):
    """One row of the table of diagnostic codes.

    Attributes:
        found_by: the inspections that report it, separated by commas: "lint", "coverage", "dry run".
        severity: the highest severity it can have.
        meaning: what the code stands for.
        remedy: general advice; a diagnostic may have more specific advice.
        allowed: whether `--allow CODE` lets a job pass.
        kind: value of `kind` in JSON, if it differs from the code.
    """

    found_by: str
    severity: Severity
    meaning: str
    remedy: str
    allowed: bool = False
    kind: str = ""


def _lint_code(meaning: str, remedy: str = "Remove it from the G-code") -> Code:
    """Return a row for a code that only the lint rules report; all of these codes can be allowed."""
    return Code("lint", "error", meaning, remedy, allowed=True)


def _coverage_code(meaning: str, remedy: str, kind: str = "") -> Code:
    """Return a row for a code that only the comparison with the model reports."""
    return Code("coverage", "error", meaning, remedy, kind=kind)


def _dry_run_code(meaning: str, remedy: str, kind: str = "") -> Code:
    """Return a row for a code that only the dry run reports."""
    return Code("dry run", "error", meaning, remedy, kind=kind)


_SET_PRINTER: Final = "Set `printer` and `material` to those that the file was sliced for"

CODES: Final[Mapping[str, Code]] = {
    "temperature": Code(
        "lint, dry run",
        "error",
        "temperature above the maximum of the profile, or not readable",
        _SET_PRINTER,
        True,
    ),
    "box": Code("lint, dry run", "error", "move outside the printable area", _SET_PRINTER, True),
    "feed": _lint_code("feed rate far above the maximum speed of the profile", _SET_PRINTER),
    "flow": Code(
        "lint, dry run", "error", "volumetric flow above the max_flow of the material", _SET_PRINTER, True
    ),
    "ratio": _lint_code("flow or speed override far from 100% (M221, M220)"),
    "unsupported": Code(
        "lint, coverage, dry run",
        "error",
        "unsupported extrusion: nothing below holds it",
        "Rotate the part or add supports",
        True,
        "air",
    ),
    "cold": Code(
        "lint, dry run",
        "error",
        "extrusion below the minimum temperature of the firmware (M302, or the nozzle was not heated)",
        "Heat the nozzle first (for example M109 S210) and remove M302",
        True,
    ),
    "homing": Code(
        "lint, dry run",
        "error",
        "move before homing, or extrusion after the motors were switched off",
        "Home first (G28) and keep the motors on",
        True,
    ),
    "eeprom": _lint_code(
        "command that stores, loads or resets firmware settings (M500, M501, M502, M504, SAVE_CONFIG)"
    ),
    "limits": _lint_code(
        "speed, acceleration or jerk limit far above that of the profile (M201 to M205)", _SET_PRINTER
    ),
    "calibration": _lint_code(
        "command that changes steps per mm, motor currents, geometry or PID values"
        " (M92, M301, M304, M350, M665, M906 and others)"
    ),
    "autotune": _lint_code("PID autotune, which heats by itself (M303)"),
    "protection": _lint_code("command that changes the protection of the heaters (M143, M562, M570)"),
    "endstops": _lint_code("command that switches the software endstops off (M211 S0, M564)"),
    "offsets": _lint_code("command that shifts the origin (M206, M290, M428, M851, G10 L2, G54 to G59)"),
    "halt": _lint_code("command that halts the printer (M112, M410); power off (M81) is only a warning"),
    "wait": _lint_code("wait for a person without a time limit (M0, M1)"),
    "firmware": _lint_code("command that updates or restarts the firmware (M997, M999, FIRMWARE_RESTART)"),
    "files": _lint_code(
        "command that reads, writes or deletes files on the printer (M23, M24, M28, M30, M32, M928)"
    ),
    "pins": _lint_code("command that switches pins of the board directly (M42, M43)"),
    "macros": _lint_code("command that stores or runs a macro (M810 to M819)"),
    "link": _lint_code(
        "command that disturbs the connection: baud rate, line numbers, replies, network"
        " (M575, M110, M118 ok, M552, M586 to M589)"
    ),
    "debug": _lint_code("debug command (D0 and others, M111)"),
    "shell": _lint_code("command that runs a program on the computer of the printer (RUN_SHELL_COMMAND)"),
    "unreadable": Code(
        "lint, dry run",
        "error",
        "command that cannot be parsed: expression, several commands in a line, letter without a number,"
        " lower case, G5, G18",
        _SET_PRINTER,
        True,
    ),
    "uncovered": _coverage_code(
        "gap in the shell of the part", "Look for missing extrusions or a wrong extrusion width"
    ),
    "outside": _coverage_code(
        "extrusion outside the outline of the part", "Check that this is the model that was sliced"
    ),
    "overlap": _coverage_code(
        "more material than fits, because extrusions overlap", "Look for duplicate extrusions"
    ),
    "underfilled": _coverage_code(
        "too little material in the shell", "Check flow and filament diameter", "under"
    ),
    "overfilled": _coverage_code(
        "too much material in the shell", "Check flow and filament diameter", "over"
    ),
    "outline": _coverage_code(
        "printed outline that differs from the part", "Check size compensation and scale"
    ),
    "contour": _coverage_code(
        "contoured extrusion above or below the surface of the part",
        "Check that this is the model that was sliced",
    ),
    "crash": _dry_run_code("collision of the nozzle with the print", "Raise the nozzle before this move"),
    "head": Code(
        "lint, dry run",
        "error",
        "contact of the print head or the gantry with a printed part",
        "Print the parts farther apart or layer by layer, or correct printer.head",
        True,
    ),
    "pressed": Code(
        "dry run",
        "warning",
        "underside of the nozzle within higher extrusions of the same layer",
        "Lay lower extrusions before higher ones",
    ),
    "bed": _dry_run_code(
        "extrusion so low that the nozzle scrapes the bed", "Check the z offset and the units"
    ),
    "speed": _dry_run_code(
        "half of all extrusions are slower than 2 mm/s", "Check that feed rates (F) are in mm/min"
    ),
    "extrusion": _dry_run_code(
        "absolute E values read as relative, or relative as absolute",
        "Check M82, M83 and G92 E0 before this line",
    ),
    "lack": _dry_run_code(
        "less material than in the layers before, or than the part needs",
        "Look for M221, and check E of the lines before",
    ),
    "clog": _dry_run_code("filament is fed but does not come out", "Clear the nozzle and check the spool"),
    "heater": _dry_run_code("heater that stays on at the end", "End with M104 S0 and M140 S0"),
    "unknown": Code(
        "lint, dry run",
        "error",
        "command that no firmware knows; lint only warns, because the printer ignores it",
        "Check that the file was sliced for this firmware",
    ),
    "tool": _dry_run_code(
        "extruder that the printer does not have", "Slice for one extruder, or set `extruders`"
    ),
    "arc": _dry_run_code("arc without a centre", "Switch arcs off in the slicer"),
    "machine": _dry_run_code("other command that the firmware rejects", ""),
    "underrun": _dry_run_code(
        "buffer underrun: the printer stands still because lines arrive too slowly",
        "Use a higher baud rate, or set printer.link_lines_per_second",
        "link",
    ),
}
"""Code -> row, in the order of the documentation."""

NAMES: Final[Mapping[str, str]] = {name: row.meaning for name, row in CODES.items() if row.allowed}
"""Code that `--allow` accepts -> its meaning."""

_COUNTED_BY_LAYER: Final = frozenset({"unsupported", "crash", "head", "bed", "flow"})
"""Codes of which a dry run counts the affected layers."""


class Diagnostic(Struct, frozen=True):
    """An error or warning about a print.

    Attributes:
        code: a key of `CODES`.
        severity: "warning" if it is harmless or if printers tolerate it.
        message: what is wrong, with numbers.
        reason: why it matters, if the message does not say so.
        remedy: what to do; empty uses the remedy of the table.
        line: line of the G-code text, counted from 1; 0 if not known.
        layer: number of the layer, counted from 1; of several layers, the worst; 0 before the first layer.
        first, last: numbers of the first and the last affected layer; 0 if `layer` is the only one.
        z: mm; None if unknown.
        place: x and y, mm; None if unknown.
        amount: measured value, in the unit of the limit; None if nothing is measured.
        limit: the limit that is exceeded; None if there is no limit.
        times: number of occurrences; number of layers for codes that a dry run reports once per layer.
        index: index of the command in the job, from 0; -1 if no command is concerned.
        command: text of this command.
    """

    code: str
    severity: Severity
    message: str
    reason: str = ""
    remedy: str = ""
    line: int = 0
    layer: int = 0
    first: int = 0
    last: int = 0
    z: float | None = None
    place: tuple[float, float] | None = None
    amount: float | None = None
    limit: float | None = None
    times: int = 1
    index: int = -1
    command: str = ""

    def __post_init__(self) -> None:
        row = CODES[self.code]
        force_setattr(self, "remedy", self.remedy or row.remedy)

    @property
    def is_error(self) -> bool:
        """Whether the severity is "error"."""
        return self.severity == "error"

    @property
    def affected_layers(self) -> range:
        """Indices, from 0, of the affected layers."""
        return range((self.first or self.layer) - 1, self.last or self.layer)


def sentence(diagnostic: Diagnostic) -> str:
    """Format a diagnostic as one line: location, message, count, then the reason or remedy."""
    where = ", ".join(_describe_location(diagnostic))
    command = f"{diagnostic.command}: " if diagnostic.command else ""
    advice = diagnostic.reason or diagnostic.remedy
    name = f" [{diagnostic.code}]" if diagnostic.command else ""
    text = (
        f"{command}{diagnostic.message}{_describe_count(diagnostic)}{f'. {advice}' if advice else ''}{name}"
    )
    return f"{where}: {text}" if where else text


def _describe_location(diagnostic: Diagnostic) -> list[str]:
    """Return the parts of the location: line or command, layers, height, position."""
    parts = (
        [f"line {diagnostic.line}"]
        if diagnostic.line
        else [f"command {diagnostic.index + 1}"]
        if diagnostic.index >= 0
        else []
    )
    if diagnostic.last > diagnostic.first:
        parts.append(f"layers {diagnostic.first} to {diagnostic.last}, worst in layer {diagnostic.layer}")
    elif diagnostic.layer and (parts or diagnostic.first):
        parts.append(f"layer {diagnostic.layer}")
    if diagnostic.z is not None and (parts or diagnostic.first):
        parts.append(f"z {diagnostic.z:.6g} mm")
    if diagnostic.place is not None and diagnostic.first:
        parts.append(f"x {diagnostic.place[0]:.2f} y {diagnostic.place[1]:.2f}")
    return parts


def _describe_count(diagnostic: Diagnostic) -> str:
    """Return the number of occurrences in parentheses; empty if there is only one."""
    if diagnostic.times <= 1:
        return ""
    if diagnostic.code in _COUNTED_BY_LAYER and not diagnostic.command:
        return f" (and in {diagnostic.times - 1} more layer{'s' if diagnostic.times > 2 else ''})"
    return f" ({diagnostic.times} times)"


def as_json(diagnostic: Diagnostic) -> dict[str, Any]:
    """Return all fields for JSON. Layers are counted from 1; outside the layers, `layer` is None."""
    return as_dict(diagnostic) | {"layer": diagnostic.layer or None}


def as_former_json(diagnostic: Diagnostic) -> dict[str, Any]:
    """Return all fields for JSON, and the former fields, which the next release removes.

    The former fields are name, kind, what, text, why, refused, harmless, x and y.
    """
    x, y = diagnostic.place or (None, None)
    return as_json(diagnostic) | {
        "name": diagnostic.code,
        "kind": CODES[diagnostic.code].kind or diagnostic.code,
        "what": diagnostic.message,
        "text": diagnostic.message,
        "why": diagnostic.reason,
        "refused": diagnostic.is_error,
        "harmless": not diagnostic.is_error,
        "x": x,
        "y": y,
    }


def format_first_error(errors: Sequence[str]) -> str:
    """Return the first error with the number of further errors, because a message cannot hold all errors."""
    more = len(errors) - 1
    return errors[0] + (f" (and {more} more error{'s' if more > 1 else ''})" if more else "")


def check_allowed_codes(allowed: Iterable[str]) -> frozenset[str]:
    """Check that `--allow` accepts all of these codes, and return them as a set.

    Raises:
        UsageError: a code is unknown or cannot be allowed.
    """
    names = frozenset(allowed)
    if wrong := sorted(names - set(NAMES)):
        raise UsageError(
            f"{wrong[0]!r} is not a code that can be allowed", remedy=f"Use one of: {', '.join(NAMES)}"
        )
    return names


def format_remedies(found: Iterable[Diagnostic]) -> str:
    """Return the remedies for the errors, followed by the call that allows the errors."""
    codes = tuple(dict.fromkeys(diagnostic.code for diagnostic in found if diagnostic.is_error))
    by_remedy: dict[str, list[str]] = {}
    for code in codes:
        by_remedy.setdefault(CODES[code].remedy, []).append(code)
    several = len(by_remedy) > 1
    remedies = [
        f"{', '.join(its_codes)}: {remedy}" if several else remedy for remedy, its_codes in by_remedy.items()
    ]
    allowed = ", ".join(f'"{code}"' for code in codes)
    return ". ".join([*remedies, f"Use `job.allowing([{allowed}])` to print it anyway"])


def raise_on_errors(
    found: Sequence[Diagnostic],
    allowed: Collection[str] = (),
    *,
    name: str = "job",
    refusal: str = "not printed",
) -> None:
    """Raise an error if a job has errors that are not allowed.

    Args:
        found: diagnostics of the whole job.
        allowed: codes that may pass.
        name: name of the job, for the message.
        refusal: what happens to the job, for the message.

    Raises:
        PolicyError: the job has such errors; the message gives the first error and the number of errors, and says how
            to allow them.
    """
    wrong = [diagnostic for diagnostic in found if diagnostic.is_error and diagnostic.code not in allowed]
    if not wrong:
        return
    raise PolicyError(
        f"{name}: {refusal}: {format_first_error(list(map(sentence, wrong)))}",
        remedy=format_remedies(wrong),
        names=tuple(dict.fromkeys(diagnostic.code for diagnostic in wrong)),
    )
