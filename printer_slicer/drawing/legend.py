"""Legend of a layer plan: ranges of layer heights with their colours and layer counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.drawing.canvas import Box, Shape, Text, fit_text
from printer_slicer.drawing.frame import Panel
from printer_slicer.model import LayerPlan

__all__ = ["LEGEND_HEIGHT", "LegendRange", "divide_heights", "draw_legend"]

LEGEND_HEIGHT: Final = 37
"""Height of the legend, px."""

_MAX_STEPS: Final = 5
_SIZE, _SWATCH, _MAX_STRIPES = 18, 40, 4
_DARK: Final = "#1f2430"


class LegendRange(NamedTuple):
    """A range of layer heights.

    Attributes:
        low, high: mm, the smallest and the largest layer height in the range.
        n_layers: number of layers with a height in the range.
        layers: indices of up to four layers of different heights, as examples for the colours.
    """

    low: float
    high: float
    n_layers: int
    layers: list[int]

    @property
    def label(self) -> str:
        """Text of the legend: the number of layers and their heights."""
        heights = f"{self.low:.3g}" if self.low == self.high else f"{self.low:.3g} to {self.high:.3g}"
        return f"{self.n_layers} x {heights} mm"


def divide_heights(plan: LayerPlan) -> list[LegendRange]:
    """Divide the layer heights of a plan into at most five ranges, in ascending order."""
    heights, first, counts = np.unique(plan.height, return_index=True, return_counts=True)
    if not len(heights):
        return []
    step = np.arange(len(heights))
    if len(heights) > _MAX_STEPS:
        edges = np.linspace(heights[0], heights[-1], _MAX_STEPS + 1)[1:-1]
        step = np.searchsorted(edges, heights, side="right")
    result = []
    for number in np.unique(step).tolist():
        own = np.flatnonzero(step == number)
        shown = own[np.linspace(0, len(own) - 1, min(len(own), _MAX_STRIPES)).round().astype(int)]
        low, high = float(heights[own[0]]), float(heights[own[-1]])
        result.append(LegendRange(low, high, int(counts[own].sum()), first[shown].tolist()))
    return result


def draw_legend(plan: LayerPlan, colours: Sequence[str], panel: Panel) -> Iterator[Shape]:
    """Draw the legend: at most five ranges of layer heights in a row.

    Args:
        plan: the layers.
        colours: one per layer.
        panel: where to draw, `LEGEND_HEIGHT` px high.
    """
    steps = divide_heights(plan)
    across = panel.width / _MAX_STEPS
    for number, step in enumerate(steps):
        x, wide = panel.left + across * number, _SWATCH / len(step.layers)
        for k, layer in enumerate(step.layers):
            yield Box(x + k * wide, panel.top, wide, 24, colours[layer], name="legend")
        text = fit_text(step.label, _SIZE, across - _SWATCH - 20)
        yield Text(x + _SWATCH + 12, panel.top + 18, text, _SIZE, _DARK)
