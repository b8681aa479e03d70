"""Every value on the way from the part to its moves, drawn: plans over z, the others layer by layer from above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import singledispatch
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Raster, Shape, Strokes, Text, text_width
from printer_slicer.drawing.card import card
from printer_slicer.drawing.colours import CALM, ROLE_COLOURS, height_colours
from printer_slicer.drawing.frame import marks
from printer_slicer.errors import UsageError
from printer_slicer.model import Areas, LayerPlan, Mesh, Program, Regions, Sections, Toolpaths
from printer_slicer.repr_svg import Summary, SvgRepr
from printer_slicer.roles import Role
from printer_slicer.surface import Certificate
from printer_slicer.texts import describe_type
from printer_slicer.thumbnails import render

__all__ = ["draw"]

_WIDE: Final = 760  # px
_ALONE: Final = 560  # px, the longer side of a layer that is drawn alone
_SHOWN, _IN_A_ROW = 6, 3  # layers where none is chosen
_HEAD, _ROW, _LETTERS, _SMALL = 34, 22, 15, 12  # px
_SEEN: Final = 0.92  # of a bead's width is drawn, so that neighbours stay apart
_STEP: Final = 0.05  # mm: beads whose widths differ by less are drawn as one
_SOFT, _OUTLINE, _TRAVEL = "#5b6472", "#222222", "#c2188b"
_REGIONS: Final = {
    "bottom_skin": ROLE_COLOURS[Role.BOTTOM_SOLID_INFILL],
    "bridge": ROLE_COLOURS[Role.BRIDGE],
    "internal_bridge": ROLE_COLOURS[Role.INTERNAL_BRIDGE],
    "top_skin": ROLE_COLOURS[Role.TOP_SOLID_INFILL],
    "solid": ROLE_COLOURS[Role.SOLID_INFILL],
    "sparse": ROLE_COLOURS[Role.INTERNAL_INFILL],
}


def draw(value: object, layer: int | None = None) -> Picture:
    """A picture of a mesh, a plan, a certificate, or layers of sections, walls, regions, toolpaths, moves or areas.

    Args:
        value: what to draw; of all stages, and of a job that was sliced here, the program is drawn.
        layer: index of the one to be drawn, from 0; None: six from the bottom to the top. Meshes, plans and
            certificates are drawn whole.

    Raises:
        UsageError: there are no pictures of such values, or it has no such layer.
    """
    return _picture(value.drawable if isinstance(value, SvgRepr) else value, layer)


@singledispatch
def _picture(value: object, _layer: int | None) -> Picture:
    raise UsageError(
        f"there is no picture of {describe_type(value)}",
        remedy="draw a mesh, or what is made of it: stages.plan, stages.sections, stages.program",
    )


# Meshes


@_picture.register
def _mesh(part: Mesh, _layer: int | None) -> Picture:
    """As it stands, seen from above and from the front left."""
    if not part.n_facets:
        return Picture(400, 40, (Text(8, 24, "a mesh without facets", _LETTERS),), part.name)
    x, y, z = part.size.tolist()
    title = f"{part.name}: {part.n_facets} facets, {x:.4g} x {y:.4g} x {z:.4g} mm"
    seen = Raster(8, _HEAD, _ALONE, _ALONE, render(part, 2 * _ALONE, 2 * _ALONE))
    return Picture(_ALONE + 16, _ALONE + _HEAD + 8, (Text(8, 24, title, _LETTERS, bold=True), seen), title)


# What has no shape


@_picture.register
def _card(told: Summary, _layer: int | None) -> Picture:
    return card(told.title, told.facts, told.problems)


# Plans


@_picture.register
def _plan(plan: LayerPlan, _layer: int | None) -> Picture:
    """Bars as high as their layers stand, as long as they are thick."""
    title = f"{plan.n_layers} layers" + (f", planner {plan.planner}" if plan.planner else "")
    return _bars(plan, plan.height, title, "layer height, mm")


@_picture.register
def _certificate(certificate: Certificate, _layer: int | None) -> Picture:
    """Bars as high as their layers stand, as long as what is proven of them."""
    title = f"{certificate.plan.n_layers} layers, nothing wrong is farther than {certificate.max_error:.4g} mm off"
    return _bars(certificate.plan, certificate.bound, title, "error bound, mm")


def _bars(plan: LayerPlan, lengths: Float, title: str, what: str) -> Picture:
    """A bar for each layer, in the colour of its height."""
    if not plan.n_layers:
        return Picture(400, 40, (Text(8, 24, "a plan without layers", _LETTERS),), title)
    heights, total = plan.height, float(plan.top[-1])
    left, right, top, tall = 56.0, _WIDE - 200.0, 50.0, 360.0
    longest = float(lengths.max()) or 1.0
    across, down = (right - left) / longest, tall / total
    shapes: list[Shape] = [Text(8, 24, title, _LETTERS, bold=True)]
    for z in marks(total, 6).tolist():
        y = top + tall - z * down
        shapes += [Line(np.array([(left - 6, y), (right, y)]), "#dddddd")]
        shapes += [Text(left - 10, y + 4, f"{z:g}", _SMALL, _SOFT, "end")]
    for length in marks(longest, 4).tolist()[1:]:
        x = left + length * across
        shapes += [Line(np.array([(x, top), (x, top + tall)]), "#dddddd")]
        shapes += [Text(x, top + tall + 18, f"{length:g}", _SMALL, _SOFT, "middle")]
    colours = height_colours(heights)
    rows = zip(plan.bottom.tolist(), heights.tolist(), lengths.tolist(), colours, strict=True)
    for bottom, high, length, colour in rows:
        y, thick = top + tall - (bottom + high) * down, high * down
        # A gap between layers that are thick enough to be told apart.
        shapes.append(Box(left, y, length * across, thick * (0.85 if thick > 3 else 1), colour, name="layer"))
    shapes += [Text(left - 10, top - 10, "z mm", _SMALL, _SOFT, "end")]
    shapes += [Text((left + right) / 2, top + tall + 36, what, _SMALL, _SOFT, "middle")]
    return Picture(_WIDE, round(top + tall + 50), (*shapes, *_counts(plan, colours, right + 24, top)), title)


def _counts(plan: LayerPlan, colours: Sequence[str], x: float, y: float) -> Iterator[Shape]:
    """How many layers of each height there are; of many heights, some."""
    values, first, counts = np.unique(plan.height, return_index=True, return_counts=True)
    some = np.unique(np.linspace(0, len(values) - 1, min(len(values), 12)).round().astype(int))
    for k, index in enumerate(some.tolist()):
        yield Box(x, y + k * _ROW, 16, 14, colours[first[index]], name="legend")
        yield Text(x + 24, y + k * _ROW + 12, f"{counts[index]} x {values[index]:.4g} mm", _SMALL + 1)


# Layers


@dataclass(frozen=True, slots=True)
class _Layers:
    """What layers are drawn from.

    Attributes:
        plan: the layers, if their heights are known.
        count: how many there are.
        boxes: (L, 2) lowest and highest corner of each; infinite, inside out, where it is empty.
        shapes: layer and how places (n, 2), mm, become px, with px for each mm -> what there is to see.
        names: layers -> name and colour of what is in them.
        title: of the whole.
    """

    plan: LayerPlan | None
    count: int
    boxes: tuple[Float, Float]
    shapes: Callable[[int, Callable[[Float], Float], float], Iterator[Shape]]
    names: Callable[[Sequence[int]], list[tuple[str, str]]]
    title: str

    def used(self) -> Int:
        """Layers with anything in them."""
        return np.flatnonzero(np.isfinite(self.boxes[0][:, 0]))


@_picture.register
def _areas(areas: Areas, layer: int | None) -> Picture:
    return _sheet(_of_areas(areas, None, [("area", CALM, areas)]), layer)


@_picture.register
def _sections(sections: Sections, layer: int | None) -> Picture:
    layers = _of_areas(sections.solid, sections.plan, [("section", CALM, sections.solid)])
    return _sheet(layers, layer)


@_picture.register
def _regions(regions: Regions, layer: int | None) -> Picture:
    named = [(name.replace("_", " "), colour, getattr(regions, name)) for name, colour in _REGIONS.items()]
    return _sheet(_of_areas(regions.inside, regions.plan, named), layer)


def _of_areas(whole: Areas, plan: LayerPlan | None, named: Sequence[tuple[str, str, Areas]]) -> _Layers:
    """Layers of areas by name; `whole` is all of them together."""

    def shapes(layer: int, place: Callable[[Float], Float], _scale: float) -> Iterator[Shape]:
        """Every area of a layer, and a fine line around it."""
        for name, colour, areas in named:
            rings = [place(ring) for ring in areas.rings(layer)]
            if rings:
                yield Fill(tuple(rings), colour, name)
            for ring in rings:
                yield Line(np.concatenate([ring, ring[:1]]), _OUTLINE, 0.6, name="outline")

    def names(layers: Sequence[int]) -> list[tuple[str, str]]:
        """Those that any of the layers has."""
        return [(name, colour) for name, colour, areas in named if areas.used[list(layers)].any()]

    kind = "regions" if len(named) > 1 else f"{named[0][0]}s"
    return _Layers(plan, whole.n_layers, whole.boxes(), shapes, names, kind)


@_picture.register
def _toolpaths(paths: Toolpaths, layer: int | None) -> Picture:
    begin, end = paths.ends_of_beads
    owner = np.repeat(np.arange(paths.n_paths), paths.beads_of_each)
    width = (paths.width[begin] + paths.width[end]) / 2
    beads = _Beads(paths.xy[begin], paths.xy[end], width, paths.role[owner], paths.layer[owner])
    return _sheet(beads.layers(paths.plan, "toolpaths"), layer)


@_picture.register
def _program(program: Program, layer: int | None) -> Picture:
    beads = _Beads(program.start[:, :2], program.xyz[:, :2], program.width, program.role, program.layer)
    return _sheet(beads.layers(program.plan, "moves"), layer)


@dataclass(frozen=True, slots=True, eq=False)
class _Beads:
    """Straight lines from `begin` to `end`, (n, 2) mm, on ascending layers (n,), with a width and a role each (n,)."""

    begin: Float
    end: Float
    width: Float
    role: Int
    layer: Int

    def layers(self, plan: LayerPlan, title: str) -> _Layers:
        """As something to be drawn."""
        n_layers = plan.n_layers
        laid = self.role != Role.TRAVEL
        low, high = np.full((n_layers, 2), np.inf), np.full((n_layers, 2), -np.inf)
        for points in (self.begin[laid], self.end[laid]):
            np.minimum.at(low, self.layer[laid], points)
            np.maximum.at(high, self.layer[laid], points)
        return _Layers(plan, n_layers, (low, high), self._shapes, self._names, title)

    def _of(self, layer: int) -> slice:
        first, last = np.searchsorted(self.layer, [layer, layer + 1]).tolist()
        return slice(first, last)

    def _names(self, layers: Sequence[int]) -> list[tuple[str, str]]:
        roles = np.unique(np.concatenate([self.role[self._of(layer)] for layer in layers])).tolist()
        return [
            (Role(role).name.lower().replace("_", " "), ROLE_COLOURS.get(Role(role), _TRAVEL))
            for role in roles
        ]

    def _shapes(self, layer: int, place: Callable[[Float], Float], scale: float) -> Iterator[Shape]:
        """Lines that follow each other in one role and one width are one stroke."""
        own = self._of(layer)
        begin, end, role = self.begin[own], self.end[own], self.role[own]
        if not len(role):
            return
        steps = np.rint(self.width[own] / _STEP).astype(np.int64)
        first = np.ones(len(role), np.bool_)
        first[1:] = (begin[1:] != end[:-1]).any(axis=1) | (np.diff(role) != 0) | (np.diff(steps) != 0)
        places = np.flatnonzero(first).tolist()
        for low, high in pairwise([*places, len(role)]):
            line = place(np.concatenate([begin[low : low + 1], end[low:high]]))
            why = Role(int(role[low]))
            if why == Role.TRAVEL:
                yield Line(line, _TRAVEL, 0.6, (1.5, 2.5), name="travel")
            else:
                wide = float(steps[low]) * _STEP * scale * _SEEN
                yield Strokes((line,), (wide,), ROLE_COLOURS.get(why, CALM), why.name.lower())


# Sheets


def _sheet(layers: _Layers, layer: int | None) -> Picture:
    """One layer, or several of them side by side, with what the colours mean."""
    used = layers.used()
    if layer is not None:
        if not 0 <= layer < layers.count:
            raise UsageError(
                f"layer {layer}: there is none", remedy=f"there are layers 0 to {layers.count - 1}"
            )
        chosen = [layer] if layer in used else []
    else:
        some = np.linspace(0, len(used) - 1, min(len(used), _SHOWN)).round().astype(int)
        chosen = used[some].tolist()
    title = f"{layers.title}: " + (
        _told(layers, layer) if layer is not None else f"{len(chosen)} of {layers.count} layers"
    )
    if not chosen:
        return Picture(400, 40, (Text(8, 24, f"{title}: nothing there", _LETTERS),), title)
    low, high = layers.boxes[0][chosen].min(axis=0) - 1, layers.boxes[1][chosen].max(axis=0) + 1
    columns = min(len(chosen), _IN_A_ROW)
    side = _ALONE if columns == 1 else (_WIDE - 16) / columns - 8
    scale = side / float((high - low).max())
    wide, tall = ((high - low) * scale).tolist()
    width = max(16 + columns * (wide + 8), text_width(title, _LETTERS) + 16, 320)
    legend, top = _legend(layers.names(chosen), width)
    shapes: list[Shape] = [Text(8, 24, title, _LETTERS, bold=True), *legend]
    named = 18 if len(chosen) > 1 else 4
    for k, number in enumerate(chosen):
        x, y = 8 + (k % columns) * (wide + 8), top + (k // columns) * (tall + named + 8)
        if len(chosen) > 1:
            shapes.append(Text(x, y + 12, _told(layers, number), _SMALL, _SOFT))
        shift = np.array([x - low[0] * scale, y + named + high[1] * scale])
        shapes += layers.shapes(number, _placed(shift, scale), scale)
    rows = -(-len(chosen) // columns)
    return Picture(round(width), round(top + rows * (tall + named + 8) + 4), tuple(shapes), title)


def _placed(shift: Float, scale: float) -> Callable[[Float], Float]:
    """From mm to px; y grows away from the viewer on the bed, downward in the picture."""
    return lambda points: np.asarray(points * np.array([scale, -scale]) + shift)


def _told(layers: _Layers, number: int) -> str:
    """A layer's number, and where it is."""
    if layers.plan is None:
        return f"layer {number}"
    return f"layer {number}, z {layers.plan.top[number]:.4g} mm, {layers.plan.height[number]:.3g} mm high"


def _legend(entries: Sequence[tuple[str, str]], width: float) -> tuple[list[Shape], float]:
    """What the colours mean, in rows under the title, and where these end, px."""
    shapes: list[Shape] = []
    x, y = 8.0, float(_HEAD)
    for name, colour in entries:
        needs = 34 + text_width(name, _SMALL + 1)
        if x + needs > width and x > 8:
            x, y = 8.0, y + _ROW
        shapes += [Box(x, y, 16, 14, colour, name="legend"), Text(x + 22, y + 12, name, _SMALL + 1)]
        x += needs
    return shapes, y + _ROW + 4
