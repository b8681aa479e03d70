"""Explain in words why a job of the queue waits."""

from __future__ import annotations

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.matching import (
    find_mismatches,
    find_obstacles,
    is_wanted_printer,
    read_traits,
)
from printer_slicer.print_queue.printers import PrinterEntry
from printer_slicer.print_queue.queue_store import PrintQueue
from printer_slicer.print_queue.records import PrinterState, QueuedJob, QueueSnapshot
from printer_slicer.print_queue.supervisor import is_supervised
from printer_slicer.values import Struct

__all__ = ["Explanation", "PrinterMatch", "explain_job"]


class PrinterMatch(Struct, frozen=True):
    """Whether a job can be printed on a printer.

    Attributes:
        printer: name of the printer.
        fits: whether it could print the job, now or later.
        reasons: why it does not print the job now, one sentence each; empty if it would.
        remedy: what to do on the command line; empty if there is nothing to do.
    """

    printer: str
    fits: bool
    reasons: tuple[str, ...]
    remedy: str = ""


class Explanation(Struct, frozen=True):
    """Why a job waits.

    Attributes:
        job: the job.
        summary: the most important reason, one sentence.
        printers: the printers, in the order of printers.toml.
        remedy: what to do on the command line; empty if there is nothing to do.
    """

    job: QueuedJob
    summary: str
    printers: tuple[PrinterMatch, ...]
    remedy: str = ""


def explain_job(queue: PrintQueue, job: int) -> Explanation:
    """Explain why a job waits.

    Raises:
        UsageError: there is no such job, or printers.toml is invalid.
    """
    snapshot = queue.snapshot()
    found = queue.find_job(job)
    states = {state.name: state for state in snapshot.printers}
    matches = tuple(
        _match_printer(queue, snapshot, found, entry, states[entry.name])
        for entry in queue.list_printers()
        if entry.name in states  # printers.toml may change in between
    )
    return Explanation(found, *_summarise(queue, found, matches))


def _match_printer(
    queue: PrintQueue, snapshot: QueueSnapshot, job: QueuedJob, entry: PrinterEntry, state: PrinterState
) -> PrinterMatch:
    """Return whether a job can be printed on a printer."""
    reasons = _find_lasting_reasons(queue, job, entry, state)
    if reasons:
        return PrinterMatch(entry.name, fits=False, reasons=tuple(reasons))
    earlier = _find_earlier_job(queue, snapshot, job, entry, state)
    reasons = [] if earlier is None else [f"job {earlier} is before it in the queue"]
    reasons += [] if state.job == job.id else find_obstacles(state)
    needs_person = state.job is None and state.bed != "clear"
    remedy = f"run printer-slicer queue clear-bed {state.name} when it is clear" if needs_person else ""
    return PrinterMatch(entry.name, fits=True, reasons=tuple(reasons), remedy=remedy)


def _find_lasting_reasons(
    queue: PrintQueue, job: QueuedJob, entry: PrinterEntry, state: PrinterState
) -> list[str]:
    """Return why a printer cannot print a job even when it is free."""
    if not is_wanted_printer(job, entry):
        return [f"the job is for {job.printer}"]
    try:
        traits = read_traits(entry, state.material)
    except UsageError as error:
        return [str(error.args[0])]
    return find_mismatches(job, queue.read_facts(job.file), traits)


def _find_earlier_job(
    queue: PrintQueue, snapshot: QueueSnapshot, job: QueuedJob, entry: PrinterEntry, state: PrinterState
) -> int | None:
    """Return the first ready job that is ahead of this one and that the printer can print, too."""
    for one in snapshot.jobs:
        if one.id == job.id:
            return None
        if one.state == "ready" and not _find_lasting_reasons(queue, one, entry, state):
            return one.id
    return None


def _summarise(
    queue: PrintQueue, job: QueuedJob, matches: tuple[PrinterMatch, ...]
) -> tuple[str, tuple[PrinterMatch, ...], str]:
    """Return the most important reason as a sentence, the printers, and what to do on the command line."""
    summary = _find_main_reason(queue, job, matches)
    if job.state == "held":
        return summary, matches, f"run printer-slicer queue release {job.id}"
    is_waiting = job.state == "ready" and any(match.fits for match in matches)
    return summary, matches, "run printer-slicer queue run" if is_waiting and not is_supervised(queue) else ""


def _find_main_reason(queue: PrintQueue, job: QueuedJob, matches: tuple[PrinterMatch, ...]) -> str:
    """Return the most important reason as a sentence."""
    if job.state == "held":
        return f"job {job.id} is held until it is released"
    if job.state != "ready":
        message = f": {job.message}" if job.message else ""
        return f"job {job.id} is {job.state}{message}"
    fitting = [match for match in matches if match.fits]
    if not fitting:
        return f"no printer can print job {job.id}"
    if not is_supervised(queue):
        return f"job {job.id} waits for a program that starts jobs"
    if free := [match.printer for match in fitting if not match.reasons]:
        return f"job {job.id} is about to start on {free[0]}"
    return f"job {job.id} waits for {' or '.join(match.printer for match in fitting)}"
