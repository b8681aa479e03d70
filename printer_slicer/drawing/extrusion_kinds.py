"""The kinds of extrusions in a file, with the names and colours under which pictures show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.drawing.canvas import Box, Line, Shape, Text, estimate_text_width
from printer_slicer.drawing.colours import ROLE_COLOURS, darken, mix_colours
from printer_slicer.inspection.coverage.layer_extrusions import LayerExtrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.roles import Role

__all__ = ["EDGE_BRIGHTNESS", "TRAVEL_COLOUR", "TRAVEL_DASH", "draw_legend", "find_kinds", "name_kind"]

TRAVEL_COLOUR: Final = "#c2188b"
TRAVEL_DASH: Final = (4.0, 3.0)  # px
EDGE_BRIGHTNESS: Final = 0.5
_SIDE, _TITLE, _ROW = 12, 34, 24  # px
_LETTERS: Final = 15  # px

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
_OTHER_COLOUR: Final = "#4477aa"
_HEIGHT_STEP: Final = 0.05  # mm
_MAX_STEPS, _LIGHTEST_STEP = 20, 5
_HEIGHT_COLOURS: Final = "#3b0f70", "#e6e6f2"  # of the lowest and the highest contoured extrusions
_LIGHT: Final = 0.25  # fraction of white in the colours, so that dark colours keep a visible edge


def find_kinds(layer: LayerExtrusions) -> tuple[Int, list[tuple[str, str]]]:
    """Return the kind (B,) of each extrusion, and the name and colour of each kind.

    A kind is one role name of the file; all names of one role share its colour. Contoured extrusions, whose height
    changes inside a layer, have kinds and colours by their height.
    """
    beads = layer.beads
    contoured = beads.is_contoured
    # The number of the height range of contoured extrusions takes the place of name and role.
    steps = np.clip(np.nan_to_num(beads.height) / _HEIGHT_STEP, 0, _MAX_STEPS - 1).astype(np.int64)
    pairs = np.stack([np.where(contoured, -1, layer.name), np.where(contoured, steps, beads.purpose)], axis=1)
    kinds, kind = np.unique(pairs, axis=0, return_inverse=True)
    return kind.ravel(), [
        _name_height(number) if index < 0 else name_kind(layer.names[index], Purpose(number))
        for index, number in kinds.tolist()
    ]


def _name_height(step: int) -> tuple[str, str]:
    """Return the name and the colour of contoured extrusions in a range of heights; low ones are dark."""
    low, high = step * _HEIGHT_STEP, (step + 1) * _HEIGHT_STEP
    colour = mix_colours(*_HEIGHT_COLOURS, min(step / _LIGHTEST_STEP, 1.0))
    return f"Contoured, {low:.2g} to {high:.2g} mm high", colour


def name_kind(name: str, purpose: Purpose) -> tuple[str, str]:
    """Return the name and the colour under which pictures show extrusions.

    Args:
        name: role name in the file, or empty.
        purpose: their role.
    """
    name = (name or purpose.label).replace("_", " ")
    name = name.capitalize() if name.isupper() else name[:1].upper() + name[1:]
    return name, mix_colours(_COLOURS.get(purpose, _OTHER_COLOUR), "#ffffff", _LIGHT)


def draw_legend(entries: Sequence[tuple[str, str]], wide: float) -> tuple[list[Shape], float]:
    """Draw the legend in rows under the title; return its shapes and its height, px.

    Args:
        entries: name and colour of each.
        wide: width of the picture, px.
    """
    shapes: list[Shape] = []
    x, y = float(_SIDE), float(_TITLE)
    for name, colour in entries:
        needed = 36 + estimate_text_width(name, _LETTERS)
        if x + needed > wide and x > _SIDE:
            x, y = float(_SIDE), y + _ROW
        if colour == TRAVEL_COLOUR:
            shapes.append(
                Line(np.array([(x, y + 8.0), (x + 18, y + 8.0)]), colour, 1.2, TRAVEL_DASH, name="legend")
            )
        else:
            shapes.append(Box(x, y + 1, 18, 14, colour, darken(colour, EDGE_BRIGHTNESS), name="legend"))
        shapes.append(Text(x + 24, y + 13, name, _LETTERS))
        x += needed
    return shapes, (y + _ROW - _TITLE + 6 if entries else 0.0)
