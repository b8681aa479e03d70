"""Layers of a coverage from above: what was laid, and what is wrong with it, whole and close up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Shape, Text, text_width
from printer_slicer.geometry import Areas, intersection, stroked
from printer_slicer.inspection.coverage.measurement import Coverage, overlapping
from printer_slicer.inspection.deposition.marks import Purpose

__all__ = ["material_picture"]

_PANEL: Final = 520  # px, width of a panel
_TALLEST, _LOWEST = 620, 180  # px, what its height may be
_GAP, _HEAD, _LEGEND = 24, 52, 40  # px
_LETTERS: Final = 15  # px
_BORDER: Final = 1.5  # mm around a layer
_CLOSE: Final = 8.0  # mm that a close-up shows, or a third of the layer, whatever is less
_SEEN: Final = 0.85  # of a bead's width is drawn, so that neighbours stay apart
_INK: Final = "#222222"
_BEAD: Final = {
    Purpose.EXTERNAL_PERIMETER: "#9fb4c4",
    Purpose.PERIMETER: "#b4c5d1",
    Purpose.OVERHANG_PERIMETER: "#9fb4c4",
    Purpose.BRIDGE: "#bcd9ea",
    Purpose.INTERNAL_INFILL: "#d9dfe3",
    Purpose.SUPPORT_MATERIAL: "#ece6d8",
    Purpose.SKIRT: "#ece6d8",
    Purpose.CUSTOM: "#ece6d8",
}
_OTHER: Final = "#c8d4dc"
_UNCOVERED, _OVERLAP, _OUTSIDE, _AIR = "#d7191c", "#f28e00", "#8e44ad", "#0050d8"
_LEGENDS: Final = (
    ("uncovered", _UNCOVERED),
    ("overlap", _OVERLAP),
    ("outside the section", _OUTSIDE),
    ("in the air", _AIR),
    ("beads", _OTHER),
    ("section", _INK),
)


@dataclass(frozen=True, slots=True)
class _View:
    """A rectangle of a layer, mm, and where it stands in the picture, px."""

    low: tuple[float, float]
    high: tuple[float, float]
    left: float
    top: float
    scale: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, px."""
        return (self.high[0] - self.low[0]) * self.scale, (self.high[1] - self.low[1]) * self.scale

    def place(self, points: Float) -> Float:
        """Where points (n, 2), mm, are in the picture, px; y grows downward there."""
        return np.column_stack(
            [
                self.left + (points[:, 0] - self.low[0]) * self.scale,
                self.top + (self.high[1] - points[:, 1]) * self.scale,
            ]
        )


def material_picture(coverage: Coverage, shown: Sequence[Diagnostic], title: str) -> Picture:
    """The layers of some findings, each whole and close up.

    Args:
        coverage: what to draw from.
        shown: one row for each; those without a place are drawn whole only.
        title: over all.
    """
    shapes: list[Shape] = []
    y = float(_HEAD + _LEGEND)
    wide = 2 * _PANEL + 3 * _GAP
    for finding in shown:
        heading = f"layer {finding.layer}, z {finding.z:.4g} mm: {finding.message}"
        y += 26
        whole, close = _views(coverage, finding, y)
        for view in (close, whole):
            if view is not None:
                shapes += _panel(coverage, finding.layer - 1, view)
        if close is not None:
            shapes.append(_frame_of(close, whole))
        shapes.append(Text(_GAP, y - 12, _fitting(heading, wide - 2 * _GAP), _LETTERS, bold=True))
        y += max(view.size[1] for view in (whole, close) if view is not None) + _GAP
    if not shown:
        shapes.append(Text(_GAP, y + 14, "nothing is beyond its limit", _LETTERS))
        y += 30
    shapes += [Text(_GAP, 32, title, 20, bold=True), *_legend(_GAP, _HEAD + 4)]
    return Picture(round(wide), round(y), tuple(shapes), title)


def _fitting(text: str, room: float) -> str:
    """The text, cut where it would leave the picture."""
    while text_width(text, _LETTERS) > room and len(text) > 10:
        text = f"{text[:-4].rstrip()}..."
    return text


def _views(coverage: Coverage, finding: Diagnostic, top: float) -> tuple[_View, _View | None]:
    """The whole layer, and what is around the place of the finding."""
    member = coverage.of_part & (coverage.stack.layer == finding.layer - 1)
    beads = coverage.stack.beads.take(member)
    corners = np.concatenate([beads.begin, beads.end, *coverage.sections.rings(finding.layer - 1)])
    low, high = corners.min(axis=0) - _BORDER, corners.max(axis=0) + _BORDER
    size = high - low
    scale = min(_PANEL / size[0], _TALLEST / size[1])
    whole = _View((low[0], low[1]), (high[0], high[1]), _GAP, top, float(scale))
    if finding.place is None:
        return whole, None
    reach = min(_CLOSE, float(size.max()) / 3) / 2
    tall = float(np.clip(whole.size[1], _LOWEST, _PANEL))
    up = reach * tall / _PANEL
    x, y = finding.place
    near = _View((x - reach, y - up), (x + reach, y + up), 2 * _GAP + _PANEL, top, _PANEL / (2 * reach))
    return whole, near


def _panel(coverage: Coverage, layer: int, view: _View) -> Iterator[Shape]:
    """What lies in a view: beads, what is wrong with them, the outline of the section, and a frame."""
    width, height = view.size
    yield Box(view.left, view.top, width, height, "#fafafa", name="panel")
    yield from _beads(coverage, layer, view)
    yield from _filled(coverage.uncovered, layer, view, _UNCOVERED, "uncovered")
    yield from _filled(coverage.outside, layer, view, _OUTSIDE, "outside")
    yield from _filled(overlapping(coverage, layer), 0, view, _OVERLAP, "overlap")
    for ring in _cut(coverage.sections, layer, view).rings(0):
        yield Line(view.place(np.concatenate([ring, ring[:1]])), _INK, 1.2, name="section")
    frame = np.array([(0, 0), (width, 0), (width, height), (0, height), (0, 0)]) + np.array(
        [view.left, view.top]
    )
    yield Line(frame, "#888888", 1.5, name="frame")


def _beads(coverage: Coverage, layer: int, view: _View) -> Iterator[Shape]:
    """The beads of a layer that the view sees, by purpose, and those in the air in a colour of their own."""
    stack = coverage.stack
    hanging = np.zeros(stack.beads.n_beads, np.bool_)
    hanging[[one.command - 1 for one in coverage.unsupported]] = True
    own = np.flatnonzero(stack.layer == layer)
    colour = np.where(hanging[own], len(Purpose), stack.beads.purpose[own])
    for one in np.unique(colour).tolist():
        beads = stack.beads.take(own[colour == one])
        ends = np.stack([beads.begin, beads.end], axis=1).reshape(-1, 2)
        n = beads.n_beads
        radius = np.maximum(beads.width * _SEEN / 2, 0.01)
        drawn = stroked(ends, np.arange(n + 1) * 2, np.zeros(n, np.int64), radius, 1)
        name = _AIR if one == len(Purpose) else _BEAD.get(Purpose(one), _OTHER)
        yield from _filled(drawn, 0, view, name, "air" if one == len(Purpose) else "bead")


def _filled(areas: Areas, layer: int, view: _View, colour: str, name: str) -> Iterator[Shape]:
    """What a view sees of the areas of a layer."""
    rings = [view.place(ring) for ring in _cut(areas, layer, view).rings(0)]
    if rings:
        yield Fill(tuple(rings), colour, name)


def _cut(areas: Areas, layer: int, view: _View) -> Areas:
    """What a view sees of one layer, as a stack of one."""
    one = Areas.from_rings([list(areas.rings(layer))])
    (x0, y0), (x1, y1) = view.low, view.high
    return intersection(one, Areas.from_rings([[np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])]]))


def _frame_of(close: _View, whole: _View) -> Shape:
    """Where the close-up lies in the whole."""
    (x0, y0), (x1, y1) = close.low, close.high
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    return Line(whole.place(corners), "#d7191c", 1.5, (4, 3), name="close-up")


def _legend(x: float, y: float) -> Iterator[Shape]:
    for name, colour in _LEGENDS:
        if name == "section":
            yield Line(np.array([(x, y + 7.0), (x + 18, y + 7.0)]), colour, 1.2, name="legend")
        else:
            yield Box(x, y, 18, 14, colour, name="legend")
        yield Text(x + 24, y + 12.5, name, _LETTERS)
        x += 44 + text_width(name, _LETTERS)
