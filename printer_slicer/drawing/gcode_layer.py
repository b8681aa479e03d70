"""Draw one layer of a G-code file from above, with the role names of the file."""

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

__all__ = ["View", "gcode_layer_picture"]

_BORDER: Final = 1.0  # mm around what is drawn
_SIDE, _TITLE, _ROW, _FOOT = 12, 34, 24, 44  # px
_LETTERS: Final = 15  # px
_NARROWEST: Final = 360  # px
_EDGE: Final = 0.09  # share of the width drawn darker on either side, so that neighbours are distinguished
_WIDEST_EDGE: Final = 1.2  # px
_STEP: Final = 0.2  # px; widths that differ by less are drawn as one
_INK, _TRAVEL, _EMPTY, _OUTLINE, _PAPER = "#222222", "#c2188b", "#ffe3d0", "#000000", "#ffffff"
_BEYOND: Final = 4.0  # px outside the drawing at which the section is clipped
_DASH: Final = (4.0, 3.0)  # px
_COLOURS: Final = {
    Purpose.EXTERNAL_PERIMETER: ROLE_COLOURS[Role.EXTERNAL_PERIMETER],
    Purpose.PERIMETER: ROLE_COLOURS[Role.PERIMETER],
    Purpose.OVERHANG_PERIMETER: ROLE_COLOURS[Role.OVERHANG_PERIMETER],
    Purpose.SOLID_INFILL: ROLE_COLOURS[Role.SOLID_INFILL],
    Purpose.BRIDGE: ROLE_COLOURS[Role.BRIDGE],
    Purpose.INTERNAL_INFILL: ROLE_COLOURS[Role.INTERNAL_INFILL],
    Purpose.GAP_FILL: "#cc79a7",
    Purpose.IRONING: ROLE_COLOURS[Role.IRONING],
    Purpose.SUPPORT_MATERIAL: ROLE_COLOURS[Role.RAFT],
    Purpose.SKIRT: ROLE_COLOURS[Role.SKIRT],
    Purpose.CUSTOM: ROLE_COLOURS[Role.SKIRT],
    Purpose.TOP_SOLID_INFILL: ROLE_COLOURS[Role.TOP_SOLID_INFILL],
}
_OTHER: Final = "#4477aa"
_LIGHT: Final = 0.25  # share of white in the colours, so that dark ones keep a visible edge
_DARK: Final = 0.5  # brightness of edges


@dataclass(frozen=True, slots=True, eq=False)
class View:
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


@dataclass(frozen=True, slots=True)
class _Frame:
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

    def place(self, points: Float) -> Float:
        """Return points (..., 2), mm, in px; y points down in the picture."""
        flip = np.array([self.scale, -self.scale])
        shift = (self.left - self.low[0] * self.scale, self.top + self.high[1] * self.scale)
        return np.asarray(points * flip + np.array(shift))

    def cut(self, lines: Float, reach: float) -> tuple[Float, Int]:
        """Clip lines (n, 2, 2) to the rectangle grown by `reach`, mm; return the parts and the index of their lines.

        Source: Liang and Barsky, A new concept and method for line clipping, 1984.
        """
        begin, way = lines[:, 0], lines[:, 1] - lines[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (np.stack([self.low - reach, self.high + reach])[:, None] - begin) / way
        inside = (begin >= self.low - reach) & (begin <= self.high + reach)
        # A line along an axis is completely between both edges or outside of them.
        level = way == 0
        enters = np.where(level, np.where(inside, -np.inf, np.inf), sides.min(axis=0)).max(
            axis=1, initial=0.0
        )
        leaves = np.where(level, np.inf, sides.max(axis=0)).min(axis=1, initial=1.0)
        seen = np.flatnonzero(enters <= leaves)
        share = np.stack([enters, leaves], axis=1)[seen, :, None]
        part = begin[seen, None] + share * way[seen, None]
        # Lines that are not clipped keep their exact coordinates.
        return np.where(share == np.array([[0.0], [1.0]]), lines[seen], part), seen


def gcode_layer_picture(sheet: LayerExtrusions, title: str, view: View = View()) -> Picture:
    """Draw one layer from above.

    Extrusions are drawn in printing order, each with a darker edge, so later ones cover earlier ones.

    Args:
        sheet: the layer.
        title: printed above, before the number, the z and the height of the layer.
        view: selection and size.

    Raises:
        ValueError: the layer is empty and the view has no section.
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
    """Return the corners of the drawn rectangle, mm."""
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
    """Draw section, extrusions and travels."""
    rings = _cut_section(view, frame)
    if rings:  # drawn as an area, so that uncovered places stay visible
        yield Fill(tuple(frame.place(ring) for ring in rings), _EMPTY, "section")
    yield from _beads(sheet, frame)
    for ring in rings:
        yield Line(frame.place(np.concatenate([ring, ring[:1]])), _OUTLINE, 1.0, name="outline")
    yield from _travels(sheet.travel, frame) if view.travel else ()


def _cut_section(view: View, frame: _Frame) -> list[Float]:
    """Return the rings of the section, clipped slightly outside of the drawing."""
    if view.box is None or not len(view.section):
        return list(view.section)
    margin = _BEYOND / frame.scale
    (x0, y0), (x1, y1) = (frame.low - margin).tolist(), (frame.high + margin).tolist()
    around = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return list(intersection(Areas.from_rings([list(view.section)]), Areas.from_rings([[around]])).rings(0))


# Beads


def _colours(sheet: LayerExtrusions) -> tuple[Int, list[tuple[str, str]]]:
    """Return the kind (B,) of each extrusion, and name and colour of each kind.

    A kind is one role name of the file; all names of one role share its colour.
    """
    pairs = np.stack([sheet.name, sheet.beads.purpose], axis=1)
    kinds, kind = np.unique(pairs, axis=0, return_inverse=True)
    result = []
    for index, purpose in kinds.tolist():
        name = sheet.names[index] or Purpose(purpose).label
        colour = _COLOURS.get(Purpose(purpose), _OTHER)
        name = name.replace("_", " ")
        name = name.capitalize() if name.isupper() else name[:1].upper() + name[1:]
        result.append((name, mixed(colour, "#ffffff", _LIGHT)))
    return kind.ravel(), result


def _beads(sheet: LayerExtrusions, frame: _Frame) -> Iterator[Shape]:
    """Draw every path: first the edges of all its extrusions, then the inner parts."""
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
    """Return the visible centre lines (n, 2, 2) of extrusions, mm, and the indices of the extrusions."""
    beads = sheet.beads
    reach = float(beads.width.max(initial=0.0)) / 2
    return frame.cut(np.stack([beads.begin, beads.end], axis=1), reach)


def _starts(lines: Float, kind: Int, steps: Int) -> tuple[Int, Int]:
    """Return where paths begin, and where runs of one width begin."""
    breaks = (lines[1:, 0] != lines[:-1, 1]).any(axis=1) | (np.diff(kind) != 0)
    first = np.append(True, breaks)
    path = np.flatnonzero(first)
    run = np.flatnonzero(first | np.append(True, np.diff(steps) != 0))
    return path, run


def _class(name: str) -> str:
    """Return a name as an SVG class of one word."""
    return "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in name.lower())


# Travels, legend and scale


def _travels(travel: Float, frame: _Frame) -> Iterator[Shape]:
    """Draw consecutive travels as one dotted line."""
    own, _ = frame.cut(travel, 0.0)
    if not len(own):
        return
    places = frame.place(own)
    first = np.flatnonzero(np.append(True, (own[1:, 0] != own[:-1, 1]).any(axis=1)))
    for begin, end in pairwise([*first.tolist(), len(own)]):
        points = np.concatenate([places[begin : begin + 1, 0], places[begin:end, 1]])
        yield Line(points, _TRAVEL, 1.2, _DASH, name="travel")


def _margins(frame: _Frame, wide: float, tall: float) -> Iterator[Shape]:
    """Draw white margins over the extrusions that extend beyond the drawing."""
    right, bottom = frame.left + frame.size[0], frame.top + frame.size[1]
    yield Box(0, 0, wide, frame.top, _PAPER, name="margin")
    yield Box(0, bottom, wide, tall - bottom, _PAPER, name="margin")
    yield Box(0, frame.top, frame.left, bottom - frame.top, _PAPER, name="margin")
    yield Box(right, frame.top, wide - right, bottom - frame.top, _PAPER, name="margin")


def _seen(sheet: LayerExtrusions, view: View, frame: _Frame) -> list[tuple[str, str]]:
    """Return the entries of the legend: names and colours."""
    kind, kinds = _colours(sheet)
    found = [kinds[i] for i in np.unique(kind[_bead_lines(sheet, frame)[1]]).tolist()]
    ways = view.travel and len(frame.cut(sheet.travel, 0.0)[1])
    found += [("Travel", _TRAVEL)] if ways else []
    return found + ([("Section without extrusion", _EMPTY)] if len(view.section) else [])


def _legend(entries: Sequence[tuple[str, str]], wide: float) -> tuple[list[Shape], float]:
    """Return the legend in rows under the title, and its height, px."""
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
    """Draw a scale bar of a round length below the drawing, about a fifth of its width."""
    length = float(marks(frame.size[0] / frame.scale, 5)[1])
    x, y = frame.left + 2, frame.top + frame.size[1] + 18
    end = x + length * frame.scale
    yield Line(np.array([(x, y), (end, y)]), _INK, 2.0, name="scale")
    for place in (x, end):
        yield Line(np.array([(place, y - 5), (place, y + 5)]), _INK, 2.0, name="tick")
    yield Text(end + 8, y + 5, f"{length:g} mm", _LETTERS)
