"""Print jobs: G-code text with its commands, print time and findings. This module does not need the slicer."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from printer_slicer.arguments import check_argument
from printer_slicer.commands import GcodeText, check_sendable, find_lines, split_gcode
from printer_slicer.diagnostics import Diagnostic, check_allowed_codes, sentence
from printer_slicer.errors import UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.saving import save
from printer_slicer.texts import format_duration
from printer_slicer.values import Struct, field, replace

if TYPE_CHECKING:
    from printer_slicer.gcode import Moves
    from printer_slicer.model import LayerPlan, Program, Repairs
    from printer_slicer.profile import Profile

__all__ = ["Job", "JobSummary", "build_job", "split_sendable"]


class Job(SvgRepr, Struct, frozen=True, eq=False):
    """A print job: G-code text, its commands, and facts about it.

    Attributes:
        name: name of the file, without folder.
        text: the G-code text.
        commands: the commands of the text, without comments and blanks.
        seconds: modelled time of all moves and dwells, including start and end G-code, without homing and heating.
        heights: z of all extrusions, mm, in order of first occurrence, including priming in the start G-code.
        end: (3,) position after the last move, mm.
        program: the moves, if the job was sliced by this package.
        marks: index of the first command of each layer -> layer number from 1, from layer comments.
        roles: index of a command -> name of the role that starts there, from comments.
        repairs: repairs of the mesh, if the job was sliced by this package.
        findings: diagnostics, such as errors and warnings.
        allowed: names of the findings that the user has allowed, see `diagnostics.NAMES`.
        profile: the profile with which the job was sliced or read; None if there was none.
        notes: for each setting that was given to `slice` under another slicer's name: the setting that it became here.
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
    profile: Profile | None = None
    notes: tuple[str, ...] = ()

    @property
    def plan(self) -> LayerPlan | None:
        """The layer plan, if the job was sliced by this package."""
        return self.program.plan if self.program else None

    def __repr__(self) -> str:
        layers = f"{self.plan.n_layers} layers, " if self.plan else ""
        findings = f", {len(self.findings)} findings" if self.findings else ""
        facts = f"{layers}{len(self.commands)} commands, {self.seconds / 60:.0f} min{findings}"
        return f"<Job {self.name!r}: {'; '.join([facts, *self.notes])}>"

    @property
    def drawable(self) -> object:
        """The moves, if the job was sliced by this package; otherwise a summary of the file."""
        facts = {
            "commands": str(len(self.commands)),
            "layers": f"extrusions at {len(self.heights)} heights",
            "motion": format_duration(self.seconds),
        }
        return self.program or Summary(
            self.name, facts, [sentence(one) for one in self.findings if one.is_error]
        )

    def require_profile(self, profile: Profile | None) -> Profile:
        """Return `profile`, or the profile of the job if it is None.

        Raises:
            UsageError: both are None, or `profile` is not a Profile.
        """
        from printer_slicer.profile import Profile as ProfileType  # noqa: PLC0415 - loaded by the caller anyway

        found = self.profile if profile is None else profile
        if found is None:
            raise UsageError(
                f"{self.name}: the job has no profile", remedy="Pass a profile as the argument `profile`"
            )
        check_argument("profile", found, ProfileType)
        return found

    def save(self, path: str | Path) -> None:
        """Write the G-code to a file.

        Raises:
            OutputError: the file cannot be written; an existing file is left unchanged.
        """
        save(Path(path), self.text)

    def allowing(self, names: Iterable[str]) -> Job:
        """Return the job with these findings allowed.

        Raises:
            UsageError: a name is unknown.
        """
        return replace(self, allowed=self.allowed | check_allowed_codes(names))

    def line_of(self, command: int) -> int:
        """Return the line number, from 1, of the command with index `command`; 0 if there is none."""
        return find_lines(self.text, [command])[0]

    def layer_of(self, command: int) -> int:
        """Return the layer number, from 1, of the command with index `command`; 0 before the first layer."""
        index = bisect_right(list(self.marks), command) - 1
        return list(self.marks.values())[index] if index >= 0 else 0

    @property
    def last_layer(self) -> int:
        """Number of the last layer; 0 if it is unknown."""
        return self.plan.n_layers if self.plan else max(self.marks.values(), default=0)


def build_job(
    name: str, text: bytes, *, limits: MotionLimits, corner: tuple[float, float], flavour: str
) -> Job:
    """Build a job from G-code text that was linted before; the text is not linted again.

    Args:
        name: name of the job.
        text: the G-code.
        limits: motion limits of the machine.
        corner: front left corner of the bed, mm.
        flavour: firmware flavour that decides what commands mean.

    Raises:
        UsageError: the text has no commands, or a command that cannot be sent.
    """
    from printer_slicer.gcode import read_moves_in_pieces  # noqa: PLC0415 - printing a finished job needs no numpy

    split = split_sendable(name, text)
    summary = JobSummary(limits)
    for piece in read_moves_in_pieces(split.commands, corner, FLAVOURS[flavour]):
        summary.add(piece)
    return summary.make_job(name, text, split)


def split_sendable(name: str, text: bytes, *, streamed: bool = True) -> GcodeText:
    """Split G-code into commands, and check that all of them can be sent.

    Args:
        name: name of the job, for messages.
        text: the G-code.
        streamed: whether the text is sent line by line; uploaded files may have longer lines.

    Raises:
        UsageError: the text has no commands, or a command that cannot be sent.
    """
    split = split_gcode(text)
    if not split.commands:
        raise UsageError(f"{name}: the file contains no commands", remedy="Check that it is a G-code file")
    if streamed:
        check_sendable(name, text, split)
    return split


class JobSummary:
    """Collects print time, heights and end position of moves that arrive in blocks.

    Args:
        limits: motion limits of the machine.
    """

    def __init__(self, limits: MotionLimits) -> None:
        from printer_slicer.gcode import Timer  # noqa: PLC0415 - printing a finished job needs no numpy

        self._timer = Timer(limits)
        self._heights: dict[float, None] = {}
        self._end = (0.0, 0.0, 0.0)

    def add(self, moves: Moves) -> Moves:
        """Add the next block of moves, and return it."""
        self._timer.add(moves)
        self._heights |= dict.fromkeys(moves.heights())
        if len(moves.end):
            x, y, z = moves.end[-1].tolist()
            self._end = x, y, z
        return moves

    def make_job(self, name: str, text: bytes, split: GcodeText) -> Job:
        """Return the job with these moves, without findings."""
        return Job(
            name,
            text,
            split.commands,
            self._timer.seconds(),
            tuple(self._heights),
            self._end,
            marks=split.marks,
            roles=split.roles,
        )
