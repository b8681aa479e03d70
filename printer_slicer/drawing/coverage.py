"""Draw layers of a coverage from above, as a whole and close up, with their findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.drawing.canvas import (
    Box,
    Fill,
    Line,
    Picture,
    Shape,
    Text,
    estimate_text_width,
    fit_text,
    wrap_text,
)
from printer_slicer.geometry import Areas, intersection, stroke_lines
from printer_slicer.inspection.coverage.limits import (
    CoverageLimits,
    describe_usage,
    find_measured_layer,
    find_nearest_to_limit,
)
from printer_slicer.inspection.coverage.measurement import Coverage, find_overlaps
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.values import Struct

__all__ = ["draw_coverage"]

_PANEL: Final = 520  # px, width of a panel
_TALLEST, _LOWEST = 620, 180  # px, limits of its height
_GAP, _HEAD, _LEGEND = 24, 52, 40  # px
_NARROWEST: Final = 740  # px, width of a picture without close-ups
_LETTERS: Final = 15  # px
_LINE: Final = 20  # px, from one line of a heading to the next
_BORDER: Final = 1.5  # mm around a layer
_CLOSE_UP_WIDTH: Final = 8.0  # mm, width of a close-up, or a third of the layer if that is less
_DRAWN_SHARE: Final = 0.85  # fraction of the extrusion width that is drawn, to leave gaps between neighbours
_INK: Final = "#222222"
_ROLE_COLOURS: Final = {
    Purpose.EXTERNAL_PERIMETER: "#9fb4c4",
    Purpose.PERIMETER: "#b4c5d1",
    Purpose.OVERHANG_PERIMETER: "#9fb4c4",
    Purpose.BRIDGE: "#bcd9ea",
    Purpose.INTERNAL_INFILL: "#d9dfe3",
    Purpose.SUPPORT_MATERIAL: "#ece6d8",
    Purpose.SKIRT: "#ece6d8",
    Purpose.CUSTOM: "#ece6d8",
}
_OTHER_COLOUR: Final = "#c8d4dc"
_UNCOVERED, _OVERLAP, _OUTSIDE, _UNSUPPORTED = "#d7191c", "#f28e00", "#8e44ad", "#0050d8"
_LEGENDS: Final = (
    ("uncovered", _UNCOVERED),
    ("overlap", _OVERLAP),
    ("outside", _OUTSIDE),
    ("unsupported", _UNSUPPORTED),
    ("extrusions", _OTHER_COLOUR),
    ("section", _INK),
)


class _Row(NamedTuple):
    """One row of the picture: index of the layer, position of the close-up (mm) or None, and heading."""

    layer: int
    place: tuple[float, float] | None
    heading: str


class _View(Struct, frozen=True):
    """A rectangle of a layer, mm, and its position in the picture, px."""

    low: tuple[float, float]
    high: tuple[float, float]
    left: float
    top: float
    scale: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, px."""
        return (self.high[0] - self.low[0]) * self.scale, (self.high[1] - self.low[1]) * self.scale

    def to_pixels(self, points: Float) -> Float:
        """Convert points (n, 2) from mm to px; y points down in the picture."""
        return np.column_stack(
            [
                self.left + (points[:, 0] - self.low[0]) * self.scale,
                self.top + (self.high[1] - points[:, 1]) * self.scale,
            ]
        )


def draw_coverage(
    coverage: Coverage, shown: Sequence[Diagnostic], title: str, limits: CoverageLimits
) -> Picture:
    """Draw the layer of each finding, as a whole and close up; without findings, draw the layer nearest to a limit.

    Args:
        coverage: the measured coverage.
        shown: findings, one row for each; findings without a position have no close-up.
        title: of the picture.
        limits: limits of a good coverage; without findings, the layer nearest to one of them is drawn.
    """
    shapes: list[Shape] = []
    y = float(_HEAD + _LEGEND)
    rows = [
        _Row(
            find_measured_layer(coverage, one),
            one.place,
            f"layer {one.layer}, z {one.z:.4g} mm: {one.message}",
        )
        for one in shown
    ] or [_find_worst_layer(coverage, limits)]
    wide = _NARROWEST if all(row.place is None for row in rows) else 2 * _PANEL + 3 * _GAP
    for row in rows:
        heading, y = _draw_heading(row.heading, wide - 2 * _GAP, y)
        shapes += heading
        whole, close = _make_views(coverage, row, y)
        for view in (close, whole):
            if view is not None:
                shapes += _draw_panel(coverage, row.layer, view)
        if close is not None:
            shapes.append(_draw_close_up_frame(close, whole))
        y += max(view.size[1] for view in (whole, close) if view is not None) + _GAP
    shapes += [
        Text(_GAP, 32, fit_text(title, 20, wide - 2 * _GAP), 20, bold=True),
        *_draw_legend(_GAP, _HEAD + 4),
    ]
    return Picture(round(wide), round(y), tuple(shapes), title)


def _draw_heading(heading: str, width: float, y: float) -> tuple[list[Shape], float]:
    """Draw the heading of a row in at most two lines below y; also return the y at which its panels begin."""
    lines = wrap_text(heading, _LETTERS, width, bold=True)
    texts = [Text(_GAP, y + 14 + _LINE * k, line, _LETTERS, bold=True) for k, line in enumerate(lines)]
    return [*texts], y + 26 + _LINE * (len(lines) - 1)


def _find_worst_layer(coverage: Coverage, limits: CoverageLimits) -> _Row:
    """Return a row for the layer nearest to a limit; its heading gives the measured value in percent of the limit."""
    nearest, share = find_nearest_to_limit(coverage, limits)
    heading = f"no findings; nearest to a limit: {describe_usage(nearest, share)}: {nearest.message}"
    return _Row(find_measured_layer(coverage, nearest), nearest.place, heading)


def _make_views(coverage: Coverage, row: _Row, top: float) -> tuple[_View, _View | None]:
    """Return the view of the whole layer, and the close-up of the row's position or None."""
    member = coverage.of_part & (coverage.stack.layer == row.layer)
    beads = coverage.stack.beads.take(member)
    corners = np.concatenate([beads.begin, beads.end, *coverage.sections.rings(row.layer)])
    low, high = corners.min(axis=0) - _BORDER, corners.max(axis=0) + _BORDER
    size = high - low
    scale = min(_PANEL / size[0], _TALLEST / size[1])
    whole = _View((low[0], low[1]), (high[0], high[1]), _GAP, top, float(scale))
    if row.place is None:
        return whole, None
    tall = float(np.clip(whole.size[1], _LOWEST, _PANEL))
    reach = min(
        min(_CLOSE_UP_WIDTH, float(size.max()) / 3) / 2, size[0] / 2, float(size[1]) / 2 * _PANEL / tall
    )
    up = reach * tall / _PANEL
    half = np.array([reach, up])  # the close-up stays within the layer
    x, y = np.clip(row.place, low + half, high - half).tolist()
    near = _View((x - reach, y - up), (x + reach, y + up), 2 * _GAP + _PANEL, top, _PANEL / (2 * reach))
    return whole, near


def _draw_panel(coverage: Coverage, layer: int, view: _View) -> Iterator[Shape]:
    """Draw a view: the extrusions, faulty areas, the outline of the section, and a frame."""
    width, height = view.size
    yield Box(view.left, view.top, width, height, "#fafafa", name="panel")
    yield from _draw_extrusions(coverage, layer, view)
    yield from _draw_areas(coverage.uncovered, layer, view, _UNCOVERED, "uncovered")
    yield from _draw_areas(coverage.outside, layer, view, _OUTSIDE, "outside")
    yield from _draw_areas(find_overlaps(coverage, layer), 0, view, _OVERLAP, "overlap")
    for ring in _clip_areas(coverage.sections, layer, view).rings(0):
        yield Line(view.to_pixels(np.concatenate([ring, ring[:1]])), _INK, 1.2, name="section")
    frame = np.array([(0, 0), (width, 0), (width, height), (0, height), (0, 0)]) + np.array(
        [view.left, view.top]
    )
    yield Line(frame, "#888888", 1.5, name="frame")


def _draw_extrusions(coverage: Coverage, layer: int, view: _View) -> Iterator[Shape]:
    """Draw the extrusions of a layer in the colours of their roles, unsupported ones in their own colour."""
    stack = coverage.stack
    is_unsupported = np.zeros(stack.beads.n_beads, np.bool_)
    is_unsupported[[one.command - 1 for one in coverage.unsupported]] = True
    selected = np.flatnonzero(stack.layer == layer)
    colour_index = np.where(is_unsupported[selected], len(Purpose), stack.beads.purpose[selected])
    for one in np.unique(colour_index).tolist():
        beads = stack.beads.take(selected[colour_index == one])
        ends = np.stack([beads.begin, beads.end], axis=1).reshape(-1, 2)
        n = beads.n_beads
        radius = np.maximum(beads.width * _DRAWN_SHARE / 2, 0.01)
        drawn = stroke_lines(ends, np.arange(n + 1) * 2, np.zeros(n, np.int64), radius, 1)
        name = _UNSUPPORTED if one == len(Purpose) else _ROLE_COLOURS.get(Purpose(one), _OTHER_COLOUR)
        yield from _draw_areas(drawn, 0, view, name, "air" if one == len(Purpose) else "bead")


def _draw_areas(areas: Areas, layer: int, view: _View, colour: str, name: str) -> Iterator[Shape]:
    """Draw the areas of a layer, clipped to a view."""
    rings = [view.to_pixels(ring) for ring in _clip_areas(areas, layer, view).rings(0)]
    if rings:
        yield Fill(tuple(rings), colour, name)


def _clip_areas(areas: Areas, layer: int, view: _View) -> Areas:
    """Clip the areas of one layer to a view; return a stack of one layer."""
    one = Areas.from_rings([list(areas.rings(layer))])
    (x0, y0), (x1, y1) = view.low, view.high
    return intersection(one, Areas.from_rings([[np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])]]))


def _draw_close_up_frame(close: _View, whole: _View) -> Shape:
    """Draw the frame of the close-up in the view of the whole layer."""
    (x0, y0), (x1, y1) = close.low, close.high
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    return Line(whole.to_pixels(corners), "#d7191c", 1.5, (4, 3), name="close-up")


def _draw_legend(x: float, y: float) -> Iterator[Shape]:
    """Draw one row that explains the colours."""
    for name, colour in _LEGENDS:
        if name == "section":
            yield Line(np.array([(x, y + 7.0), (x + 18, y + 7.0)]), colour, 1.2, name="legend")
        else:
            yield Box(x, y, 18, 14, colour, name="legend")
        yield Text(x + 24, y + 12.5, name, _LETTERS)
        x += 44 + estimate_text_width(name, _LETTERS)
