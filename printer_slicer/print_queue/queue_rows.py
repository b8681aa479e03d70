"""Rows of the queue's tables as values, and the changes of rows that several of its methods need.

All functions with a connection belong to the transaction of their caller.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from time import time
from typing import Any, Final, NoReturn, get_args

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.records import (
    ENDED_STATES,
    WAITING_STATES,
    JobState,
    PrintRun,
    QueuedJob,
    check_transition,
)

__all__ = [
    "HAS_ENDED",
    "IS_WAITING",
    "LIST_REMEDY",
    "SELECT_JOB",
    "SELECT_RUN",
    "change_state",
    "clip_number",
    "find_jobs_of_request",
    "insert_job",
    "make_job",
    "make_run",
    "raise_missing_job",
    "read_order",
    "read_state",
    "store_request",
    "write_order",
]

LIST_REMEDY: Final = "Run printer-slicer queue list to see the queue"
"""What helps if a job does not exist or is in another state."""


def _make_condition(states: frozenset[JobState]) -> str:
    """Return the condition of jobs in one of these states, as SQL."""
    return f"state IN ({', '.join(repr(state) for state in sorted(states))})"


IS_WAITING: Final = _make_condition(WAITING_STATES)
"""Condition of jobs that wait."""

HAS_ENDED: Final = _make_condition(ENDED_STATES)
"""Condition of jobs that have ended."""

_REQUEST_SECONDS: Final = 86400.0  # in which a request is recognised when it is sent again
_MAX_NUMBER: Final = (1 << 63) - 1  # of SQLite
SELECT_JOB: Final = "SELECT id, name, file, state, printer, material, allow, added, message, run FROM job"
"""Statement that reads jobs, before its conditions."""

SELECT_RUN: Final = (
    "SELECT id, job, printer, started, ended, outcome, message, is_cancelling, findings FROM run"
)
"""Statement that reads runs, before its conditions."""


def make_job(row: sqlite3.Row) -> QueuedJob:
    """Make a job from its row."""
    values: dict[str, Any] = dict(row)
    assert values["state"] in get_args(JobState)
    return QueuedJob(**values | {"allow": tuple(json.loads(values["allow"]))})


def make_run(row: sqlite3.Row) -> PrintRun:
    """Make a run from its row."""
    values: dict[str, Any] = dict(row)
    findings = tuple(json.loads(values["findings"]))
    return PrintRun(**values | {"is_cancelling": bool(values["is_cancelling"]), "findings": findings})


def find_jobs_of_request(connection: sqlite3.Connection, request_id: str, content: str) -> list[int]:
    """Return the jobs that a request has added before; empty if it is new.

    Raises:
        UsageError: it has the id of another request.
    """
    statement = "SELECT content, jobs FROM request WHERE id = ? AND added > ?"
    row = connection.execute(statement, (request_id, time() - _REQUEST_SECONDS)).fetchone()
    if row is None or not request_id:
        return []
    if row["content"] != content:
        raise UsageError(
            "another request had the same idempotency key", remedy="Choose a new key for each request"
        )
    numbers: list[int] = json.loads(row["jobs"])
    return numbers


def store_request(
    connection: sqlite3.Connection, request_id: str, content: str, numbers: Sequence[int]
) -> None:
    """Store which jobs a request has added, and delete old requests."""
    if request_id:
        now = time()
        connection.execute("DELETE FROM request WHERE added <= ?", (now - _REQUEST_SECONDS,))
        row = (request_id, content, json.dumps(list(numbers)), now)
        connection.execute("INSERT INTO request VALUES (?, ?, ?, ?)", row)


def clip_number(job: int) -> int:
    """Return the number of a job, or one that no job has if SQLite cannot hold it."""
    return max(-1, min(job, _MAX_NUMBER))


def insert_job(connection: sqlite3.Connection, values: dict[str, Any]) -> int:
    """Insert a job at the end of the queue; return its number."""
    position = connection.execute("SELECT coalesce(max(position), 0) + 1 FROM job").fetchone()[0]
    names = ", ".join(values)
    cursor = connection.execute(
        f"INSERT INTO job (position, {names}) VALUES (?{', ?' * len(values)})",  # noqa: S608 - names of columns
        (position, *values.values()),
    )
    return int(cursor.lastrowid or 0)


def read_state(connection: sqlite3.Connection, job: int) -> JobState:
    """Return the state of a job.

    Raises:
        UsageError: there is none with this number.
    """
    row = connection.execute("SELECT state FROM job WHERE id = ?", (clip_number(job),)).fetchone()
    state: JobState = row["state"] if row else raise_missing_job(job)
    return state


def change_state(connection: sqlite3.Connection, job: int, state: JobState, message: str = "") -> None:
    """Change the state of a job.

    Raises:
        UsageError: the job does not exist, or may not change so; see `TRANSITIONS`.
    """
    check_transition(job, read_state(connection, job), state)
    connection.execute("UPDATE job SET state = ?, message = ? WHERE id = ?", (state, message, job))


def read_order(connection: sqlite3.Connection) -> list[int]:
    """Return the numbers of the waiting jobs in their order."""
    rows = connection.execute(f"SELECT id FROM job WHERE {IS_WAITING} ORDER BY position, id")  # noqa: S608 - a constant
    return [row["id"] for row in rows]


def write_order(connection: sqlite3.Connection, jobs: Sequence[int]) -> None:
    """Give the waiting jobs the positions that they have together, in a new order."""
    marks = ", ".join("?" * len(jobs))
    rows = connection.execute(f"SELECT position FROM job WHERE id IN ({marks}) ORDER BY position", jobs)  # noqa: S608 - marks
    positions = [row["position"] for row in rows]
    connection.executemany("UPDATE job SET position = ? WHERE id = ?", zip(positions, jobs, strict=True))


def raise_missing_job(job: int) -> NoReturn:
    """Raise the error of a job that does not exist."""
    raise UsageError(f"there is no job {job}", remedy=LIST_REMEDY)
