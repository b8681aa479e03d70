"""Find the point of a move that is nearest to a position, and build the rest of a move from there."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin, sqrt

from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing.machine_state import Step, format_number
from printer_slicer.values import replace

__all__ = ["build_remaining_move", "find_nearest_move", "interpolate_state"]

_MOVES = find_codes(Effect.MOVES)
_ARCS = find_codes(Effect.ARC)
_CHORDS = 64  # number of chords that replace an arc in the search for its nearest point
PositionWithE = tuple[float, float, float, float]


def _find_endpoints(step: Step) -> tuple[PositionWithE, PositionWithE]:
    """Return the start and end position of a move."""
    x0, y0, z0 = step.before.place
    x1, y1, z1 = step.after.place
    return (x0, y0, z0, step.before.e), (x1, y1, z1, step.after.e)


def _find_arc_centre(step: Step) -> tuple[float, float, float] | None:
    """Return the centre (x, y) of an arc, mm, and its signed angle, rad; None for a straight move."""
    word, values = parse(step.command)
    if word not in _ARCS:
        return None
    unit = step.before.unit
    (x0, y0, *_), (x1, y1, *_) = _find_endpoints(step)
    if b"R" in values:
        x, y = (x1 - x0) / 2, (y1 - y0) / 2
        half = hypot(x, y)
        radius = values[b"R"] * unit
        distance_ratio = sqrt(max(radius * radius - half * half, 0.0)) / (half or 1.0)
        side = -1.0 if (word == b"G2") == (radius > 0) else 1.0
        cx, cy = x0 + x - side * y * distance_ratio, y0 + y + side * x * distance_ratio
    else:
        cx, cy = x0 + values.get(b"I", 0.0) * unit, y0 + values.get(b"J", 0.0) * unit
    angle = (atan2(y1 - cy, x1 - cx) - atan2(y0 - cy, x0 - cx)) % (2 * pi)
    angle = angle or 2 * pi
    return cx, cy, angle if word == b"G3" else angle - 2 * pi if angle < 2 * pi else -2 * pi


def _interpolate_position(step: Step, fraction: float) -> PositionWithE:
    """Return the position after the given fraction of a move."""
    start, end = _find_endpoints(step)
    x, y, z, e = (a + fraction * (b - a) for a, b in zip(start, end, strict=True))
    arc = _find_arc_centre(step)
    if arc is not None:
        cx, cy, turn = arc
        radius = hypot(start[0] - cx, start[1] - cy)
        angle = atan2(start[1] - cy, start[0] - cx) + fraction * turn
        x, y = cx + radius * cos(angle), cy + radius * sin(angle)
    return x, y, z, e


def _project_on_segment(a: PositionWithE, b: PositionWithE, point: PositionWithE) -> tuple[float, float]:
    """Return the fraction of segment a-b at which it is nearest to `point`, and the squared distance."""
    along = [q - p for p, q in zip(a, b, strict=True)]
    length = sum(d * d for d in along)
    fraction = sum(d * (q - p) for d, p, q in zip(along, a, point, strict=True)) / length if length else 1.0
    fraction = min(max(fraction, 0.0), 1.0)
    return fraction, sum((p + fraction * d - q) ** 2 for p, d, q in zip(a, along, point, strict=True))


def _find_nearest_fraction(step: Step, point: PositionWithE) -> tuple[float, float]:
    """Return the fraction of a move at which it is nearest to `point`, and the squared distance."""
    if _find_arc_centre(step) is None:
        return _project_on_segment(*_find_endpoints(step), point)
    best = (0.0, float("inf"))
    for chord in range(_CHORDS):
        fraction, off = _project_on_segment(
            _interpolate_position(step, chord / _CHORDS),
            _interpolate_position(step, (chord + 1) / _CHORDS),
            point,
        )
        if off < best[1]:
            best = (chord + fraction) / _CHORDS, off
    return best


def find_nearest_move(steps: Sequence[Step], point: PositionWithE) -> tuple[int, float, float]:
    """Find the move nearest to a position.

    Returns:
        Index of the move, fraction of the move at its nearest point, and distance, mm.
    """
    found = [
        (off, -index, fraction)
        for index, step in enumerate(steps)
        for fraction, off in [_find_nearest_fraction(step, point)]
    ]
    least = min(off for off, _, _ in found)
    # Consecutive moves share a point; take the later one, at its start.
    _, index, fraction = min((one for one in found if one[0] <= least + 1e-9), key=lambda one: one[1])
    return -index, fraction, sqrt(least)


def interpolate_state(step: Step, fraction: float) -> ModalState:
    """Return the machine state after the given fraction of a move."""
    x, y, z, e = _interpolate_position(step, fraction)
    pulled = max(step.before.pulled - (e - step.before.e), 0.0)
    return replace(
        step.before,
        pulled=pulled,
        x=round(x, 4),
        y=round(y, 4),
        z=round(z, 4),
        e=round(e, 5),
        speed=step.after.speed,
    )


def build_remaining_move(step: Step, fraction: float) -> bytes:
    """Return the command for the rest of a move after the given fraction, in the unit of the program."""
    here, after = interpolate_state(step, fraction), step.after
    word = parse(step.command)[0]
    words = [word if word in _MOVES else b"G1"]  # not G53, whose coordinates are those of the machine

    def format_word(letter: bytes, mm: float) -> bytes:
        """Format a length as a G-code word in the unit of the program."""
        return letter + format_number(mm / here.unit)

    at = here.place
    for letter, goal, now in zip((b"X", b"Y", b"Z"), after.place, at, strict=True):
        if goal != now:
            words.append(format_word(letter, goal - now if here.relative else goal))
    arc = _find_arc_centre(step)
    if arc is not None:
        words += [format_word(b"I", arc[0] - at[0]), format_word(b"J", arc[1] - at[1])]
    if after.e != here.e:
        words.append(format_word(b"E", after.e - here.e if here.relative_e else after.e))
    return b" ".join([*words, format_word(b"F", after.speed * 60)] if after.speed else words)
