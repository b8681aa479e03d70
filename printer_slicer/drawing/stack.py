"""The stack of layers in 3D, seen from above at an angle.

Seen from above, a layer cannot hide anything of a higher one, and in a layer nothing can hide the top face. So painting
the layers from the bed up, of each the walls that face the viewer from far to near and then the top face, shows every
layer as the prism that is printed. (The painter's algorithm, after Newell,
Newell and Sancha, "A solution to the hidden surface problem", 1972, needs no splitting here.)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import cos, radians, sin
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Fill, Line, Shape
from printer_slicer.drawing.colours import shaded
from printer_slicer.drawing.frame import Panel, marks
from printer_slicer.geometry import simplify
from printer_slicer.model import Areas, Sections

__all__ = ["draw_stack"]

_TURN: Final = radians(-32)  # the part, about z
_DOWN: Final = radians(28)  # the line of sight, from level
_LIGHT: Final = (-0.62, -0.78)  # where light comes from, in the turned plane: the viewer's left
_DARKEST, _BRIGHTEST, _TOP = (
    0.58,
    0.9,
    1.0,
)  # light on walls turned away from it, towards it, and on top faces
_SHADES: Final = 12  # steps from the darkest to the brightest wall
_RESOLUTION: Final = 0.15  # px; what is smaller is not drawn
_LEAST_WALL: Final = 0.9  # px; thinner layers are drawn together
_OVERLAP: Final = (
    0.35  # px that walls reach down over what is below, or its colour would shine through between them
)
_BORDER: Final = 0.1  # of the part's width is bed around it
_BED, _GRID = "#eef1f4", "#d3d9df"


@dataclass(frozen=True, slots=True)
class _View:
    """From the part to the picture: px per mm, and where the middle of the part's foot is."""

    scale: float
    x: float
    y: float

    def place(self, turned: Float, z: Float | float) -> Float:
        """(n, 2) px of points (n, 2) mm in the turned plane at height z, mm."""
        x = self.x + self.scale * turned[:, 0]
        y = self.y - self.scale * (turned[:, 1] * sin(_DOWN) + np.asarray(z) * cos(_DOWN))
        return np.column_stack([x, y])


def draw_stack(sections: Sections, colours: Sequence[str], panel: Panel) -> tuple[list[Shape], float]:
    """The layers as prisms on the bed, each in its colour, as large as fits.

    Args:
        sections: the part's solid areas; their plan gives the layers.
        colours: one per layer.
        panel: where to draw.

    Returns:
        The shapes, and the width of the bed's grid, mm; nothing and 0 if there is nothing to see.
    """
    solid, plan = sections.solid, sections.plan
    if solid.n_rings == 0:
        return [], 0.0
    low, high = solid.xy.min(axis=0), solid.xy.max(axis=0)
    middle, reach = (low + high) / 2, max(float((high - low).max()), 1e-6)
    step = float(marks(1.2 * reach, 8)[1])
    half = (high - low) / 2 + _BORDER * reach
    bed = _turned(half * [(-1, -1), (1, -1), (1, 1), (-1, 1)])
    turned = _turned(solid.xy - middle)
    view = _fitted(bed, turned, plan.top[solid.point_layer], panel)
    shapes = list(_bed(half, step, view))
    drawn, bottom, top = _resolved(sections, view.scale)
    for layer, rings in _layers(drawn, middle):
        shapes += _prism(rings, view, (float(bottom[layer]), float(top[layer])), colours[layer])
    return shapes, step


def _turned(xy: Float) -> Float:
    """Points as the viewer has them: x to the right, y away."""
    return np.asarray(xy @ np.array([[cos(_TURN), sin(_TURN)], [-sin(_TURN), cos(_TURN)]]))


def _fitted(bed: Float, turned: Float, top: Float, panel: Panel) -> _View:
    """The largest view that shows bed and part in the panel, at its foot."""
    flat = _View(1.0, 0.0, 0.0)
    seen = np.concatenate([flat.place(bed, 0.0), flat.place(turned, top)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall = np.maximum(high - low, 1e-9).tolist()
    scale = min(panel.width / wide, panel.height / tall)
    middle, lowest = float(low[0] + high[0]) / 2, float(high[1])
    return _View(scale, (panel.left + panel.right) / 2 - scale * middle, panel.bottom - scale * lowest)


def _bed(half: Float, step: float, view: _View) -> Iterator[Shape]:
    """The bed under the part, `half` (2,) mm to each side of its middle, with lines every `step` mm."""
    yield Fill((view.place(_turned(half * [(-1, -1), (1, -1), (1, 1), (-1, 1)]), 0.0),), _BED, "bed")
    for axis in (0, 1):
        count = int(half[axis] / step)
        for at in (np.arange(-count, count + 1) * step).tolist():
            ends = half * [(-1, -1), (1, 1)]
            ends[:, axis] = at
            yield Line(view.place(_turned(ends), 0.0), _GRID)


def _resolved(sections: Sections, scale: float) -> tuple[Areas, Float, Float]:
    """The areas with no more layers and points than can be seen, and (L,) where the layers kept begin and end, mm.

    Of layers too thin to see, the one with the largest area stands for itself and its neighbours.
    """
    solid, plan = sections.solid, sections.plan
    group = _groups(plan.top, _LEAST_WALL / (scale * cos(_DOWN)))
    order = np.lexsort((-solid.area(), group))
    keep = np.zeros(plan.n_layers, np.bool_)
    keep[order[np.diff(group[order], prepend=-1) > 0]] = True
    first, last = np.searchsorted(group, group), np.searchsorted(group, group, side="right") - 1
    kept = solid.of_layers(keep)
    return simplify(kept, _RESOLUTION / scale), plan.bottom[first], plan.top[last]


def _groups(top: Float, least: float) -> Int:
    """(L,) layers that are drawn as one have the same number: as few as it takes to be `least` mm high."""
    group, number, bottom = [], 0, 0.0
    for z in top.tolist():
        group.append(number)
        if z - bottom >= least:
            number, bottom = number + 1, z
    return np.array(group, np.int64)


def _layers(areas: Areas, middle: Float) -> Iterator[tuple[int, Areas]]:
    """Each layer that has an area, from the bed up, as the viewer has it."""
    turned = Areas(_turned(areas.xy - middle), areas.ring_start, areas.ring_layer, areas.n_layers)
    for layer in np.flatnonzero(turned.used).tolist():
        yield layer, turned.select(turned.ring_layer == layer)


def _prism(rings: Areas, view: _View, z: tuple[float, float], colour: str) -> Iterator[Shape]:
    """Walls that face the viewer from far to near, then the top face."""
    bottom, top = z
    begin, count, shade = _walls(rings)
    upper = view.place(rings.xy, top)
    down = np.array([0.0, view.scale * (top - bottom) * cos(_DOWN) + _OVERLAP])
    following = rings.following
    for light, several in groupby(zip(begin, count, shade, strict=True), lambda wall: wall[2]):
        strips = []
        for first, length, _ in several:
            edge = np.concatenate([upper[first : first + length], upper[following[first + length - 1]][None]])
            strips.append(np.concatenate([edge, edge[::-1] + down]))
        yield Fill(
            tuple(strips), shaded(colour, _DARKEST + light / _SHADES * (_BRIGHTEST - _DARKEST)), "wall"
        )
    faces = tuple(upper[a:b] for a, b in zip(rings.ring_start[:-1], rings.ring_start[1:], strict=True))
    yield Fill(faces, shaded(colour, _TOP), "top")


def _walls(rings: Areas) -> tuple[list[int], list[int], list[int]]:
    """First point, number of edges and light of the walls that face the viewer, from far to near.

    A wall is a run of edges of one ring in the same light. With the solid to the left of its edges, a wall faces the
    viewer, who looks along y, if its edges lead to the right.
    """
    following = rings.following
    step = rings.xy[following] - rings.xy
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-300)
    toward = (step[:, 1] * _LIGHT[0] - step[:, 0] * _LIGHT[1]) / length
    light = np.where(step[:, 0] > 0, np.rint(np.clip(toward, 0, 1) * _SHADES), -1).astype(np.int64)
    ring = rings.point_ring
    begin = np.flatnonzero((np.diff(light, prepend=-2) != 0) | (np.diff(ring, prepend=-1) != 0))
    count = np.diff(np.append(begin, len(light)))
    away = np.add.reduceat(rings.xy[:, 1] + rings.xy[following, 1], begin) / (2 * count)
    order = np.argsort(-away, kind="stable")
    order = order[light[begin[order]] >= 0]
    return begin[order].tolist(), count[order].tolist(), light[begin[order]].tolist()
