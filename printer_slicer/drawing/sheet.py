"""One layer of a G-code file from above: every bead as wide as it is laid, by what the file calls it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Shape, Strokes, Text, text_width
from printer_slicer.drawing.colours import ROLE_COLOURS, mixed, shaded
from printer_slicer.drawing.frame import marks
from printer_slicer.geometry import Areas, intersection
from printer_slicer.inspection.coverage.layer_extrusions import LayerExtrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.roles import Role

__all__ = ["View", "sheet_picture"]

_BORDER: Final = 1.0  # mm around what is drawn
_SIDE, _TITLE, _ROW, _FOOT = 12, 34, 24, 44  # px
_LETTERS: Final = 15  # px
_NARROWEST: Final = 360  # px
_EDGE: Final = 0.09  # of a bead's width, on either side, is drawn darker, so that neighbours are told apart
_WIDEST_EDGE: Final = 1.2  # px
_STEP: Final = 0.2  # px: widths that differ by less are drawn as one
_INK, _TRAVEL, _EMPTY, _OUTLINE, _PAPER = "#222222", "#c2188b", "#ffe3d0", "#000000", "#ffffff"
_BEYOND: Final = 4.0  # px outside of the drawing where its section ends
_DASH: Final = (4.0, 3.0)  # px
_COLOURS: Final = {
    Purpose.EXTERNAL_PERIMETER: ROLE_COLOURS[Role.EXTERNAL_PERIMETER],
    Purpose.PERIMETER: ROLE_COLOURS[Role.PERIMETER],
    Purpose.OVERHANG_PERIMETER: ROLE_COLOURS[Role.OVERHANG_PERIMETER],
    Purpose.SOLID_INFILL: ROLE_COLOURS[Role.SOLID_INFILL],
    Purpose.BRIDGE: ROLE_COLOURS[Role.BRIDGE],
    Purpose.INTERNAL_INFILL: ROLE_COLOURS[Role.INTERNAL_INFILL],
    Purpose.GAP_FILL: ROLE_COLOURS[Role.BOTTOM_SOLID_INFILL],
    Purpose.IRONING: ROLE_COLOURS[Role.IRONING],
    Purpose.SUPPORT_MATERIAL: ROLE_COLOURS[Role.RAFT],
    Purpose.SKIRT: ROLE_COLOURS[Role.SKIRT],
    Purpose.CUSTOM: ROLE_COLOURS[Role.SKIRT],
    Purpose.TOP_SOLID_INFILL: ROLE_COLOURS[Role.TOP_SOLID_INFILL],
}
_OTHER: Final = "#4477aa"
_LIGHT: Final = 0.25  # of white is added to the colours, so that dark ones keep an edge
_DARK: Final = 0.5  # of the light of a bead is that of its edge


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What of a layer is shown, and how.

    Attributes:
        box: (x, y) of two corners, mm; None: all beads.
        pixels: the longer side of the drawing.
        travel: whether ways of the nozzle that lay nothing are shown.
        section: rings (n, 2) of the model's section, mm, to be seen under and around the beads.
    """

    box: tuple[tuple[float, float], tuple[float, float]] | None = None
    pixels: int = 1000
    travel: bool = False
    section: Sequence[Float] = ()


@dataclass(frozen=True, slots=True)
class _Frame:
    """A rectangle of the bed, mm, and where it stands in the picture, px."""

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

    def place(self, points: Float) -> Float:
        """Where points (..., 2), mm, are in the picture; y grows downward there."""
        flip = np.array([self.scale, -self.scale])
        shift = (self.left - self.low[0] * self.scale, self.top + self.high[1] * self.scale)
        return np.asarray(points * flip + np.array(shift))

    def cut(self, lines: Float, reach: float) -> tuple[Float, Int]:
        """What of lines (n, 2, 2) lies within `reach`, mm, of the rectangle, and the index of each line that does.

        Source: Liang and Barsky, A new concept and method for line clipping, 1984.
        """
        begin, way = lines[:, 0], lines[:, 1] - lines[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (np.stack([self.low - reach, self.high + reach])[:, None] - begin) / way
        inside = (begin >= self.low - reach) & (begin <= self.high + reach)
        # A line along an axis is on one side of both edges, or between them, all the way.
        level = way == 0
        enters = np.where(level, np.where(inside, -np.inf, np.inf), sides.min(axis=0)).max(
            axis=1, initial=0.0
        )
        leaves = np.where(level, np.inf, sides.max(axis=0)).min(axis=1, initial=1.0)
        seen = np.flatnonzero(enters <= leaves)
        share = np.stack([enters, leaves], axis=1)[seen, :, None]
        part = begin[seen, None] + share * way[seen, None]
        # What is not cut stays as it is, to the last digit.
        return np.where(share == np.array([[0.0], [1.0]]), lines[seen], part), seen


def sheet_picture(sheet: LayerExtrusions, title: str, view: View = View()) -> Picture:
    """One layer from above.

    Beads lie over each other as they were laid, each with a darker edge: of two that overlap, the later one is seen
    whole.

    Args:
        sheet: the layer.
        title: stands over it, before the number, the height and the place of the layer.
        view: what is shown of it.

    Raises:
        ValueError: neither the layer nor the view has anything with a place.
    """
    where = f"layer {sheet.number + 1} of {sheet.count}, z {sheet.top:.4g} mm, {sheet.height:.3g} mm high"
    heading = f"{title}: {where}" if title else where
    low, high = _bounds(sheet, view)
    scale = view.pixels / float((high - low).max())
    across = float((high - low)[0]) * scale
    wide = round(max(across, _NARROWEST, text_width(heading, _LETTERS)) + 2 * _SIDE)
    legend, rows = _legend(_seen(sheet, view, _Frame(low, high, 0.0, 0.0, scale)), wide)
    frame = _Frame(low, high, (wide - across) / 2, _TITLE + rows, scale)
    tall = round(frame.top + frame.size[1] + _FOOT)
    shapes = [
        *_layer(sheet, view, frame),
        *_margins(frame, wide, tall),
        Text(_SIDE, 23, heading, _LETTERS, bold=True),
        *legend,
        *_scale_bar(frame),
    ]
    return Picture(wide, tall, tuple(shapes), heading)


def _bounds(sheet: LayerExtrusions, view: View) -> tuple[Float, Float]:
    """The corners of what is shown, mm."""
    if view.box is not None:
        corners = np.array(view.box, np.float64)
        return corners.min(axis=0), corners.max(axis=0)
    beads = sheet.beads
    places = np.concatenate([beads.begin, beads.end, *view.section])
    if not len(places):
        raise ValueError("there is nothing to draw")
    reach = _BORDER + float(beads.width.max(initial=0.0)) / 2
    return places.min(axis=0) - reach, places.max(axis=0) + reach


def _layer(sheet: LayerExtrusions, view: View, frame: _Frame) -> Iterator[Shape]:
    """All that has a place on the bed."""
    rings = _cut_section(view, frame)
    if rings:  # as an area: what no bead covers of it stays to be seen
        yield Fill(tuple(frame.place(ring) for ring in rings), _EMPTY, "section")
    yield from _beads(sheet, frame)
    for ring in rings:
        yield Line(frame.place(np.concatenate([ring, ring[:1]])), _OUTLINE, 1.0, name="outline")
    yield from _travels(sheet.travel, frame) if view.travel else ()


def _cut_section(view: View, frame: _Frame) -> list[Float]:
    """The rings of the section, cut a little outside of what is shown."""
    if view.box is None or not len(view.section):
        return list(view.section)
    margin = _BEYOND / frame.scale
    (x0, y0), (x1, y1) = (frame.low - margin).tolist(), (frame.high + margin).tolist()
    around = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return list(intersection(Areas.from_rings([list(view.section)]), Areas.from_rings([[around]])).rings(0))


# Beads


def _colours(sheet: LayerExtrusions) -> tuple[Int, list[tuple[str, str]]]:
    """(B,) the kind of each bead, and name and colour of each kind, in the order of their colours.

    A kind is what the file calls by one name; the names of a purpose share its colour.
    """
    pairs = np.stack([sheet.name, sheet.beads.purpose], axis=1)
    kinds, kind = np.unique(pairs, axis=0, return_inverse=True)
    result = []
    for index, purpose in kinds.tolist():
        name = sheet.names[index] or Purpose(purpose).label
        colour = _COLOURS.get(Purpose(purpose), _OTHER)
        name = name.replace("_", " ").capitalize()
        result.append((name, mixed(colour, "#ffffff", _LIGHT)))
    return kind.ravel(), result


def _beads(sheet: LayerExtrusions, frame: _Frame) -> Iterator[Shape]:
    """Every path as it was laid: first the edges of all its beads, then what lies between the edges."""
    lines, seen = _bead_lines(sheet, frame)
    if not len(seen):
        return
    kind, kinds = _colours(sheet)
    kind = kind[seen]
    steps = np.maximum(np.rint(sheet.beads.width[seen] * frame.scale / _STEP), 1).astype(np.int64)
    path, run = _starts(lines, kind, steps)
    places = frame.place(lines)
    ways = [
        np.concatenate([places[first : first + 1, 0], places[first:last, 1]])
        for first, last in pairwise([*run.tolist(), len(seen)])
    ]
    widths = (steps[run] * _STEP).tolist()
    for first, last in pairwise([*np.searchsorted(run, path).tolist(), len(run)]):
        name, colour = kinds[kind[run[first]]]
        own, wide = tuple(ways[first:last]), widths[first:last]
        inner = tuple(width - 2 * min(_EDGE * width, _WIDEST_EDGE) for width in wide)
        yield Strokes(own, tuple(wide), shaded(colour, _DARK), "edge")
        yield Strokes(own, inner, colour, _class(name))


def _bead_lines(sheet: LayerExtrusions, frame: _Frame) -> tuple[Float, Int]:
    """The centre lines of beads (n, 2, 2), mm, as far as they are seen, and which beads these are."""
    beads = sheet.beads
    reach = float(beads.width.max(initial=0.0)) / 2
    return frame.cut(np.stack([beads.begin, beads.end], axis=1), reach)


def _starts(lines: Float, kind: Int, steps: Int) -> tuple[Int, Int]:
    """Where paths begin, and where runs of one width in them do."""
    breaks = (lines[1:, 0] != lines[:-1, 1]).any(axis=1) | (np.diff(kind) != 0)
    first = np.append(True, breaks)
    path = np.flatnonzero(first)
    run = np.flatnonzero(first | np.append(True, np.diff(steps) != 0))
    return path, run


def _class(name: str) -> str:
    """A name that programs can read, of one word."""
    return "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in name.lower())


# What else there is to see


def _travels(travel: Float, frame: _Frame) -> Iterator[Shape]:
    """Ways that follow each other as one dotted line."""
    own, _ = frame.cut(travel, 0.0)
    if not len(own):
        return
    places = frame.place(own)
    first = np.flatnonzero(np.append(True, (own[1:, 0] != own[:-1, 1]).any(axis=1)))
    for begin, end in pairwise([*first.tolist(), len(own)]):
        points = np.concatenate([places[begin : begin + 1, 0], places[begin:end, 1]])
        yield Line(points, _TRAVEL, 1.2, _DASH, name="travel")


def _margins(frame: _Frame, wide: float, tall: float) -> Iterator[Shape]:
    """White around the drawing: beads that it shows in part stick out of it."""
    right, bottom = frame.left + frame.size[0], frame.top + frame.size[1]
    yield Box(0, 0, wide, frame.top, _PAPER, name="margin")
    yield Box(0, bottom, wide, tall - bottom, _PAPER, name="margin")
    yield Box(0, frame.top, frame.left, bottom - frame.top, _PAPER, name="margin")
    yield Box(right, frame.top, wide - right, bottom - frame.top, _PAPER, name="margin")


def _seen(sheet: LayerExtrusions, view: View, frame: _Frame) -> list[tuple[str, str]]:
    """Name and colour of all that is to be explained."""
    kind, kinds = _colours(sheet)
    found = [kinds[i] for i in np.unique(kind[_bead_lines(sheet, frame)[1]]).tolist()]
    ways = view.travel and len(frame.cut(sheet.travel, 0.0)[1])
    found += [("Travel", _TRAVEL)] if ways else []
    return found + ([("Section without plastic", _EMPTY)] if len(view.section) else [])


def _legend(entries: Sequence[tuple[str, str]], wide: float) -> tuple[list[Shape], float]:
    """What the colours mean, in rows under the title, and how high that is, px."""
    shapes: list[Shape] = []
    x, y = float(_SIDE), float(_TITLE)
    for name, colour in entries:
        needs = 36 + text_width(name, _LETTERS)
        if x + needs > wide and x > _SIDE:
            x, y = float(_SIDE), y + _ROW
        if colour == _TRAVEL:
            shapes.append(
                Line(np.array([(x, y + 8.0), (x + 18, y + 8.0)]), colour, 1.2, _DASH, name="legend")
            )
        else:
            shapes.append(Box(x, y + 1, 18, 14, colour, shaded(colour, _DARK), name="legend"))
        shapes.append(Text(x + 24, y + 13, name, _LETTERS))
        x += needs
    return shapes, (y + _ROW - _TITLE + 6 if entries else 0.0)


def _scale_bar(frame: _Frame) -> Iterator[Shape]:
    """A round length, about a fifth of the drawing, under it."""
    length = float(marks(frame.size[0] / frame.scale, 5)[1])
    x, y = frame.left + 2, frame.top + frame.size[1] + 18
    end = x + length * frame.scale
    yield Line(np.array([(x, y), (end, y)]), _INK, 2.0, name="scale")
    for place in (x, end):
        yield Line(np.array([(place, y - 5), (place, y + 5)]), _INK, 2.0, name="tick")
    yield Text(end + 8, y + 5, f"{length:g} mm", _LETTERS)
