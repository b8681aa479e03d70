"""The values of the print queue: files, jobs, printers, runs, and the states that they can have."""

from __future__ import annotations

import re
from typing import Final, Literal

from printer_slicer.errors import UsageError
from printer_slicer.values import Struct

__all__ = [
    "ACTIVE_STATES",
    "ENDED_STATES",
    "MAX_NAME_LENGTH",
    "TRANSITIONS",
    "WAITING_STATES",
    "BedState",
    "JobRequest",
    "JobState",
    "PrintRun",
    "PrinterState",
    "QueueSnapshot",
    "QueuedFile",
    "QueuedJob",
    "RunOutcome",
    "check_transition",
    "clean_name",
]

JobState = Literal["held", "ready", "starting", "printing", "done", "failed", "cancelled"]
BedState = Literal["clear", "occupied", "unknown"]
RunOutcome = Literal["done", "failed", "cancelled", "rejected", "not_started", "lost"]

TRANSITIONS: Final[dict[JobState, frozenset[JobState]]] = {
    "held": frozenset({"ready", "cancelled"}),
    "ready": frozenset({"held", "starting", "cancelled"}),
    "starting": frozenset({"printing", "ready", "done", "failed", "cancelled"}),
    "printing": frozenset({"done", "failed", "cancelled"}),
    "done": frozenset(),
    "failed": frozenset({"ready"}),
    "cancelled": frozenset({"ready"}),
}
"""State of a job -> the states that may follow. Only a person leads from failed or cancelled back to ready."""

WAITING_STATES: Final[frozenset[JobState]] = frozenset({"held", "ready"})
ACTIVE_STATES: Final[frozenset[JobState]] = frozenset({"starting", "printing"})
ENDED_STATES: Final[frozenset[JobState]] = frozenset({"done", "failed", "cancelled"})

MAX_NAME_LENGTH: Final = 200
"""Characters of the name of a file."""

_NOT_SHOWN: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]+")


class QueuedFile(Struct, frozen=True):
    """A file in the store of the queue.

    Attributes:
        id: SHA-256 of the content, hexadecimal.
        name: name under which it was added last, without folder.
        size: bytes.
        added: time of the upload, s since 1970.
    """

    id: str
    name: str
    size: int
    added: float


class JobRequest(Struct, frozen=True):
    """What is wanted of a new job.

    Attributes:
        name: name of the job; empty: that of the file.
        printer: name of the printer or of a group of printers; empty: any that fits.
        material: name or type of the material to print with; empty: the material in the file.
        allow: names of findings that do not prevent the print, see `Job.allowing`.
        held: whether the job waits until a person releases it.
        first: whether the job is placed before all waiting jobs.
        copies: number of jobs to add.
    """

    name: str = ""
    printer: str = ""
    material: str = ""
    allow: tuple[str, ...] = ()
    held: bool = False
    first: bool = False
    copies: int = 1


class QueuedJob(Struct, frozen=True):
    """A job of the queue: one print of a file.

    Attributes:
        id: number of the job.
        name: name for people.
        file: id of its file.
        state: state of the job.
        printer, material, allow: as in `JobRequest`.
        added: time at which it was added, s since 1970.
        message: why it ended or waits again; empty if there is nothing to say.
        run: id of its last run; empty if it was never started.
    """

    id: int
    name: str
    file: str
    state: JobState
    printer: str
    material: str
    allow: tuple[str, ...]
    added: float
    message: str
    run: str


class PrinterState(Struct, frozen=True):
    """What the queue knows about a printer.

    Attributes:
        name: name of the printer in printers.toml.
        bed: whether the bed is clear. Every start sets `occupied`, and only a person sets `clear`.
        material: name of the loaded material.
        job: number of the job that it prints; None if it prints none.
        message: how its last run ended, if that needs attention.
        webcam, webcam_interval: picture of the printer, as in `PrinterEntry`.
    """

    name: str
    bed: BedState
    material: str
    job: int | None
    message: str
    webcam: str = ""
    webcam_interval: float = 0.0


class PrintRun(Struct, frozen=True):
    """One start of a job on a printer.

    Attributes:
        id: name of the folder of the run, and of the folder of its print in the job store.
        job: number of the job.
        printer: name of the printer.
        started: time of the start, s since 1970.
        ended: time of the end, s since 1970; None while it runs.
        outcome: how it ended; empty while it runs.
        message: why it ended so.
        is_cancelling: whether a person asked for its end.
        findings: names of the findings that prevented the print; a job that allows them is printed.
    """

    id: str
    job: int
    printer: str
    started: float
    ended: float | None
    outcome: RunOutcome | Literal[""]
    message: str
    is_cancelling: bool
    findings: tuple[str, ...] = ()


class QueueSnapshot(Struct, frozen=True):
    """The queue at one moment.

    Attributes:
        revision: number that grows with each change.
        printers: all printers, in the order of printers.toml.
        jobs: the jobs that have not ended, in the order of the queue.
        runs: the runs that have not ended.
    """

    revision: int
    printers: tuple[PrinterState, ...]
    jobs: tuple[QueuedJob, ...]
    runs: tuple[PrintRun, ...]


def check_transition(job: int, before: JobState, after: JobState) -> None:
    """Check that a job may change its state.

    Raises:
        UsageError: it may not.
    """
    if after not in TRANSITIONS[before]:
        raise UsageError(
            f"job {job} is {before} and cannot become {after}", remedy="Run printer-slicer queue list"
        )


def clean_name(name: str) -> str:
    """Return the last part of a file name, without control characters and marks that change the direction of text."""
    last = re.split(r"[/\\]", name)[-1]
    return _NOT_SHOWN.sub("", last).strip()[:MAX_NAME_LENGTH] or "unnamed"
