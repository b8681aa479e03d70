"""A dry run in one picture: what stands on the plate at the end, time and flow of each layer, the faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Shape, Strokes, Text
from printer_slicer.drawing.frame import Panel, marks
from printer_slicer.inspection.deposition.height_map import PlateHeights
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition

__all__ = ["FaultMark", "rehearsal_picture"]

_SHADES: Final = ("#d5e5f2", "#b0cfe6", "#86b4d6", "#5e98c4", "#3c7baf", "#215f94", "#0d4577")
_BAR, _FLOW, _CAP, _WRONG, _INK, _PALE = "#4f8ac0", "#8a6bb1", "#c0392b", "#c0392b", "#222222", "#dddddd"
_SIZE: Final = 11.0
_ROW: Final = 18.0
_MOST: Final = 8  # faults that are shown
_WIDE: Final = 960
_LETTERS: Final = 150  # of a fault, that fit


class _Bed(NamedTuple):
    """The bed from above, in a panel: px to mm."""

    panel: Panel
    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def scale(self) -> float:
        """px to a mm."""
        wide, deep = self.high[0] - self.low[0], self.high[1] - self.low[1]
        return min(self.panel.width / wide, self.panel.height / deep)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """px, where a place on the bed is drawn."""
        return self.panel.left + (x - self.low[0]) * self.scale, self.panel.bottom - (
            y - self.low[1]
        ) * self.scale

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """The same, for a place beside the bed at its edge."""
        return self.at(
            min(max(x, self.low[0]), self.high[0]),
            min(max(y, self.low[1]), self.high[1]),
        )


class _Chart(NamedTuple):
    """A value of each layer."""

    panel: Panel
    name: str
    colour: str
    values: Sequence[float]
    cap: float = 0.0
    cap_name: str = ""


class FaultMark(NamedTuple):
    """A fault to be shown: its sentence, its height and place on the plate, mm, where they are known."""

    text: str
    z: float | None
    place: tuple[float, float] | None


def rehearsal_picture(
    account: Deposition,
    found: Sequence[FaultMark],
    title: str,
    corners: tuple[tuple[float, float], tuple[float, float]],
    max_flow: float,
) -> Picture:
    """What a dry run came to.

    Args:
        account: of the material.
        found: what would go wrong.
        title: over it.
        corners: of the bed, mm.
        max_flow: mm³/s that the material melts.
    """
    shown = found[:_MOST]
    bed = _Bed(Panel(30, 420, 50, 440), *corners)
    layers = sorted((layer for layer in account.layers if layer.number), key=lambda layer: layer.z)
    top = max((layer.z for layer in layers), default=1.0) or 1.0
    time = _Chart(Panel(490, 700, 50, 440), "s per layer", _BAR, [layer.seconds for layer in layers])
    flows = [layer.peak_flow for layer in layers]
    flow = _Chart(Panel(730, 940, 50, 440), "mm³/s at most", _FLOW, flows, max_flow, "melts")
    shapes: list[Shape] = [
        Text(30, 28, title, 15, _WRONG if found else _INK, bold=True),
        *_plate(account.plate, bed),
        *_heights(time.panel, top),
        *_bars(time, top, layers),
        *_bars(flow, top, layers),
    ]
    foot = bed.panel.bottom + 22
    for number, mark in enumerate(shown, 1):
        shapes += _marked(number, mark, bed, (time.panel, flow.panel), top)
        shapes.append(Text(30, foot + number * _ROW, f"{number}  {mark.text[:_LETTERS]}", _SIZE, _WRONG))
    if len(found) > _MOST:
        more = f"... and {len(found) - _MOST} more"
        shapes.append(Text(30, foot + (_MOST + 1) * _ROW, more, _SIZE, _WRONG))
    rows = len(shown) + (len(found) > _MOST)
    return Picture(_WIDE, int(foot + 23 + rows * _ROW), tuple(shapes), title)


def _plate(plate: PlateHeights, bed: _Bed) -> Iterator[Shape]:
    """The bed from above, and how high plastic stands on it."""
    scale, (left, upper) = bed.scale, bed.at(bed.low[0], bed.high[1])
    wide, deep = bed.high[0] - bed.low[0], bed.high[1] - bed.low[1]
    yield Box(left, upper, wide * scale, deep * scale, "#f7f7f7", _PALE, "bed")
    top = plate.top
    if top.size:
        steps = np.minimum(top / top.max() * len(_SHADES), len(_SHADES) - 1).astype(np.int64)
        shade = np.where(top > 0, steps, -1)
        corner = bed.at(plate.left, plate.front)
        for index, colour in enumerate(_SHADES):
            rings = tuple(_runs(shade == index, plate.cell * scale, *corner))
            if rings:
                yield Fill(rings, colour, f"plastic {index}")
    yield Text(bed.panel.left, bed.panel.bottom + 16, "the plate from above, darker is higher", _SIZE)


def _runs(cells: Float, cell: float, x0: float, y0: float) -> Iterator[Float]:
    """Rectangles, px, of cells that follow each other in their rows."""
    steps = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, begins = np.nonzero(steps == 1)
    _, ends = np.nonzero(steps == -1)
    for row, begin, end in zip(rows.tolist(), begins.tolist(), ends.tolist(), strict=True):
        low, high = y0 - row * cell, y0 - (row + 1) * cell
        left, right = x0 + begin * cell, x0 + end * cell
        yield np.array([(left, low), (right, low), (right, high), (left, high)])


def _heights(panel: Panel, top: float) -> Iterator[Shape]:
    """The axis of z."""
    for z in marks(top, 8).tolist():
        y = panel.bottom - z / top * panel.height
        yield Text(panel.left - 6, y + 4, f"{z:g}", _SIZE, anchor="end")
        yield Line(np.array([(panel.left - 3, y), (panel.left, y)]), _INK)
    yield Text(panel.left - 6, panel.top - 14, "z mm", _SIZE, anchor="end")


def _bars(chart: _Chart, top: float, layers: Sequence[LayerDeposition]) -> Iterator[Shape]:
    """A value of each layer, over the height."""
    panel, cap = chart.panel, chart.cap
    most = max(*chart.values, cap, 1e-9) if chart.values else 1.0
    yield Box(panel.left, panel.top, panel.width, panel.height, "#ffffff", _PALE)
    for value in marks(most, 4).tolist():
        x = panel.left + value / most * panel.width
        yield Line(np.array([(x, panel.top), (x, panel.bottom)]), "#eeeeee")
        yield Text(x, panel.bottom + 16, f"{value:g}", _SIZE, anchor="middle")
    yield Text(panel.left, panel.top - 8, chart.name, _SIZE)
    bottom = 0.0
    for layer, value in zip(layers, chart.values, strict=True):
        low, high = (panel.bottom - z / top * panel.height for z in (bottom, layer.z))
        bottom = layer.z
        if low - high > 0 and value > 0:
            yield Box(panel.left, high, value / most * panel.width, low - high, chart.colour)
    if cap:
        x = panel.left + cap / most * panel.width
        yield Line(np.array([(x, panel.top), (x, panel.bottom)]), _CAP, 1.5, (5, 3), name="cap")
        yield Text(x, panel.top - 8, f"{chart.cap_name} {cap:g}", _SIZE, _CAP, anchor="end")


def _marked(number: int, mark: FaultMark, bed: _Bed, charts: Sequence[Panel], top: float) -> Iterator[Shape]:
    """A fault on the plate and over the height."""
    if mark.place is not None:
        x, y = bed.nearest(*mark.place)
        yield Strokes((np.array([(x, y), (x, y)]),), (9.0,), _WRONG, "fault")
        yield Text(x + 7, y - 5, str(number), 13, _WRONG, bold=True)
    if mark.z is not None:
        y = charts[0].bottom - min(mark.z / top, 1.0) * charts[0].height
        for panel in charts:
            yield Line(np.array([(panel.left, y), (panel.right, y)]), _WRONG, 1.2, (2, 2), name="fault")
        yield Text(charts[-1].right + 4, y + 4, str(number), 12, _WRONG, bold=True)
