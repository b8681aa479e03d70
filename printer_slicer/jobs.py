"""A job: the lines to send, and what is known about them. Nothing here knows of the slicer."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from printer_slicer.commands import GcodeText, check_sendable, lines_of, split_gcode
from printer_slicer.diagnostics import Diagnostic, check_names, sentence
from printer_slicer.errors import UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.saving import save
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.gcode import Moves
    from printer_slicer.model import LayerPlan, Program, Repairs

__all__ = ["GCODE_SUFFIXES", "Job", "JobSummary", "is_gcode", "job_of_text", "sendable"]

GCODE_SUFFIXES = frozenset({".gcode", ".gco", ".g", ".nc"})


@dataclass(frozen=True, slots=True, eq=False)
class Job(SvgRepr):
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
        allowed: names of findings with which it is printed all the same, see `diagnostics.NAMES`.
    """

    name: str
    text: bytes
    commands: Sequence[bytes]
    seconds: float
    heights: tuple[float, ...]
    end: tuple[float, float, float]
    program: Program | None = None
    marks: Mapping[int, int] = field(default_factory=dict)
    roles: Mapping[int, str] = field(default_factory=dict)
    repairs: Repairs | None = None
    findings: tuple[Diagnostic, ...] = ()
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

    @property
    def drawable(self) -> object:
        """The moves, if the job was sliced here; else what is known of the file."""
        facts = {
            "commands": str(len(self.commands)),
            "layers": f"plastic at {len(self.heights)} heights",
            "motion": format_duration(self.seconds),
        }
        return self.program or Summary(
            self.name, facts, [sentence(one) for one in self.findings if one.is_error]
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
        index = bisect_right(list(self.marks), command) - 1
        return list(self.marks.values())[index] if index >= 0 else 0


def is_gcode(path: Path) -> bool:
    """Whether a file is taken for G-code rather than for a model."""
    return path.suffix.lower() in GCODE_SUFFIXES


def job_of_text(
    name: str, text: bytes, *, limits: MotionLimits, corner: tuple[float, float], flavour: str
) -> Job:
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
    from printer_slicer.gcode import pieces_of  # noqa: PLC0415 - a job that is there needs no arrays

    told = sendable(name, text)
    tally = JobSummary(limits)
    for piece in pieces_of(told.commands, corner, FLAVOURS[flavour]):
        tally.add(piece)
    return tally.job(name, text, told)


def sendable(name: str, text: bytes, *, streamed: bool = True) -> GcodeText:
    """Return what a text holds that can be sent.

    Args:
        name: of the job, for messages.
        text: the G-code.
        streamed: whether it goes to the printer line by line; what is uploaded may hold longer lines.

    Raises:
        UsageError: there is nothing in it, or something that can never be sent.
    """
    told = split_gcode(text)
    if not told.commands:
        raise UsageError(f"{name}: no commands in it", remedy="is it a G-code file?")
    if streamed:
        check_sendable(name, text, told)
    return told


class JobSummary:
    """Time, heights and end of moves that come piece by piece.

    Args:
        limits: of the machine.
    """

    def __init__(self, limits: MotionLimits) -> None:
        from printer_slicer.gcode import Timer  # noqa: PLC0415 - a job that is there needs no arrays

        self._timer = Timer(limits)
        self._heights: dict[float, None] = {}
        self._end = (0.0, 0.0, 0.0)

    def add(self, moves: Moves) -> Moves:
        """Add the next piece, and hand it on."""
        self._timer.add(moves)
        self._heights |= dict.fromkeys(moves.heights())
        if len(moves.end):
            x, y, z = moves.end[-1].tolist()
            self._end = x, y, z
        return moves

    def job(self, name: str, text: bytes, told: GcodeText) -> Job:
        """Return the job that makes these moves, without findings."""
        return Job(
            name,
            text,
            told.commands,
            self._timer.seconds(),
            tuple(self._heights),
            self._end,
            marks=told.marks,
            roles=told.roles,
        )
