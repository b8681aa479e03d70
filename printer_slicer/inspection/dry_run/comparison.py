"""Compare the commands that a printer executes with the commands of a job."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from hashlib import sha256
from typing import Final

import numpy as np

from printer_slicer.arrays import Int

__all__ = ["SHOWN", "Comparison"]

_OURS: Final = (b"M105", b"M110", b"M114", b"M115", b"M155", b"M400")  # what the host asks on its own account
_OTHERS: Final = (b"M20", b"M21", b"M27", b"M113")  # what other hosts ask on theirs
_WINDOW: Final = 16  # commands behind the one that is due, among which the job is found again
SHOWN: Final = 20
"""Things told in full."""


class Comparison:
    """Compares what a printer executes with what a job holds, command by command.

    A command that is not the next one of the job is unexpected. The comparison continues further down in the job where
    as many commands are missing as unexpected ones came, or where two executed commands follow each other. So an
    altered or lost line is one difference.

    Attributes:
        executed: number of commands of the job that were executed in order.
        due: index of the next command of the job.
        n_unexpected: number of executed commands that were unexpected.
        unexpected: the first few of them: (index of the command that was due, the executed command).
        skipped: indices of the first few commands that were not executed.
        digest: SHA-256 over the executed commands of the job, each followed by a newline.
    """

    def __init__(self, commands: Sequence[bytes] = ()) -> None:
        self._commands = commands
        self._hash = sha256()
        self._begun = 0
        # Runs of commands that are not the job's: numbers of the first and of the one behind the last, and the indices
        # of those of the job in front and behind. The first run is empty and ends where everything begins.
        self._begins, self._ends = array("q", [0]), array("q", [1])
        self._before, self._behind = array("q", [-1]), array("q", [0])
        self._last = (0, b"")  # stray
        self._in_row = 0  # strays since the last command of the job
        self.executed = self.due = self.n_unexpected = 0
        self.unexpected: list[tuple[int, str]] = []
        self.skipped: list[int] = []

    def __call__(self, text: str) -> None:
        """Compare one more executed command."""
        self._begun += 1
        command = text.encode("latin-1")
        if self.due < len(self._commands) and command == self._commands[self.due]:
            self._take(command)
        elif not self._commands:
            # There is nothing to compare with, and maybe no end.
            if not command.startswith(_OURS):
                self._take(command)
        elif command.startswith(_OURS + _OTHERS):
            self._set_apart()
        elif not self._found_again(command):
            self._set_apart()
            self._last = self._begun, command
            self._in_row += 1
            self.n_unexpected += 1
            if self.n_unexpected <= SHOWN:
                self.unexpected.append((self.due, text))

    def many(self, commands: Sequence[bytes]) -> None:
        """Count many commands that were executed in order; none of them is a query of the host."""
        self._begun += len(commands)
        self.executed += len(commands)
        self.due += len(commands)
        self._hash.update(b"\n".join(commands) + b"\n")

    def of_job(self, executed: int) -> bool:
        """Return whether executed command number `executed`, counted from 1, belongs to the job."""
        return executed >= self._ends[bisect_right(self._begins, executed) - 1]

    def commands_of(self, executed: Int) -> Int:
        """Return the result of `command_of` for each, (n,)."""
        run = np.searchsorted(np.array(self._begins), executed, side="right") - 1
        since = executed - np.array(self._ends)[run]
        return np.asarray(
            np.where(since < 0, np.array(self._before)[run], np.array(self._behind)[run] + since)
        )

    def command_of(self, executed: int) -> int:
        """Return the index in the job of executed command number `executed`, counted from 1.

        For a command that is not of the job, return the index of the command before it; -1 if there is none.
        """
        return int(self.commands_of(np.array([executed]))[0])

    @property
    def digest(self) -> str:
        """Return the SHA-256 so far, in hexadecimal."""
        return self._hash.hexdigest()

    def _take(self, command: bytes) -> None:
        """Count the next command as executed."""
        self.executed += 1
        self.due += 1
        self._in_row = 0
        self._hash.update(command + b"\n")

    def _set_apart(self) -> None:
        """Record an executed command as unexpected; consecutive ones form one run."""
        if self._ends[-1] != self._begun:
            self._begins.append(self._begun)
            self._ends.append(self._begun)
            self._before.append(self.due - 1)
            self._behind.append(self.due)
        self._ends[-1] = self._begun + 1

    def _found_again(self, command: bytes) -> bool:
        """Return whether the job continues with this command, or continued with the unexpected one before it."""
        ahead = self._commands[self.due : self.due + _WINDOW + 1]
        altered = self._in_row
        if 0 < altered < len(ahead) and ahead[altered] == command and self._ends[-1] == self._begun:
            self._pass_over(altered)
            self._take(command)
            return True
        number, last = self._last
        if not altered or number != self._begun - 1:
            return False
        lost = next((at for at in range(1, len(ahead) - 1) if [*ahead[at : at + 2]] == [last, command]), 0)
        if not lost:
            return False
        self._ends[-1] -= 1
        self.n_unexpected -= 1
        del self.unexpected[self.n_unexpected :]
        self._pass_over(lost)
        self._take(last)
        self._take(command)
        return True

    def _pass_over(self, count: int) -> None:
        """Record commands of the job as skipped; the job continues after the last run."""
        self.skipped += range(self.due, self.due + min(count, SHOWN - len(self.skipped)))
        self.due += count
        self._behind[-1] = self.due
