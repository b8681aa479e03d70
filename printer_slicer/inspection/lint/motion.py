"""Check the end points, speeds and flow of a job's moves, which are stored in arrays.

Firmware limits speeds itself. So a feed rate above that of the profile is only a warning, unless it is far above or the
file raises the limits of the firmware too. Inches, relative modes, offsets (G92), homing, tools, M200 and M220 are
taken into account.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.diagnostics import Diagnostic, Severity
from printer_slicer.gcode import Moves
from printer_slicer.inspection.deposition.head_contacts import HeadContactFinder
from printer_slicer.inspection.deposition.unsupported import UnsupportedTracker, describe_unsupported
from printer_slicer.motion.rules import limits_of
from printer_slicer.motion.vectorized import FLOW_WINDOW, compute_volumetric_flow
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["SHORT_TERM_FLOW", "MoveChecker"]

SHORT_TERM_FLOW: Final = 1.5
"""For a short time, a hotend can deliver this factor times `max_flow`."""

_EXTRUSION_MARGIN: Final = 5.0  # mm outside the bed; printers reach this far, for priming and wiping
# mm outside the bed, for travel: slicers park there, and the firmware stops the move at the edge
_TRAVEL_MARGIN: Final = 25.0
_MARGIN_ABOVE: Final = 10.0  # mm above the printable height, where slicers lift the nozzle at the end
_ROUNDING: Final = 0.011  # mm
_MAX_SPEED_RATIO: Final = 2.0  # a feed rate above this multiple of the profile's speed is an error
_MAX_SPEED_RATIO_ZE: Final = 3.0  # such a multiple for z and extruder, whose limits slicers often do not know


class MoveChecker:
    """Checks the moves of a job, batch by batch.

    Args:
        profile: profile of the machine and its material.
        factors: flow factors (M221): (command from which it applies, ratio), ascending.
        tracker: finds unsupported extrusion; None if the moves are not a complete print.
    """

    def __init__(
        self,
        profile: Profile,
        factors: Sequence[tuple[int, float]] = (),
        tracker: UnsupportedTracker | None = None,
    ) -> None:
        self._profile, self._tracker = profile, tracker
        self._flow_factor_since = np.array([index for index, _ in factors], np.int64)
        self._flow_factors = np.array([1.0, *(ratio for _, ratio in factors)])
        self._speed_limits = np.array(limits_of(profile.printer).max_speed)
        self._fed: dict[int, tuple[float, float]] = {}
        self._found: dict[tuple[str, str, bool], _Problem] = {}
        self._head = HeadContactFinder(profile.printer.head_shapes, profile.printer.corners)

    def check(self, moves: Moves) -> None:
        """Check the next batch of moves."""
        speed_limits = self._firmware_speed_limits(moves)
        if not len(moves.speed):
            return
        speed, axis_share = _axis_speeds(moves)
        ratio = self._flow_factors[np.searchsorted(self._flow_factor_since, moves.line, side="right")]
        new_filament = self._new_filament(moves, moves.delta[:, 3] * ratio)
        if self._tracker is not None:
            self._check_print(self._tracker, moves, new_filament)
        results = (
            _check_box(moves, self._profile),
            _check_speeds(self._profile, speed, axis_share, speed_limits),
            _check_flow(moves, new_filament, _min_durations(moves, speed / speed_limits), self._profile),
        )
        for result in chain(*results):
            self._record(moves, result)

    def _check_print(self, tracker: UnsupportedTracker, moves: Moves, new_filament: Float) -> None:
        """Check moves for unsupported extrusion, and for contacts of the print head."""
        start = moves.end - moves.delta[:, :3]

        def add(some: slice) -> None:
            """Add moves to what is printed."""
            tracker.add_moves(moves.line[some] + 1, start[some], moves.end[some], new_filament[some])

        extrudes = (new_filament > 0) & (moves.delta[:, :2] != 0).any(axis=1)
        for one in self._head.check((start, moves.end, extrudes), add, tracker.read_height_map):
            shape = f"its shape {one.height:g} mm above the nozzle"
            message = f"the head touches a printed part, up to {{:.1f}} mm deep, with {shape}"
            fails = np.zeros(len(start), np.bool_)
            fails[one.moves] = True
            amount = np.full(len(start), one.depth)
            reason = f"Nozzle at x {one.x:.1f} y {one.y:.1f} z {one.z:.4g}: print the parts farther apart"
            self._record(moves, _CheckResult("head", fails, amount, message, reason, is_error=True))

    def findings(self, commands: Sequence[bytes]) -> Iterator[Diagnostic]:
        """Yield one diagnostic for each kind of problem; `commands` are all commands of the job."""
        for (name, message, is_error), one in self._found.items():
            command = commands[one.index].decode("latin-1")
            severity: Severity = "error" if is_error else "warning"
            yield Diagnostic(
                name,
                severity,
                message.format(one.worst),
                one.reason,
                times=one.count,
                index=one.index,
                command=command,
            )
        if self._tracker is not None and (found := self._tracker.close()):
            index = found[0].command - 1
            command, reason = (
                commands[index].decode("latin-1"),
                "The filament will fall down: rotate the part or add supports",
            )
            yield Diagnostic(
                "unsupported", "error", describe_unsupported(found), reason, index=index, command=command
            )

    def _record(self, moves: Moves, result: _CheckResult) -> None:
        """Record the first failing move, the number of failing commands, and the largest amount."""
        failing = np.flatnonzero(result.fails)
        if not len(failing):
            return
        worst = float(result.amount[failing[np.argmax(np.abs(result.amount[failing]))]])
        count = len(np.unique(moves.line[failing]))
        key = result.name, result.message, result.is_error
        old = self._found.get(key)
        if old is None:
            self._found[key] = _Problem(int(moves.line[failing[0]]), count, worst, result.reason)
        else:
            old.count += count
            old.worst = max(old.worst, worst, key=abs)

    def _firmware_speed_limits(self, moves: Moves) -> Float:
        """Return the firmware's speed limits (4, K): those of the profile until the file changes them."""
        speed_limits = np.repeat(self._speed_limits[:, None], len(moves.speed), axis=1)
        for first, kind, values in moves.changes:
            for axis, letter in enumerate("XYZE" if kind == "M203" else ""):
                if letter in values:
                    speed_limits[axis, first:] = self._speed_limits[axis] = values[letter]
        return speed_limits

    def _new_filament(self, moves: Moves, fed: Float) -> Float:
        """Return the filament (K,), mm, that leaves the nozzle; deretracted filament does not count."""
        new_filament = np.zeros(len(fed))
        for tool in np.unique(moves.tool).tolist():
            before, highest = self._fed.get(tool, (0.0, 0.0))
            own = moves.tool == tool
            total = before + np.cumsum(fed[own])
            peak = np.maximum.accumulate(np.maximum(total, highest))
            new_filament[own] = np.diff(peak, prepend=highest)
            self._fed[tool] = float(total[-1]), float(peak[-1])
        return new_filament


class _Problem(Struct):
    """All occurrences of one problem: first command, number of commands, largest amount, and reason."""

    index: int
    count: int
    worst: float
    reason: str


class _CheckResult(NamedTuple):
    """The result of a check: mask of failing moves (K,), amounts (K,) for the braces in `message`, reason."""

    name: str
    fails: Bool
    amount: Float
    message: str
    reason: str
    is_error: bool


def _check_box(moves: Moves, profile: Profile) -> Iterator[_CheckResult]:
    """Find moves that end outside the printable area."""
    (left, front), (right, back) = profile.printer.corners
    reach = profile.printer.reach
    low = (left - reach, front - reach, 0.0)
    high = (right + reach, back + reach, profile.printer.bed_z)
    end_stop_reason = "The axis would hit its end stop"
    extruding = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    side_margin = np.where(extruding, _EXTRUSION_MARGIN, _TRAVEL_MARGIN)
    for axis, letter in enumerate("xyz"):
        position = moves.end[:, axis]
        moves_along = moves.delta[:, axis] != 0
        below, above = low[axis] - position, position - high[axis]
        margins = (
            (0.0, 0.0 if profile.printer.firmware.halts_out_of_bounds else _MARGIN_ABOVE)
            if letter == "z"
            else (side_margin, side_margin)
        )
        low_reason = "The nozzle would hit the bed" if letter == "z" else end_stop_reason
        for excess, margin, bound, reason in (
            (below, margins[0], low[axis], low_reason),
            (above, margins[1], high[axis], end_stop_reason),
        ):
            message = f"{letter} is up to {{:.2f}} mm outside the limit of {bound:g} mm"
            is_far = moves_along & (excess > margin + _ROUNDING)
            yield _CheckResult("box", is_far, excess, message, reason, is_error=True)
            is_near = moves_along & (excess > _ROUNDING) & ~is_far
            yield _CheckResult(
                "box",
                is_near,
                excess,
                message,
                "Most printers reach this far, some stop at the limit",
                is_error=False,
            )


def _axis_speeds(moves: Moves) -> tuple[Float, Float]:
    """Return the requested speed, mm/s, and share of the move's length, of each axis and move (4, K)."""
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    axis_share = np.array([x, y, z, e]) / np.where(length > 0, length, 1.0)
    return axis_share * moves.speed, axis_share


def _check_speeds(
    profile: Profile, speed: Float, axis_share: Float, speed_limits: Float
) -> Iterator[_CheckResult]:
    """Find axis speeds above the maximum of the profile."""
    limited = "The firmware limits this speed"
    for axis, letter in enumerate("xyze"):
        maximum = limits_of(profile.printer).max_speed[axis]
        requested = speed[axis]
        reached = np.minimum(requested, speed_limits[axis])
        if letter in "xy":
            far = (requested > maximum * _MAX_SPEED_RATIO) | (
                (reached > maximum * 1.001) & (speed_limits[axis] > maximum * 1.001)
            )
        else:
            far = reached > maximum * _MAX_SPEED_RATIO_ZE
        name = "the extruder" if letter == "e" else letter
        message = f"{name} moves at {{:.3g}} mm/s, the maximum of the profile is {maximum:g} mm/s"
        yield _CheckResult("feed", far, requested, message, "The motors may lose steps", is_error=True)
        slower = (requested > maximum * 1.001) & ~far & (axis_share[axis] > 0)
        yield _CheckResult("feed", slower, requested, message, limited, is_error=False)


def _check_flow(
    moves: Moves, new_filament: Float, seconds: Float, profile: Profile
) -> Iterator[_CheckResult]:
    """Find moves whose flow exceeds the maximum of the material, including extrusion at standstill."""
    volume = new_filament * profile.material.filament_area
    extruding = (moves.delta[:, :2] != 0).any(axis=1) & (volume > 0)
    standing = ~extruding & (volume >= FLOW_WINDOW) & (seconds > 0)
    flow = np.zeros(len(volume))
    flow[extruding] = compute_volumetric_flow(volume[extruding], seconds[extruding])
    flow[standing] = volume[standing] / seconds[standing]
    maximum = profile.max_flow
    message = f"flow {{:.3g}} mm³/s, {profile.material.name} allows {maximum:g} mm³/s"
    far = extruding & (flow > maximum * SHORT_TERM_FLOW)
    yield _CheckResult(
        "flow", far, flow, message, "The extruder slips, and too little material comes out", is_error=True
    )
    more = ~far & (flow > maximum * 1.01)
    yield _CheckResult(
        "flow", more, flow, message, "The excess is small, or the nozzle only primes", is_error=False
    )


def _min_durations(moves: Moves, speed_ratio: Float) -> Float:
    """Return the shortest duration (K,), s, of each move within the speed limits of the axes.

    Args:
        moves: the moves.
        speed_ratio: (4, K) requested speed of each axis divided by its limit.
    """
    slowdown = np.maximum(1.0, speed_ratio.max(axis=0))
    x, y, z, e = np.abs(moves.delta.T)
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length > 1e-6, length, e)
    return np.asarray(length / np.maximum(moves.speed, 1e-9) * slowdown)
