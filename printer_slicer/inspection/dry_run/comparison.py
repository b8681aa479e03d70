"""What a printer executes, against what a job holds."""

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

    A command that is not next in the job is a stray. The job goes on further down where as many commands are missing as
    strays came, or where two that were executed stand one behind the other: an altered or lost line is one difference.

    Attributes:
        executed: how many commands of the job were executed, in their order.
        due: index of the one that is next.
        n_unexpected: how many commands were executed that were not.
        unexpected: the first few of them: (index of what was next, the command).
        skipped: indices of the first few commands that were passed over.
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
        """One more executed command."""
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
        """Many commands that are next in the job were executed; none of them is what a host asks."""
        self._begun += len(commands)
        self.executed += len(commands)
        self.due += len(commands)
        self._hash.update(b"\n".join(commands) + b"\n")

    def of_job(self, executed: int) -> bool:
        """Whether the command that was executed as number `executed`, counted from 1, is one of the job."""
        return executed >= self._ends[bisect_right(self._begins, executed) - 1]

    def commands_of(self, executed: Int) -> Int:
        """(n,) what `command_of` gives for each."""
        run = np.searchsorted(np.array(self._begins), executed, side="right") - 1
        since = executed - np.array(self._ends)[run]
        return np.asarray(
            np.where(since < 0, np.array(self._before)[run], np.array(self._behind)[run] + since)
        )

    def command_of(self, executed: int) -> int:
        """Index in the job of the command that was executed as number `executed`, counted from 1.

        Of one that is not the job's it is that of the command in front of it, -1 if there was none.
        """
        return int(self.commands_of(np.array([executed]))[0])

    @property
    def digest(self) -> str:
        """SHA-256 so far, in hexadecimal."""
        return self._hash.hexdigest()

    def _take(self, command: bytes) -> None:
        """The command that is next was executed."""
        self.executed += 1
        self.due += 1
        self._in_row = 0
        self._hash.update(command + b"\n")

    def _set_apart(self) -> None:
        """The command that was executed is not of the job. What follows each other is one run."""
        if self._ends[-1] != self._begun:
            self._begins.append(self._begun)
            self._ends.append(self._begun)
            self._before.append(self.due - 1)
            self._behind.append(self.due)
        self._ends[-1] = self._begun + 1

    def _found_again(self, command: bytes) -> bool:
        """Whether the job goes on with this command, or went on with the stray before it."""
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
        """Commands of the job were not executed; it goes on behind the last run."""
        self.skipped += range(self.due, self.due + min(count, SHOWN - len(self.skipped)))
        self.due += count
        self._behind[-1] = self.due
