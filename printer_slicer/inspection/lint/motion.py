"""Where the moves of a job lead, how fast, and how much plastic they lay: over many moves at once.

Firmware holds moves back to its own limits, so a feed rate over the profile's is only told, unless the file raises the
firmware's limits too or it is far over. Ends of moves are what the reader of moves makes of them: inches, relative
modes, offsets (G92), homing, tools, M200, M220.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.diagnostics import Diagnostic, Severity
from printer_slicer.gcode import Moves
from printer_slicer.inspection.deposition.unsupported import UnsupportedTracker, describe
from printer_slicer.motion.rules import limits_of
from printer_slicer.motion.vectorized import FLOW_WINDOW, volumetric_flow
from printer_slicer.profile import Profile

__all__ = ["MELTS", "MoveJudge"]

MELTS: Final = 1.5
"""Times `max_flow` that a hotend gives for a short while."""

_BESIDE: Final = 5.0  # mm beside the bed that machines reach, to prime and to wipe
_AWAY: Final = 25.0  # mm beside it that slicers send an empty nozzle at the end, for the firmware stops it
_OVER: Final = 10.0  # mm over the highest part, to present it, where the firmware minds it less
_ROUNDED: Final = 0.011  # mm
_FAST: Final = 2.0  # times the profile's speed from which on a feed is refused
_RAISED: Final = 3.0  # the same of z and extruder, for slicers know little about them


class MoveJudge:
    """Says what is wrong with the moves of a job, which it sees piece by piece.

    Args:
        profile: of the machine and its material.
        factors: of flow (M221): from which command on, ratio; ascending.
        tracker: finds unsupported extrusion; None if the moves are not a complete print.
    """

    def __init__(
        self,
        profile: Profile,
        factors: Sequence[tuple[int, float]] = (),
        tracker: UnsupportedTracker | None = None,
    ) -> None:
        self._profile, self._tracker = profile, tracker
        self._factor_from = np.array([index for index, _ in factors], np.int64)
        self._factor = np.array([1.0, *(ratio for _, ratio in factors)])
        self._raised = np.array(limits_of(profile.printer).max_speed)
        self._fed: dict[int, tuple[float, float]] = {}
        self._found: dict[tuple[str, str, bool], _Found] = {}

    def see(self, moves: Moves) -> None:
        """Some more moves."""
        raised = self._raised_over(moves)
        if not len(moves.speed):
            return
        speed, part = _speeds(moves)
        ratio = self._factor[np.searchsorted(self._factor_from, moves.line, side="right")]
        fresh = self._fresh(moves, moves.delta[:, 3] * ratio)
        if self._tracker is not None:
            self._tracker.feed(moves.line + 1, moves.end - moves.delta[:, :3], moves.end, fresh)
        cases = (
            _box(moves, self._profile),
            _feed(self._profile, speed, part, raised),
            _flow(moves, fresh, _least_seconds(moves, speed / raised), self._profile),
        )
        for case in chain(*cases):
            self._keep(moves, case)

    def findings(self, commands: Sequence[bytes]) -> Iterator[Diagnostic]:
        """What was wrong, each thing once; `commands` of the job are shown in it."""
        for (name, what, refused), one in self._found.items():
            command = commands[one.index].decode("latin-1")
            severity: Severity = "error" if refused else "warning"
            yield Diagnostic(
                name,
                severity,
                what.format(one.worst),
                one.why,
                times=one.times,
                index=one.index,
                command=command,
            )
        if self._tracker is not None and (found := self._tracker.close()):
            index = found[0].command - 1
            command, why = commands[index].decode("latin-1"), "it will fall: turn the part, or add supports"
            yield Diagnostic("unsupported", "error", describe(found), why, index=index, command=command)

    def _keep(self, moves: Moves, case: _Case) -> None:
        """Keep the first of the moves, the number of commands, and the worst size."""
        at = np.flatnonzero(case.which)
        if not len(at):
            return
        worst = float(case.size[at[np.argmax(np.abs(case.size[at]))]])
        times = len(np.unique(moves.line[at]))
        key = case.name, case.what, case.refused
        old = self._found.get(key)
        if old is None:
            self._found[key] = _Found(int(moves.line[at[0]]), times, worst, case.why)
        else:
            old.times += times
            old.worst = max(old.worst, worst, key=abs)

    def _raised_over(self, moves: Moves) -> Float:
        """(4, K) the firmware's limits of speed: the profile's, until the file sets others."""
        raised = np.repeat(self._raised[:, None], len(moves.speed), axis=1)
        for first, kind, values in moves.changes:
            for axis, letter in enumerate("XYZE" if kind == "M203" else ""):
                if letter in values:
                    raised[axis, first:] = self._raised[axis] = values[letter]
        return raised

    def _fresh(self, moves: Moves, fed: Float) -> Float:
        """(K,) mm of filament that were never in the nozzle before: what only comes back does not count."""
        fresh = np.zeros(len(fed))
        for tool in np.unique(moves.tool).tolist():
            before, highest = self._fed.get(tool, (0.0, 0.0))
            own = moves.tool == tool
            total = before + np.cumsum(fed[own])
            peak = np.maximum.accumulate(np.maximum(total, highest))
            fresh[own] = np.diff(peak, prepend=highest)
            self._fed[tool] = float(total[-1]), float(peak[-1])
        return fresh


@dataclass(slots=True)
class _Found:
    """Something wrong: the first command that does it, how many do, the worst size."""

    index: int
    times: int
    worst: float
    why: str


class _Case(NamedTuple):
    """What is true of which moves (K,), how much it is of each (K,) for the braces in `what`, and why that matters."""

    name: str
    which: Bool
    size: Float
    what: str
    why: str
    refused: bool


def _box(moves: Moves, profile: Profile) -> Iterator[_Case]:
    """Ends of moves out of the machine."""
    (left, front), (right, back) = profile.printer.corners
    reach = profile.printer.reach
    low = (left - reach, front - reach, 0.0)
    high = (right + reach, back + reach, profile.printer.bed_z)
    over = "the head is driven against the end of its axis"
    laying = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    aside = np.where(laying, _BESIDE, _AWAY)
    for axis, letter in enumerate("xyz"):
        at = moves.end[:, axis]
        goes = moves.delta[:, axis] != 0
        below, above = low[axis] - at, at - high[axis]
        spare = (
            (0.0, 0.0 if profile.printer.firmware.halts_out_of_bounds else _OVER)
            if letter == "z"
            else (aside, aside)
        )
        why = "the nozzle is driven into the bed" if letter == "z" else over
        for off, room, bound, reason in (
            (below, spare[0], low[axis], why),
            (above, spare[1], high[axis], over),
        ):
            what = f"{letter} at up to {{:.2f}} mm beyond {bound:g} mm"
            far = goes & (off > room + _ROUNDED)
            yield _Case("box", far, off, what, reason, refused=True)
            beside = goes & (off > _ROUNDED) & ~far
            yield _Case(
                "box", beside, off, what, "most machines reach so far, some stop there", refused=False
            )


def _speeds(moves: Moves) -> tuple[Float, Float]:
    """(4, K) wanted speed of each axis, mm/s, and the part of it in the length of the move."""
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    part = np.array([x, y, z, e]) / np.where(length > 0, length, 1.0)
    return part * moves.speed, part


def _feed(profile: Profile, speed: Float, part: Float, raised: Float) -> Iterator[_Case]:
    """Speeds over the profile's."""
    held = "the firmware holds it back"
    for axis, letter in enumerate("xyze"):
        most = limits_of(profile.printer).max_speed[axis]
        wanted = speed[axis]
        reached = np.minimum(wanted, raised[axis])
        if letter in "xy":
            far = (wanted > most * _FAST) | ((reached > most * 1.001) & (raised[axis] > most * 1.001))
        else:
            far = reached > most * _RAISED
        name = "the extruder" if letter == "e" else letter
        what = f"{name} at {{:.3g}} mm/s, the profile has {most:g}"
        yield _Case("feed", far, wanted, what, "the machine may lose steps", refused=True)
        slower = (wanted > most * 1.001) & ~far & (part[axis] > 0)
        yield _Case("feed", slower, wanted, what, held, refused=False)


def _flow(moves: Moves, fresh: Float, seconds: Float, profile: Profile) -> Iterator[_Case]:
    """Plastic per second: of beads, and of what is pushed out standing."""
    volume = fresh * np.pi * profile.material.filament_diameter**2 / 4
    laid = (moves.delta[:, :2] != 0).any(axis=1) & (volume > 0)
    standing = ~laid & (volume >= FLOW_WINDOW) & (seconds > 0)
    flow = np.zeros(len(volume))
    flow[laid] = volumetric_flow(volume[laid], seconds[laid])
    flow[standing] = volume[standing] / seconds[standing]
    most = profile.max_flow
    what = f"{{:.3g}} mm3/s of plastic, {profile.material.name} melts {most:g}"
    far = laid & (flow > most * MELTS)
    yield _Case("flow", far, flow, what, "too little comes out, and the extruder slips", refused=True)
    more = ~far & (flow > most * 1.01)
    yield _Case("flow", more, flow, what, "it is a little, or nothing is laid with it", refused=False)


def _least_seconds(moves: Moves, over: Float) -> Float:
    """(K,) s that each move takes at least: at its speed, no axis over its limit; (4, K) by how much it would be."""
    slow = np.maximum(1.0, over.max(axis=0))
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    return np.asarray(length / np.maximum(moves.speed, 1e-9) * slow)
