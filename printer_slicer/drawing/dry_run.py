"""Draw a dry run: the printed plate, time and flow of each layer, set points over time, and the faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.drawing.canvas import (
    Box,
    Fill,
    Line,
    Picture,
    Shape,
    Strokes,
    Text,
    estimate_text_width,
    fit_text,
    wrap_text,
)
from printer_slicer.drawing.frame import Panel, choose_axis_marks
from printer_slicer.inspection.deposition.height_map import PlateHeights
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.inspection.deposition.timeline import Timeline
from printer_slicer.inspection.dry_run.set_points import SetPoints

__all__ = ["FaultMark", "draw_dry_run"]

_SHADES: Final = ("#d5e5f2", "#b0cfe6", "#86b4d6", "#5e98c4", "#3c7baf", "#215f94", "#0d4577")
_BAR, _FLOW, _SPEED, _FAN, _NOZZLE, _BED = "#4f8ac0", "#8a6bb1", "#4f8ac0", "#009e73", "#d55e00", "#cc79a7"
_WRONG, _INK, _PALE, _GRID, _PAPER = "#c0392b", "#222222", "#dddddd", "#eeeeee", "#ffffff"
_WIDE: Final = 960  # px
_SIZE: Final = 11.0  # px
_TITLE: Final = 15.0  # px
_ROW: Final = 16.0  # px, of a line of the faults
_MAX_FAULTS: Final = 8  # faults that are listed
_MAX_CELLS: Final = 260  # cells along a side of the drawn plate
_PART_RATIO: Final = 2.0  # times the first layer height; skirts, brims and priming lines are lower
_MARGIN: Final = 0.08  # share of the part's size, around the part
_MIN_MARGIN: Final = 2.0  # mm
_PLATE: Final = Panel(30, 420, 50, 440)
_TIME_CHART, _FLOW_CHART = Panel(490, 700, 50, 440), Panel(730, 930, 50, 440)
_INSET: Final = Panel(30, 170, 500, 640)
_TIME_CHARTS: Final = (Panel(230, 930, 500, 575), Panel(230, 930, 605, 660), Panel(230, 930, 690, 765))
_FOOT: Final = 805.0  # px, y at which the list of faults begins


class _Bed(NamedTuple):
    """A rectangle of the bed seen from above, drawn in the middle of a panel."""

    panel: Panel
    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def scale(self) -> float:
        """Scale, px per mm."""
        wide, deep = self.high[0] - self.low[0], self.high[1] - self.low[1]
        return min(self.panel.width / wide, self.panel.height / deep)

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """Convert a position on the bed, mm, to a position in the picture, px."""
        middle = (self.panel.left + self.panel.right) / 2, (self.panel.top + self.panel.bottom) / 2
        return (
            middle[0] + (x - (self.low[0] + self.high[0]) / 2) * self.scale,
            middle[1] - (y - (self.low[1] + self.high[1]) / 2) * self.scale,
        )

    def box(self) -> tuple[float, float, float, float]:
        """Return left, upper, width and height of the rectangle in the picture, px."""
        left, upper = self.to_pixels(self.low[0], self.high[1])
        return (
            left,
            upper,
            (self.high[0] - self.low[0]) * self.scale,
            (self.high[1] - self.low[1]) * self.scale,
        )

    def clamp_to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """Convert a position on the bed to px; positions outside the rectangle are moved to its border."""
        return self.to_pixels(min(max(x, self.low[0]), self.high[0]), min(max(y, self.low[1]), self.high[1]))


class _Chart(NamedTuple):
    """A chart of one value per layer, with an optional limit."""

    panel: Panel
    name: str
    colour: str
    values: Sequence[float]
    limit: float = 0.0
    limit_name: str = ""


class FaultMark(NamedTuple):
    """A fault to show: its text, and its z and its position on the plate, mm; None if unknown."""

    text: str
    z: float | None
    place: tuple[float, float] | None


def draw_dry_run(
    deposition: Deposition,
    set_points: SetPoints,
    found: Sequence[FaultMark],
    *,
    title: str,
    corners: tuple[tuple[float, float], tuple[float, float]],
    max_flow: float,
) -> Picture:
    """Draw the result of a dry run.

    Args:
        deposition: the extruded material.
        set_points: fan speed and temperatures.
        found: the faults.
        title: of the picture.
        corners: of the bed, mm.
        max_flow: mm³/s that the material allows.
    """
    whole = _Bed(_PLATE, *corners)
    part = _find_part_box(deposition)
    bed = _Bed(_PLATE, *part) if part else whole
    layers = sorted((layer for layer in deposition.layers if layer.number), key=lambda layer: layer.z)
    top = max((layer.z for layer in layers), default=1.0) or 1.0
    time = _Chart(_TIME_CHART, "s per layer", _BAR, [layer.seconds for layer in layers])
    flows = [layer.peak_flow for layer in layers]
    flow = _Chart(_FLOW_CHART, "peak flow, mm³/s", _FLOW, flows, max_flow, "limit")
    inset = _Bed(_INSET, *corners) if part else None
    colour = _WRONG if found else _INK
    shapes: list[Shape] = [
        Text(30, 28, fit_text(title, _TITLE, _WIDE - 70), _TITLE, colour, bold=True),
        *_draw_plate(deposition.plate, bed, "#ffffff" if part else "#f7f7f7"),
        *(_draw_inset(deposition.plate, inset, bed) if inset else ()),
        Text(_PLATE.left, _PLATE.bottom + 16, "plate from above; darker is higher", _SIZE),
        *_draw_z_axis(time.panel, top),
        *_draw_bars(time, top, layers),
        *_draw_bars(flow, top, layers),
        *_draw_time_charts(deposition.timeline, set_points),
        *_draw_fault_lines(found[:_MAX_FAULTS], (time.panel, flow.panel), top),
    ]
    for number, mark in enumerate(found[:_MAX_FAULTS], 1):
        shapes += _mark_fault(number, mark, [bed, *([inset] if inset else [])])
    texts, bottom = _list_faults(found)
    return Picture(_WIDE, int(bottom + 4), (*shapes, *texts), title)


# The plate


def _find_part_box(deposition: Deposition) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return two corners of a square around the part, mm, without skirt and priming; None if there is no part."""
    plate = deposition.plate
    if not plate.top.size:
        return None
    first = min((layer.z for layer in deposition.layers if layer.number and layer.length), default=0.0)
    tall = plate.top > _PART_RATIO * first
    if not tall.any():
        tall = plate.top > 0
    rows, columns = (np.flatnonzero(tall.any(axis=axis)) for axis in (1, 0))
    low = np.array([plate.left + columns[0] * plate.cell, plate.front + rows[0] * plate.cell])
    high = np.array([plate.left + (columns[-1] + 1) * plate.cell, plate.front + (rows[-1] + 1) * plate.cell])
    margin = max(float((high - low).max()) * _MARGIN, _MIN_MARGIN)
    (x0, y0), (x1, y1) = (low - margin).tolist(), (high + margin).tolist()
    # Extend it to a square, so that it fills the panel.
    more = (x1 - x0 - y1 + y0) / 2
    return (x0 + min(more, 0), y0 - max(more, 0)), (x1 - min(more, 0), y1 + max(more, 0))


def _draw_plate(plate: PlateHeights, bed: _Bed, paper: str) -> Iterator[Shape]:
    """Draw the bed from above, with the height of the printed material as shades."""
    yield Box(*bed.box(), paper, _PALE, "bed")
    part = _crop_plate(plate, bed)
    if not part.top.size:
        return
    steps = np.minimum(part.top / plate.top.max() * len(_SHADES), len(_SHADES) - 1).astype(np.int64)
    shade = np.where(part.top > 0, steps, -1)
    corner = bed.to_pixels(part.left, part.front)
    for index, colour in enumerate(_SHADES):
        rings = tuple(_find_cell_rectangles(shade == index, part.cell * bed.scale, *corner))
        if rings:
            yield Fill(rings, colour, f"plastic {index}")


def _crop_plate(plate: PlateHeights, bed: _Bed) -> PlateHeights:
    """Crop the plate to a view, and merge cells that are smaller than needed."""
    if not plate.top.size:
        return plate
    n_rows, n_columns = plate.top.shape
    first, last = (
        np.clip(np.rint((np.array(corner) - (plate.left, plate.front)) / plate.cell), 0, (n_columns, n_rows))
        .astype(int)
        .tolist()
        for corner in (bed.low, bed.high)
    )
    top = plate.top[first[1] : last[1], first[0] : last[0]]
    if not top.size:
        return PlateHeights(np.zeros((0, 0)), plate.left, plate.front, plate.cell)
    by = int(max(np.ceil(max(top.shape) / _MAX_CELLS), 1))
    top = np.pad(top, ((0, -top.shape[0] % by), (0, -top.shape[1] % by)))
    coarse = top.reshape(top.shape[0] // by, by, top.shape[1] // by, by).max(axis=(1, 3))
    left, front = plate.left + first[0] * plate.cell, plate.front + first[1] * plate.cell
    return PlateHeights(coarse, left, front, plate.cell * by)


def _find_cell_rectangles(cells: Bool, cell: float, x0: float, y0: float) -> Iterator[Float]:
    """Yield rectangles, px, around the runs of cells in each row."""
    steps = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, begins = np.nonzero(steps == 1)
    _, ends = np.nonzero(steps == -1)
    for row, begin, end in zip(rows.tolist(), begins.tolist(), ends.tolist(), strict=True):
        low, high = y0 - row * cell, y0 - (row + 1) * cell
        left, right = x0 + begin * cell, x0 + end * cell
        yield np.array([(left, low), (right, low), (right, high), (left, high)])


def _draw_inset(plate: PlateHeights, inset: _Bed, bed: _Bed) -> Iterator[Shape]:
    """Draw the whole bed in a small panel, with a frame around the area that the large view shows."""
    yield from _draw_plate(plate, inset, "#f7f7f7")
    corners = [
        inset.clamp_to_pixels(x, y)
        for x, y in (bed.low, (bed.high[0], bed.low[1]), bed.high, (bed.low[0], bed.high[1]))
    ]
    yield Line(np.array([*corners, corners[0]]), _INK, 1.0, name="view")
    wide, deep = inset.high[0] - inset.low[0], inset.high[1] - inset.low[1]
    text = fit_text(f"bed, {wide:g} x {deep:g} mm", _SIZE, inset.panel.width + 20)
    yield Text(inset.panel.left, inset.panel.bottom + 16, text, _SIZE)


# Charts over z


def _draw_z_axis(panel: Panel, top: float) -> Iterator[Shape]:
    """Draw the z axis of the charts."""
    for z in choose_axis_marks(top, 8).tolist():
        y = panel.bottom - z / top * panel.height
        yield Text(panel.left - 6, y + 4, f"{z:g}", _SIZE, anchor="end")
        yield Line(np.array([(panel.left - 3, y), (panel.left, y)]), _INK)
    yield Text(panel.left - 6, panel.top - 14, "z mm", _SIZE, anchor="end")


def _draw_bars(chart: _Chart, top: float, layers: Sequence[LayerDeposition]) -> Iterator[Shape]:
    """Draw a bar for each layer over z."""
    panel, limit = chart.panel, chart.limit
    most = max(*chart.values, limit, 1e-9) if chart.values else 1.0
    yield Box(panel.left, panel.top, panel.width, panel.height, _PAPER, _PALE)
    for value in choose_axis_marks(most, 4).tolist():
        x = panel.left + value / most * panel.width
        yield Line(np.array([(x, panel.top), (x, panel.bottom)]), _GRID)
        yield Text(x, panel.bottom + 16, f"{value:g}", _SIZE, anchor="middle")
    yield Text(panel.left, panel.top - 8, chart.name, _SIZE)
    bottom = 0.0
    for layer, value in zip(layers, chart.values, strict=True):
        low, high = (panel.bottom - z / top * panel.height for z in (bottom, layer.z))
        bottom = layer.z
        if low - high > 0 and value > 0:
            yield Box(panel.left, high, value / most * panel.width, low - high, chart.colour)
    if limit:
        x = panel.left + limit / most * panel.width
        yield Line(np.array([(x, panel.top), (x, panel.bottom)]), _WRONG, 1.5, (5, 3), name="limit")
        label = f"{chart.limit_name} {limit:g}"
        x = max(
            x, panel.left + estimate_text_width(chart.name, _SIZE) + 8 + estimate_text_width(label, _SIZE)
        )
        yield Text(x, panel.top - 8, label, _SIZE, _WRONG, anchor="end")


# Charts over time


def _draw_time_charts(timeline: Timeline, set_points: SetPoints) -> Iterator[Shape]:
    """Draw speed, fan speed and target temperatures over the time in motion."""
    total = timeline.seconds or 1.0
    speed, fan, heat = _TIME_CHARTS
    samples = np.repeat(np.arange(len(timeline.speed) + 1) * timeline.step, 2)[1:-1]
    time = (
        timeline.time_of(set_points.command) if len(timeline.command) else np.zeros(len(set_points.command))
    )
    yield from _draw_axes(speed, "mean speed, mm/s", timeline.speed)
    yield from _draw_curve(speed, samples, np.repeat(timeline.speed, 2), (total, timeline.speed), _SPEED)
    yield from _draw_axes(fan, "fan, %", np.array([100.0]))
    yield from _draw_steps(fan, time, set_points.fan, (total, np.array([100.0])), _FAN)
    both = np.concatenate([set_points.nozzle, set_points.bed])
    yield from _draw_axes(heat, "target temperature, °C", both)
    yield from _draw_steps(heat, time, set_points.nozzle, (total, both), _NOZZLE)
    yield from _draw_steps(heat, time, set_points.bed, (total, both), _BED)
    for name, colour, right in (("nozzle", _NOZZLE, 40.0), ("bed", _BED, 0.0)):
        yield Text(heat.right - right, heat.top - 8, name, _SIZE, colour, anchor="end")
    unit, per = ("h", 3600.0) if total > 3 * 3600 else ("min", 60.0) if total > 180 else ("s", 1.0)
    for mark in choose_axis_marks(total / per, 8).tolist():
        x = heat.left + mark * per / total * heat.width
        yield Text(x, heat.bottom + 16, f"{mark:g}", _SIZE, anchor="middle" if x < heat.right - 30 else "end")
    yield Text(heat.left - 6, heat.bottom + 16, unit, _SIZE, anchor="end")


def _draw_axes(panel: Panel, name: str, values: Float) -> Iterator[Shape]:
    """Draw the frame of a chart over time, with the name of the chart, and with numbers at the left."""
    yield Box(panel.left, panel.top, panel.width, panel.height, _PAPER, _PALE)
    yield Text(panel.left, panel.top - 8, name, _SIZE)
    most = _choose_axis_end(values)
    for value in choose_axis_marks(most, 3).tolist():
        y = panel.bottom - value / most * panel.height
        yield Line(np.array([(panel.left, y), (panel.right, y)]), _GRID)
        yield Text(panel.left - 6, y + 4, f"{value:g}", _SIZE, anchor="end")


def _choose_axis_end(values: Float) -> float:
    """Return the largest value of an axis that shows all values."""
    return max(float(values.max(initial=0.0)) * 1.05, 1.0)


def _draw_steps(
    panel: Panel, time: Float, values: Float, scale: tuple[float, Float], colour: str
) -> Iterator[Shape]:
    """Draw values (m,) that change at the times `time` (m,), s, and are constant in between.

    `scale` is the total time and all values that share the axis.
    """
    ends = np.append(time[1:], scale[0])
    yield from _draw_curve(panel, np.stack([time, ends], axis=1).ravel(), np.repeat(values, 2), scale, colour)


def _draw_curve(
    panel: Panel, time: Float, values: Float, scale: tuple[float, Float], colour: str
) -> Iterator[Shape]:
    """Draw values (n,) over times (n,), s; `scale` is the total time and all values that share the axis."""
    if not len(time):
        return
    x = panel.left + np.minimum(time / scale[0], 1.0) * panel.width
    y = panel.bottom - values / _choose_axis_end(scale[1]) * panel.height
    yield Line(np.stack([x, y], axis=1), colour, 1.4, name="curve")


# Faults


def _list_faults(found: Sequence[FaultMark]) -> tuple[list[Shape], float]:
    """Draw the list of faults under the charts; return its shapes and the y at which it ends, px."""
    shapes: list[Shape] = []
    y = _FOOT
    for number, mark in enumerate(found[:_MAX_FAULTS], 1):
        shapes.append(Text(30, y, str(number), _SIZE, _WRONG))
        for line in wrap_text(mark.text, _SIZE, _WIDE - 80):
            shapes.append(Text(46, y, line, _SIZE, _WRONG))
            y += _ROW
    if len(found) > _MAX_FAULTS:
        shapes.append(Text(30, y, f"... and {len(found) - _MAX_FAULTS} more", _SIZE, _WRONG))
        y += _ROW
    return shapes, y


def _mark_fault(number: int, mark: FaultMark, beds: Sequence[_Bed]) -> Iterator[Shape]:
    """Mark a fault on the views of the plate."""
    if mark.place is None:
        return
    for bed, size in zip(beds, (9.0, 5.0), strict=False):
        x, y = bed.clamp_to_pixels(*mark.place)
        yield Strokes((np.array([(x, y), (x, y)]),), (size,), _WRONG, "fault")
    panel, (x, y) = beds[0].panel, beds[0].clamp_to_pixels(*mark.place)
    left = x > panel.right - 20
    x, y = x + (-7 if left else 7), max(y - 5, panel.top + 12)
    yield Text(x, y, str(number), 13, _WRONG, "end" if left else "start", bold=True)


def _draw_fault_lines(found: Sequence[FaultMark], charts: Sequence[Panel], top: float) -> Iterator[Shape]:
    """Draw lines at the heights of faults across the charts over z, with their numbers at the right."""
    labels: list[tuple[float, list[int]]] = []
    known = [(mark.z, number) for number, mark in enumerate(found, 1) if mark.z is not None]
    for z, number in sorted(known):
        y = charts[0].bottom - min(z / top, 1.0) * charts[0].height
        for panel in charts:
            yield Line(np.array([(panel.left, y), (panel.right, y)]), _WRONG, 1.2, (2, 2), name="fault")
        if labels and labels[-1][0] - y < _SIZE:
            labels[-1][1].append(number)
        else:
            labels.append((y, [number]))
    for y, numbers in labels:
        text = ",".join(map(str, numbers)) if len(numbers) < 3 else f"{numbers[0]}…"
        yield Text(charts[-1].right + 4, y + 4, text, _SIZE, _WRONG, bold=True)
