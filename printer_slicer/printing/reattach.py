"""Resume a print on a printer that has kept its state, after the host has ended or the connection was lost.

The journal holds the last lines that were sent. The printer reports which of them it accepted, and the end position of
its planned motion. If both agree, the printer has kept its state, and no line is repeated or skipped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import HEATERS_OFF, Journal, JournalData, restore_struct
from printer_slicer.printing.machine_state import SCRIPT_ENTRY, PrintState
from printer_slicer.printing.objects import LiveJob, Span
from printer_slicer.printing.parking import ParkedState, build_return_script, parse_parked_state
from printer_slicer.stream.events import AxisPositions
from printer_slicer.stream.resync import Resync
from printer_slicer.stream.session import Transport
from printer_slicer.values import Struct, field

__all__ = [
    "PrinterStateLost",
    "ResumePlan",
    "find_journal_damage",
    "find_resume_plan",
    "query_printer",
    "rebuild_job",
]

_MAX_LINES_BEHIND: Final = 8
"""Maximum number of lines that the journal lists as accepted by mistake, because of surplus oks on a bad cable."""

_MAX_LINES_BEYOND: Final = 64
_QUERY_COMMANDS: Final = ("M105", "M114", "M115", "M155", "M400")
_POSITION_TOLERANCE: Final = 0.06


class PrinterStateLost(Exception):  # noqa: N818 - a state of the printer, not a fault
    """Raised if the printer has lost its state; the message gives the reason."""


class ResumePlan(Struct, frozen=True):
    """Plan of a resume: where and how to continue an unfinished print.

    Attributes:
        entries: number of job entries that the printer has accepted.
        job: the job entries, with the print state after these entries.
        phase: phase of the print: "printing", "parking", "returning", "cancelling"...
        parked: state to which the nozzle returns, None if the nozzle is on the part.
        extruded: filament extruded since parking, mm.
        replay: commands to send before the rest of the job, such as discarded moves.
        point: recovery point as stored in the journal, if the printer has lost its state.
    """

    entries: int
    job: LiveJob
    phase: str
    parked: ParkedState | None
    extruded: float
    replay: tuple[str, ...] = ()
    point: Mapping[str, Any] | None = None

    @property
    def is_paused(self) -> bool:
        """Return whether the print was paused."""
        return self.phase == "parking"


class _JournalStates(Struct, frozen=True):
    """States in the journal that a resume needs."""

    phase: str = "printing"
    parked: ParkedState | None = None
    pushed: float = 0.0
    line: int = 0
    heaters_off: str = ""
    cancelled_at: Mapping[str, Any] = field(default_factory=dict)
    recovering_at: Mapping[str, Any] | None = None


def find_journal_damage(journal_data: JournalData, total: int) -> str:
    """Return why a print cannot be resumed from its journal; empty if the journal is valid.

    Args:
        journal_data: the journal.
        total: number of commands of the job.
    """
    if journal_data.damage:
        return journal_data.damage
    most = max([journal_data.base, journal_data.entries, *(record.entries for record in journal_data.lines)])
    if most > total:
        return f"the journal lists {most} accepted commands, but the job has {total}"
    try:
        states = restore_struct(
            _JournalStates, {name: one for name, one in journal_data.states.items() if one not in ({}, "")}
        )
        if not all(isinstance(at, int) and 0 <= at <= total for at in states.cancelled_at.values()):
            return "a cancelled object has an invalid command number"
        places: list[ParkedState | _RecoveryPosition] = [states.parked] if states.parked else []
        if states.recovering_at is not None:
            places.append(restore_struct(_RecoveryPosition, states.recovering_at))
    except TypeError as error:
        return f"a recorded state is invalid: {error}"
    beyond = [place.entries for place in places if not 0 <= place.entries <= total]
    return f"the journal resumes after {beyond[0]} commands, but the job has {total}" if beyond else ""


class _RecoveryPosition(Struct, frozen=True):
    """Recovery point as stored in the journal, see `recovery.RecoveryPoint`."""

    entries: int
    stand: ModalState
    replay: tuple[str, ...]


def query_printer(
    transport: Transport,
    clock: Callable[[], float],
    journal_data: JournalData,
    journal: Journal | None = None,
) -> Resync:
    """Query the printer for its last line and position, and wait for the answers.

    Raises:
        PortError: the connection is lost.
    """
    last = max(
        [journal_data.line, journal_data.before, *(record.number for record in journal_data.lines[-1:])]
    )
    resync = Resync(last)
    is_recorded = False
    while not resync.done:
        if resync.line is not None and not is_recorded and journal is not None:
            is_recorded = True
            for number, query in resync.queries():
                journal.record_line(number, journal_data.count_entries_until(resync.line), query)
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
    """Derive the plan of a resume from the journal and the answers of the printer.

    Raises:
        PrinterStateLost: the printer has not kept its state.
    """
    line = resync.line
    if journal_data.states.get("phase") == "recovering":
        raise PrinterStateLost("an earlier recovery was interrupted")
    if off := journal_data.states.get(HEATERS_OFF):
        raise PrinterStateLost(f"the heaters were switched off ({off})")
    if resync.reason or line is None:
        raise PrinterStateLost(resync.reason or "the printer does not report its last line")
    entries = _count_entries(journal_data, line)
    job = rebuild_job(journal_data, line, commands, spans, setup.flavour)
    job.follow(entries)
    parked, extruded, replay = _find_parked_state(journal_data, line, setup)
    _check_position(job.print_state, resync.position)
    phase = str(journal_data.states.get("phase", "printing"))
    if phase == "returning" and parked is None:
        phase = "printing"
    return ResumePlan(entries, job, phase, parked, extruded, replay)


def _count_entries(journal_data: JournalData, line: int) -> int:
    """Return how many job entries are accepted if `line` is the last accepted line.

    Raises:
        PrinterStateLost: the line does not fit the journal.
    """
    if journal_data.line == 0 and line in {journal_data.before, 0, 1, 2}:
        # Numbering has just restarted, or was about to restart: no job entry was sent since.
        return journal_data.base
    if line < 1 or not journal_data.line - _MAX_LINES_BEHIND <= line <= journal_data.line + _MAX_LINES_BEYOND:
        raise PrinterStateLost(f"the last accepted line is {line}, not {journal_data.line}")
    return journal_data.count_entries_until(line)


def rebuild_job(
    journal_data: JournalData, line: int, commands: Sequence[bytes], spans: tuple[Span, ...], flavour: str
) -> LiveJob:
    """Rebuild the job as it was sent up to line `line`, with user commands and cancelled objects."""
    job = LiveJob(commands, spans, flavour=flavour)
    cancelled = sorted((at, name) for name, at in dict(journal_data.states.get("cancelled_at", {})).items())
    changes = [(at, 0, name) for at, name in cancelled]
    changes += [
        (entries, 1, command.decode("latin-1"))
        for entries, command in journal_data.list_inserted_commands_until(line)
    ]
    for entries, kind, text in sorted(changes, key=lambda one: one[:2]):
        if kind == 0:
            job.cancel_object(text, entries)
        else:
            job.follow(entries)
            job.print_state.follow(
                text.encode("latin-1"), -1 if text.startswith(_QUERY_COMMANDS) else SCRIPT_ENTRY
            )
    return job


def _find_parked_state(
    journal_data: JournalData, line: int, setup: HostSettings
) -> tuple[ParkedState | None, float, tuple[str, ...]]:
    """Find the parked state of the print after the line with number `line`.

    Returns:
        Parked state (None if the nozzle has returned), filament extruded since parking (mm), and discarded moves that
        must still be sent.
    """
    values = journal_data.states.get("parked")
    if not values:
        return None, 0.0, ()
    parked, extruded = parse_parked_state(values), float(journal_data.states.get("pushed", 0.0))
    first = int(journal_data.states.get("line", 0))
    since = [one.command for one in journal_data.lines if first <= one.number <= line and one.command]
    back = (
        build_return_script(parked, setup, extruded)
        if journal_data.states.get("phase") == "returning"
        else []
    )
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
            extruded += values_.get(b"E", 0.0)
    returned = journal_data.states.get("phase") == "returning" and not back
    return None if returned else parked, extruded, tuple(left)


def _check_position(print_state: PrintState, reported: AxisPositions | None) -> None:
    """Check that the reported end of the planned motion agrees with the commands.

    Raises:
        PrinterStateLost: the positions differ.
    """
    modal = print_state.modal
    if reported is None or modal.inches:  # firmwares report inches differently
        return
    for name, actual, expected in zip("xyz", reported, (modal.x, modal.y, modal.z), strict=True):
        if actual is not None and expected is not None and abs(actual - expected) > _POSITION_TOLERANCE:
            raise PrinterStateLost(f"{name} of the nozzle is {actual:g} mm instead of {expected:g} mm")
