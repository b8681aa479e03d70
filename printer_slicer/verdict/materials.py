"""From the moves that a printer made to the account of its material."""

from __future__ import annotations

import re
from array import array
from math import pi

import numpy as np

from printer_slicer.geometry import Int
from printer_slicer.jobs import Job
from printer_slicer.ledger.beads import Purpose
from printer_slicer.ledger.executed import Account, Marks
from printer_slicer.ledger.keeper import Keeper
from printer_slicer.ledger.text import purpose_of
from printer_slicer.profile import Profile
from printer_slicer.sim.track import COLUMNS, Track
from printer_slicer.verdict.comparison import Comparison

__all__ = ["Materials"]

_TOOL = re.compile(rb"[Tt]\d{1,3}\b")
_OTHER_TOOL = re.compile(rb"^[ \t]*(?:N\d+[ \t]*)?[Tt]0*[1-9]", re.MULTILINE)


class Materials:
    """Watches a printer that executes a job.

    Args:
        job: it.
        profile: with the machine and the material.
        comparison: knows which command of the job each executed one is.

    Attributes:
        track: what to give to the printer.
    """

    def __init__(self, job: Job, profile: Profile, comparison: Comparison) -> None:
        self.track = Track(self._take)
        self._comparison = comparison
        area = pi * profile.material.filament_diameter**2 / 4
        self._keeper = Keeper(profile.printer.corners, area, profile.material.max_flow, _marks_of(job))

    def account(self) -> Account:
        """What it came to."""
        self.track.flush()
        return self._keeper.close()

    def _take(self, rows: array[float], seconds: array[float], kept_back: float) -> None:
        table = np.frombuffer(rows).reshape(-1, COLUMNS).copy()
        table[:, 0] = self._comparison.commands_of(table[:, 0].astype(np.int64)) + 1
        self._keeper.feed(table, np.frombuffer(seconds), kept_back)


def _marks_of(job: Job) -> Marks:
    """What the comments of a job tell, by commands counted from 1."""
    layers = np.array(list(job.marks), np.int64) + 1
    roles = {command: purpose_of(name) for command, name in job.roles.items()}
    first = int(layers[0]) - 1 if len(layers) else 0
    if roles and first:
        # What is laid before the first layer primes the nozzle.
        roles = {0: Purpose.BESIDE} | {command: kind for command, kind in roles.items() if command >= first}
    changes, tools = _tools_of(job)
    return Marks(
        layers=layers,
        roles=np.array(list(roles), np.int64) + 1,
        names=np.array([int(kind) for kind in roles.values()], np.int64),
        spoken=tuple(SPOKEN.get(kind, kind.spoken) for kind in Purpose),
        loose=frozenset({int(Purpose.SUPPORT)}),
        changes=changes,
        tools=tools,
    )


def _tools_of(job: Job) -> tuple[Int, Int]:
    """Commands, counted from 1, that choose a tool, and which; none where there is no other than the first."""
    if not _OTHER_TOOL.search(job.text):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = [
        (at, int(command[1:].split()[0]))
        for at, command in enumerate(job.commands, 1)
        if _TOOL.match(command)
    ]
    return np.array([at for at, _ in found], np.int64), np.array([tool for _, tool in found], np.int64)


SPOKEN = {
    Purpose.UNKNOWN: "printing",
    Purpose.SPARSE: "sparse infill",
    Purpose.GAP: "gaps and thin walls",
    Purpose.BESIDE: "skirt, brim, priming",
    Purpose.SUPPORT: "support and raft",
}
"""Purposes of beads in words that say enough by themselves."""
