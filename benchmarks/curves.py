"""Rows of a comparison, their curve of deviation against minutes, and its picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from benchmarks.scoring import Score
from printer_slicer.arrays import Float
from printer_slicer.model import LayerPlan

__all__ = ["Frontier", "Row", "draw"]


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One plan and its scores.

    Attributes:
        family: the planner or peer; a line of the picture.
        setting: its settings.
        plan: the layers, extended to the top where a tip is too thin for an extrusion.
        score: with our toolpaths.
        ours: whether a planner of this project made it.
        own_minutes: minutes of the slicer's own G-code.
        prusa_minutes: minutes of PrusaSlicer's G-code with this plan; None if it did not slice it.
        cpu: CPU time of planning, s; None for peers, whose planning cannot be timed separately.
        strayed: largest height error of PrusaSlicer when it printed our layers, mm; None if it did not slice the plan.
        dropped: number of our layers that PrusaSlicer left empty; None if it did not slice the plan.
    """

    family: str
    setting: str
    plan: LayerPlan
    score: Score
    ours: bool
    own_minutes: float
    prusa_minutes: float | None = None
    cpu: float | None = None
    strayed: float | None = None
    dropped: int | None = None


Minutes = Callable[[Row], float | None]
"""Returns the minutes of a row that count."""


class Frontier:
    """The best results of some plans: least deviation for a number of minutes, interpolated linearly.

    Args:
        rows: the plans.
        minutes: returns the minutes that count; rows without them are left out.
    """

    def __init__(self, rows: Sequence[Row], minutes: Minutes) -> None:
        known = ((minutes(row), row.score.mean) for row in rows)
        points = sorted((time, mean) for time, mean in known if time is not None)
        best: list[tuple[float, float]] = []
        for time, mean in points:
            if not best or mean < best[-1][1]:
                best.append((time, mean))
        self._time = np.array([time for time, _ in best])
        self._mean = np.array([mean for _, mean in best])

    def mean_at(self, minutes: float) -> float | None:
        """Return the deviation, mm, within a number of minutes; None if no plan is as fast."""
        if not len(self._time) or minutes < self._time[0]:
            return None
        return float(np.interp(minutes, self._time, self._mean))

    def minutes_at(self, mean: float) -> float | None:
        """Return the minutes for a deviation, mm, of at most `mean`; None if no plan is as accurate."""
        if not len(self._time) or mean < self._mean[-1]:
            return None
        return float(np.interp(-mean, -self._mean, self._time))


# Drawing

_WIDTH, _HEIGHT, _LEFT, _TOP, _GAP = 460, 360, 60, 60, 70
_LEGEND = 190
_COLOURS = (
    *(
        "#0072b2",
        "#d55e00",
        "#56b4e9",
        "#e69f00",
        "#aaaaaa",
        "#8c564b",
        "#999933",
        "#cc79a7",
        "#88ccee",
        "#ddcc77",
    ),
    *("#882255", "#555555", "#009e73", "#000000", "#44aa99", "#117733"),
)
_FONT = 'font-family="sans-serif"'


def draw(title: str, rows: Sequence[Row], panels: Sequence[tuple[str, Minutes]]) -> str:
    """Draw deviation against minutes as SVG: a panel for each way to count minutes, a line for each family."""
    families = {row.family: row.ours for row in rows}
    width = _LEFT + len(panels) * (_WIDTH + _GAP) + _LEGEND
    height = _TOP + _HEIGHT + 60
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        _text(_LEFT, 24, title, 16),
    ]
    for i, (name, minutes) in enumerate(panels):
        parts += _draw_panel(_LEFT + i * (_WIDTH + _GAP), name, rows, minutes)
    left = width - _LEGEND
    for i, (family, ours) in enumerate(families.items()):
        y = _TOP + 10 + 20 * i
        parts += [_draw_marker(left, y, i, ours=ours), _text(left + 12, y + 4, family, 11)]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _draw_panel(left: float, name: str, rows: Sequence[Row], minutes: Minutes) -> list[str]:
    """Draw one chart; the scale of the deviation is logarithmic, because ratios are compared."""
    known = [(time, 1e3 * row.score.mean, row) for row in rows if (time := minutes(row)) is not None]
    if not known:
        return []
    times = np.array([time for time, _, _ in known])
    means = np.maximum(np.array([mean for _, mean, _ in known]), 1e-3)
    x_low, x_high = float(times.min()) * 0.97, float(times.max()) * 1.03
    y_low, y_high = float(np.log(means.min())) - 0.1, float(np.log(means.max())) + 0.1

    def place(time: float, mean: float) -> tuple[float, float]:
        x = left + _WIDTH * (time - x_low) / (x_high - x_low)
        return x, _TOP + _HEIGHT * (y_high - float(np.log(max(mean, 1e-3)))) / (y_high - y_low)

    parts = _draw_axes(left, name, (x_low, x_high), (float(np.exp(y_low)), float(np.exp(y_high))), place)
    for i, family in enumerate(dict.fromkeys(row.family for row in rows)):
        points = sorted(
            (time, mean, row.setting, row.ours) for time, mean, row in known if row.family == family
        )
        where = [(*place(time, mean), setting, ours) for time, mean, setting, ours in points]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y, _, _ in where)
        colour = _COLOURS[i % len(_COLOURS)]
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.2"/>')
        parts += [_draw_marker(x, y, i, f"{family}, {setting}", ours=ours) for x, y, setting, ours in where]
    return parts


def _draw_axes(
    left: float,
    name: str,
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    place: Callable[[float, float], tuple[float, float]],
) -> list[str]:
    bottom = _TOP + _HEIGHT
    parts = [
        f'<rect x="{left}" y="{_TOP}" width="{_WIDTH}" height="{_HEIGHT}" fill="none" stroke="#888888"/>',
        _text(left, _TOP - 8, name, 12),
        _text(left + _WIDTH / 2 - 25, bottom + 38, "minutes", 12),
        _text(left - 52, _TOP - 8, "µm", 12),
    ]
    for value in _ticks(*x_range):
        x, _ = place(value, y_range[0])
        parts.append(f'<path d="M{x:.1f} {_TOP}V{bottom}" stroke="#e5e5e5"/>')
        parts.append(_text(x - 8, bottom + 18, f"{value:g}", 11))
    for value in _log_ticks(*y_range):
        _, y = place(x_range[0], value)
        parts.append(f'<path d="M{left} {y:.1f}H{left + _WIDTH}" stroke="#e5e5e5"/>')
        parts.append(_text(left - 34, y + 4, f"{value:g}", 11))
    return parts


def _ticks(low: float, high: float) -> Float:
    step = 10.0 ** np.floor(np.log10((high - low) / 4))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (step * factor) <= 8)
    return np.asarray(np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step, np.float64)


def _log_ticks(low: float, high: float) -> list[float]:
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    factors = (1, 1.5, 2, 3, 4, 5, 7) if high / low < 30 else (1, 2, 5)
    return [
        factor * 10.0**power for power in powers for factor in factors if low <= factor * 10.0**power <= high
    ]


def _draw_marker(x: float, y: float, family: int, title: str = "", *, ours: bool) -> str:
    """Draw a circle for one of our plans, a square for a peer's; the title appears when pointed at."""
    colour, said = _COLOURS[family % len(_COLOURS)], f"<title>{escape(title)}</title>"
    if ours:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="{colour}">{said}</circle>'
    return f'<rect x="{x - 3.5:.1f}" y="{y - 3.5:.1f}" width="7" height="7" fill="{colour}">{said}</rect>'


def _text(x: float, y: float, text: str, size: int) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" {_FONT} font-size="{size}">{escape(text)}</text>'
