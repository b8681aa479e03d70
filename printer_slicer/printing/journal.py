"""The journal of a print: what must be known to take it up again, whatever ends the host.

A print has a folder of its own: `head.json` (what and where), `job.gcode` (a copy, so that the file may change or go)
and `journal`, which only ever grows. One short line per record, with a checksum at its end:

    E <entries>                   line numbers begin anew; so many entries of the job were accepted before
    N <number> <entries> <text>   line <number> is not just the next entry: text is a command, or empty
    A <number> <entries> <time>   the printer accepted everything up to line <number>
    S <json>                      the print was paused, goes on, heats...
    X <time> <reason>             the print ended, or was left

What is given a number is on record before its bytes are written, what was accepted as soon as it is known, each with
one `write` to the system. So a host that is killed loses nothing. `sync`, called once a second by a thread of its own,
brings it to the disk: a computer that loses its power loses the last second.
"""

from __future__ import annotations

import json
import os
from bisect import bisect_right
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from math import isfinite, isnan
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints
from zlib import crc32

from printer_slicer.input_files import check_is_file, read_input

__all__ = [
    "HEATERS_OFF",
    "HOST",
    "LOST",
    "Journal",
    "JournalData",
    "NumberedRecord",
    "dataclass_from_json",
    "read_journal",
]

_NAME: Final = "journal"
_LONGEST: Final = 1 << 32  # bytes
_DIGITS: Final = 12  # maximum length of a count
LOST: Final = "lost: "
"""A reason begins so if the time of the loss is known: the cable was gone at that moment."""

HEATERS_OFF: Final = "heaters_off"
HOST: Final = "host"
"""State: why the heaters were switched off, so that the printer cannot just go on; empty where they were not."""


class Journal:
    """The writing end.

    Attributes:
        failed: why it cannot be written any more, empty while it can.
    """

    def __init__(self, folder: Path) -> None:
        self.failed = ""
        self._file = -1
        self._dirty = False
        try:
            self._file = os.open(folder / _NAME, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        except OSError as error:
            self.failed = error.strerror or str(error)

    def epoch(self, entries: int) -> None:
        """Line numbers begin anew, behind so many entries of the job."""
        self._write(f"E {entries}")

    def numbered(self, number: int, entries: int, command: bytes) -> None:
        """Line `number` is about to go out."""
        self._write(f"N {number} {entries} {command.decode('latin-1')}")

    def accepted(self, number: int, entries: int, now: float) -> None:
        """The printer took everything up to line `number`."""
        self._write(f"A {number} {entries} {now:.3f}")

    def state(self, values: Mapping[str, Any]) -> None:
        """Anything else that must be known; a later one takes the place of those before."""
        self._write("S " + json.dumps(values))

    def ended(self, reason: str, now: float) -> None:
        """The print ended, or was left."""
        self._write(f"X {now:.3f} " + " ".join(reason.split()))

    def sync(self) -> None:
        """Bring it to the disk."""
        if self._dirty and self._file >= 0:
            self._dirty = False
            with suppress(OSError):  # /dev/full cannot; what fails for good fails in writing, too
                os.fsync(self._file)

    def close(self) -> None:
        """Let go of the file."""
        if self._file >= 0:
            self.sync()
            os.close(self._file)
            self._file = -1

    def _write(self, record: str) -> None:
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
        """Half a record would hide what comes behind it: write no more."""
        self.failed = self.failed or reason
        os.close(self._file)
        self._file = -1


@dataclass(frozen=True, slots=True)
class NumberedRecord:
    """From line `number` on, entry by entry; `entries` are accepted with it. See the record `N`."""

    number: int
    entries: int
    command: bytes


@dataclass(slots=True)
class JournalData:
    """What a journal tells.

    Attributes:
        base: entries accepted when line numbers began anew for the last time.
        before: last number accepted by then, -1 if they had never begun.
        lines: records of line numbers since then.
        line, entries: accepted last, number and entries of the job.
        accepted: (entries, time in s) of each acknowledgement since numbers began anew.
        commands: (entries before it, command) of everything that was not of the job, in order, accepted for certain.
        states: what else was noted, last one of each kind.
        stopped: when the host noticed that the print had ended, s; None if the host itself was ended.
        reason: why, empty while it has not.
        damage: the first invalid record and why; reading stops there. Empty if there is none.
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

    def entries_at(self, number: int) -> int:
        """Entries of the job that are accepted with line `number`; numbers are those since they began anew."""
        index = bisect_right(self.lines, number, key=lambda record: record.number) - 1
        if index < 0:
            return self.base
        record = self.lines[index]
        return record.entries + number - record.number

    def others_until(self, number: int) -> list[tuple[int, bytes]]:
        """All commands that were not of the job, with those that line `number` proves to be accepted."""
        proven = [one for one in self._pending if one.number <= number]
        return self.commands + [(one.entries, one.command) for one in proven if one.command]

    def take(self, kind: str, rest: str) -> None:
        """Add a record.

        Raises:
            ValueError: it is invalid.
        """
        if kind == "E":
            self._begin_anew(_count(rest))
        elif kind == "N":
            number, entries, command = rest.split(" ", 2)
            self._number(NumberedRecord(_count(number), _count(entries), command.encode("latin-1")))
        elif kind == "A":
            number, entries, now = rest.split(" ")
            self._accept(_count(number), _count(entries), _moment(now))
        elif kind == "S":
            states = json.loads(rest)
            if not isinstance(states, dict):
                raise ValueError("not a JSON object")
            self.states |= states
        elif kind == "X":
            now, reason = rest.split(" ", 1)
            if self.stopped is None:
                self.stopped, self.reason = _moment(now), reason
        else:
            raise ValueError("unknown kind of record")

    def _begin_anew(self, entries: int) -> None:
        self.before = self.line if self.lines else self.before
        self.base = self.entries = entries
        self.line, self.stopped, self.reason = 0, None, ""
        self.lines, self.accepted, self._pending = [], [], []

    def _number(self, record: NumberedRecord) -> None:
        # The printer may have been greeted anew: then what had the number before never counted.
        for records in (self.lines, self._pending):
            while records and records[-1].number >= record.number:
                records.pop()
            records.append(record)

    def _accept(self, number: int, entries: int, now: float) -> None:
        self.line, self.entries = number, entries
        self.accepted.append((entries, now))
        while self._pending and self._pending[0].number <= number:
            done = self._pending.pop(0)
            if done.command:
                self.commands.append((done.entries, done.command))


def _count(text: str) -> int:
    """Parse a count.

    Raises:
        ValueError: it is not a count.
    """
    number = int(text) if len(text) <= _DIGITS else -1
    if number < 0:
        raise ValueError(f"{text[:_DIGITS]} is not a number of lines or commands")
    return number


def _moment(text: str) -> float:
    """Parse a time, s.

    Raises:
        ValueError: it is not a time.
    """
    seconds = float(text)
    if not isfinite(seconds):
        raise ValueError(f"{text} is not a time")
    return seconds


def read_journal(folder: Path) -> JournalData:
    """What the journal in a folder tells, up to the first record that is damaged: a torn end is no error.

    An invalid record with a correct checksum is noted in `damage`.

    Raises:
        OSError: it cannot be read.
    """
    journal_data = JournalData()
    check_is_file(folder / _NAME)
    for index, line in enumerate(read_input(folder / _NAME, _LONGEST).split(b"\n"), start=1):
        data, _, sum_ = line.rpartition(b" ")
        if not data or sum_ != b"%08x" % crc32(data):
            break
        try:
            kind, _, rest = data.decode("utf-8").partition(" ")
            journal_data.take(kind, rest)
        except (ValueError, RecursionError) as error:
            journal_data.damage = f"record {index} is invalid: {error}"
            break
    return journal_data


_Value = TypeVar("_Value")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def dataclass_from_json(kind: type[_Value], kept: object) -> _Value:
    """Rebuild a dataclass from what `dataclasses.asdict` and JSON made of it; unknown names are ignored.

    Raises:
        TypeError: a value has the wrong type; names it.
    """
    if not isinstance(kept, Mapping):
        raise TypeError(f"expected a JSON object, found {_shown(kept)}")
    hints = _hints(cast("Any", kind))
    known = [field.name for field in fields(cast("Any", kind)) if field.init and field.name in kept]
    return kind(**{name: _of(hints[name], kept[name], name) for name in known})


def _of(wanted: Any, kept: object, name: str) -> Any:
    """Rebuild the value of one field."""
    if is_dataclass(wanted) and isinstance(wanted, type):
        return dataclass_from_json(wanted, kept)
    if get_origin(wanted) in {Union, UnionType}:
        kinds = [kind for kind in get_args(wanted) if kind is not NoneType]
        return None if kept is None and NoneType in get_args(wanted) else _of(kinds[0], kept, name)
    if get_origin(wanted) is tuple and isinstance(kept, list | tuple):
        kinds = list(get_args(wanted))
        kinds = kinds[:1] * len(kept) if kinds[1:] == [Ellipsis] else kinds
        if len(kinds) == len(kept):
            return tuple(_of(kind, one, name) for kind, one in zip(kinds, kept, strict=True))
    elif get_origin(wanted) is not tuple and _is(wanted, kept):
        return kept
    raise TypeError(f"{name} is {_shown(kept)}")


def _is(wanted: Any, kept: object) -> bool:
    """Whether a plain value has the wanted type."""
    if get_origin(wanted) is Literal:
        return kept in get_args(wanted)
    if wanted is float:
        return isinstance(kept, float | int) and not isinstance(kept, bool) and not isnan(kept)
    if wanted is int:
        return isinstance(kept, int) and not isinstance(kept, bool)
    return isinstance(kept, get_origin(wanted) or wanted)


def _shown(kept: object) -> str:
    """Abbreviate a value for a message."""
    text = repr(kept)
    return text if len(text) <= 30 else f"{text[:27]}..."
