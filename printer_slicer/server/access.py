"""Who may do what: keys for programs, and sessions of browsers.

A key is 256 random bits. Only its SHA-256 is stored, and its public first part finds it. A browser gets a session by
signing in with a key, or on the computer of the server by a link that works once. A session ends when it is closed or
its key is deleted. There are no passwords.
"""

from __future__ import annotations

import hmac
import secrets
import sqlite3
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path
from threading import Lock
from time import monotonic, time
from typing import Final, Literal, get_args

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.database import QueueDatabase
from printer_slicer.server.problems import ProblemError
from printer_slicer.values import Struct

__all__ = ["ANY_PRINTER", "SCOPES", "SLICER_SCOPES", "Access", "AccessStore", "ApiKey", "KeyScope"]

KeyScope = Literal["read", "upload", "print", "control", "admin"]
SCOPES: Final[frozenset[KeyScope]] = frozenset(get_args(KeyScope))
SLICER_SCOPES: Final[frozenset[KeyScope]] = frozenset({"read", "upload", "print"})
"""What a key for a slicer may do."""

ANY_PRINTER: Final = "*"
"""Stands for any printer, and is no name of one: a key for one printer may not change what all printers share."""

_SESSION_SECONDS: Final = 14 * 86400.0
_LINK_SECONDS: Final = 600.0
_USE_STEP: Final = 60.0  # s; the last use of a key is stored this accurately
_MIGRATIONS: Final = (
    """
    CREATE TABLE key (
        id TEXT PRIMARY KEY,
        name TEXT NOT NULL,
        secret BLOB NOT NULL,
        scopes TEXT NOT NULL,
        printer TEXT NOT NULL,
        created REAL NOT NULL,
        used REAL
    ) STRICT;
    CREATE TABLE session (
        id BLOB PRIMARY KEY,
        key TEXT REFERENCES key (id) ON DELETE CASCADE,
        created REAL NOT NULL
    ) STRICT
    """,
)


class ApiKey(Struct, frozen=True):
    """A key of a program or person, without its secret.

    Attributes:
        id: its public part.
        name: for people.
        scopes: what it allows.
        printer: name of the only printer that it is for; empty: all.
        created: time, s since 1970.
        used: time of the last use, s since 1970; None: never.
    """

    id: str
    name: str
    scopes: frozenset[KeyScope]
    printer: str
    created: float
    used: float | None


class Access(Struct, frozen=True):
    """What the sender of a request may do.

    Attributes:
        name: of the key, or of the person at this computer.
        scopes: what is allowed.
        printer: name of the only printer; empty: all.
        session: hash of the session; empty for a key in the request.
    """

    name: str
    scopes: frozenset[KeyScope]
    printer: str = ""
    session: bytes = b""

    def allows(self, scope: KeyScope, printer: str = "") -> bool:
        """Return whether something is allowed, on a printer if one is given."""
        is_for_it = not self.printer or not printer or printer == self.printer
        return scope in self.scopes and is_for_it

    def require(self, scope: KeyScope, printer: str = "") -> None:
        """Check that something is allowed, on a printer if one is given.

        Raises:
            ProblemError: it is not.
        """
        if not self.allows(scope, printer):
            where = f" on printer {printer}" if printer else ""
            raise ProblemError(403, f"this key does not allow {scope}{where}", "Use a key with this scope")


class AccessStore:
    """Keys and sessions, in an SQLite file that is created if it is missing."""

    def __init__(self, path: Path) -> None:
        self._database = QueueDatabase(path, _MIGRATIONS, subject="access keys")
        self._links: dict[bytes, float] = {}
        self._lock = Lock()

    def close(self) -> None:
        """Close the database."""
        self._database.close()

    def create_key(
        self, name: str, scopes: Iterable[KeyScope] = SLICER_SCOPES, printer: str = ""
    ) -> tuple[ApiKey, str]:
        """Create a key; return it, and its text, which is never shown again.

        Raises:
            UsageError: the name is empty, or a scope is unknown.
        """
        wanted = frozenset(scopes)
        if not name.strip() or not wanted or wanted - SCOPES:
            raise UsageError(
                "a key needs a name and scopes",
                remedy=f"Choose scopes among {', '.join(get_args(KeyScope))}",
            )
        id_, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
        key = ApiKey(id_, name.strip()[:80], wanted, printer, time(), None)
        row = (id_, key.name, _hash(secret), " ".join(sorted(wanted)), printer, key.created)
        with self._database.transaction() as connection:
            connection.execute("INSERT INTO key VALUES (?, ?, ?, ?, ?, ?, NULL)", row)
        return key, f"ps_{id_}_{secret}"

    def list_keys(self) -> tuple[ApiKey, ...]:
        """Return all keys, the oldest first."""
        return tuple(map(_make_key, self._database.read("SELECT * FROM key ORDER BY created")))

    def delete_key(self, id_: str) -> None:
        """Delete a key and the sessions that began with it.

        Raises:
            UsageError: there is no such key.
        """
        with self._database.transaction() as connection:
            if not connection.execute("DELETE FROM key WHERE id = ?", (id_,)).rowcount:
                raise UsageError(
                    f"there is no key {id_}", remedy="Run printer-slicer serve --keys to list them"
                )

    def find_key(self, text: str) -> Access | None:
        """Return what a key allows; None if there is no such key. An unknown key costs the same time."""
        parts = text.split("_", 2)
        id_, secret = (parts[1], parts[2]) if len(parts) == 3 and parts[0] == "ps" else ("", "")
        rows = self._database.read("SELECT * FROM key WHERE id = ?", id_)
        stored = bytes(rows[0]["secret"]) if rows else bytes(32)
        if not hmac.compare_digest(stored, _hash(secret)) or not rows:
            return None
        key = _make_key(rows[0])
        if key.used is None or time() - key.used > _USE_STEP:
            with self._database.transaction() as connection:
                connection.execute("UPDATE key SET used = ? WHERE id = ?", (time(), id_))
        return Access(key.name, key.scopes, key.printer)

    def create_link_token(self) -> str:
        """Return a token that opens one session with all scopes, within ten minutes, also if the clock is set."""
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._links[_hash(token)] = monotonic() + _LINK_SECONDS
        return token

    def sign_in(self, token_or_key: str) -> str | None:
        """Return the secret of a new session; None if the token is used or too old, or the key unknown."""
        with self._lock:
            expires = self._links.pop(_hash(token_or_key), 0.0)
        key = None
        if expires < monotonic():
            if self.find_key(token_or_key) is None:
                return None
            key = token_or_key.split("_", 2)[1]
        secret = secrets.token_urlsafe(32)
        with self._database.transaction() as connection:
            connection.execute("DELETE FROM session WHERE created < ?", (time() - _SESSION_SECONDS,))
            connection.execute("INSERT INTO session VALUES (?, ?, ?)", (_hash(secret), key, time()))
        return secret

    def find_session(self, secret: str) -> Access | None:
        """Return what a session allows now; None if there is none, or if it has ended."""
        session = _hash(secret)
        statement = """
            SELECT session.id AS session, session.created AS begun, key.* FROM session
            LEFT JOIN key ON session.key = key.id WHERE session.id = ?
        """
        rows = self._database.read(statement, session)
        if not rows or rows[0]["begun"] < time() - _SESSION_SECONDS:
            return None
        if rows[0]["id"] is None:
            return Access("this computer", SCOPES, session=session)
        key = _make_key(rows[0])
        return Access(key.name, key.scopes, key.printer, session)

    def end_session(self, session: bytes) -> None:
        """End the session with this hash."""
        with self._database.transaction() as connection:
            connection.execute("DELETE FROM session WHERE id = ?", (session,))


def _hash(secret: str) -> bytes:
    """Return the SHA-256 of a secret, which is random and needs no slower hash."""
    return sha256(secret.encode("utf-8", "surrogatepass")).digest()


def _make_key(row: sqlite3.Row) -> ApiKey:
    """Make a key of its row."""
    scopes = frozenset(scope for scope in SCOPES if scope in row["scopes"].split())
    return ApiKey(row["id"], row["name"], scopes, row["printer"], row["created"], row["used"])
