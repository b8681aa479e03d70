"""Draw the stack of layers in 3D, seen from above at an angle.

Seen from above, no layer hides any part of a higher layer, and no wall of a layer hides its top face. So layers are
painted from the bed up. In each layer, the walls that face the viewer are painted first, from far to near, and the top
face last. This is the painter's algorithm after Newell, Newell and Sancha, "A solution to the hidden surface problem",
1972; faces need not be split here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from math import cos, radians, sin
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Fill, Line, Shape
from printer_slicer.drawing.colours import darken
from printer_slicer.drawing.frame import Panel, choose_axis_marks
from printer_slicer.geometry import simplify
from printer_slicer.model import Areas, Sections
from printer_slicer.values import Struct

__all__ = ["draw_stack"]

_TURN: Final = radians(-32)  # rotation of the part about z
_DOWN: Final = radians(28)  # angle of the line of sight below the horizontal
_LIGHT: Final = (-0.62, -0.78)  # direction of the light in the rotated plane, from the viewer's left
# Brightness of walls facing away from the light, of walls towards it, and of top faces.
_DARKEST, _BRIGHTEST, _TOP = 0.58, 0.9, 1.0
_SHADES: Final = 12  # steps from the darkest to the brightest wall
_RESOLUTION: Final = 0.15  # px, tolerance of simplified outlines
_MIN_WALL: Final = 0.9  # px; thinner layers are drawn together
_OVERLAP: Final = 0.35  # px by which walls overlap the walls below, so that no gap is visible between them
_BORDER: Final = 0.1  # width of the bed around the part, as a fraction of the part's width
_BED, _GRID = "#eef1f4", "#d3d9df"


class _View(Struct, frozen=True):
    """Projection of the part into the picture: px per mm, and position of the middle of the part's base."""

    scale: float
    x: float
    y: float

    def to_pixels(self, rotated: Float, z: Float | float) -> Float:
        """Convert points (n, 2) of the rotated plane at height z from mm to px."""
        x = self.x + self.scale * rotated[:, 0]
        y = self.y - self.scale * (rotated[:, 1] * sin(_DOWN) + np.asarray(z) * cos(_DOWN))
        return np.column_stack([x, y])


def draw_stack(stacks: Sequence[tuple[Sections, Sequence[str]]], panel: Panel) -> tuple[list[Shape], float]:
    """Draw the layers as prisms on the bed, each in its colour, as large as possible.

    Args:
        stacks: the solid areas of each stack, whose plan gives the layers, with the colour of each layer.
        panel: where to draw.

    Returns:
        The shapes, and the step of the bed's grid, mm; no shapes and 0 for an empty part.
    """
    xy = np.concatenate([one.solid.xy for one, _ in stacks])
    if not len(xy):
        return [], 0.0
    low, high = xy.min(axis=0), xy.max(axis=0)
    middle, reach = (low + high) / 2, max(float((high - low).max()), 1e-6)
    step = float(choose_axis_marks(1.2 * reach, 8)[1])
    half = (high - low) / 2 + _BORDER * reach
    bed = _rotate(half * [(-1, -1), (1, -1), (1, 1), (-1, 1)])
    top = np.concatenate([one.plan.top[one.solid.point_layer] for one, _ in stacks])
    view = _fit_view(bed, _rotate(xy - middle), top, panel)
    shapes = list(_draw_bed(half, step, view))
    prisms = [prism for one, colours in stacks for prism in _list_prisms(one, colours, middle, view.scale)]
    # Seen from above, what is farther away is hidden by what is higher.
    for rings, z, colour in sorted(prisms, key=lambda prism: prism[1][1]):
        shapes += _draw_prism(rings, view, z, colour)
    return shapes, step


def _list_prisms(
    sections: Sections, colours: Sequence[str], middle: Float, scale: float
) -> Iterator[tuple[Areas, tuple[float, float], str]]:
    """Yield rotated areas, bottom and top in mm, and colour of the visible layers of a stack."""
    drawn, bottom, top = _reduce_to_visible(sections, scale)
    for layer, rings in _split_layers(drawn, middle):
        yield rings, (float(bottom[layer]), float(top[layer])), colours[layer]


def _rotate(xy: Float) -> Float:
    """Rotate points (n, 2) to the view: x to the right, y away from the viewer."""
    return np.asarray(xy @ np.array([[cos(_TURN), sin(_TURN)], [-sin(_TURN), cos(_TURN)]]))


def _fit_view(bed: Float, rotated: Float, top: Float, panel: Panel) -> _View:
    """Return the largest view with bed and part at the bottom of the panel."""
    flat = _View(1.0, 0.0, 0.0)
    seen = np.concatenate([flat.to_pixels(bed, 0.0), flat.to_pixels(rotated, top)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall = np.maximum(high - low, 1e-9).tolist()
    scale = min(panel.width / wide, panel.height / tall)
    middle, lowest = float(low[0] + high[0]) / 2, float(high[1])
    return _View(scale, (panel.left + panel.right) / 2 - scale * middle, panel.bottom - scale * lowest)


def _draw_bed(half: Float, step: float, view: _View) -> Iterator[Shape]:
    """Draw the bed under the part, `half` (2,) mm to each side of its middle, with lines every `step` mm."""
    yield Fill((view.to_pixels(_rotate(half * [(-1, -1), (1, -1), (1, 1), (-1, 1)]), 0.0),), _BED, "bed")
    for axis in (0, 1):
        count = int(half[axis] / step)
        for at in (np.arange(-count, count + 1) * step).tolist():
            ends = half * [(-1, -1), (1, 1)]
            ends[:, axis] = at
            yield Line(view.to_pixels(_rotate(ends), 0.0), _GRID)


def _reduce_to_visible(sections: Sections, scale: float) -> tuple[Areas, Float, Float]:
    """Reduce layers and points to the visible ones; also return bottom and top (L,) of the layers, mm.

    Of layers too thin to see, the one with the largest area represents its neighbours.
    """
    solid, plan = sections.solid, sections.plan
    group = _group_layers(plan.top, _MIN_WALL / (scale * cos(_DOWN)))
    order = np.lexsort((-solid.area(), group))
    keep = np.zeros(plan.n_layers, np.bool_)
    keep[order[np.diff(group[order], prepend=-1) > 0]] = True
    first, last = np.searchsorted(group, group), np.searchsorted(group, group, side="right") - 1
    kept = solid.of_layers(keep)
    return simplify(kept, _RESOLUTION / scale), plan.bottom[first], plan.top[last]


def _group_layers(top: Float, min_height: float) -> Int:
    """Return the group (L,) of each layer; layers of a group, at least `min_height` mm high, are drawn as one."""
    group, number, bottom = [], 0, 0.0
    for z in top.tolist():
        group.append(number)
        if z - bottom >= min_height:
            number, bottom = number + 1, z
    return np.array(group, np.int64)


def _split_layers(areas: Areas, middle: Float) -> Iterator[tuple[int, Areas]]:
    """Yield index and rotated area of each layer that is not empty, from the bed up."""
    rotated = Areas(_rotate(areas.xy - middle), areas.ring_start, areas.ring_layer, areas.n_layers)
    for layer in np.flatnonzero(rotated.used).tolist():
        yield layer, rotated.select(rotated.ring_layer == layer)


def _draw_prism(rings: Areas, view: _View, z: tuple[float, float], colour: str) -> Iterator[Shape]:
    """Draw a layer: the walls that face the viewer from far to near, then the top face."""
    bottom, top = z
    begin, count, shade = _find_walls(rings)
    upper = view.to_pixels(rings.xy, top)
    down = np.array([0.0, view.scale * (top - bottom) * cos(_DOWN) + _OVERLAP])
    following = rings.following
    for light, several in groupby(zip(begin, count, shade, strict=True), lambda wall: wall[2]):
        strips = []
        for first, length, _ in several:
            edge = np.concatenate([upper[first : first + length], upper[following[first + length - 1]][None]])
            strips.append(np.concatenate([edge, edge[::-1] + down]))
        yield Fill(
            tuple(strips), darken(colour, _DARKEST + light / _SHADES * (_BRIGHTEST - _DARKEST)), "wall"
        )
    faces = tuple(upper[a:b] for a, b in zip(rings.ring_start[:-1], rings.ring_start[1:], strict=True))
    yield Fill(faces, darken(colour, _TOP), "top")


def _find_walls(rings: Areas) -> tuple[list[int], list[int], list[int]]:
    """Return first point, number of edges and brightness of the walls that face the viewer, from far to near.

    A wall is a run of edges of one ring with the same brightness. The solid is to the left of its edges, so a wall
    faces the viewer, who looks along y, if its edges lead to the right.
    """
    following = rings.following
    step = rings.xy[following] - rings.xy
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-300)
    toward_light = (step[:, 1] * _LIGHT[0] - step[:, 0] * _LIGHT[1]) / length
    light = np.where(step[:, 0] > 0, np.rint(np.clip(toward_light, 0, 1) * _SHADES), -1).astype(np.int64)
    ring = rings.point_ring
    begin = np.flatnonzero((np.diff(light, prepend=-2) != 0) | (np.diff(ring, prepend=-1) != 0))
    count = np.diff(np.append(begin, len(light)))
    away = np.add.reduceat(rings.xy[:, 1] + rings.xy[following, 1], begin) / (2 * count)
    order = np.argsort(-away, kind="stable")
    order = order[light[begin[order]] >= 0]
    return begin[order].tolist(), count[order].tolist(), light[begin[order]].tolist()
