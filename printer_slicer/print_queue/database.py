"""The SQLite database of the print queue: connection, migrations and transactions.

Each change is one transaction that is on the disk when it returns, and it increases the revision. A migration copies
the database first.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from threading import RLock
from typing import Any, Final

from printer_slicer.errors import OutputError

__all__ = ["MIGRATIONS", "QueueDatabase"]

_BUSY_TIMEOUT: Final = 30.0  # s to wait for the transaction of another process

MIGRATIONS: Final[tuple[str, ...]] = (
    """
    CREATE TABLE file (
        id TEXT PRIMARY KEY,
        name TEXT NOT NULL,
        size INTEGER NOT NULL,
        added REAL NOT NULL,
        facts TEXT
    ) STRICT;
    CREATE TABLE printer (
        name TEXT PRIMARY KEY,
        bed TEXT NOT NULL CHECK (bed IN ('clear', 'occupied', 'unknown')),
        material TEXT NOT NULL DEFAULT '',
        message TEXT NOT NULL DEFAULT ''
    ) STRICT;
    CREATE TABLE job (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        name TEXT NOT NULL,
        file TEXT NOT NULL REFERENCES file (id),
        state TEXT NOT NULL CHECK (
            state IN ('held', 'ready', 'starting', 'printing', 'done', 'failed', 'cancelled')
        ),
        position INTEGER NOT NULL,
        printer TEXT NOT NULL,
        material TEXT NOT NULL,
        allow TEXT NOT NULL,
        added REAL NOT NULL,
        message TEXT NOT NULL DEFAULT '',
        run TEXT NOT NULL DEFAULT ''
    ) STRICT;
    CREATE TABLE run (
        id TEXT PRIMARY KEY,
        job INTEGER NOT NULL REFERENCES job (id),
        printer TEXT NOT NULL REFERENCES printer (name),
        started REAL NOT NULL,
        ended REAL,
        outcome TEXT NOT NULL DEFAULT '' CHECK (
            outcome IN ('', 'done', 'failed', 'cancelled', 'rejected', 'not_started', 'lost')
        ),
        message TEXT NOT NULL DEFAULT '',
        is_cancelling INTEGER NOT NULL DEFAULT 0,
        CHECK ((ended IS NULL) = (outcome = ''))
    ) STRICT;
    CREATE UNIQUE INDEX one_run_per_printer ON run (printer) WHERE ended IS NULL;
    CREATE UNIQUE INDEX one_run_per_job ON run (job) WHERE ended IS NULL;
    CREATE INDEX job_order ON job (state, position);
    """,
    """
    CREATE TABLE request (
        id TEXT PRIMARY KEY,
        content TEXT NOT NULL,
        jobs TEXT NOT NULL,
        added REAL NOT NULL
    ) STRICT
    """,
    "ALTER TABLE run ADD COLUMN findings TEXT NOT NULL DEFAULT '[]'",
)
"""The statements that lead from each version of the schema to the next; the version is `user_version`."""


@contextmanager
def _explain_errors(path: Path, subject: str) -> Iterator[None]:
    """Raise errors of the disk and of locks as `OutputError`, which names what the database holds."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise OutputError(
            f"{path}: the {subject} cannot be read or written: {error}",
            remedy="Check the free space and the permissions, and that no other program has locked the file",
        ) from None


class QueueDatabase:
    """A connection to the database, which threads may share.

    Args:
        path: file of the database; it is created if it is missing, its folder is not.
        migrations: statements that lead from each version of the schema to the next.
        subject: what the database holds, for messages.

    Raises:
        OutputError: the file is no database, or that of a newer version of this program.
    """

    def __init__(self, path: Path, migrations: Sequence[str] = MIGRATIONS, *, subject: str = "queue") -> None:
        self._subject = subject
        self._path, self._migrations, self._lock = path, migrations, RLock()
        try:
            path.touch(mode=0o600)
            self._connection = sqlite3.connect(
                path, timeout=_BUSY_TIMEOUT, isolation_level=None, check_same_thread=False
            )
            self._connection.row_factory = sqlite3.Row
            with suppress(sqlite3.OperationalError):  # another process is about to do the same
                self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            self._connection.execute("PRAGMA foreign_keys = ON")
            self._migrate()
        except (sqlite3.Error, OSError) as error:
            raise OutputError(
                f"{path}: the database of the {subject} cannot be opened: {error}",
                remedy="Check the permissions and the free space, or move the file away to begin without it",
            ) from None

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            self._connection.close()

    def read(self, statement: str, *values: Any) -> list[sqlite3.Row]:
        """Return the rows of a SELECT statement.

        Raises:
            OutputError: the database cannot be read.
        """
        with self._lock, _explain_errors(self._path, self._subject):
            return self._connection.execute(statement, values).fetchall()

    @contextmanager
    def transaction(self, *, changes: bool = True) -> Iterator[sqlite3.Connection]:
        """Run a `with` block as one transaction; an error in the block undoes all of it.

        Args:
            changes: whether the block changes something; otherwise it only reads one consistent state.

        Raises:
            OutputError: the database cannot be written, for example because the disk is full.
        """
        with self._lock, _explain_errors(self._path, self._subject):
            self._connection.execute("BEGIN IMMEDIATE" if changes else "BEGIN")
            try:
                if changes:
                    self._connection.execute("UPDATE revision SET number = number + 1")
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:  # some errors of the disk have ended it
                    self._connection.execute("ROLLBACK")
                raise

    def read_revision(self) -> int:
        """Return the number that grows with each change."""
        return int(self.read("SELECT number FROM revision")[0][0])

    def _migrate(self) -> None:
        """Bring the schema up to date; two processes may try it at the same time."""
        if (version := self._read_version()) == len(self._migrations):
            return
        if version > len(self._migrations):
            raise OutputError(
                f"{self._path}: the {self._subject} belongs to a newer version of this program",
                remedy="Update it: pip install -U printer-slicer",
            )
        if version > 0:
            with closing(sqlite3.connect(f"{self._path}.version-{version}")) as copy:
                self._connection.backup(copy)
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            if not self._read_version():
                self._connection.execute("CREATE TABLE revision (number INTEGER NOT NULL) STRICT")
                self._connection.execute("INSERT INTO revision VALUES (0)")
            for statements in self._migrations[self._read_version() :]:
                for statement in statements.split(";"):
                    self._connection.execute(statement)
            self._connection.execute(f"PRAGMA user_version = {len(self._migrations)}")
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")

    def _read_version(self) -> int:
        """Return the version of the schema; 0 for a new database."""
        return int(self._connection.execute("PRAGMA user_version").fetchone()[0])
