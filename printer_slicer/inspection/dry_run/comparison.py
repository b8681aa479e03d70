"""Compare the commands that a printer executes with the commands of a job."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from hashlib import sha256
from typing import Final

import numpy as np

from printer_slicer.arrays import Int

__all__ = ["MAX_LISTED", "Comparison"]

# Commands that our host sends in addition to the job.
_HOST_QUERIES: Final = (b"M105", b"M110", b"M114", b"M115", b"M155", b"M400")
# Commands that other hosts send in addition to the job.
_OTHER_HOSTS_QUERIES: Final = (b"M20", b"M21", b"M27", b"M113")
_SEARCH_WINDOW: Final = 16  # number of commands in which the comparison searches for a match
MAX_LISTED: Final = 20
"""Maximum number of listed differences."""


class Comparison:
    """Compares the commands that a printer executes with those of a job, one by one.

    An executed command that is not the next one of the job is unexpected. The comparison continues later in the job,
    after as many missing commands as there were unexpected ones, or where two executed commands follow each other. So
    an altered or lost line is one difference.

    Attributes:
        executed: number of commands of the job that were executed in order.
        due: index of the next command of the job.
        n_unexpected: number of executed commands that were unexpected.
        unexpected: the first few of them: (index of the next command of the job, the executed command).
        skipped: indices of the first few commands that were not executed.
        digest: SHA-256 over the executed commands of the job, each followed by a newline.
    """

    def __init__(self, commands: Sequence[bytes] = ()) -> None:
        self._commands = commands
        self._hash = sha256()
        self._n_started = 0
        # Runs of unexpected commands: number of the first one and of the one after the last, and indices of the job's
        # commands before and after the run. The first run is empty and ends before the first command.
        self._begins, self._ends = array("q", [0]), array("q", [1])
        self._before, self._after = array("q", [-1]), array("q", [0])
        self._last_unexpected = (0, b"")  # its number and text
        self._unexpected_in_row = 0  # number of unexpected commands since the last command of the job
        self.executed = self.due = self.n_unexpected = 0
        self.unexpected: list[tuple[int, str]] = []
        self.skipped: list[int] = []

    def __call__(self, text: str) -> None:
        """Compare the next executed command with the job."""
        self._n_started += 1
        command = text.encode("latin-1")
        if self.due < len(self._commands) and command == self._commands[self.due]:
            self._count_executed(command)
        elif not self._commands:
            # Without a job, every command counts, except commands that the host adds.
            if not command.startswith(_HOST_QUERIES):
                self._count_executed(command)
        elif command.startswith(_HOST_QUERIES + _OTHER_HOSTS_QUERIES):
            self._record_unexpected()
        elif not self._try_resync(command):
            self._record_unexpected()
            self._last_unexpected = self._n_started, command
            self._unexpected_in_row += 1
            self.n_unexpected += 1
            if self.n_unexpected <= MAX_LISTED:
                self.unexpected.append((self.due, text))

    def add_batch(self, commands: Sequence[bytes]) -> None:
        """Count commands of the job that were executed in order, without queries between them."""
        self._n_started += len(commands)
        self.executed += len(commands)
        self.due += len(commands)
        self._hash.update(b"\n".join(commands) + b"\n")

    def is_job_command(self, executed: int) -> bool:
        """Return whether the executed command with number `executed`, counted from 1, belongs to the job."""
        return executed >= self._ends[bisect_right(self._begins, executed) - 1]

    def commands_of(self, executed: Int) -> Int:
        """Return the result of `command_of` for each executed command (n,)."""
        run = np.searchsorted(np.array(self._begins), executed, side="right") - 1
        since = executed - np.array(self._ends)[run]
        return np.asarray(
            np.where(since < 0, np.array(self._before)[run], np.array(self._after)[run] + since)
        )

    def command_of(self, executed: int) -> int:
        """Return the job index of the executed command with number `executed`, counted from 1.

        For a command that does not belong to the job, return the index of the job command before it, or -1.
        """
        return int(self.commands_of(np.array([executed]))[0])

    @property
    def digest(self) -> str:
        """SHA-256 of the executed commands so far, in hexadecimal."""
        return self._hash.hexdigest()

    def _count_executed(self, command: bytes) -> None:
        """Count the next command of the job as executed."""
        self.executed += 1
        self.due += 1
        self._unexpected_in_row = 0
        self._hash.update(command + b"\n")

    def _record_unexpected(self) -> None:
        """Record an executed command as unexpected; consecutive unexpected commands form one run."""
        if self._ends[-1] != self._n_started:
            self._begins.append(self._n_started)
            self._ends.append(self._n_started)
            self._before.append(self.due - 1)
            self._after.append(self.due)
        self._ends[-1] = self._n_started + 1

    def _try_resync(self, command: bytes) -> bool:
        """Search for a command later in the job, and continue there; return whether it was found."""
        ahead = self._commands[self.due : self.due + _SEARCH_WINDOW + 1]
        n_altered = self._unexpected_in_row
        if 0 < n_altered < len(ahead) and ahead[n_altered] == command and self._ends[-1] == self._n_started:
            self._skip_commands(n_altered)
            self._count_executed(command)
            return True
        number, last = self._last_unexpected
        if not n_altered or number != self._n_started - 1:
            return False
        n_lost = next((at for at in range(1, len(ahead) - 1) if [*ahead[at : at + 2]] == [last, command]), 0)
        if not n_lost:
            return False
        self._ends[-1] -= 1
        self.n_unexpected -= 1
        del self.unexpected[self.n_unexpected :]
        self._skip_commands(n_lost)
        self._count_executed(last)
        self._count_executed(command)
        return True

    def _skip_commands(self, count: int) -> None:
        """Record the next `count` commands of the job as skipped, and continue after them."""
        self.skipped += range(self.due, self.due + min(count, MAX_LISTED - len(self.skipped)))
        self.due += count
        self._after[-1] = self.due
