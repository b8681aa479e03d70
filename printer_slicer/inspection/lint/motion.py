"""Check the end points, speeds and flow of the moves of a job, many moves at once.

Firmware limits speeds itself. So a feed rate above that of the profile is only a warning, unless it is far above or the
file raises the limits of the firmware too. Inches, relative modes, offsets (G92), homing, tools, M200 and M220 are
taken into account.
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
"""Factor on `max_flow` that a hotend can deliver for a short time."""

_BESIDE: Final = 5.0  # mm outside the bed that printers reach, to prime and to wipe
_AWAY: Final = (
    25.0  # mm outside the bed for travel: slicers park there, and the firmware stops the move at the edge
)
_OVER: Final = 10.0  # mm above the printable height, where slicers lift the nozzle at the end
_ROUNDED: Final = 0.011  # mm
_FAST: Final = 2.0  # a feed rate above this multiple of the speed in the profile is an error
_RAISED: Final = 3.0  # the same for z and extruder, whose limits slicers often do not know


class MoveJudge:
    """Checks the moves of a job, batch by batch.

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
        """Check the next batch of moves."""
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
        """Yield one diagnostic for each kind of problem; `commands` are those of the job, for the text."""
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
            command, why = (
                commands[index].decode("latin-1"),
                "It will fall down: rotate the part or add supports",
            )
            yield Diagnostic("unsupported", "error", describe(found), why, index=index, command=command)

    def _keep(self, moves: Moves, case: _Case) -> None:
        """Record the first of the moves, the number of commands, and the largest amount."""
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
        """Return the speed limits (4, K) of the firmware: those of the profile until the file sets others."""
        raised = np.repeat(self._raised[:, None], len(moves.speed), axis=1)
        for first, kind, values in moves.changes:
            for axis, letter in enumerate("XYZE" if kind == "M203" else ""):
                if letter in values:
                    raised[axis, first:] = self._raised[axis] = values[letter]
        return raised

    def _fresh(self, moves: Moves, fed: Float) -> Float:
        """Return the new filament (K,) that leaves the nozzle, mm, without filament that returns after a retraction."""
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
    """One kind of problem: its first command, the number of commands with it, the largest amount."""

    index: int
    times: int
    worst: float
    why: str


class _Case(NamedTuple):
    """One check: which moves (K,) fail it, by how much (K,) for the braces in `what`, and why it matters."""

    name: str
    which: Bool
    size: Float
    what: str
    why: str
    refused: bool


def _box(moves: Moves, profile: Profile) -> Iterator[_Case]:
    """Find moves that end outside the printable area."""
    (left, front), (right, back) = profile.printer.corners
    reach = profile.printer.reach
    low = (left - reach, front - reach, 0.0)
    high = (right + reach, back + reach, profile.printer.bed_z)
    over = "The axis would hit its end stop"
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
        why = "The nozzle would hit the bed" if letter == "z" else over
        for off, room, bound, reason in (
            (below, spare[0], low[axis], why),
            (above, spare[1], high[axis], over),
        ):
            what = f"{letter} is up to {{:.2f}} mm outside the limit of {bound:g} mm"
            far = goes & (off > room + _ROUNDED)
            yield _Case("box", far, off, what, reason, refused=True)
            beside = goes & (off > _ROUNDED) & ~far
            yield _Case(
                "box",
                beside,
                off,
                what,
                "Most printers reach this far, some stop at the limit",
                refused=False,
            )


def _speeds(moves: Moves) -> tuple[Float, Float]:
    """Return the requested speed (4, K) of each axis, mm/s, and each axis's share of the length of the move."""
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    part = np.array([x, y, z, e]) / np.where(length > 0, length, 1.0)
    return part * moves.speed, part


def _feed(profile: Profile, speed: Float, part: Float, raised: Float) -> Iterator[_Case]:
    """Find speeds above those of the profile."""
    held = "The firmware limits it"
    for axis, letter in enumerate("xyze"):
        most = limits_of(profile.printer).max_speed[axis]
        wanted = speed[axis]
        reached = np.minimum(wanted, raised[axis])
        if letter in "xy":
            far = (wanted > most * _FAST) | ((reached > most * 1.001) & (raised[axis] > most * 1.001))
        else:
            far = reached > most * _RAISED
        name = "the extruder" if letter == "e" else letter
        what = f"{name} moves at {{:.3g}} mm/s, the maximum of the profile is {most:g} mm/s"
        yield _Case("feed", far, wanted, what, "The motors may lose steps", refused=True)
        slower = (wanted > most * 1.001) & ~far & (part[axis] > 0)
        yield _Case("feed", slower, wanted, what, held, refused=False)


def _flow(moves: Moves, fresh: Float, seconds: Float, profile: Profile) -> Iterator[_Case]:
    """Find volumetric flow above the maximum, while moving and while standing still."""
    volume = fresh * np.pi * profile.material.filament_diameter**2 / 4
    laid = (moves.delta[:, :2] != 0).any(axis=1) & (volume > 0)
    standing = ~laid & (volume >= FLOW_WINDOW) & (seconds > 0)
    flow = np.zeros(len(volume))
    flow[laid] = volumetric_flow(volume[laid], seconds[laid])
    flow[standing] = volume[standing] / seconds[standing]
    most = profile.max_flow
    what = f"flow {{:.3g}} mm³/s, {profile.material.name} allows {most:g} mm³/s"
    far = laid & (flow > most * MELTS)
    yield _Case(
        "flow", far, flow, what, "The extruder slips, and too little material comes out", refused=True
    )
    more = ~far & (flow > most * 1.01)
    yield _Case("flow", more, flow, what, "The excess is small, or the nozzle only primes", refused=False)


def _least_seconds(moves: Moves, over: Float) -> Float:
    """Return the minimum duration (K,) of each move within the axis limits, s; `over` (4, K) is speed by limit."""
    slow = np.maximum(1.0, over.max(axis=0))
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    return np.asarray(length / np.maximum(moves.speed, 1e-9) * slow)
