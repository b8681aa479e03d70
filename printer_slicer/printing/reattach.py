"""Taking up a print that another host, or this one before the cable was pulled, had to leave.

The journal says what the last lines were, the printer says which of them it took, and where its plan ends. If that
agrees, the printer has kept its state: nothing is sent again, and nothing is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import HEATERS_OFF, Journal, JournalData, dataclass_from_json
from printer_slicer.printing.machine_state import SCRIPT, PrintState
from printer_slicer.printing.objects import LiveJob, Span
from printer_slicer.printing.parking import ParkedState, parse_parked_state, return_to_part
from printer_slicer.stream.events import AxisPositions
from printer_slicer.stream.resync import Resync
from printer_slicer.stream.session import Transport

__all__ = [
    "PrinterStateLost",
    "ResumePlan",
    "find_journal_damage",
    "find_resume_plan",
    "query_printer",
    "rebuild",
]

_BEHIND: Final = 8
"""Lines that may count as accepted on record and were not: an ok too many on a bad cable."""

_BEYOND: Final = 64
_QUESTIONS: Final = ("M105", "M114", "M115", "M155", "M400")
_SAME_PLACE: Final = 0.06


class PrinterStateLost(Exception):  # noqa: N818 - not a fault: what the printer knew is gone
    """The printer has not kept its state; says why."""


@dataclass(frozen=True, slots=True)
class ResumePlan:
    """Where to go on.

    Attributes:
        entries: of the job that the printer has.
        job: the entries, followed up to there.
        phase: what the host was doing: "printing", "parking", "returning", "cancelling"...
        parked: what to come back to, None while printing and when it has come back.
        pushed: mm of filament since it was left.
        replay: what is left of thrown-away moves, or what is sent before the rest.
        point: where a printer that had lost its state is brought to, as the journal holds it.
    """

    entries: int
    job: LiveJob
    phase: str
    parked: ParkedState | None
    pushed: float
    replay: tuple[str, ...] = ()
    point: Mapping[str, Any] | None = None

    @property
    def waits(self) -> bool:
        """Whether it was paused, and waits for a person."""
        return self.phase == "parking"


@dataclass(frozen=True, slots=True)
class _States:
    """State of a pause in the journal, as far as a resume needs it."""

    phase: str = "printing"
    parked: ParkedState | None = None
    pushed: float = 0.0
    line: int = 0
    heaters_off: str = ""
    cancelled_at: Mapping[str, Any] = field(default_factory=dict)
    recovering_at: Mapping[str, Any] | None = None


def find_journal_damage(journal_data: JournalData, total: int) -> str:
    """Return why a journal cannot be resumed; empty if it can.

    Args:
        journal_data: the journal.
        total: number of commands of the job.
    """
    if journal_data.damage:
        return journal_data.damage
    most = max([journal_data.base, journal_data.entries, *(record.entries for record in journal_data.lines)])
    if most > total:
        return f"it lists {most} accepted commands, but the job has {total}"
    try:
        states = dataclass_from_json(
            _States, {name: one for name, one in journal_data.states.items() if one not in ({}, "")}
        )
        if not all(isinstance(at, int) and 0 <= at <= total for at in states.cancelled_at.values()):
            return "a cancelled object has an invalid command number"
        places: list[ParkedState | _RecoveryPosition] = [states.parked] if states.parked else []
        if states.recovering_at is not None:
            places.append(dataclass_from_json(_RecoveryPosition, states.recovering_at))
    except TypeError as error:
        return f"a state is invalid: {error}"
    beyond = [place.entries for place in places if not 0 <= place.entries <= total]
    return f"it resumes after {beyond[0]} commands, but the job has {total}" if beyond else ""


@dataclass(frozen=True, slots=True)
class _RecoveryPosition:
    """The position to which the printer returns."""

    entries: int
    stand: ModalState
    replay: tuple[str, ...]


def query_printer(
    transport: Transport,
    clock: Callable[[], float],
    journal_data: JournalData,
    journal: Journal | None = None,
) -> Resync:
    """Ask the printer what it took, and wait for its answers.

    Raises:
        PortError: the cable is gone.
    """
    last = max(
        [journal_data.line, journal_data.before, *(record.number for record in journal_data.lines[-1:])]
    )
    resync = Resync(last)
    noted = False
    while not resync.done:
        if resync.line is not None and not noted and journal is not None:
            noted = True
            for number, question in resync.queries():
                journal.numbered(number, journal_data.entries_at(resync.line), question)
        if data := resync.send(clock()):
            transport.write(data)
        due = resync.wakeup()
        resync.receive(transport.read(0.25 if due is None else min(max(due - clock(), 0.0), 0.25)), clock())
    return resync


def find_resume_plan(
    journal_data: JournalData,
    resync: Resync,
    commands: Sequence[bytes],
    spans: tuple[Span, ...],
    setup: HostSettings,
) -> ResumePlan:
    """Where to go on, after the printer has answered.

    Raises:
        Lost: it has not kept its state.
    """
    line = resync.line
    if journal_data.states.get("phase") == "recovering":
        raise PrinterStateLost("it was being brought back to its place")
    if off := journal_data.states.get(HEATERS_OFF):
        raise PrinterStateLost(f"its heaters were switched off: {off}")
    if resync.reason or line is None:
        raise PrinterStateLost(resync.reason or "it does not say which line it took")
    entries = _entries(journal_data, line)
    job = rebuild(journal_data, line, commands, spans, setup.flavour)
    job.follow(entries)
    parked, pushed, replay = _parked(journal_data, line, setup)
    _check_position(job.modes, resync.position)
    phase = str(journal_data.states.get("phase", "printing"))
    if phase == "returning" and parked is None:
        phase = "printing"
    return ResumePlan(entries, job, phase, parked, pushed, replay)


def _entries(journal_data: JournalData, line: int) -> int:
    if journal_data.line == 0 and line in {journal_data.before, 0, 1, 2}:
        # Numbers had just begun anew, or were about to: nothing of the job went out since.
        return journal_data.base
    if line < 1 or not journal_data.line - _BEHIND <= line <= journal_data.line + _BEYOND:
        raise PrinterStateLost(f"it took line {line} last, and line {journal_data.line} is on record")
    return journal_data.entries_at(line)


def rebuild(
    journal_data: JournalData, line: int, commands: Sequence[bytes], spans: tuple[Span, ...], flavour: str
) -> LiveJob:
    """The job as it was sent so far: what was said between, what was given up; not followed beyond the last of that."""
    job = LiveJob(commands, spans, flavour=flavour)
    given_up = sorted((at, name) for name, at in dict(journal_data.states.get("cancelled_at", {})).items())
    happened = [(at, 0, name) for at, name in given_up]
    happened += [
        (entries, 1, command.decode("latin-1")) for entries, command in journal_data.others_until(line)
    ]
    for entries, kind, text in sorted(happened, key=lambda one: one[:2]):
        if kind == 0:
            job.cancel(text, entries)
        else:
            job.follow(entries)
            job.modes.follow(text.encode("latin-1"), -1 if text.startswith(_QUESTIONS) else SCRIPT)
    return job


def _parked(
    journal_data: JournalData, line: int, setup: HostSettings
) -> tuple[ParkedState | None, float, tuple[str, ...]]:
    """What it has to come back to, and how much of that has happened."""
    values = journal_data.states.get("parked")
    if not values:
        return None, 0.0, ()
    parked, pushed = parse_parked_state(values), float(journal_data.states.get("pushed", 0.0))
    first = int(journal_data.states.get("line", 0))
    since = [one.command for one in journal_data.lines if first <= one.number <= line and one.command]
    back = return_to_part(parked, setup, pushed) if journal_data.states.get("phase") == "returning" else []
    left = list(parked.replay)
    for command in since:
        word, values_ = parse(command)
        if back and command == back[0]:
            back.pop(0)
        elif (
            journal_data.states.get("phase") == "returning"
            and not back
            and left
            and command == left[0].encode("latin-1")
        ):
            left.pop(0)
            continue
        if word == b"G1":
            pushed += values_.get(b"E", 0.0)
    returned = journal_data.states.get("phase") == "returning" and not back
    return None if returned else parked, pushed, tuple(left)


def _check_position(modes: PrintState, said: AxisPositions | None) -> None:
    """The plan must end where the commands lead."""
    stand = modes.stand
    if said is None or stand.inches:  # firmwares report inches differently
        return
    for name, is_at, to_be in zip("xyz", said, (stand.x, stand.y, stand.z), strict=True):
        if is_at is not None and to_be is not None and abs(is_at - to_be) > _SAME_PLACE:
            raise PrinterStateLost(f"its {name} is {is_at:g}, and should be {to_be:g}")
