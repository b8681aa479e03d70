"""Where the moves of a job lead, how fast, and how much plastic they lay: over all moves at once.

Firmware holds moves back to its own limits, so a feed rate over the profile's is only told, unless the file raises the
firmware's limits too or it is far over. Ends of moves are what the reader of moves makes of them: inches, relative
modes, offsets (G92), homing, tools, M200, M220.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.gcode import Moves
from printer_slicer.geometry import Bool, Float
from printer_slicer.motion.flow import ENOUGH, flow_of
from printer_slicer.motion.machine import limits_of
from printer_slicer.policy.findings import Finding
from printer_slicer.profile import Profile

__all__ = ["MELTS", "judge_moves"]

MELTS: Final = 1.5
"""Times `max_flow` that a hotend gives for a short while."""

_BESIDE: Final = 5.0  # mm beside the bed that machines reach, to prime and to wipe
_AWAY: Final = 25.0  # mm beside it that slicers send an empty nozzle at the end, for the firmware stops it
_OVER: Final = 10.0  # mm over the highest part, to present it
_ROUNDED: Final = 0.011  # mm
_FAST: Final = 2.0  # times the profile's speed from which on a feed is refused
_RAISED: Final = 3.0  # the same of z and extruder, for slicers know little about them


def judge_moves(
    moves: Moves, commands: Sequence[bytes], profile: Profile, factors: Sequence[tuple[int, float]] = ()
) -> Iterator[Finding]:
    """What is wrong with the moves of a job.

    Args:
        moves: of the commands.
        commands: of the job.
        profile: of the machine and its material.
        factors: of flow (M221): from which command on, ratio.
    """
    if not len(moves.speed):
        return
    tell = _Teller(moves, commands)
    yield from _box(moves, profile, tell)
    speed, part = _speeds(moves)
    yield from _feed(moves, profile, tell, speed, part)
    yield from _flow(moves, profile, tell, factors)


class _Teller:
    """Makes a finding of the moves of which something is true."""

    def __init__(self, moves: Moves, commands: Sequence[bytes]) -> None:
        self._line = moves.line
        self._commands = commands

    def __call__(
        self, name: str, which: Bool, size: Float, what: str, why: str, *, refused: bool
    ) -> list[Finding]:
        """The first of the moves, the number of commands, and the value of the worst in place of the braces."""
        at = np.flatnonzero(which)
        if not len(at):
            return []
        index = int(self._line[at[0]])
        worst = at[np.argmax(np.abs(size[at]))]
        times = len(np.unique(self._line[at]))
        command = self._commands[index].decode("latin-1")
        return [Finding(name, refused, index, command, what.format(float(size[worst])), why, times)]


def _box(moves: Moves, profile: Profile, tell: _Teller) -> Iterator[Finding]:
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
        spare = (0.0, _OVER) if letter == "z" else (aside, aside)
        why = "the nozzle is driven into the bed" if letter == "z" else over
        for off, room, bound, reason in (
            (below, spare[0], low[axis], why),
            (above, spare[1], high[axis], over),
        ):
            what = f"{letter} at up to {{:.2f}} mm beyond {bound:g} mm"
            far = goes & (off > room + _ROUNDED)
            yield from tell("box", far, off, what, reason, refused=True)
            beside = goes & (off > _ROUNDED) & ~far
            yield from tell(
                "box", beside, off, what, "most machines reach so far, some stop there", refused=False
            )


def _speeds(moves: Moves) -> tuple[Float, Float]:
    """(4, K) wanted speed of each axis, mm/s, and the part of it in the length of the move."""
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    part = np.array([x, y, z, e]) / np.where(length > 0, length, 1.0)
    return part * moves.speed, part


def _feed(moves: Moves, profile: Profile, tell: _Teller, speed: Float, part: Float) -> Iterator[Finding]:
    """Speeds over the profile's."""
    raised = _raised(moves, profile)
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
        yield from tell("feed", far, wanted, what, "the machine may lose steps", refused=True)
        slower = (wanted > most * 1.001) & ~far & (part[axis] > 0)
        yield from tell("feed", slower, wanted, what, held, refused=False)


def _raised(moves: Moves, profile: Profile) -> Float:
    """(4, K) the firmware's limits of speed: the profile's, until the file sets others."""
    usual = np.array(limits_of(profile.printer).max_speed)
    raised = np.repeat(usual[:, None], len(moves.speed), axis=1)
    for first, kind, values in moves.changes:
        if kind == "M203":
            for axis, letter in enumerate("XYZE"):
                if letter in values:
                    raised[axis, first:] = values[letter]
    return raised


def _flow(
    moves: Moves, profile: Profile, tell: _Teller, factors: Sequence[tuple[int, float]]
) -> Iterator[Finding]:
    """Plastic per second: of beads, and of what is pushed out standing. What only comes back does not count."""
    delta, ratio = moves.delta, np.ones(len(moves.speed))
    for index, factor in factors:
        ratio[np.searchsorted(moves.line, index) :] = factor
    fed = delta[:, 3] * ratio
    fresh = np.zeros(len(fed))
    for tool in np.unique(moves.tool):
        own = moves.tool == tool
        total = np.cumsum(fed[own])
        peak = np.maximum.accumulate(np.maximum(total, 0.0))
        fresh[own] = np.diff(peak, prepend=0.0)
    seconds = _least_seconds(moves, profile)
    area = np.pi * profile.material.filament_diameter**2 / 4
    volume = fresh * area
    laid = (delta[:, :2] != 0).any(axis=1) & (volume > 0)
    standing = ~laid & (volume >= ENOUGH) & (seconds > 0)
    flow = np.zeros(len(fed))
    flow[laid] = flow_of(volume[laid], seconds[laid])
    flow[standing] = volume[standing] / seconds[standing]
    most = profile.material.max_flow
    what = f"{{:.3g}} mm3/s of plastic, {profile.material.name} melts {most:g}"
    far = laid & (flow > most * MELTS)
    yield from tell("flow", far, flow, what, "too little comes out, and the extruder slips", refused=True)
    more = ~far & (flow > most * 1.01)
    yield from tell("flow", more, flow, what, "it is a little, or nothing is laid with it", refused=False)


def _least_seconds(moves: Moves, profile: Profile) -> Float:
    """(K,) s that each move takes at least: at its speed, no axis over its limit."""
    raised = _raised(moves, profile)
    wanted, _ = _speeds(moves)
    slow = np.maximum(1.0, (wanted / raised).max(axis=0))
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    return np.asarray(length / np.maximum(moves.speed, 1e-9) * slow)
