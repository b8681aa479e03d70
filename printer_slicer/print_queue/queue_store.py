"""The print queue: its files, jobs, printers and runs, in a folder that several processes may use at the same time."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import closing, suppress
from itertools import islice
from pathlib import Path
from threading import Event as Flag
from time import monotonic, time
from typing import Final

from printer_slicer.diagnostics import check_allowed_codes
from printer_slicer.errors import PrinterSlicerError, UsageError
from printer_slicer.print_queue.database import QueueDatabase
from printer_slicer.print_queue.file_facts import FileFacts, format_facts, parse_facts
from printer_slicer.print_queue.file_store import DEFAULT_MAX_BYTES, FileStore
from printer_slicer.print_queue.folders import DATABASE_FILE, default_queue_folder, has_default_queue
from printer_slicer.print_queue.printers import PrinterEntry, find_printers_file, read_printers
from printer_slicer.print_queue.queue_rows import (
    HAS_ENDED,
    LIST_REMEDY,
    SELECT_JOB,
    SELECT_RUN,
    change_state,
    clip_number,
    find_jobs_of_request,
    insert_job,
    make_job,
    make_run,
    raise_missing_job,
    read_order,
    read_state,
    store_request,
    write_order,
)
from printer_slicer.print_queue.records import (
    ACTIVE_STATES,
    WAITING_STATES,
    BedState,
    JobRequest,
    JobState,
    PrinterState,
    PrintRun,
    QueuedFile,
    QueuedJob,
    QueueSnapshot,
    RunOutcome,
    clean_name,
)
from printer_slicer.printing.job_store import is_same_port
from printer_slicer.saving import make_folder
from printer_slicer.values import as_dict

__all__ = ["MAX_COPIES", "PrintQueue", "occupy_bed_on_port", "open_queue"]

MAX_COPIES: Final = 1000
"""Largest number of jobs that one request adds."""

_POLL_INTERVAL: Final = 0.1  # s
_OUTCOME_STATES: Final[dict[RunOutcome, JobState]] = {
    "done": "done",
    "failed": "failed",
    "cancelled": "cancelled",
    "rejected": "failed",
    "not_started": "ready",
    "lost": "failed",
}
"""Outcome of a run -> the state of its job afterwards."""


def open_queue(folder: Path | None = None, printers_file: Path | None = None) -> PrintQueue:
    """Open the queue in a folder, which is created if it is missing.

    Args:
        folder: folder of the queue; None: `default_queue_folder`.
        printers_file: the file printers.toml; None: `find_printers_file`.

    Raises:
        OutputError: the folder or its database cannot be opened.
    """
    return PrintQueue(folder or default_queue_folder(), printers_file or find_printers_file())


def occupy_bed_on_port(port: str) -> None:
    """Record that a print begins on a port without the queue, so that no job is started onto its part.

    Does nothing if there is no queue, or none of its printers is connected to this port.
    """
    if not has_default_queue():
        return
    with suppress(PrinterSlicerError), closing(open_queue()) as queue:
        for entry in queue.list_printers():
            if is_same_port(entry.port, port):
                queue.set_bed(entry.name, "occupied")


class PrintQueue:
    """The queue in a folder. Its methods may be called on any thread; each change is one transaction.

    Args:
        folder: folder of the queue, which is created if it is missing.
        printers_file: the file printers.toml, which is read again when it changes.
        max_bytes: largest file that is accepted.

    Attributes:
        folder: folder of the queue.
        files: the files by their ids.

    Raises:
        OutputError: the folder or its database cannot be opened.
    """

    def __init__(self, folder: Path, printers_file: Path, *, max_bytes: int = DEFAULT_MAX_BYTES) -> None:
        make_folder(folder)
        self.folder = folder
        self.files = FileStore(folder / "files", max_bytes)
        self._printers_file = printers_file
        self._printers: tuple[int, tuple[PrinterEntry, ...]] = (-1, ())
        self._database = QueueDatabase(folder / DATABASE_FILE)

    def close(self) -> None:
        """Close the database."""
        self._database.close()

    # Files.

    def add_file(self, name: str, pieces: Iterable[bytes]) -> QueuedFile:
        """Store a file that arrives in pieces; the same content is stored once, with its last name.

        Args:
            name: name of the file; folders in it are ignored.
            pieces: its content.

        Raises:
            UsageError: the file is too large.
            OutputError: it cannot be stored.
        """
        stored = self.files.add(pieces)
        with self._database.transaction() as connection:
            connection.execute(
                "INSERT INTO file (id, name, size, added) VALUES (?, ?, ?, ?) "
                "ON CONFLICT (id) DO UPDATE SET name = excluded.name, added = excluded.added",
                (stored.id, clean_name(name), stored.size, time()),
            )
            self._require_content(stored.id)
        return self.find_file(stored.id)

    def find_file(self, file_id: str) -> QueuedFile:
        """Return a file.

        Raises:
            UsageError: there is none with this id.
        """
        rows = self._database.read("SELECT id, name, size, added FROM file WHERE id = ?", file_id)
        if not rows:
            raise UsageError(f"there is no file {file_id[:12]} in the queue", remedy="Add it")
        return QueuedFile(*rows[0])

    def list_files(self, most: int = 1000) -> tuple[QueuedFile, ...]:
        """Return the files that were added last and not deleted, the newest first."""
        rows = self._database.read("SELECT id, name, size, added FROM file ORDER BY added DESC")
        stored = (QueuedFile(*row) for row in rows if self.files.contains(row["id"]))
        return tuple(islice(stored, most))

    def delete_file(self, file_id: str) -> None:
        """Delete the content of a file; its name and facts stay for jobs that have ended.

        Raises:
            UsageError: there is no such file, or a job that has not ended needs it.
            OutputError: it cannot be deleted.
        """
        name = self.find_file(file_id).name
        needed = f"SELECT id FROM job WHERE file = ? AND NOT {HAS_ENDED}"  # noqa: S608 - a constant
        with self._database.transaction() as connection:
            if row := connection.execute(needed, (file_id,)).fetchone():
                raise UsageError(f"job {row['id']} needs {name}", remedy=f"Cancel job {row['id']} first")
            self.files.delete(file_id)

    def _require_content(self, file_id: str) -> None:
        """Check that the content of a file is stored.

        Raises:
            UsageError: it was deleted.
        """
        if not self.files.contains(file_id):
            raise UsageError(f"{self.find_file(file_id).name} was deleted", remedy="Add the file again")

    def read_facts(self, file_id: str) -> FileFacts | None:
        """Return what was read from a file; None if it has not been read yet."""
        rows = self._database.read("SELECT facts FROM file WHERE id = ?", file_id)
        return parse_facts(rows[0]["facts"]) if rows and rows[0]["facts"] else None

    def store_facts(self, file_id: str, facts: FileFacts) -> None:
        """Store what was read from a file; a job is started only if the facts of its file are known."""
        with self._database.transaction() as connection:
            connection.execute("UPDATE file SET facts = ? WHERE id = ?", (format_facts(facts), file_id))

    # Jobs.

    def add_jobs(
        self, file_id: str, request: JobRequest | None = None, *, request_id: str = ""
    ) -> tuple[QueuedJob, ...]:
        """Add a job for a file, or several with `copies`.

        Args:
            file_id: id of the file.
            request: what is wanted of the jobs.
            request_id: text that the sender chose; the same request with it adds nothing within a day, and its jobs
                are returned again. Empty: none.

        Raises:
            UsageError: there is no such file or printer, the file was deleted, the number of copies or a name of a
                finding is invalid, or another request has the same `request_id`.
        """
        request = request or JobRequest()
        file = self.find_file(file_id)
        if not 1 <= request.copies <= MAX_COPIES:
            raise UsageError(f"cannot add {request.copies} copies", remedy=f"Add 1 to {MAX_COPIES} copies")
        self._check_printer_name(request.printer)
        allow = json.dumps(sorted(check_allowed_codes(request.allow)))
        values = {
            "name": clean_name(request.name or file.name),
            "file": file_id,
            "state": "held" if request.held else "ready",
            "printer": request.printer,
            "material": request.material,
            "allow": allow,
            "added": time(),
        }
        content = json.dumps([file_id, as_dict(request)])
        with self._database.transaction() as connection:
            numbers = find_jobs_of_request(connection, request_id, content)
            if not numbers:
                self._require_content(file_id)
                numbers = [insert_job(connection, values) for _ in range(request.copies)]
                store_request(connection, request_id, content, numbers)
                if request.first:
                    waiting = read_order(connection)
                    write_order(connection, [*numbers, *(one for one in waiting if one not in numbers)])
        return tuple(self.find_job(number) for number in numbers)

    def find_job(self, job: int) -> QueuedJob:
        """Return a job.

        Raises:
            UsageError: there is none with this number.
        """
        rows = self._database.read(f"{SELECT_JOB} WHERE id = ?", clip_number(job))
        return make_job(rows[0]) if rows else raise_missing_job(job)

    def list_ended_jobs(self, most: int = 100) -> tuple[QueuedJob, ...]:
        """Return the jobs that have ended, the last added first."""
        ended = f"WHERE {HAS_ENDED} ORDER BY id DESC LIMIT ?"
        return tuple(map(make_job, self._database.read(f"{SELECT_JOB} {ended}", most)))

    def list_runs(self, job: int) -> tuple[PrintRun, ...]:
        """Return all runs of a job, the first one first."""
        return tuple(map(make_run, self._database.read(f"{SELECT_RUN} WHERE job = ? ORDER BY started", job)))

    def move_job(self, job: int, before: int | None = None) -> None:
        """Move a waiting job before another waiting job, or with None to the end of the queue.

        Raises:
            UsageError: one of the jobs does not exist or does not wait.
        """
        with self._database.transaction() as connection:
            for number in (job,) if before is None else (job, before):
                if (state := read_state(connection, number)) not in WAITING_STATES:
                    raise UsageError(
                        f"job {number} is {state} and is not waiting in the queue", remedy=LIST_REMEDY
                    )
            order = [number for number in read_order(connection) if number != job]
            order.insert(len(order) if before in {None, job} else order.index(before or 0), job)
            write_order(connection, order)

    def hold_job(self, job: int) -> None:
        """Keep a ready job from being started until it is released.

        Raises:
            UsageError: the job does not exist, or is not ready.
        """
        with self._database.transaction() as connection:
            change_state(connection, job, "held")

    def release_job(self, job: int) -> None:
        """Make a job ready that is held, has failed or was cancelled; it keeps its place.

        Raises:
            UsageError: the job does not exist, is in another state, or its file was deleted.
        """
        with self._database.transaction() as connection:
            if read_state(connection, job) in ACTIVE_STATES:
                raise UsageError(f"job {job} is printing", remedy=LIST_REMEDY)
            self._require_content(self.find_job(job).file)
            change_state(connection, job, "ready")

    def cancel_job(self, job: int) -> QueuedJob:
        """Cancel a job. A job that is printing is still active afterwards: its supervisor ends the print.

        Raises:
            UsageError: the job does not exist, or has ended.
        """
        with self._database.transaction() as connection:
            if read_state(connection, job) in ACTIVE_STATES:
                connection.execute("UPDATE run SET is_cancelling = 1 WHERE job = ? AND ended IS NULL", (job,))
            else:
                change_state(connection, job, "cancelled", "cancelled before it was started")
        return self.find_job(job)

    # Printers.

    def list_printers(self) -> tuple[PrinterEntry, ...]:
        """Return the printers of printers.toml; their state is in `snapshot`.

        Raises:
            UsageError: the file is missing or invalid.
        """
        try:
            changed = self._printers_file.stat().st_mtime_ns
        except OSError:
            changed = -1
        if changed == -1 or changed != self._printers[0]:
            entries = read_printers(self._printers_file)
            known = {row["name"] for row in self._database.read("SELECT name FROM printer")}
            if new := [entry.name for entry in entries if entry.name not in known]:
                with self._database.transaction() as connection:
                    statement = "INSERT INTO printer (name, bed) VALUES (?, 'unknown') ON CONFLICT DO NOTHING"
                    connection.executemany(statement, [(name,) for name in new])
            self._printers = (changed, entries)
        return self._printers[1]

    def set_bed(self, printer: str, bed: BedState) -> None:
        """Record what a person says about the bed of a printer; jobs are started on clear beds only.

        Raises:
            UsageError: there is no such printer, or it is printing and the bed cannot be clear.
        """
        self.find_printer(printer)
        with self._database.transaction() as connection:
            active = connection.execute(
                "SELECT job FROM run WHERE printer = ? AND ended IS NULL", (printer,)
            ).fetchone()
            if active and bed != "occupied":
                raise UsageError(
                    f"{printer} is printing job {active['job']}, so its bed is occupied",
                    remedy="Wait for the end of the print, and take the part off the bed",
                )
            connection.execute("UPDATE printer SET bed = ?, message = '' WHERE name = ?", (bed, printer))

    def set_material(self, printer: str, material: str) -> None:
        """Record that a material is loaded.

        Args:
            printer: name of the printer.
            material: name of a material profile.

        Raises:
            UsageError: there is no such printer or profile.
        """
        from printer_slicer.profile import load_profile  # noqa: PLC0415 - slow

        entry = self.find_printer(printer)
        load_profile(entry.profile, material, slices=False)
        with self._database.transaction() as connection:
            connection.execute("UPDATE printer SET material = ? WHERE name = ?", (material, printer))

    def find_printer(self, name: str) -> PrinterEntry:
        """Return a printer.

        Raises:
            UsageError: there is none of this name.
        """
        entries = {entry.name: entry for entry in self.list_printers()}
        if name not in entries:
            raise UsageError(f"there is no printer {name}", remedy=f"Choose one of: {', '.join(entries)}")
        return entries[name]

    def _check_printer_name(self, name: str) -> None:
        """Check that a name is empty, or that of a printer or a group.

        Raises:
            UsageError: it is another name.
        """
        entries = self.list_printers()
        known = [
            *(entry.name for entry in entries),
            *sorted({group for one in entries for group in one.groups}),
        ]
        if name and name not in known:
            raise UsageError(
                f"there is no printer or group {name}", remedy=f"Choose one of: {', '.join(known)}"
            )

    # The whole queue.

    def snapshot(self) -> QueueSnapshot:
        """Return the state of the queue at one moment.

        Raises:
            UsageError: printers.toml is missing or invalid.
        """
        entries = self.list_printers()
        not_ended = f"WHERE NOT {HAS_ENDED} ORDER BY position, id"
        with self._database.transaction(changes=False) as connection:
            revision = connection.execute("SELECT number FROM revision").fetchone()[0]
            jobs = tuple(map(make_job, connection.execute(f"{SELECT_JOB} {not_ended}")))
            runs = tuple(
                map(make_run, connection.execute(f"{SELECT_RUN} WHERE ended IS NULL ORDER BY started"))
            )
            rows = {row["name"]: row for row in connection.execute("SELECT * FROM printer")}
        active = {run.printer: run.job for run in runs}
        printers = tuple(
            PrinterState(
                entry.name,
                rows[entry.name]["bed"],
                rows[entry.name]["material"] or entry.material,
                active.get(entry.name),
                rows[entry.name]["message"],
                entry.webcam,
                entry.webcam_interval,
            )
            for entry in entries
        )
        return QueueSnapshot(revision, printers, jobs, runs)

    def wait_for_change(self, revision: int, timeout: float) -> int:
        """Wait until the queue differs from a revision, or for `timeout` seconds; return the current revision."""
        pause, end = Flag(), monotonic() + timeout
        while (current := self._database.read_revision()) == revision and monotonic() < end:
            pause.wait(min(_POLL_INTERVAL, max(end - monotonic(), 0.0)))
        return current

    # Runs: called by the supervisor.

    def find_run_folder(self, run: str) -> Path:
        """Return the folder of a run."""
        return self.folder / "runs" / run

    def list_run_ids(self) -> set[str]:
        """Return the ids of all runs, also of those that have ended."""
        return {row["id"] for row in self._database.read("SELECT id FROM run")}

    def list_old_runs(self, ended_before: float) -> list[str]:
        """Return the ids of the runs that ended before a time, s since 1970."""
        return [row["id"] for row in self._database.read("SELECT id FROM run WHERE ended < ?", ended_before)]

    def list_active_runs(self) -> tuple[PrintRun, ...]:
        """Return the runs that have not ended, the first one first."""
        return tuple(map(make_run, self._database.read(f"{SELECT_RUN} WHERE ended IS NULL ORDER BY started")))

    def begin_run(self, run: str, job: int, printer: str) -> bool:
        """Give a ready job to a printer whose bed is clear, and mark the bed as occupied.

        Args:
            run: id of the new run, whose folder exists.
            job: number of the job.
            printer: name of the printer.

        Returns:
            False, without a change, if the job is not ready or the bed is not clear any more.
        """
        with self._database.transaction() as connection:
            states = connection.execute(
                "SELECT 1 FROM printer, job WHERE printer.name = ? AND bed = 'clear' AND job.id = ? AND state = 'ready'"
                " AND NOT EXISTS (SELECT 1 FROM run WHERE run.printer = printer.name AND ended IS NULL)",
                (printer, job),
            ).fetchone()
            if states is None:
                return False
            connection.execute("UPDATE printer SET bed = 'occupied', message = '' WHERE name = ?", (printer,))
            connection.execute(
                "INSERT INTO run (id, job, printer, started) VALUES (?, ?, ?, ?)", (run, job, printer, time())
            )
            change_state(connection, job, "starting")
            connection.execute("UPDATE job SET run = ? WHERE id = ?", (run, job))
        return True

    def mark_printing(self, run: str) -> None:
        """Record that the print of a run can be controlled; no change if that is known."""
        with self._database.transaction() as connection:
            row = connection.execute("SELECT job FROM run WHERE id = ? AND ended IS NULL", (run,)).fetchone()
            if row and read_state(connection, row["job"]) == "starting":
                change_state(connection, row["job"], "printing")

    def end_run(self, run: str, outcome: RunOutcome, message: str, findings: tuple[str, ...] = ()) -> None:
        """Record how a run has ended; no change if that is known. The bed stays occupied.

        Args:
            run: id of the run.
            outcome: how it ended.
            message: why it ended so.
            findings: names of the findings that prevented the print.
        """
        with self._database.transaction() as connection:
            row = connection.execute("SELECT * FROM run WHERE id = ? AND ended IS NULL", (run,)).fetchone()
            if row is None:
                return
            state = _OUTCOME_STATES[outcome]
            if state == "ready" and row["is_cancelling"]:
                state = "cancelled"
            ended = "UPDATE run SET ended = ?, outcome = ?, message = ?, findings = ? WHERE id = ?"
            connection.execute(ended, (time(), outcome, message, json.dumps(findings), run))
            change_state(connection, row["job"], state, message)
            said = f"job {row['job']}: {message}" if message else ""
            connection.execute("UPDATE printer SET message = ? WHERE name = ?", (said, row["printer"]))
