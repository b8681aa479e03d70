"""A model or a G-code file as a job: the lines to send, and what is known about them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from printer_slicer.errors import UsageError
from printer_slicer.gcode import FLAVOURS, Dialect, Moves, read_moves
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Program, Repairs
from printer_slicer.motion.machine import limits_of
from printer_slicer.motion.rules import Limits
from printer_slicer.pipeline import Report, Stages, gcode_of, quiet, slice_stages
from printer_slicer.placing import IN_THE_MIDDLE, Placement
from printer_slicer.policy import Finding, check_names, scan
from printer_slicer.profile import Profile
from printer_slicer.saving import save
from printer_slicer.strategies import OURS, Strategies
from printer_slicer.stream.framing import check_commands, strip

__all__ = [
    "GCODE_SUFFIXES",
    "Job",
    "commands_of",
    "is_gcode",
    "job_and_moves",
    "job_from",
    "job_of",
    "job_of_text",
    "lines_of",
    "read_text",
]

_MOST_BYTES = 1 << 29  # of G-code; in memory it is ten times as much
_ALWAYS_FITS = 60  # bytes: shorter commands need no closer look
_CONTROL = re.compile(rb"[\x00-\x1f]")
_MOVES = frozenset({b"G1 ", b"G0 "})
_BLANK = ord(" ")
_ROLES = (b"TYPE:", b" FEATURE:")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_ASKED_FOR = frozenset({"wait"})  # of a job that is sliced here: its pauses are the settings'
GCODE_SUFFIXES = frozenset({".gcode", ".gco", ".g", ".nc"})


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What is to be printed.

    Attributes:
        name: of the file it came from, without folder.
        text: the G-code as it would be written to a file.
        commands: one per line, without comments and blanks.
        seconds: modelled time of all moves and dwells, start and end G-code included; homing and heating are not.
        heights: z at which plastic is laid, mm, in order of the first time; the start G-code's priming included.
        end: (3,) where the last move ends, mm.
        program: the moves, if the job was sliced here.
        marks: command index -> layer (counted from 1), where the text has layer comments.
        roles: command index -> what comments call the beads from there on, as slicers write it.
        repairs: what was put right in the part, if the job was sliced here.
        findings: what a person should know, or must allow, before a printer gets it.
        allowed: names of findings with which it is printed all the same, see `policy.NAMES`.
    """

    name: str
    text: bytes
    commands: tuple[bytes, ...]
    seconds: float
    heights: tuple[float, ...]
    end: tuple[float, float, float]
    program: Program | None = None
    marks: Mapping[int, int] = field(default_factory=dict)
    roles: Mapping[int, str] = field(default_factory=dict)
    repairs: Repairs = field(default_factory=Repairs)
    findings: tuple[Finding, ...] = ()
    allowed: frozenset[str] = frozenset()

    @property
    def plan(self) -> LayerPlan | None:
        """The layer plan, if the job was sliced here."""
        return self.program.plan if self.program else None

    def __repr__(self) -> str:
        layers = f"{self.plan.n_layers} layers, " if self.plan else ""
        told = f", {len(self.findings)} findings" if self.findings else ""
        return (
            f"<Job {self.name!r}: {layers}{len(self.commands)} commands, {self.seconds / 60:.0f} min{told}>"
        )

    def save(self, path: str | Path) -> None:
        """Write the G-code.

        Raises:
            OutputError: the file cannot be written; what was there before is as it was.
        """
        save(Path(path), self.text)

    def allowing(self, names: Iterable[str]) -> Job:
        """The same job with these findings allowed.

        Raises:
            UsageError: nothing is allowed by one of the names.
        """
        return replace(self, allowed=self.allowed | check_names(names))

    def line_of(self, command: int) -> int:
        """The line of the text, counted from 1, that holds the command with this index; 0 if there is none."""
        return lines_of(self.text, [command])[0]

    def layer_of(self, command: int) -> int:
        """The layer, counted from 1, that the command with this index belongs to; 0 before the first."""
        index = int(np.searchsorted(list(self.marks), command, side="right")) - 1
        return list(self.marks.values())[index] if index >= 0 else 0


def is_gcode(path: Path) -> bool:
    """Whether a file is taken for G-code rather than for a model."""
    return path.suffix.lower() in GCODE_SUFFIXES


def job_from(path: Path, profile: Profile, *, report: Report = quiet, strict: bool = False) -> Job:
    """The job that prints a model (sliced now) or a G-code file (as it is).

    Args:
        path: of the file.
        profile: printer, material and quality.
        report: is told the name of each stage as it begins.
        strict: whether a mesh that needs repair is refused.

    Raises:
        PrinterSlicerError: the file cannot be read, sliced or sent.
    """
    if is_gcode(path):
        report("reading")
        return job_and_moves(path, profile)[0]
    report("loading")
    return job_of(load_mesh(path), profile, name=path.name, report=report, strict=strict)


def job_and_moves(path: Path, profile: Profile, *, streamed: bool = True) -> tuple[Job, Moves]:
    """The job that a G-code file is, and its moves.

    Args:
        path: of the file.
        profile: what it is judged by.
        streamed: whether it goes to the printer line by line; what is uploaded may hold longer lines.

    Raises:
        PrinterSlicerError: the file cannot be read or sent.
    """
    return _judged(path.name, read_text(path), profile, streamed=streamed)


def job_of(  # noqa: PLR0913 - every choice has a usual value
    part: Mesh | Stages,
    profile: Profile,
    *,
    name: str = "",
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strategies: Strategies = OURS,
) -> Job:
    """The job that prints a part, sliced now or before.

    Args:
        part: as a mesh, or what `slice_stages` made of it; then `placement`, `report` and `strict` had their time.
        profile: what it is sliced with.
        name: what to call the job; empty: as the part.
        placement: where the part is put.
        report: is told the name of each stage as it begins.
        strict: whether a mesh that needs repair is refused.
        strategies: functions from outside in place of ours.

    Raises:
        PrinterSlicerError: it cannot be sliced.
    """
    stages = (
        part
        if isinstance(part, Stages)
        else slice_stages(
            part, profile, placement=placement, report=report, strict=strict, strategies=strategies
        )
    )
    report("writing")
    text = gcode_of(stages.program, profile, part=stages.part, labels=stages.labels, strategies=strategies)
    job, _ = _judged(name or stages.part.name, text, profile, flavour=strategies.flavour)
    return replace(job, program=stages.program, allowed=_ASKED_FOR, repairs=stages.repairs)


def job_of_text(name: str, text: bytes, *, limits: Limits, corner: tuple[float, float], flavour: str) -> Job:
    """The job that a G-code text is, as it was looked at before: nothing is found in it.

    Args:
        name: what to call it.
        text: the G-code.
        limits: of the machine.
        corner: front left of the bed, mm.
        flavour: whose meanings commands have.

    Raises:
        UsageError: there is nothing in it, or something that can never be sent.
    """
    return _read(name, text, limits, corner, FLAVOURS[flavour])[0]


def _read(
    name: str,
    text: bytes,
    limits: Limits,
    corner: tuple[float, float],
    flavour: Dialect,
    *,
    streamed: bool = True,
) -> tuple[Job, Moves]:
    """The job that a text is, and its moves."""
    commands, marks, roles = _told(text)
    if not commands:
        raise UsageError(f"{name}: no commands in it", remedy="is it a G-code file?")
    if streamed:
        _refuse_unsendable(name, text, commands)
    moves = read_moves(commands, corner, flavour)
    end = moves.end[-1] if len(moves.end) else np.zeros(3)
    job = Job(
        name,
        text,
        tuple(commands),
        moves.seconds(limits),
        tuple(moves.heights()),
        (float(end[0]), float(end[1]), float(end[2])),
        marks=marks,
        roles=roles,
    )
    return job, moves


def _judged(
    name: str, text: bytes, profile: Profile, *, streamed: bool = True, flavour: Dialect | None = None
) -> tuple[Job, Moves]:
    """The job that a text is, with what is found in it, and its moves."""
    printer = profile.printer
    limits, corner = limits_of(printer), printer.corners[0]
    dialect = flavour or FLAVOURS[printer.flavour]
    job, moves = _read(name, text, limits, corner, dialect, streamed=streamed)
    findings = scan(job.commands, profile, moves=moves, marks=job.marks)
    lines = lines_of(text, [one.index for one in findings])
    placed = tuple(replace(one, line=line) for one, line in zip(findings, lines, strict=True))
    return replace(job, findings=placed), moves


def _refuse_unsendable(name: str, text: bytes, commands: list[bytes]) -> None:
    """Raise for a command that no printer can get, naming its line of the file."""
    everything = b"".join(commands)
    if everything.isascii() and not _CONTROL.search(everything) and max(map(len, commands)) <= _ALWAYS_FITS:
        return
    for index, command in enumerate(commands):
        if len(command) <= _ALWAYS_FITS and command.isascii() and not _CONTROL.search(command):
            continue
        try:
            check_commands([command])
        except UsageError as error:
            what = str(error).splitlines()[0].removeprefix("line 1 ")
            raise UsageError(
                f"{name}: line {lines_of(text, [index])[0]} {what}", remedy=error.remedy
            ) from None


def lines_of(text: bytes, commands: Sequence[int]) -> list[int]:
    """The lines of a text, counted from 1, that hold its commands with these indices; 0 where there is none."""
    if not commands:
        return []
    wanted, last, index, found = set(commands), max(commands), 0, dict.fromkeys(commands, 0)
    for number, line in enumerate(text.split(b"\n"), 1):
        if strip(line):
            if index in wanted:
                found[index] = number
            index += 1
            if index > last:
                break
    return [found[one] for one in commands]


def read_text(path: Path) -> bytes:
    """The bytes of a G-code file.

    Raises:
        UsageError: it is not there, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            endless = os.fstat(file.fileno()).st_size > _MOST_BYTES
            text = b"" if endless else file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file", remedy="check the path") from None
    except IsADirectoryError:
        raise UsageError(f"{path}: is a folder", remedy="name a file in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: cannot be read: {reason}", remedy="check name and permissions") from None
    if endless or len(text) > _MOST_BYTES:
        raise UsageError(
            f"{path}: longer than {_MOST_BYTES >> 20} MiB, the most that is read of G-code",
            remedy="print the part in pieces, or with thicker layers",
        )
    return text


def commands_of(text: bytes) -> tuple[list[bytes], dict[int, int]]:
    """The commands of a G-code text without comments, blanks, line numbers and checksums, and where layers begin.

    Returns:
        The commands, and command index -> layer counted from 1, from `;LAYER_CHANGE` or `;LAYER:` comments.
    """
    commands, marks, _ = _told(text)
    return commands, marks


def _told(text: bytes) -> tuple[list[bytes], dict[int, int], dict[int, str]]:
    """What `commands_of` gives; and command index -> what beads are called, from `;TYPE:` or `; FEATURE:` comments."""
    commands: list[bytes] = []
    marks: dict[int, int] = {}
    roles: dict[int, str] = {}
    layer = 0
    kinds: tuple[bytes, ...] = (b"LAYER_CHANGE", b"LAYER:")
    for line in text.removeprefix(_BYTE_ORDER_MARK).split(b"\n"):
        # Nine lines of ten are moves with nothing to take off.
        if line[:3] in _MOVES and b";" not in line and line[-1] > _BLANK:
            commands.append(line)
            continue
        command = strip(line)
        if command:
            commands.append(command)
            continue
        _, _, comment = line.partition(b";")
        if comment.startswith(_ROLES):
            roles[len(commands)] = comment.partition(b":")[2].decode("utf-8", "replace").strip()
        elif comment.startswith(kinds):
            kinds = tuple(kind for kind in kinds if comment.startswith(kind))  # some files hold both
            layer += 1
            marks[len(commands)] = layer
    return commands, marks, roles
