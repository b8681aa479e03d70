"""Which layer heights there are, and how many layers of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.drawing.canvas import Box, Shape, Text
from printer_slicer.drawing.frame import Panel
from printer_slicer.model import LayerPlan

__all__ = ["draw_legend", "legend_height"]

_MOST, _IN_A_ROW = 12, 6  # entries of one height each
_MERGED, _MERGED_IN_A_ROW = 10, 5  # entries of several heights each, where there are more
_ROW, _SIZE, _SWATCH, _STRIPES = 37, 22, 40, 4
_DARK: Final = "#1f2430"


def legend_height(plan: LayerPlan) -> float:
    """How much height the legend of a plan takes, px."""
    count = len(np.unique(plan.height))
    return _ROW * (-(-count // _IN_A_ROW) if count <= _MOST else _MERGED // _MERGED_IN_A_ROW)


def draw_legend(plan: LayerPlan, colours: Sequence[str], panel: Panel) -> Iterator[Shape]:
    """The layer heights with their colours and numbers of layers, neighbours together where there are many.

    Args:
        plan: the layers.
        colours: one per layer.
        panel: where to draw; as high as `legend_height` says.
    """
    heights, first, counts = np.unique(plan.height, return_index=True, return_counts=True)
    several = len(heights) > _MOST
    across = _MERGED_IN_A_ROW if several else _IN_A_ROW
    entries = np.array_split(np.arange(len(heights)), _MERGED if several else len(heights))
    down = -(-len(entries) // across)
    for i, entry in enumerate(entries):
        x, y = panel.left + panel.width / across * (i // down), panel.top + _ROW * (i % down)
        stripes = entry[np.linspace(0, len(entry) - 1, min(len(entry), _STRIPES)).round().astype(int)]
        wide = _SWATCH / len(stripes)
        for k, stripe in enumerate(first[stripes].tolist()):
            yield Box(x + k * wide, y, wide, 24, colours[stripe], name="legend")
        low, high = float(heights[entry[0]]), float(heights[entry[-1]])
        text = f"{low:.4g} mm" if low == high else f"{low:.4g} to {high:.4g} mm"
        yield Text(x + _SWATCH + 12, y + 20, f"{int(counts[entry].sum())} x {text}", _SIZE, _DARK)
