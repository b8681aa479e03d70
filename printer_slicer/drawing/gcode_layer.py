"""Draw one layer of a G-code file from above, with the role names of the file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Shape, Strokes, Text, estimate_text_width
from printer_slicer.drawing.colours import darken
from printer_slicer.drawing.extrusion_kinds import (
    EDGE_BRIGHTNESS,
    TRAVEL_COLOUR,
    TRAVEL_DASH,
    draw_legend,
    find_kinds,
)
from printer_slicer.drawing.frame import choose_axis_marks
from printer_slicer.geometry import Areas, intersection
from printer_slicer.inspection.coverage.layer_extrusions import LayerExtrusions
from printer_slicer.values import Struct

__all__ = ["View", "draw_gcode_layer"]

_BORDER: Final = 1.0  # mm around the drawn extrusions
_SIDE, _TITLE, _FOOT = 12, 34, 44  # px
_LETTERS: Final = 15  # px
_NARROWEST: Final = 360  # px
_EDGE: Final = (
    0.09  # fraction of the width that is darker on either side, so that neighbours are distinguished
)
_WIDEST_EDGE: Final = 1.2  # px
_STEP: Final = 0.2  # px; widths that differ by less are drawn as one
_INK, _EMPTY, _OUTLINE, _PAPER = "#222222", "#ffe3d0", "#000000", "#ffffff"
_CLIP_MARGIN: Final = 4.0  # px outside the drawing at which the section is clipped


class View(Struct, frozen=True, eq=False):
    """Selection and size of the drawing.

    Attributes:
        box: (x, y) of two corners, mm; None shows all extrusions.
        pixels: longer side of the drawing.
        travel: whether to draw travels.
        section: rings (n, 2) of the model's section, mm, drawn below the extrusions.
    """

    box: tuple[tuple[float, float], tuple[float, float]] | None = None
    pixels: int = 1000
    travel: bool = False
    section: Sequence[Float] = ()


class _Frame(Struct, frozen=True):
    """A rectangle of the bed, mm, and its position in the picture, px."""

    low: Float
    high: Float
    left: float
    top: float
    scale: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, px."""
        wide, tall = ((self.high - self.low) * self.scale).tolist()
        return wide, tall

    def to_pixels(self, points: Float) -> Float:
        """Convert points (..., 2) from mm to px; y points down in the picture."""
        flip = np.array([self.scale, -self.scale])
        shift = (self.left - self.low[0] * self.scale, self.top + self.high[1] * self.scale)
        return np.asarray(points * flip + np.array(shift))

    def clip(self, lines: Float, reach: float) -> tuple[Float, Int]:
        """Clip lines (n, 2, 2) to the rectangle grown by `reach`, mm; return the parts and the line index of each.

        Source: Liang and Barsky, A new concept and method for line clipping, 1984.
        """
        begin, way = lines[:, 0], lines[:, 1] - lines[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (np.stack([self.low - reach, self.high + reach])[:, None] - begin) / way
        inside = (begin >= self.low - reach) & (begin <= self.high + reach)
        # A line parallel to an axis is completely between the two edges or outside of them.
        is_parallel = way == 0
        entry_share = np.where(is_parallel, np.where(inside, -np.inf, np.inf), sides.min(axis=0)).max(
            axis=1, initial=0.0
        )
        exit_share = np.where(is_parallel, np.inf, sides.max(axis=0)).min(axis=1, initial=1.0)
        seen = np.flatnonzero(entry_share <= exit_share)
        share = np.stack([entry_share, exit_share], axis=1)[seen, :, None]
        part = begin[seen, None] + share * way[seen, None]
        # Lines that are not clipped keep their exact coordinates.
        return np.where(share == np.array([[0.0], [1.0]]), lines[seen], part), seen


def draw_gcode_layer(layer: LayerExtrusions, title: str, view: View = View()) -> Picture:
    """Draw one layer from above.

    Extrusions are drawn in printing order, each with a darker edge, so later ones cover earlier ones.

    Args:
        layer: extrusions of the layer.
        title: printed above, before the number, the z and the height of the layer.
        view: selection and size.

    Raises:
        ValueError: the layer is empty and the view has no section.
    """
    where = f"layer {layer.number + 1} of {layer.count}, z {layer.top:.4g} mm, {layer.height:.3g} mm high"
    heading = f"{title}: {where}" if title else where
    low, high = _find_drawn_bounds(layer, view)
    scale = view.pixels / float((high - low).max())
    across = float((high - low)[0]) * scale
    wide = round(max(across, _NARROWEST, estimate_text_width(heading, _LETTERS)) + 2 * _SIDE)
    legend, rows = draw_legend(_list_legend_entries(layer, view, _Frame(low, high, 0.0, 0.0, scale)), wide)
    frame = _Frame(low, high, (wide - across) / 2, _TITLE + rows, scale)
    tall = round(frame.top + frame.size[1] + _FOOT)
    shapes = [
        *_draw_layer(layer, view, frame),
        *_draw_margins(frame, wide, tall),
        Text(_SIDE, 23, heading, _LETTERS, bold=True),
        *legend,
        *_draw_scale_bar(frame),
    ]
    return Picture(wide, tall, tuple(shapes), heading)


def _find_drawn_bounds(layer: LayerExtrusions, view: View) -> tuple[Float, Float]:
    """Return the corners of the drawn rectangle, mm."""
    if view.box is not None:
        corners = np.array(view.box, np.float64)
        return corners.min(axis=0), corners.max(axis=0)
    beads = layer.beads
    places = np.concatenate([beads.begin, beads.end, *view.section])
    if not len(places):
        raise ValueError("the layer has nothing to draw")
    reach = _BORDER + float(beads.width.max(initial=0.0)) / 2
    return places.min(axis=0) - reach, places.max(axis=0) + reach


def _draw_layer(layer: LayerExtrusions, view: View, frame: _Frame) -> Iterator[Shape]:
    """Draw section, extrusions and travels."""
    rings = _clip_section(view, frame)
    if rings:  # drawn as an area, so that uncovered places stay visible
        yield Fill(tuple(frame.to_pixels(ring) for ring in rings), _EMPTY, "section")
    yield from _draw_paths(layer, frame)
    for ring in rings:
        yield Line(frame.to_pixels(np.concatenate([ring, ring[:1]])), _OUTLINE, 1.0, name="outline")
    yield from _draw_travels(layer.travel, frame) if view.travel else ()


def _clip_section(view: View, frame: _Frame) -> list[Float]:
    """Return the rings of the section, clipped slightly outside of the drawing."""
    if view.box is None or not len(view.section):
        return list(view.section)
    margin = _CLIP_MARGIN / frame.scale
    (x0, y0), (x1, y1) = (frame.low - margin).tolist(), (frame.high + margin).tolist()
    around = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return list(intersection(Areas.from_rings([list(view.section)]), Areas.from_rings([[around]])).rings(0))


# Beads


def _draw_paths(layer: LayerExtrusions, frame: _Frame) -> Iterator[Shape]:
    """Draw every path: first the edges of all its extrusions, then the inner parts."""
    lines, seen = _find_visible_lines(layer, frame)
    if not len(seen):
        return
    kind, kinds = find_kinds(layer)
    kind = kind[seen]
    steps = np.maximum(np.rint(layer.beads.width[seen] * frame.scale / _STEP), 1).astype(np.int64)
    path, run = _find_starts(lines, kind, steps)
    places = frame.to_pixels(lines)
    polylines = [
        np.concatenate([places[first : first + 1, 0], places[first:last, 1]])
        for first, last in pairwise([*run.tolist(), len(seen)])
    ]
    widths = (steps[run] * _STEP).tolist()
    for first, last in pairwise([*np.searchsorted(run, path).tolist(), len(run)]):
        name, colour = kinds[kind[run[first]]]
        visible, wide = tuple(polylines[first:last]), widths[first:last]
        inner = tuple(width - 2 * min(_EDGE * width, _WIDEST_EDGE) for width in wide)
        yield Strokes(visible, tuple(wide), darken(colour, EDGE_BRIGHTNESS), "edge")
        yield Strokes(visible, inner, colour, _make_svg_class(name))


def _find_visible_lines(layer: LayerExtrusions, frame: _Frame) -> tuple[Float, Int]:
    """Return the visible centre lines (n, 2, 2) of extrusions, mm, and the indices of the extrusions."""
    beads = layer.beads
    reach = float(beads.width.max(initial=0.0)) / 2
    return frame.clip(np.stack([beads.begin, beads.end], axis=1), reach)


def _find_starts(lines: Float, kind: Int, steps: Int) -> tuple[Int, Int]:
    """Return the indices of the lines that begin a path, and of the lines that begin a run of equal width."""
    breaks = (lines[1:, 0] != lines[:-1, 1]).any(axis=1) | (np.diff(kind) != 0)
    first = np.append(True, breaks)
    path = np.flatnonzero(first)
    run = np.flatnonzero(first | np.append(True, np.diff(steps) != 0))
    return path, run


def _make_svg_class(name: str) -> str:
    """Return a name as an SVG class of one word."""
    return "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in name.lower())


# Travels, legend and scale


def _draw_travels(travel: Float, frame: _Frame) -> Iterator[Shape]:
    """Draw consecutive travels as one dotted line."""
    visible, _ = frame.clip(travel, 0.0)
    if not len(visible):
        return
    places = frame.to_pixels(visible)
    first = np.flatnonzero(np.append(True, (visible[1:, 0] != visible[:-1, 1]).any(axis=1)))
    for begin, end in pairwise([*first.tolist(), len(visible)]):
        points = np.concatenate([places[begin : begin + 1, 0], places[begin:end, 1]])
        yield Line(points, TRAVEL_COLOUR, 1.2, TRAVEL_DASH, name="travel")


def _draw_margins(frame: _Frame, wide: float, tall: float) -> Iterator[Shape]:
    """Draw white margins over the extrusions that extend beyond the drawing."""
    right, bottom = frame.left + frame.size[0], frame.top + frame.size[1]
    yield Box(0, 0, wide, frame.top, _PAPER, name="margin")
    yield Box(0, bottom, wide, tall - bottom, _PAPER, name="margin")
    yield Box(0, frame.top, frame.left, bottom - frame.top, _PAPER, name="margin")
    yield Box(right, frame.top, wide - right, bottom - frame.top, _PAPER, name="margin")


def _list_legend_entries(layer: LayerExtrusions, view: View, frame: _Frame) -> list[tuple[str, str]]:
    """Return the names and colours in the legend."""
    kind, kinds = find_kinds(layer)
    found = [kinds[i] for i in np.unique(kind[_find_visible_lines(layer, frame)[1]]).tolist()]
    has_travel = view.travel and len(frame.clip(layer.travel, 0.0)[1])
    found += [("Travel", TRAVEL_COLOUR)] if has_travel else []
    return found + ([("Section without extrusion", _EMPTY)] if len(view.section) else [])


def _draw_scale_bar(frame: _Frame) -> Iterator[Shape]:
    """Draw a scale bar of a round length below the drawing, about a fifth of its width."""
    length = float(choose_axis_marks(frame.size[0] / frame.scale, 5)[1])
    x, y = frame.left + 2, frame.top + frame.size[1] + 18
    end = x + length * frame.scale
    yield Line(np.array([(x, y), (end, y)]), _INK, 2.0, name="scale")
    for place in (x, end):
        yield Line(np.array([(place, y - 5), (place, y + 5)]), _INK, 2.0, name="tick")
    yield Text(end + 8, y + 5, f"{length:g} mm", _LETTERS)
