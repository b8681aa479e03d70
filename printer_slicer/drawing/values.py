"""Draw any value of the pipeline: layer plans as bars over z, and values with layers layer by layer from above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import singledispatch
from itertools import pairwise
from types import NoneType
from typing import Final

import numpy as np

from printer_slicer.arguments import check_arguments
from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import (
    Box,
    Fill,
    Line,
    Picture,
    Raster,
    Shape,
    Strokes,
    Text,
    estimate_text_width,
    fit_text,
    wrap_text,
)
from printer_slicer.drawing.colours import CALM, ROLE_COLOURS, choose_height_colours
from printer_slicer.drawing.frame import choose_axis_marks
from printer_slicer.drawing.legend import divide_heights
from printer_slicer.drawing.summary_card import draw_summary_card
from printer_slicer.errors import UsageError
from printer_slicer.model import Areas, LayerPlan, Mesh, Program, Regions, Sections, Toolpaths
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.roles import ROLES, Role
from printer_slicer.surface import Certificate
from printer_slicer.texts import describe_type
from printer_slicer.thumbnails import render
from printer_slicer.values import Struct

__all__ = ["draw"]

_WIDE: Final = 760  # px
_SINGLE_SIZE: Final = 560  # px, the longer side of a layer that is drawn alone
_MAX_SHOWN, _MAX_COLUMNS = 6, 3  # layers if none is chosen
_MIN_COLUMN_WIDTH: Final = 120  # px, minimum width of a layer's column, so that its caption fits
_SMALL_LINE: Final = 15  # px
_HEAD, _LINE, _ROW, _LETTERS, _SMALL, _SMALLEST = 34, 20, 22, 15, 12, 11  # px
_DRAWN_SHARE: Final = 0.92  # fraction of the extrusion width that is drawn, to leave gaps between neighbours
_WIDTH_STEP: Final = 0.05  # mm: extrusions whose widths differ by less are drawn as one line
_SOFT, _OUTLINE, _TRAVEL = "#5b6472", "#222222", "#c2188b"
_REGIONS: Final = {
    "bottom_solid_infill": ("Bottom solid infill", "#cc79a7"),
    "bridge": ("Bridge infill", ROLE_COLOURS[Role.BRIDGE]),
    "internal_bridge": ("Internal bridge infill", "#a6d8f0"),
    "top_solid_infill": ("Top solid infill", ROLE_COLOURS[Role.TOP_SOLID_INFILL]),
    "solid_infill": ("Solid infill", ROLE_COLOURS[Role.SOLID_INFILL]),
    "internal_infill": ("Internal infill", ROLE_COLOURS[Role.INTERNAL_INFILL]),
}


@check_arguments(layer=(int, np.integer, NoneType))
def draw(value: object, layer: int | None = None) -> Picture:
    """Draw a mesh, a layer plan, a certificate, or layers of sections, walls, regions, toolpaths, moves or areas.

    Args:
        value: the value to draw; for stages, and for a job that this package sliced, the program is drawn.
        layer: number of a layer, counted from 1; None draws six layers from the bottom to the top. Meshes, plans and
            certificates are always drawn whole.

    Raises:
        UsageError: the value cannot be drawn, or it has no such layer.
    """
    return _draw_value(
        value.drawable if isinstance(value, SvgRepr) else value, None if layer is None else layer - 1
    )


@singledispatch
def _draw_value(value: object, _layer: int | None) -> Picture:
    raise UsageError(
        f"cannot draw {describe_type(value)}",
        remedy="Draw a mesh or a result of slicing: stages.plan, stages.sections, stages.program",
    )


# Meshes


@_draw_value.register
def _draw_mesh(part: Mesh, _layer: int | None) -> Picture:
    """Draw a mesh, seen from above and from the front left."""
    if not part.n_facets:
        return _draw_note("a mesh without facets", part.name)
    x, y, z = part.size.tolist()
    title = f"{part.name}: {part.n_facets} facets, {x:.4g} x {y:.4g} x {z:.4g} mm"
    lines = wrap_text(title, _LETTERS, _SINGLE_SIZE, bold=True)
    top = _HEAD + (len(lines) - 1) * _LINE
    seen = Raster(8, top, _SINGLE_SIZE, _SINGLE_SIZE, render(part, 2 * _SINGLE_SIZE, 2 * _SINGLE_SIZE))
    heading = [Text(8, 24 + k * _LINE, line, _LETTERS, bold=True) for k, line in enumerate(lines)]
    return Picture(_SINGLE_SIZE + 16, _SINGLE_SIZE + top + 8, (*heading, seen), title)


def _draw_note(text: str, title: str) -> Picture:
    """Draw one line of text, for a value with nothing to draw."""
    return Picture(
        max(400, round(estimate_text_width(text, _LETTERS)) + 16), 40, (Text(8, 24, text, _LETTERS),), title
    )


# Values without a shape


@_draw_value.register
def _draw_card(summary: Summary, _layer: int | None) -> Picture:
    return draw_summary_card(summary.title, summary.facts, summary.problems)


# Plans


@_draw_value.register
def _draw_plan(plan: LayerPlan, _layer: int | None) -> Picture:
    """Draw a bar for each layer, as long as the layer is high."""
    title = f"{plan.n_layers} layers" + (f", planner {plan.planner}" if plan.planner else "")
    return _draw_bars(plan, plan.height, title, "layer height, mm")


@_draw_value.register
def _draw_certificate(certificate: Certificate, _layer: int | None) -> Picture:
    """Draw a bar for each layer, as long as its largest possible deviation."""
    title = f"{certificate.plan.n_layers} layers, surface deviation at most {certificate.max_error:.3g} mm"
    return _draw_bars(certificate.plan, certificate.bound, title, "max deviation, mm")


def _draw_bars(plan: LayerPlan, lengths: Float, title: str, axis_title: str) -> Picture:
    """Draw a horizontal bar for each layer, in the colour of its height."""
    if not plan.n_layers:
        return _draw_note("a plan without layers", title)
    heights, total = plan.height, float(plan.top[-1])
    left, right, top, tall = 56.0, _WIDE - 200.0, 50.0, 360.0
    longest = float(lengths.max()) or 1.0
    across, down = (right - left) / longest, tall / total
    shapes: list[Shape] = [Text(8, 24, fit_text(title, _LETTERS, _WIDE - 24, bold=True), _LETTERS, bold=True)]
    for z in choose_axis_marks(total, 6).tolist():
        y = top + tall - z * down
        shapes += [Line(np.array([(left - 6, y), (right, y)]), "#dddddd")]
        shapes += [Text(left - 10, y + 4, f"{z:g}", _SMALL, _SOFT, "end")]
    for length in choose_axis_marks(longest, 4).tolist()[1:]:
        x = left + length * across
        shapes += [Line(np.array([(x, top), (x, top + tall)]), "#dddddd")]
        shapes += [Text(x, top + tall + 18, f"{length:g}", _SMALL, _SOFT, "middle")]
    colours = choose_height_colours(heights)
    rows = zip(plan.bottom.tolist(), heights.tolist(), lengths.tolist(), colours, strict=True)
    for bottom, high, length, colour in rows:
        y, thick = top + tall - (bottom + high) * down, high * down
        # Leave a gap between layers that are thick enough to be distinguished.
        shapes.append(Box(left, y, length * across, thick * (0.85 if thick > 3 else 1), colour, name="layer"))
    shapes += [Text(left - 10, top - 10, "z mm", _SMALL, _SOFT, "end")]
    shapes += [Text((left + right) / 2, top + tall + 36, axis_title, _SMALL, _SOFT, "middle")]
    return Picture(
        _WIDE, round(top + tall + 50), (*shapes, *_draw_height_legend(plan, colours, right + 24, top)), title
    )


def _draw_height_legend(plan: LayerPlan, colours: Sequence[str], x: float, y: float) -> Iterator[Shape]:
    """Draw the legend: ranges of layer heights with their layer counts."""
    for k, step in enumerate(divide_heights(plan)):
        wide = 16 / len(step.layers)
        for stripe, layer in enumerate(step.layers):
            yield Box(x + stripe * wide, y + k * _ROW, wide, 14, colours[layer], name="legend")
        yield Text(x + 24, y + k * _ROW + 12, fit_text(step.label, _SMALL, _WIDE - x - 28), _SMALL)


# Layers


class _Layers(Struct, frozen=True):
    """Layers of a value that is drawn from above.

    Attributes:
        plan: the layers, if their heights are known.
        count: number of layers.
        boxes: (L, 2) lowest and highest corner of each layer; (inf, -inf) if it is empty.
        shapes: function that draws a layer, given its index, a function that maps points (n, 2) from mm to px, and
            px per mm.
        names: function that returns the legend of layers: names and colours of their contents.
        title: title of the picture.
    """

    plan: LayerPlan | None
    count: int
    boxes: tuple[Float, Float]
    shapes: Callable[[int, Callable[[Float], Float], float], Iterator[Shape]]
    names: Callable[[Sequence[int]], list[tuple[str, str]]]
    title: str

    def find_filled_layers(self) -> Int:
        """Return the indices of the layers that are not empty."""
        return np.flatnonzero(np.isfinite(self.boxes[0][:, 0]))


@_draw_value.register
def _draw_areas(areas: Areas, layer: int | None) -> Picture:
    return _draw_layers(_make_area_layers(areas, None, [("area", CALM, areas)]), layer)


@_draw_value.register
def _draw_sections(sections: Sections, layer: int | None) -> Picture:
    layers = _make_area_layers(sections.solid, sections.plan, [("section", CALM, sections.solid)])
    return _draw_layers(layers, layer)


@_draw_value.register
def _draw_regions(regions: Regions, layer: int | None) -> Picture:
    named = [(label, colour, getattr(regions, name)) for name, (label, colour) in _REGIONS.items()]
    return _draw_layers(_make_area_layers(regions.inside, regions.plan, named), layer)


def _make_area_layers(
    whole: Areas, plan: LayerPlan | None, named: Sequence[tuple[str, str, Areas]]
) -> _Layers:
    """Return layers that draw named areas; `whole` is the union of the areas."""

    def draw_layer_areas(layer: int, place: Callable[[Float], Float], _scale: float) -> Iterator[Shape]:
        """Draw the areas of a layer with outlines."""
        for name, colour, areas in named:
            rings = [place(ring) for ring in areas.rings(layer)]
            if rings:
                yield Fill(tuple(rings), colour, name)
            for ring in rings:
                yield Line(np.concatenate([ring, ring[:1]]), _OUTLINE, 0.6, name="outline")

    def list_names(layers: Sequence[int]) -> list[tuple[str, str]]:
        """Return the name and colour of each area that occurs in any of the layers."""
        return [(name, colour) for name, colour, areas in named if areas.used[list(layers)].any()]

    kind = "regions" if len(named) > 1 else f"{named[0][0]}s"
    return _Layers(plan, whole.n_layers, whole.boxes(), draw_layer_areas, list_names, kind)


@_draw_value.register
def _draw_toolpaths(paths: Toolpaths, layer: int | None) -> Picture:
    begin, end = paths.ends_of_beads
    owner = paths.path_of_bead
    width = (paths.width[begin] + paths.width[end]) / 2
    beads = _StraightMoves(paths.xy[begin], paths.xy[end], width, paths.role[owner], paths.layer[owner])
    return _draw_layers(beads.make_layers(paths.plan, "toolpaths"), layer)


@_draw_value.register
def _draw_program(program: Program, layer: int | None) -> Picture:
    beads = _StraightMoves(
        program.start[:, :2], program.xyz[:, :2], program.width, program.role, program.layer
    )
    return _draw_layers(beads.make_layers(program.plan, "moves"), layer)


class _StraightMoves(Struct, frozen=True, eq=False):
    """Straight moves from `begin` to `end`, (n, 2) mm, with width, role and ascending layer (n,)."""

    begin: Float
    end: Float
    width: Float
    role: Int
    layer: Int

    def make_layers(self, plan: LayerPlan, title: str) -> _Layers:
        """Return the moves as layers to draw."""
        n_layers = plan.n_layers
        laid = self.role != Role.TRAVEL
        low, high = np.full((n_layers, 2), np.inf), np.full((n_layers, 2), -np.inf)
        for points in (self.begin[laid], self.end[laid]):
            np.minimum.at(low, self.layer[laid], points)
            np.maximum.at(high, self.layer[laid], points)
        return _Layers(plan, n_layers, (low, high), self._draw_moves, self._list_legend_entries, title)

    def _find_layer_range(self, layer: int) -> slice:
        first, last = np.searchsorted(self.layer, [layer, layer + 1]).tolist()
        return slice(first, last)

    def _list_legend_entries(self, layers: Sequence[int]) -> list[tuple[str, str]]:
        roles = np.unique(
            np.concatenate([self.role[self._find_layer_range(layer)] for layer in layers])
        ).tolist()
        return list(
            dict.fromkeys(
                (
                    "Travel" if role == Role.TRAVEL else ROLES[role].type_comment,
                    ROLE_COLOURS.get(Role(role), _TRAVEL),
                )
                for role in roles
            )
        )

    def _draw_moves(self, layer: int, place: Callable[[Float], Float], scale: float) -> Iterator[Shape]:
        """Draw the moves of a layer; consecutive moves of the same role and width become one stroke."""
        selected = self._find_layer_range(layer)
        begin, end, role = self.begin[selected], self.end[selected], self.role[selected]
        if not len(role):
            return
        steps = np.rint(self.width[selected] / _WIDTH_STEP).astype(np.int64)
        first = np.ones(len(role), np.bool_)
        first[1:] = (begin[1:] != end[:-1]).any(axis=1) | (np.diff(role) != 0) | (np.diff(steps) != 0)
        places = np.flatnonzero(first).tolist()
        for low, high in pairwise([*places, len(role)]):
            line = place(np.concatenate([begin[low : low + 1], end[low:high]]))
            role_of_run = Role(int(role[low]))
            if role_of_run == Role.TRAVEL:
                yield Line(line, _TRAVEL, 0.6, (1.5, 2.5), name="travel")
            else:
                wide = float(steps[low]) * _WIDTH_STEP * scale * _DRAWN_SHARE
                yield Strokes((line,), (wide,), ROLE_COLOURS.get(role_of_run, CALM), role_of_run.name.lower())


# Sheets


def _draw_layers(layers: _Layers, layer: int | None) -> Picture:
    """Draw one layer, or several side by side, with a legend."""
    used = layers.find_filled_layers()
    if layer is not None:
        if not 0 <= layer < layers.count:
            raise UsageError(
                f"layer {layer + 1} does not exist", remedy=f"Choose a layer from 1 to {layers.count}"
            )
        chosen = [layer] if layer in used else []
    else:
        shown = np.linspace(0, len(used) - 1, min(len(used), _MAX_SHOWN)).round().astype(int)
        chosen = used[shown].tolist()
    title = f"{layers.title}: " + (
        _format_caption(layers, layer) if layer is not None else f"{len(chosen)} of {layers.count} layers"
    )
    if not chosen:
        return _draw_note(f"{title}: nothing there", title)
    low, high = layers.boxes[0][chosen].min(axis=0) - 1, layers.boxes[1][chosen].max(axis=0) + 1
    columns = min(len(chosen), _MAX_COLUMNS)
    side = _SINGLE_SIZE if columns == 1 else (_WIDE - 16) / columns - 8
    scale = side / float((high - low).max())
    wide, tall = ((high - low) * scale).tolist()
    column = max(wide, _MIN_COLUMN_WIDTH) if columns > 1 else wide
    width = max(16 + columns * (column + 8), estimate_text_width(title, _LETTERS, bold=True) + 24, 320)
    legend, top = _draw_legend(layers.names(chosen), width)
    shapes: list[Shape] = [Text(8, 24, title, _LETTERS, bold=True), *legend]
    captions = [wrap_text(_format_caption(layers, number), _SMALLEST, column) for number in chosen]
    head = 4 + _SMALL_LINE * max(map(len, captions)) if len(chosen) > 1 else 4
    for k, number in enumerate(chosen):
        x, y = 8 + (k % columns) * (column + 8), top + (k // columns) * (tall + head + 8)
        if len(chosen) > 1:
            for row, line in enumerate(captions[k]):
                shapes.append(Text(x, y + 12 + row * _SMALL_LINE, line, _SMALLEST, _SOFT))
        shift = np.array([x - low[0] * scale, y + head + high[1] * scale])
        shapes += layers.shapes(number, _make_pixel_mapping(shift, scale), scale)
    rows = -(-len(chosen) // columns)
    return Picture(round(width), round(top + rows * (tall + head + 8) + 4), tuple(shapes), title)


def _make_pixel_mapping(shift: Float, scale: float) -> Callable[[Float], Float]:
    """Return a function that maps points from mm to px; y points up on the bed and down in the picture."""
    return lambda points: np.asarray(points * np.array([scale, -scale]) + shift)


def _format_caption(layers: _Layers, index: int) -> str:
    """Return the caption of a layer: its number, from 1, its z and its height."""
    if layers.plan is None:
        return f"layer {index + 1}"
    return f"layer {index + 1}, z {layers.plan.top[index]:.4g} mm, {layers.plan.height[index]:.3g} mm high"


def _draw_legend(entries: Sequence[tuple[str, str]], width: float) -> tuple[list[Shape], float]:
    """Draw the legend in rows under the title; return its shapes and the y at which it ends, px."""
    shapes: list[Shape] = []
    x, y = 8.0, float(_HEAD)
    for name, colour in entries:
        needed = 34 + estimate_text_width(name, _SMALL + 1)
        if x + needed > width and x > 8:
            x, y = 8.0, y + _ROW
        shapes += [Box(x, y, 16, 14, colour, name="legend"), Text(x + 22, y + 12, name, _SMALL + 1)]
        x += needed
    return shapes, y + _ROW + 4
