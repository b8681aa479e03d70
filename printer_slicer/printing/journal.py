"""Keep the journal of a print: the data to resume it, however the host process ends.

Each print has a folder with `head.json` (job, port and printer settings), `job.gcode` (a copy of the file, because the
original may be changed or deleted) and `journal`, to which records are only appended. A record is one short line with a
checksum at its end:

    E <entries>                   line numbering restarts; <entries> job entries were accepted before
    N <number> <entries> <text>   line <number> is not simply the next entry; <text> is its command, or empty
    A <number> <entries> <time>   the printer has accepted everything up to line <number>
    S <json>                      states: phase of the print, parked position, why the heaters were switched off...
    X <time> <reason>             the print ended, or the host lost the connection

A line is recorded before its bytes are sent, and an acknowledgement as soon as it arrives, each with one `write` call.
So a killed host loses no record. A separate thread calls `sync` once a second to write the journal to the disk, so a
computer that loses its power loses the records of the last second.
"""

from __future__ import annotations

import json
import os
from bisect import bisect_right
from collections.abc import Mapping
from contextlib import suppress
from math import isfinite, isnan
from pathlib import Path
from typing import Any, Final, TypeVar
from zlib import crc32

import msgspec

from printer_slicer.input_files import check_is_file, read_input
from printer_slicer.values import Struct, field

__all__ = [
    "HEATERS_OFF",
    "HOST",
    "LOST",
    "Journal",
    "JournalData",
    "NumberedRecord",
    "read_journal",
    "restore_struct",
]

_FILE_NAME: Final = "journal"
_MAX_BYTES: Final = 1 << 32  # bytes
_MAX_DIGITS: Final = 12  # maximum length of a count
LOST: Final = "lost: "
"""Prefix of a reason: the connection was lost at the recorded time."""

HEATERS_OFF: Final = "heaters_off"
"""Name of the state that says why the heaters were switched off; empty if they were not."""

HOST: Final = "host"
"""Name of the state that identifies the host process of the print."""


class Journal:
    """Appends records to the journal of a print.

    Attributes:
        failure: why the journal can no longer be written; empty while it can.
    """

    def __init__(self, folder: Path) -> None:
        self.failure = ""
        self._file = -1
        self._dirty = False
        try:
            self._file = os.open(folder / _FILE_NAME, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        except OSError as error:
            self.failure = error.strerror or str(error)

    def record_restart(self, entries: int) -> None:
        """Record that line numbering restarts after `entries` accepted job entries."""
        self._write_record(f"E {entries}")

    def record_line(self, number: int, entries: int, command: bytes) -> None:
        """Record that line `number` is about to be sent."""
        self._write_record(f"N {number} {entries} {command.decode('latin-1')}")

    def record_accepted(self, number: int, entries: int, now: float) -> None:
        """Record that the printer has accepted everything up to line `number`."""
        self._write_record(f"A {number} {entries} {now:.3f}")

    def record_state(self, values: Mapping[str, Any]) -> None:
        """Record named states; a later value replaces an earlier one of the same name."""
        self._write_record("S " + json.dumps(values))

    def record_end(self, reason: str, now: float) -> None:
        """Record why the print ended, or that the host lost the connection."""
        self._write_record(f"X {now:.3f} " + " ".join(reason.split()))

    def sync(self) -> None:
        """Write the journal to the disk."""
        if self._dirty and self._file >= 0:
            self._dirty = False
            with suppress(
                OSError
            ):  # some file systems cannot sync; a permanent error also makes `write` fail
                os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            self.sync()
            os.close(self._file)
            self._file = -1

    def _write_record(self, record: str) -> None:
        """Append a record with its checksum."""
        if self._file < 0:
            return
        data = record.encode("utf-8")
        line = b"%s %08x\n" % (data, crc32(data))
        try:
            written = os.write(self._file, line)
        except OSError as error:
            self._fail(error.strerror or str(error))
            return
        if written < len(line):
            self._fail("no space left")
        self._dirty = True

    def _fail(self, reason: str) -> None:
        """Stop writing, because readers stop at an incomplete record."""
        self.failure = self.failure or reason
        os.close(self._file)
        self._file = -1


class NumberedRecord(Struct, frozen=True):
    """Record `N`: line `number` completes the first `entries` job entries, each later line one more."""

    number: int
    entries: int
    command: bytes


class JournalData(Struct):
    """Contents of the journal of a print.

    Attributes:
        base: number of entries accepted at the last restart of line numbering.
        before: last line number accepted before that restart, -1 if there was none.
        lines: records `N` since that restart.
        line, entries: last accepted line number, and number of accepted job entries.
        accepted: (entries, time in s) of each acknowledgement since that restart.
        commands: accepted commands that are not from the job, in order, as (number of entries before it, command).
        states: recorded states by name, each with its last value.
        stopped: time at which the host noticed the end of the print, s; None if the host itself was terminated.
        reason: why the print ended; empty if it has not ended.
        damage: the first invalid record and what is wrong with it; reading stops there. Empty if there is none.
    """

    base: int = 0
    before: int = -1
    lines: list[NumberedRecord] = field(default_factory=list)
    line: int = 0
    entries: int = 0
    accepted: list[tuple[int, float]] = field(default_factory=list)
    commands: list[tuple[int, bytes]] = field(default_factory=list)
    states: dict[str, Any] = field(default_factory=dict)
    stopped: float | None = None
    reason: str = ""
    damage: str = ""
    _pending: list[NumberedRecord] = field(default_factory=list)

    def count_entries_until(self, number: int) -> int:
        """Return how many job entries are accepted once line `number` of this numbering is accepted."""
        index = bisect_right(self.lines, number, key=lambda record: record.number) - 1
        if index < 0:
            return self.base
        record = self.lines[index]
        return record.entries + number - record.number

    def list_inserted_commands_until(self, number: int) -> list[tuple[int, bytes]]:
        """Return the commands from outside the job that are accepted once line `number` is accepted."""
        accepted = [record for record in self._pending if record.number <= number]
        return self.commands + [(record.entries, record.command) for record in accepted if record.command]

    def add_record(self, kind: str, rest: str) -> None:
        """Update the data by one record of the journal.

        Args:
            kind: first letter of the record.
            rest: text of the record after the kind.

        Raises:
            ValueError: the record is invalid.
        """
        if kind == "E":
            self._restart_numbering(_parse_count(rest))
        elif kind == "N":
            number, entries, command = rest.split(" ", 2)
            record = NumberedRecord(_parse_count(number), _parse_count(entries), command.encode("latin-1"))
            self._add_line(record)
        elif kind == "A":
            number, entries, now = rest.split(" ")
            self._accept(_parse_count(number), _parse_count(entries), _parse_time(now))
        elif kind == "S":
            states = json.loads(rest)
            if not isinstance(states, dict):
                raise ValueError("the states are not a JSON object")
            self.states |= states
        elif kind == "X":
            now, reason = rest.split(" ", 1)
            if self.stopped is None:
                self.stopped, self.reason = _parse_time(now), reason
        else:
            raise ValueError("unknown kind of record")

    def _restart_numbering(self, entries: int) -> None:
        """Restart the line numbering after `entries` accepted job entries."""
        self.before = self.line if self.lines else self.before
        self.base = self.entries = entries
        self.line, self.stopped, self.reason = 0, None, ""
        self.lines, self.accepted, self._pending = [], [], []

    def _add_line(self, record: NumberedRecord) -> None:
        """Add a record `N`; drop earlier records with the same or a higher number."""
        # After a new handshake, lines with the same or higher numbers were never accepted.
        for records in (self.lines, self._pending):
            while records and records[-1].number >= record.number:
                records.pop()
            records.append(record)

    def _accept(self, number: int, entries: int, now: float) -> None:
        """Mark the lines up to `number`, and `entries` job entries, as accepted."""
        self.line, self.entries = number, entries
        self.accepted.append((entries, now))
        while self._pending and self._pending[0].number <= number:
            done = self._pending.pop(0)
            if done.command:
                self.commands.append((done.entries, done.command))


def _parse_count(text: str) -> int:
    """Parse a non-negative number of lines or commands.

    Raises:
        ValueError: the text is not such a number.
    """
    number = int(text) if len(text) <= _MAX_DIGITS else -1
    if number < 0:
        raise ValueError(f"{text[:_MAX_DIGITS]} is not a number of lines or commands")
    return number


def _parse_time(text: str) -> float:
    """Parse a time, s.

    Raises:
        ValueError: the text is not a time.
    """
    seconds = float(text)
    if not isfinite(seconds):
        raise ValueError(f"{text} is not a time")
    return seconds


def read_journal(folder: Path) -> JournalData:
    """Read the journal in a folder up to the first damaged record; an incomplete last record is not an error.

    An invalid record with a correct checksum is reported in `damage`.

    Raises:
        OSError: the journal cannot be read.
    """
    journal_data = JournalData()
    check_is_file(folder / _FILE_NAME)
    for index, line in enumerate(read_input(folder / _FILE_NAME, _MAX_BYTES).split(b"\n"), start=1):
        data, _, sum_ = line.rpartition(b" ")
        if not data or sum_ != b"%08x" % crc32(data):
            break
        try:
            kind, _, rest = data.decode("utf-8").partition(" ")
            journal_data.add_record(kind, rest)
        except (ValueError, RecursionError) as error:
            journal_data.damage = f"record {index} is invalid: {error}"
            break
    return journal_data


_Stored = TypeVar("_Stored", bound=Struct)


def restore_struct(kind: type[_Stored], stored: object) -> _Stored:
    """Restore a struct from the JSON object that `as_dict` has returned; unknown fields are ignored.

    Raises:
        TypeError: a value is missing or has the wrong type; the message names it.
    """
    if _has_nan(stored):
        raise TypeError("a stored number is NaN")
    try:
        return msgspec.convert(stored, kind)
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at `$")
        raise TypeError(f"{path.strip('.`')}: {reason}" if path else reason) from error


def _has_nan(stored: object) -> bool:
    """Return whether a number in a JSON document is NaN, which JSON does not know."""
    if isinstance(stored, Mapping):
        return any(map(_has_nan, stored.values()))
    if isinstance(stored, list):
        return any(map(_has_nan, stored))
    return isinstance(stored, float) and isnan(stored)
