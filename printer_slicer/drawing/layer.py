"""Draw one layer of a program from above."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Box, Line, Picture, Shape, Text, estimate_text_width
from printer_slicer.drawing.colours import ROLE_COLOURS
from printer_slicer.model import Program
from printer_slicer.roles import ROLES, Role

__all__ = ["draw_layer", "draw_program_layer"]

_SIZE: Final = 800  # px, longer side of the drawn layer
_BORDER: Final = 2.0  # mm around the drawn layer
_HEAD, _ROW = 34, 26  # px for the title, and for each row of the legend
_LETTERS: Final = 15  # px
_DRAWN_SHARE: Final = 0.92  # fraction of the extrusion width that is drawn, to leave gaps between neighbours
_OTHER_COLOUR: Final = "#4477aa"


def draw_layer(program: Program, layer: int) -> str:
    """Draw one layer as an SVG document; see `draw_program_layer`."""
    return draw_program_layer(program, layer).svg()


def draw_program_layer(program: Program, layer: int) -> Picture:
    """Draw the extrusions of one layer with their width and the colour of their role; travels are dotted.

    Raises:
        ValueError: the program has no layer with this index.
    """
    if not 0 <= layer < program.plan.n_layers:
        raise ValueError(f"layer {layer} is not in the program, which has {program.plan.n_layers} layers")
    title = f"layer {layer + 1} of {program.plan.n_layers}, z {program.plan.top[layer]:g} mm"
    member = program.layer == layer
    if not member.any():
        note = f"{title}: no extrusion"
        return Picture(
            max(400, round(estimate_text_width(note, _LETTERS)) + 16),
            40,
            (Text(8, 24, note, _LETTERS),),
            title,
        )
    start, end = program.start[member][:, :2], program.xyz[member][:, :2]
    role, width = program.role[member], program.width[member]
    beads = role != Role.TRAVEL
    corners = np.concatenate([start[beads], end[beads]]) if beads.any() else np.concatenate([start, end])
    low, high = corners.min(axis=0) - _BORDER, corners.max(axis=0) + _BORDER
    scale = _SIZE / float((high - low).max())
    wide = max(float(high[0] - low[0]) * scale, estimate_text_width(title, _LETTERS) + 16)
    legend, foot = _draw_legend(role, wide)
    tall = _HEAD + foot + float(high[1] - low[1]) * scale
    # y points up on the bed and down in the picture.
    flip, shift = np.array([scale, -scale]), np.array([-low[0] * scale, _HEAD + foot + high[1] * scale])
    lines = _draw_moves(start * flip + shift, end * flip + shift, role, width * scale)
    shapes = [*lines, Text(8, 24, title, _LETTERS), *legend]
    return Picture(round(wide), round(tall), tuple(shapes), title)


def _draw_moves(start: Float, end: Float, role: Int, width: Float) -> Iterator[Shape]:
    """Draw a line for each move."""
    pairs = np.stack([start, end], axis=1)
    for points, number, wide in zip(pairs, role.tolist(), width.tolist(), strict=True):
        colour = ROLE_COLOURS.get(Role(number), _OTHER_COLOUR)
        if wide:
            yield Line(points, colour, wide * _DRAWN_SHARE, round=True)
        else:
            yield Line(points, colour, 1.0, (1, 3))


def _draw_legend(role: Int, wide: float) -> tuple[list[Shape], float]:
    """Draw the legend of the roles in rows under the title; return its shapes and its height, px."""
    shapes: list[Shape] = []
    x, y = 8.0, float(_HEAD)
    roles = [Role(number) for number in np.unique(role).tolist() if number != Role.TRAVEL]
    entries = {ROLES[one].type_comment: one for one in roles}
    for name, one in entries.items():
        needed = 40 + estimate_text_width(name, _LETTERS)
        if x + needed > wide and x > 8:
            x, y = 8.0, y + _ROW
        shapes.append(Box(x, y, 18, 14, ROLE_COLOURS.get(one, _OTHER_COLOUR), name="legend"))
        shapes.append(Text(x + 24, y + 12.5, name, _LETTERS))
        x += needed
    return shapes, (y + _ROW - _HEAD if roles else 0.0)
