"""Start the jobs of the queue on free printers, and record how their prints end.

Only one supervisor works on a queue. It can be killed at any moment: what it does next depends only on the database
and on the folders of the runs, see `run_folder`.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from shutil import rmtree
from threading import Event as Flag
from time import time
from typing import Final, Protocol

from printer_slicer.errors import PortError, PrinterSlicerError, UsageError
from printer_slicer.print_queue.matching import (
    PrinterTraits,
    find_mismatches,
    find_obstacles,
    is_wanted_printer,
    read_traits,
)
from printer_slicer.print_queue.printers import PrinterEntry, list_missing_profiles
from printer_slicer.print_queue.queue_store import PrintQueue
from printer_slicer.print_queue.records import PrinterState, PrintRun, QueuedJob, QueueSnapshot
from printer_slicer.print_queue.run_folder import (
    LOG_FILE,
    RunInstructions,
    RunReport,
    RunResult,
    create_run_folder,
    read_report,
    request_end,
    try_to_claim,
)
from printer_slicer.printing.control_socket import send_control_command
from printer_slicer.printing.detached import spawn_detached
from printer_slicer.printing.job_store import default_job_store
from printer_slicer.process_lock import ProcessLock
from printer_slicer.values import as_dict

__all__ = ["PrintProcess", "Supervisor", "is_supervised", "launch_run", "lock_queue", "request_cancellation"]

_LOCK_FILE: Final = "supervisor.lock"
_INTERVAL: Final = 0.5  # s between two looks at the running prints
_LOCK_TIMEOUT: Final = 1.0  # s; `is_supervised` holds the lock for a moment
_LOG_SECONDS: Final = 90 * 86400.0  # after the end of a run, in which its folder is kept
_CANCEL_TIMEOUT: Final = 2.0  # s


class PrintProcess(Protocol):
    """A process that was started: `poll` returns None while it runs."""

    def poll(self) -> int | None:
        """Return the exit code; None while the process runs."""


def launch_run(folder: Path) -> PrintProcess:
    """Start the process that prints the run in a folder; it outlives this process.

    Raises:
        OSError: the process cannot be started.
    """
    return spawn_detached(["-m", "printer_slicer.print_queue.run_print", str(folder)], folder / LOG_FILE)


@contextmanager
def lock_queue(queue: PrintQueue) -> Iterator[None]:
    """Keep other supervisors off the queue within a `with` block.

    Raises:
        UsageError: another supervisor works on this queue.
    """
    lock = ProcessLock(queue.folder / _LOCK_FILE)
    if not lock.acquire(_LOCK_TIMEOUT):
        raise UsageError(
            f"another process runs the queue in {queue.folder}", remedy="Use it, or end it first"
        )
    try:
        yield
    finally:
        lock.release()


def is_supervised(queue: PrintQueue) -> bool:
    """Return whether a supervisor works on the queue."""
    return ProcessLock(queue.folder / _LOCK_FILE).is_held()


def request_cancellation(queue: PrintQueue, job: int) -> None:
    """Ask the print of a cancelled job to end now; if it does not answer yet, the supervisor asks it later."""
    for run in queue.list_active_runs():
        if run.job == job and run.is_cancelling:
            _request_end(queue.find_run_folder(run.id), default_job_store() / run.id)


def _request_end(run_folder: Path, print_folder: Path) -> None:
    """Ask a print to end: one on a port if it answers, one on a print server when it looks next."""
    request_end(run_folder)
    with suppress(PortError):
        send_control_command(print_folder, "cancel", timeout=_CANCEL_TIMEOUT)


class Supervisor:
    """Starts jobs and follows their prints; the caller holds `lock_queue`.

    Args:
        queue: the queue.
        launch: starts the process of a run, whose folder is its argument.
        on_change: called with a sentence for each start and each end.
    """

    def __init__(
        self,
        queue: PrintQueue,
        *,
        launch: Callable[[Path], PrintProcess] = launch_run,
        on_change: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._queue, self._launch, self._on_change = queue, launch, on_change
        self._processes: dict[str, PrintProcess] = {}
        self._traits: dict[tuple[PrinterEntry, str], PrinterTraits] = {}
        self._job_store = default_job_store()

    def run(self, stop: Callable[[], bool]) -> None:
        """Work on the queue until `stop` returns True, which is asked at least twice a second.

        An error, such as an invalid printers.toml or a full disk, is told to `on_change`, and the work is tried again.
        """
        self.recover()
        with suppress(PrinterSlicerError):  # the first step tells it
            for text in list_missing_profiles(self._queue.list_printers()):
                self._on_change(text)
        revision, problem = -1, ""
        while not stop():
            try:
                revision, problem = self.step(), ""
            except PrinterSlicerError as error:
                if problem != str(error):
                    problem = str(error)
                    self._on_change(problem)
            try:
                self._queue.wait_for_change(revision, _INTERVAL)
            except PrinterSlicerError:  # the next step tells it
                Flag().wait(_INTERVAL)

    def recover(self) -> None:
        """Delete what is not needed any more; call it once, before the first `step`.

        That is what an interrupted supervisor or upload has left, and the logs of runs that ended 90 days ago.
        """
        self._queue.files.delete_interrupted_uploads()
        known = self._queue.list_run_ids().difference(self._queue.list_old_runs(time() - _LOG_SECONDS))
        for folder in self._queue.find_run_folder("").glob("*"):
            if folder.name not in known:
                rmtree(folder, ignore_errors=True)

    def step(self) -> int:
        """Record what has happened to the running prints, and start what can be started; return the revision.

        Raises:
            UsageError: printers.toml is invalid.
            OutputError: the database or the folder of a run cannot be written.
        """
        for run in self._queue.list_active_runs():
            self._follow(run)
        snapshot = self._queue.snapshot()
        self._start_jobs(snapshot)
        return snapshot.revision

    # Prints that were started.

    def _follow(self, run: PrintRun) -> None:
        """Record what has happened to a run since the last look."""
        folder = self._queue.find_run_folder(run.id)
        report = self._settle(run, folder)
        if report.result is not None:
            self._processes.pop(run.id, None)
            result = report.result
            self._queue.end_run(run.id, result.outcome, result.message, result.findings)
            said = result.outcome.replace("_", " ")
            message = f": {result.message}" if result.message else ""
            self._on_change(f"{run.printer}: job {run.job} {said}{message}")
            return
        if report.state == "printing":
            if self._queue.find_job(run.job).state == "starting":
                self._queue.mark_printing(run.id)
                self._on_change(f"{run.printer}: job {run.job} is printing")
            if run.is_cancelling:
                _request_end(folder, self._job_store / run.id)

    def _settle(self, run: PrintRun, folder: Path) -> RunReport:
        """Return what the folder of a run says; a run without a process is claimed, so that it never starts."""
        report = read_report(folder)
        if report.state != "unclaimed" or self._has_process(run.id):
            return report
        if try_to_claim(folder):
            return RunReport("ended", RunResult("not_started", "the print was not started"))
        return read_report(folder)

    def _has_process(self, run: str) -> bool:
        """Return whether this supervisor has started the process of a run, and the process has not ended."""
        process = self._processes.get(run)
        return process is not None and process.poll() is None

    # New prints.

    def _start_jobs(self, snapshot: QueueSnapshot) -> None:
        """Start the first job that fits on each printer that is free."""
        entries = {entry.name: entry for entry in self._queue.list_printers()}
        waiting = [job for job in snapshot.jobs if job.state == "ready"]
        for state in snapshot.printers:
            entry = entries.get(state.name)  # None: was removed from printers.toml since the snapshot
            if entry is None or find_obstacles(state) or not waiting:
                continue
            traits = self._find_traits(entry, state.material)
            job = next((one for one in waiting if self._fits(one, entry, traits)), None)
            if job is not None:
                waiting.remove(job)
                self._start(job, entry, state)

    def _find_traits(self, entry: PrinterEntry, material: str) -> PrinterTraits | None:
        """Return what a printer can print; None if its profiles cannot be read now."""
        key = (entry, material)
        if key not in self._traits:
            try:
                self._traits[key] = read_traits(entry, material)
            except UsageError:  # `run` tells it, and so does `explain_job`
                return None
        return self._traits[key]

    def _fits(self, job: QueuedJob, entry: PrinterEntry, traits: PrinterTraits | None) -> bool:
        """Return whether a job can be printed on a printer."""
        return (
            traits is not None
            and is_wanted_printer(job, entry)
            and not find_mismatches(job, self._queue.read_facts(job.file), traits)
        )

    def _start(self, job: QueuedJob, entry: PrinterEntry, state: PrinterState) -> None:
        """Start a job on a printer, unless a person has changed one of them in the meantime."""
        run = _make_run_id(job.name)
        folder = self._queue.find_run_folder(run)
        path = self._queue.files.find_path(job.file)
        instructions = RunInstructions(
            job.name, str(path), as_dict(entry), state.material, job.allow, str(self._job_store)
        )
        create_run_folder(folder, instructions)
        if not self._queue.begin_run(run, job.id, entry.name):
            rmtree(folder, ignore_errors=True)
            return
        self._on_change(f"{entry.name}: job {job.id} starts: {job.name}")
        with suppress(OSError):  # the next step finds a run without a process
            self._processes[run] = self._launch(folder)


def _make_run_id(name: str) -> str:
    """Return the id of a new run: the time, the name of the job, and random digits."""
    now = datetime.now(UTC).astimezone()
    safe_name = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:40]
    return f"{now:%Y%m%d-%H%M%S}-{safe_name}-{secrets.token_hex(3)}"
