"""What a printer executes, against what a job holds."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from hashlib import sha256
from typing import Final

import numpy as np

from printer_slicer.geometry import Int

__all__ = ["SHOWN", "Comparison"]

_OURS: Final = (b"M105", b"M110", b"M114", b"M115", b"M155", b"M400")  # what the host asks on its own account
_OTHERS: Final = (b"M20", b"M21", b"M27", b"M113")  # what other hosts ask on theirs
SHOWN: Final = 20
"""Things told in full."""


class Comparison:
    """Compares what a printer executes with what a job holds, command by command.

    Attributes:
        executed: commands of the job that were executed in their order.
        strays: the first few commands that were executed and were not next in the job: (how many had been
            executed before, the command).
        digest: SHA-256 over the executed commands of the job, each followed by a newline.
    """

    def __init__(self, commands: Sequence[bytes] = ()) -> None:
        self._commands = commands
        self._hash = sha256()
        self._begun = 0
        self._own: list[int] = []
        self.executed = 0
        self.n_strays = 0
        self.strays: list[tuple[int, str]] = []

    def __call__(self, text: str) -> None:
        """One more executed command."""
        self._begun += 1
        command = text.encode("latin-1")
        due = self.executed < len(self._commands) and command == self._commands[self.executed]
        if due or not (self._commands or command.startswith(_OURS)):
            self.executed += 1
            self._hash.update(command + b"\n")
        elif command.startswith(_OURS + _OTHERS):
            self._own.append(self._begun)
        else:
            self._own.append(self._begun)
            self.n_strays += 1
            if len(self.strays) < SHOWN:
                self.strays.append((self.executed, text))

    def many(self, commands: Sequence[bytes]) -> None:
        """Many commands that are next in the job were executed; none of them is what a host asks."""
        self._begun += len(commands)
        self.executed += len(commands)
        self._hash.update(b"\n".join(commands) + b"\n")

    def of_job(self, executed: int) -> bool:
        """Whether the command that was executed as number `executed`, counted from 1, is one of the job."""
        at = bisect_right(self._own, executed)
        return not at or self._own[at - 1] != executed

    def commands_of(self, executed: Int) -> Int:
        """(n,) what `command_of` gives for each."""
        return np.asarray(executed - 1 - np.searchsorted(self._own, executed, side="right"))

    def command_of(self, executed: int) -> int:
        """Index in the job of the command that was executed as number `executed`, counted from 1."""
        return executed - 1 - bisect_right(self._own, executed)

    @property
    def digest(self) -> str:
        """SHA-256 so far, in hexadecimal."""
        return self._hash.hexdigest()
