"""Diagnostics: errors and warnings about a print, and the table of their codes.

`CODES` is the single source for the table of `docs/diagnostics.md`, the names that `--allow` takes, the remedies, and
`code` and `severity` in the JSON of `slice`, `check`, `dry-run` and `print`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, NamedTuple

from printer_slicer.errors import PolicyError, UsageError

__all__ = [
    "CODES",
    "NAMES",
    "Code",
    "Diagnostic",
    "Severity",
    "as_json",
    "check_names",
    "insist",
    "remedy_of",
    "sentence",
]

Severity = Literal["error", "warning"]
"""An error blocks the job, or means that the part will come out wrong. A warning does neither."""

_MOST_LISTED: Final = 12  # diagnostics listed in one error message


class Code(NamedTuple):
    """One row of the table of diagnostic codes.

    Attributes:
        found_by: the inspections that report it: "lint", "coverage", "dry run".
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


def _lint(meaning: str, remedy: str = "Remove it from the G-code") -> Code:
    """Return a row for a code that only the lint rules report; all of these can be allowed."""
    return Code("lint", "error", meaning, remedy, allowed=True)


def _coverage(meaning: str, remedy: str, kind: str = "") -> Code:
    """Return a row for a code that only the comparison with the model reports."""
    return Code("coverage", "error", meaning, remedy, kind=kind)


def _dry_run(meaning: str, remedy: str, kind: str = "") -> Code:
    """Return a row for a code that only the dry run reports."""
    return Code("dry run", "error", meaning, remedy, kind=kind)


_NAME_PRINTER: Final = "Name the printer and material the file was made for with `printer` and `material`"

CODES: Final[Mapping[str, Code]] = {
    "temperature": Code(
        "lint, dry run",
        "error",
        "temperature above the maximum of the profile, or not readable",
        _NAME_PRINTER,
        True,
    ),
    "box": Code("lint, dry run", "error", "move outside the printable area", _NAME_PRINTER, True),
    "feed": _lint("feed rate far above the maximum speed of the profile", _NAME_PRINTER),
    "flow": Code(
        "lint, dry run", "error", "volumetric flow above the max_flow of the material", _NAME_PRINTER, True
    ),
    "ratio": _lint("flow or speed override far from 100% (M221, M220)"),
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
    "eeprom": _lint(
        "command that stores, loads or resets firmware settings (M500, M501, M502, M504, SAVE_CONFIG)"
    ),
    "limits": _lint(
        "speed, acceleration or jerk limit far above that of the profile (M201 to M205)", _NAME_PRINTER
    ),
    "calibration": _lint(
        "command that changes steps per mm, motor currents, geometry or PID values"
        " (M92, M301, M304, M350, M665, M906 and others)"
    ),
    "autotune": _lint("PID autotune, which heats by itself (M303)"),
    "protection": _lint("command that changes the protection of the heaters (M143, M562, M570)"),
    "endstops": _lint("command that switches the software endstops off (M211 S0, M564)"),
    "offsets": _lint("command that shifts the origin (M206, M290, M428, M851, G10 L2, G54 to G59)"),
    "halt": _lint("command that halts the printer (M112, M410); power off (M81) is only a warning"),
    "wait": _lint("wait for a person without a time limit (M0, M1)"),
    "firmware": _lint("command that updates or restarts the firmware (M997, M999, FIRMWARE_RESTART)"),
    "files": _lint(
        "command that reads, writes or deletes files on the printer (M23, M24, M28, M30, M32, M928)"
    ),
    "pins": _lint("command that switches pins of the board directly (M42, M43)"),
    "macros": _lint("command that stores or runs a macro (M810 to M819)"),
    "link": _lint(
        "command that disturbs the connection: baud rate, line numbers, replies, network"
        " (M575, M110, M118 ok, M552, M586 to M589)"
    ),
    "debug": _lint("debug command (D0 and others, M111)"),
    "shell": _lint("command that runs a program on the computer of the printer (RUN_SHELL_COMMAND)"),
    "unreadable": Code(
        "lint, dry run",
        "error",
        "command that cannot be parsed: expression, several commands in a line, letter without a number,"
        " lower case, G5, G18",
        _NAME_PRINTER,
        True,
    ),
    "uncovered": _coverage(
        "gap in the shell of the part", "Look for missing extrusions or a wrong extrusion width"
    ),
    "outside": _coverage(
        "extrusion outside the outline of the part", "Check that this is the model that was sliced"
    ),
    "overlap": _coverage(
        "more material than fits, because extrusions overlap", "Look for duplicate extrusions"
    ),
    "underfilled": _coverage("too little material in the shell", "Check flow and filament diameter", "under"),
    "overfilled": _coverage("too much material in the shell", "Check flow and filament diameter", "over"),
    "outline": _coverage("printed outline that differs from the part", "Check size compensation and scale"),
    "crash": _dry_run("collision of the nozzle with the print", "Raise the nozzle before this move"),
    "bed": _dry_run("extrusion so low that the nozzle scrapes the bed", "Check the z offset and the units"),
    "speed": _dry_run(
        "half of all extrusions are slower than 2 mm/s", "Check that feed rates (F) are in mm/min"
    ),
    "extrusion": _dry_run(
        "absolute E values read as relative, or relative as absolute",
        "Check M82, M83 and G92 E0 before this line",
    ),
    "lack": _dry_run(
        "less material than in the layers before, or than the part needs",
        "Look for M221, and check E of the lines before",
    ),
    "clog": _dry_run("filament is fed but does not come out", "Clear the nozzle and check the spool"),
    "heater": _dry_run("heater that stays on at the end", "End with M104 S0 and M140 S0"),
    "unknown": _dry_run(
        "command that the firmware does not know", "Check that the file was made for this firmware"
    ),
    "tool": _dry_run("extruder that the printer does not have", "Slice for one extruder, or set `extruders`"),
    "arc": _dry_run("arc without a centre", "Switch arcs off in the slicer"),
    "machine": _dry_run("other command that the firmware rejects", ""),
    "underrun": _dry_run(
        "buffer underrun: the printer stands still because lines arrive too slowly",
        "Use a higher baud rate, or set printer.link_lines_per_second",
        "link",
    ),
}
"""Code -> row, in the order of the documentation."""

NAMES: Final[Mapping[str, str]] = {name: row.meaning for name, row in CODES.items() if row.allowed}
"""Codes that `--allow` takes -> what they allow."""

_BY_LAYER: Final = frozenset({"unsupported", "crash", "bed", "flow"})
"""Codes that a dry run reports once for each layer."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """An error or warning about a print.

    Attributes:
        code: a key of `CODES`.
        severity: a warning if it is harmless or within what printers tolerate.
        message: what is wrong, with numbers.
        reason: why it matters, if the message does not say so.
        remedy: what to do; empty uses the remedy of the table.
        line: of the text, counted from 1; 0 if not known.
        layer: counted from 1; the worst one of several; 0 before the first.
        first, last: range of layers that have it; 0 if `layer` is the only one.
        z: mm; None if unknown.
        place: x and y, mm; None if unknown.
        amount: measured value, in the unit of the limit; None if nothing is measured.
        limit: the limit that is exceeded; None without one.
        times: number of occurrences; number of layers for codes that a dry run reports once per layer.
        index: of the command in the job, from 0; -1 without a command.
        command: its text.
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
        object.__setattr__(self, "remedy", self.remedy or row.remedy)

    @property
    def is_error(self) -> bool:
        """Whether its severity is error."""
        return self.severity == "error"

    @property
    def in_layers(self) -> range:
        """Indices, from 0, of the affected layers."""
        return range((self.first or self.layer) - 1, self.last or self.layer)


def sentence(diagnostic: Diagnostic) -> str:
    """Return a diagnostic as one line of text: place, message, count, then the reason or remedy."""
    where = ", ".join(_where(diagnostic))
    command = f"{diagnostic.command}: " if diagnostic.command else ""
    behind = diagnostic.reason or diagnostic.remedy
    name = f" [{diagnostic.code}]" if diagnostic.command else ""
    text = f"{command}{diagnostic.message}{_more(diagnostic)}{f'. {behind}' if behind else ''}{name}"
    return f"{where}: {text}" if where else text


def _where(diagnostic: Diagnostic) -> list[str]:
    where = (
        [f"line {diagnostic.line}"]
        if diagnostic.line
        else [f"command {diagnostic.index + 1}"]
        if diagnostic.index >= 0
        else []
    )
    if diagnostic.last > diagnostic.first:
        where.append(f"layers {diagnostic.first} to {diagnostic.last}, worst in layer {diagnostic.layer}")
    elif diagnostic.layer and (where or diagnostic.first):
        where.append(f"layer {diagnostic.layer}")
    if diagnostic.z is not None and (where or diagnostic.first):
        where.append(f"z {diagnostic.z:.6g} mm")
    if diagnostic.place is not None and diagnostic.first:
        where.append(f"x {diagnostic.place[0]:.2f} y {diagnostic.place[1]:.2f}")
    return where


def _more(diagnostic: Diagnostic) -> str:
    """Return how often it occurs besides the first time."""
    if diagnostic.times <= 1:
        return ""
    if diagnostic.code in _BY_LAYER and not diagnostic.command:
        return f" (and in {diagnostic.times - 1} more layer{'s' if diagnostic.times > 2 else ''})"
    return f" ({diagnostic.times} times)"


def as_json(diagnostic: Diagnostic) -> dict[str, Any]:
    """Return all fields, plus their names of version 0.1: name, kind, what, text, why, refused, harmless, x, y."""
    x, y = diagnostic.place or (None, None)
    return asdict(diagnostic) | {
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


def check_names(allowed: Iterable[str]) -> frozenset[str]:
    """Check that `--allow` knows all names, and return them as a set.

    Raises:
        UsageError: a name is unknown.
    """
    names = frozenset(allowed)
    if wrong := sorted(names - set(NAMES)):
        raise UsageError(
            f"{wrong[0]!r}: no finding of this name can be allowed", remedy=f"Known names: {', '.join(NAMES)}"
        )
    return names


def remedy_of(found: Iterable[Diagnostic]) -> str:
    """Return the remedies of the errors, and how to allow them."""
    codes = tuple(dict.fromkeys(diagnostic.code for diagnostic in found if diagnostic.is_error))
    by_remedy: dict[str, list[str]] = {}
    for code in codes:
        by_remedy.setdefault(CODES[code].remedy, []).append(code)
    several = len(by_remedy) > 1
    helps = [f"{', '.join(of)}: {remedy}" if several else remedy for remedy, of in by_remedy.items()]
    allowed = ", ".join(f'"{code}"' for code in codes)
    return ". ".join([*helps, f"Use `job.allowing([{allowed}])` to print it anyway"])


def insist(
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
        name: of the job, for the message.
        refusal: what is not done with it, for the message.

    Raises:
        PolicyError: it has; the message says what, where, and how to allow it.
    """
    wrong = [diagnostic for diagnostic in found if diagnostic.is_error and diagnostic.code not in allowed]
    if not wrong:
        return
    lines = [sentence(diagnostic) for diagnostic in wrong[:_MOST_LISTED]]
    lines += [f"... and {len(wrong) - _MOST_LISTED} more"] if len(wrong) > _MOST_LISTED else []
    raise PolicyError(
        f"{name}: {refusal} because of these errors:\n  " + "\n  ".join(lines),
        remedy=remedy_of(wrong),
        names=tuple(dict.fromkeys(diagnostic.code for diagnostic in wrong)),
    )
