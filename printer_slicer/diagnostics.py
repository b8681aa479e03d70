"""What is wrong, or worth knowing, about a print: one value for all that look at it, and the table of their codes.

`CODES` is the only list: it makes the table of `docs/diagnostics.md`, the names of `--allow`, the remedies, and the
`code` and `severity` of the JSON of `slice`, `check`, `dry-run` and `print`.
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
"""An error keeps a job from being printed, or means that the part comes out wrong; a warning does neither."""

_TOLD: Final = 12  # diagnostics told in full in one error


class Code(NamedTuple):
    """One row of the table.

    Attributes:
        found_by: the rooms that give it, of "lint", "coverage" and "dry run".
        severity: the worst that it can have.
        meaning: what it is.
        remedy: what helps in general; a diagnostic may know better.
        allowed: whether `--allow` with the name of the code lets a job pass.
        kind: what `kind` in JSON calls it, where that is not the name of the code.
    """

    found_by: str
    severity: Severity
    meaning: str
    remedy: str
    allowed: bool = False
    kind: str = ""


def _lint(meaning: str, remedy: str = "remove it from the G-code") -> Code:
    """A row of what only the rules on commands find; all of it can be allowed."""
    return Code("lint", "error", meaning, remedy, allowed=True)


def _coverage(meaning: str, remedy: str, kind: str = "") -> Code:
    """A row of what only the comparison with the model finds."""
    return Code("coverage", "error", meaning, remedy, kind=kind)


def _dry_run(meaning: str, remedy: str, kind: str = "") -> Code:
    """A row of what only the simulated printer finds."""
    return Code("dry run", "error", meaning, remedy, kind=kind)


_NAME_IT: Final = "name the printer it was made for with --printer and --material"

CODES: Final[Mapping[str, Code]] = {
    "temperature": Code(
        "lint, dry run",
        "error",
        "heating over the profile's ceilings, or to values that cannot be read",
        _NAME_IT,
        True,
    ),
    "box": Code("lint, dry run", "error", "moves out of the machine", _NAME_IT, True),
    "feed": _lint("speeds far over the profile's", _NAME_IT),
    "flow": Code(
        "lint, dry run", "error", "more plastic per second than the material's max_flow", _NAME_IT, True
    ),
    "ratio": _lint("flow or speed override far from 100 % (M221, M220)"),
    "unsupported": Code(
        "lint, coverage, dry run",
        "error",
        "unsupported extrusion: nothing is under it",
        "turn the part or add supports",
        True,
        "air",
    ),
    "cold": Code(
        "lint, dry run",
        "error",
        "extrusion below the firmware's minimum temperature (M302, or no heating before it)",
        "heat the nozzle first (M109 S and a temperature) and remove M302",
        True,
    ),
    "homing": Code(
        "lint, dry run",
        "error",
        "moves before homing, extrusion after the motors were switched off",
        "home first (G28) and keep the motors on",
        True,
    ),
    "eeprom": _lint(
        "storing, loading or resetting the firmware's settings (M500, M501, M502, M504, SAVE_CONFIG)"
    ),
    "limits": _lint("limits of speed, acceleration and jerk far over the profile's (M201 to M205)", _NAME_IT),
    "calibration": _lint(
        "steps, currents, geometry and control loops (M92, M301, M304, M350, M665, M906 and others)"
    ),
    "autotune": _lint("heating by itself to tune a heater (M303)"),
    "protection": _lint("what guards the heaters (M143, M562, M570)"),
    "endstops": _lint("moves beyond the endstops (M211 S0, M564)"),
    "offsets": _lint(
        "another origin, which makes the box unknown (M206, M290, M428, M851, G10 L2, G54 to G59)"
    ),
    "halt": _lint("halting the machine (M112, M410); power off (M81) is only told"),
    "wait": _lint("waiting for a person without end (M0, M1)"),
    "firmware": _lint("updating or restarting the firmware (M997, M999, FIRMWARE_RESTART)"),
    "files": _lint("reading, writing or deleting files of the printer (M23, M24, M28, M30, M32, M928)"),
    "pins": _lint("switching pins of the board directly (M42, M43)"),
    "macros": _lint("storing commands that run later (M810 to M819)"),
    "link": _lint(
        "the serial port, line numbers, answers, the printer's network (M575, M110, M118 ok, M552, M586 to M589)"
    ),
    "debug": _lint("commands for developers (D0 and others, M111)"),
    "shell": _lint("programs of the printer's computer (RUN_SHELL_COMMAND)"),
    "unreadable": Code(
        "lint, dry run",
        "error",
        "unparsed commands: expressions, several commands in a line, bare letters, lower case, G5, G18",
        _NAME_IT,
        True,
    ),
    "uncovered": _coverage(
        "gaps in the shell of the part", "look for missing extrusions, or a wrong extrusion width"
    ),
    "outside": _coverage("extrusion beyond the section of the part", "is it the model that was sliced?"),
    "overlap": _coverage(
        "more material than fits where extrusions overlap", "look for extrusions laid twice"
    ),
    "underfilled": _coverage(
        "too little material in the shell", "look at flow and filament diameter", "under"
    ),
    "overfilled": _coverage("too much material in the shell", "look at flow and filament diameter", "over"),
    "outline": _coverage("the outline differs from that of the part", "look at compensation and scale"),
    "crash": _dry_run("the nozzle goes through what is printed", "raise the nozzle before it goes there"),
    "bed": _dry_run("extrusions lie so low that the nozzle scrapes the bed", "are z offset and units right?"),
    "speed": _dry_run("half of all extrusions are slower than 2 mm/s", "does the file count F in mm/s?"),
    "extrusion": _dry_run(
        "E is read as a total and is none, or the other way round", "look at M82, M83 and G92 E0 before it"
    ),
    "lack": _dry_run(
        "less plastic than before, or than the part needs", "look for M221, and at E of the lines before"
    ),
    "clog": _dry_run("filament that is fed does not come out", "clear the nozzle, look at the spool"),
    "heater": _dry_run("a heater stays on at the end", "end with M104 S0 and M140 S0"),
    "unknown": _dry_run("commands that the firmware does not know", "is the file made for this firmware?"),
    "tool": _dry_run(
        "an extruder that the printer does not have", "slice for one extruder, or say --extruders N"
    ),
    "arc": _dry_run("an arc without a centre", "switch arcs off in the slicer"),
    "machine": _dry_run("something else that the firmware refuses", ""),
    "underrun": _dry_run(
        "the machine stands still because lines come too slowly (buffer underrun)",
        "use a faster link, or set printer.link_lines_per_second",
        "link",
    ),
}
"""Name -> row, in the order of the documents."""

NAMES: Final[Mapping[str, str]] = {name: row.meaning for name, row in CODES.items() if row.allowed}
"""Name for `--allow` -> what it allows."""

_BY_LAYER: Final = frozenset({"unsupported", "crash", "bed", "flow"})
"""Codes that a dry run gives once for each layer."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One thing that is wrong, or worth knowing.

    Attributes:
        code: a key of `CODES`.
        severity: an error unless it is harmless or within what machines bear.
        message: what it is, with numbers.
        reason: why that matters, where the message does not say it.
        remedy: what helps; empty takes that of the table.
        line: of the text, counted from 1; 0 if not known.
        layer: counted from 1, the worst one of several; 0 before the first.
        first, last: all layers of a run; 0 where `layer` is the only one.
        z: mm; None if not known.
        place: x and y, mm; None if not known.
        amount: as the limit counts; None where nothing is measured.
        limit: that is broken; None without one.
        times: how often: layers for what a dry run finds once in a layer.
        index: of the command in the job, from 0; -1 if no command is named.
        command: it.
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
        """Whether it keeps the job from being printed, or the part from coming out well."""
        return self.severity == "error"

    @property
    def in_layers(self) -> range:
        """Indices, from 0, of the layers that have it."""
        return range((self.first or self.layer) - 1, self.last or self.layer)


def sentence(one: Diagnostic) -> str:
    """One diagnostic in one line, for people: where, what, how often, why or what helps."""
    where = ", ".join(_where(one))
    command = f"{one.command}: " if one.command else ""
    behind = one.reason or one.remedy
    name = f" [{one.code}]" if one.command else ""
    text = f"{command}{one.message}{_more(one)}{f'; {behind}' if behind else ''}{name}"
    return f"{where}: {text}" if where else text


def _where(one: Diagnostic) -> list[str]:
    where = [f"line {one.line}"] if one.line else [f"command {one.index + 1}"] if one.index >= 0 else []
    if one.last > one.first:
        where.append(f"layers {one.first} to {one.last}, worst {one.layer}")
    elif one.layer and (where or one.first):
        where.append(f"layer {one.layer}")
    if one.z is not None and (where or one.first):
        where.append(f"z {one.z:.6g} mm")
    if one.place is not None and one.first:
        where.append(f"x {one.place[0]:.2f} y {one.place[1]:.2f}")
    return where


def _more(one: Diagnostic) -> str:
    """How often besides."""
    if one.times <= 1:
        return ""
    if one.code in _BY_LAYER and not one.command:
        return f", and {one.times - 1} more layer{'s' if one.times > 2 else ''}"
    return ", and once more" if one.times == 2 else f", and {one.times - 1} more times"


def as_json(one: Diagnostic) -> dict[str, Any]:
    """All fields, and the names that they had in version 0.1: name, kind, what, text, why, refused, harmless, x, y."""
    x, y = one.place or (None, None)
    return asdict(one) | {
        "name": one.code,
        "kind": CODES[one.code].kind or one.code,
        "what": one.message,
        "text": one.message,
        "why": one.reason,
        "refused": one.is_error,
        "harmless": not one.is_error,
        "x": x,
        "y": y,
    }


def check_names(allowed: Iterable[str]) -> frozenset[str]:
    """Return the names, all of which exist.

    Raises:
        UsageError: one does not.
    """
    names = frozenset(allowed)
    if wrong := sorted(names - set(NAMES)):
        raise UsageError(
            f"--allow {wrong[0]}: nothing is allowed by that name", remedy=f"names are {', '.join(NAMES)}"
        )
    return names


def remedy_of(found: Iterable[Diagnostic]) -> str:
    """Return the remedies of the errors and the flags that allow them."""
    codes = tuple(dict.fromkeys(one.code for one in found if one.is_error))
    by_remedy: dict[str, list[str]] = {}
    for code in codes:
        by_remedy.setdefault(CODES[code].remedy, []).append(code)
    several = len(by_remedy) > 1
    helps = [f"{', '.join(of)}: {remedy}" if several else remedy for remedy, of in by_remedy.items()]
    meant = "if they are meant" if len(codes) > 1 else "if it is meant"
    return "; ".join([*helps, f"{meant}: {' '.join(f'--allow {code}' for code in codes)}"])


def insist(
    found: Sequence[Diagnostic],
    allowed: Collection[str] = (),
    *,
    name: str = "job",
    refusal: str = "not printed",
) -> None:
    """Refuse a job that holds an error which was not allowed.

    Args:
        found: in the whole job.
        allowed: codes.
        name: of the job, for the message.
        refusal: what does not happen to it, for the message.

    Raises:
        PolicyError: it does; says what, where, and how to allow it.
    """
    wrong = [one for one in found if one.is_error and one.code not in allowed]
    if not wrong:
        return
    said = [sentence(one) for one in wrong[:_TOLD]]
    said += [f"... and {len(wrong) - _TOLD} more"] if len(wrong) > _TOLD else []
    raise PolicyError(
        f"{name}: {refusal}, for it holds\n  " + "\n  ".join(said),
        remedy=remedy_of(wrong),
        names=tuple(dict.fromkeys(one.code for one in wrong)),
    )
