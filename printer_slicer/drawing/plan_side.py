"""Draw the part from the front, and the deviation and height of its layers over the same z axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.drawing.canvas import Box, Fill, Line, Shape, Text, estimate_text_width
from printer_slicer.drawing.colours import WARNING, darken, mix_colours
from printer_slicer.drawing.frame import Panel, ZAxis, choose_axis_marks
from printer_slicer.model import Areas, LayerPlan, Sections
from printer_slicer.surface import Certificate

__all__ = ["draw_deviation", "draw_front", "draw_grid", "draw_heights", "make_z_axis"]

_AXIS, _GRID, _LABEL = "#6b7280", "#e3e7eb", 22
_MIN_ROW_HEIGHT: Final = 0.8  # px; thinner layers are drawn together
_MIN_EDGED_HEIGHT: Final = 3.0  # px; layers have outlines if all are higher
_OVERLAP: Final = 0.5  # px by which layers overlap the next lower one
_MAX_PROTRUSION: Final = 12  # px by which marks may exceed the panel
_MIN_HEIGHT_SHARE: Final = 0.55  # minimum height of a drawn part, as a fraction of the tallest panels
_DARK: Final = "#1f2430"
_ERROR, _CURVE, _BEYOND = "#c5cfda", "#4a5b70", mix_colours(WARNING, "#ffffff", 0.45)


def make_z_axis(sections: Sections, width: float, tallest: float, top: float) -> tuple[ZAxis, float]:
    """Return the z axis for panels, from `top` downward, and the scale along x, px per mm.

    Both scales are the same, except for flat parts: these are stretched along z so that their layers are visible.

    Args:
        sections: the part's solid areas.
        width: px, width of the panel for the part.
        tallest: px, largest height of the panels.
        top: px, position of the top of the last layer.
    """
    total, xy = float(sections.plan.top[-1]), sections.solid.xy
    wide = float(np.ptp(xy[:, 0])) if len(xy) else 0.0
    level = min(width / max(wide, 1e-9), tallest / total)
    scale = max(level, _MIN_HEIGHT_SHARE * tallest / total)
    return ZAxis(top + scale * total, scale, total), level


def draw_grid(axis: ZAxis, panel: Panel) -> Iterator[Shape]:
    """Draw horizontal lines at round z, with their values at the left."""
    for z in choose_axis_marks(axis.total, 8).tolist():
        y = axis.y(z)
        yield Line(np.array([(panel.left, y), (panel.right, y)]), _GRID if z else _AXIS)
        yield Text(panel.left - 12, y + 0.35 * _LABEL, f"{z:g}", _LABEL, _AXIS, "end")


def draw_front(
    stacks: Sequence[tuple[Sections, Sequence[str]]], axis: ZAxis, panel: Panel, scale: float
) -> Iterator[Shape]:
    """Draw every layer of each stack as seen from the front, in its colour; nearer stacks hide others.

    Args:
        stacks: sections, and the colours of their layers.
        axis: z axis.
        panel: where to draw.
        scale: px per mm along x.
    """
    filled = [one for one in stacks if one[0].solid.n_rings]
    if not filled:
        return
    x = np.concatenate([sections.solid.xy[:, 0] for sections, _ in filled])
    low, high = float(x.min()), float(x.max())
    left = (panel.left + panel.right - scale * (high - low)) / 2
    for sections, colours in sorted(filled, key=lambda one: -float(one[0].solid.xy[:, 1].min())):
        yield from _draw_front_of_stack(sections, colours, axis, scale, left - scale * low)


def _draw_front_of_stack(
    sections: Sections, colours: Sequence[str], axis: ZAxis, scale: float, origin: float
) -> Iterator[Shape]:
    """Draw the layers of one stack; x = 0 is at `origin`, px."""
    rows = _find_visible_rows(sections.plan, axis)
    has_edges = axis.scale * float(sections.plan.height.min()) > _MIN_EDGED_HEIGHT
    # Draw from the top down; each layer overlaps the next lower one a little, so that no gap is visible.
    for k, (x0, x1) in reversed(list(_find_x_ranges(sections.solid))):
        if k not in rows:
            continue
        top, bottom = rows[k]
        size = axis.scale * (top - bottom)
        edge = darken(colours[k], 0.8) if has_edges else ""
        tall = size + (_OVERLAP if bottom > 0 and not edge else 0)
        yield Box(origin + scale * x0, axis.y(top), scale * (x1 - x0), tall, colours[k], edge, "layer")


def _find_visible_rows(plan: LayerPlan, axis: ZAxis) -> dict[int, tuple[float, float]]:
    """Return top and bottom, mm, of each drawn layer; of layers too thin to see, only the thickest is drawn."""
    rows, begin = {}, 0
    bottom, top, height = plan.bottom.tolist(), plan.top.tolist(), plan.height
    for k in range(plan.n_layers):
        if axis.scale * (top[k] - bottom[begin]) >= _MIN_ROW_HEIGHT or k + 1 == plan.n_layers:
            rows[begin + int(np.argmax(height[begin : k + 1]))] = (top[k], bottom[begin])
            begin = k + 1
    return rows


def _find_x_ranges(solid: Areas) -> Iterator[tuple[int, tuple[float, float]]]:
    """Yield layer and range of x for each stretch of a layer that its section covers, seen from the front."""
    start = solid.ring_start[:-1]
    low = np.minimum.reduceat(solid.xy[:, 0], start)
    high = np.maximum.reduceat(solid.xy[:, 0], start)
    order = np.lexsort((low, solid.ring_layer))
    layer, reach, begin = -1, -np.inf, 0.0
    for k, x0, x1 in zip(
        solid.ring_layer[order].tolist(), low[order].tolist(), high[order].tolist(), strict=True
    ):
        if k != layer or x0 > reach:
            if layer >= 0:
                yield layer, (begin, reach)
            layer, begin, reach = k, x0, x1
        reach = max(reach, x1)
    yield layer, (begin, reach)


def draw_deviation(
    certificate: Certificate,
    ranges_beyond: Sequence[tuple[float, float, float]],
    axis: ZAxis,
    panel: Panel,
    *,
    tolerance: float | None,
) -> Iterator[Shape]:
    """Draw the largest possible deviation of each layer over z, the tolerance, and the ranges beyond it.

    Args:
        certificate: certificate of the plan.
        ranges_beyond: (z_low, z_high, bound) of each range beyond the tolerance, mm.
        axis: z axis.
        panel: where to draw.
        tolerance: mm, or None.
    """
    most = 1.08 * (max(certificate.max_error, tolerance or 0.0) or float(certificate.plan.height.max()))
    scale = panel.width / most
    yield from _draw_x_axis(most, axis, panel)
    curves = list[Shape]()
    for one in certificate.parts or (certificate,):
        widths = panel.left + scale * np.repeat(one.bound, 2)
        top = axis.y(float(one.plan.top[-1])) if certificate.parts else axis.y(axis.total)
        foot = np.array([(panel.left, top), (panel.left, axis.floor)])
        curve = np.column_stack([widths, _find_layer_edges(one.plan, axis)])
        yield Fill((np.concatenate([curve, foot]),), _ERROR, "error")
        curves.append(Line(curve, _CURVE, _limit_line_width(1.6, one.plan, axis)))
    if tolerance is not None:
        limit = panel.left + scale * tolerance
        for low, high, worst in ranges_beyond:
            # The missing part above the last layer may have any height.
            top = max(axis.y(high), panel.top - _MAX_PROTRUSION)
            tall = max(axis.y(low) - top, 3)
            yield Box(limit, top, max(scale * (worst - tolerance), 3), tall, _BEYOND, name="over")
            yield Box(panel.right + 4, top, 8, tall, WARNING, name="over-mark")
        ends = np.array([(limit, axis.floor), (limit, panel.top - _MAX_PROTRUSION)])
        yield Line(ends, _DARK, 2.5, (9, 6), name="tolerance")
        label = f"tolerance {tolerance:g}"
        x = min(limit, panel.right + 24 - estimate_text_width(label, _LABEL) / 2)
        yield Text(x, axis.y(axis.total) - 24, label, _LABEL, _DARK, "middle")
    yield from curves


def draw_heights(
    plans: Sequence[LayerPlan], colours: Sequence[str], axis: ZAxis, panel: Panel
) -> Iterator[Shape]:
    """Draw layer height over z: each layer of a single plan in its colour, or a line for each of several plans."""
    most = 1.08 * max(float(plan.height.max()) for plan in plans)
    scale = panel.width / most
    yield from _draw_x_axis(most, axis, panel)
    if len(plans) == 1:
        yield from _draw_runs(plans[0], colours, axis, panel, scale)
    for plan in plans:
        widths = panel.left + scale * np.repeat(plan.height, 2)
        curve = np.column_stack([widths, _find_layer_edges(plan, axis)])
        yield Line(curve, "#444444", _limit_line_width(1.2, plan, axis))


def _draw_runs(
    plan: LayerPlan, colours: Sequence[str], axis: ZAxis, panel: Panel, scale: float
) -> Iterator[Shape]:
    """Draw each run of equal layers as a box in its colour; `scale` is in px per mm of layer height."""
    k = plan.n_layers
    for count, height in reversed(plan.runs()):
        top, k = axis.y(float(plan.top[k - 1])), k - count
        tall = axis.y(float(plan.bottom[k])) - top + (_OVERLAP if k else 0)
        yield Box(panel.left, top, scale * height, tall, colours[k], name="height")


def _limit_line_width(width: float, plan: LayerPlan, axis: ZAxis) -> float:
    """Return the width of a line, px, reduced if it would cover thin layers."""
    return min(width, 0.4 * axis.scale * axis.total / plan.n_layers)


def _find_layer_edges(plan: LayerPlan, axis: ZAxis) -> Float:
    """Return the position of bottom and top of each layer, (2 L,) px."""
    return axis.y_positions(np.column_stack([plan.bottom, plan.top]).ravel())


def _draw_x_axis(most: float, axis: ZAxis, panel: Panel) -> Iterator[Shape]:
    """Draw vertical lines at round values, with the values below the axis."""
    for value in choose_axis_marks(most, 3).tolist():
        x = panel.left + panel.width * value / most
        yield Line(np.array([(x, axis.floor), (x, axis.y(axis.total))]), _GRID if value else _AXIS)
        yield Text(x, axis.floor + 1.3 * _LABEL, f"{value:g}", _LABEL, _AXIS, "middle")
