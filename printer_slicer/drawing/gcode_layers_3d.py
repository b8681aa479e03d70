"""Draw the layers of a G-code file in 3D, each extrusion as a prism in the colour of its role."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.drawing.canvas import Picture, Raster, Text, estimate_text_width
from printer_slicer.drawing.colours import parse_colour
from printer_slicer.drawing.extrusion_kinds import draw_legend, find_kinds
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.layer_extrusions import LayerExtrusions
from printer_slicer.rendering import RenderedFacets, measure_rendered_size, render_facets

__all__ = ["draw_gcode_layers_3d"]

_SIDE, _TITLE, _LETTERS = 12, 34, 15  # px
_NARROWEST: Final = 360  # px
_SHADOW: Final = 0.35  # brightness of colours in full shadow
_ROUND_END: Final = 0.25  # widths by which a prism is longer than its centre line, so that corners are closed
_MIN_HEIGHT: Final = 0.01  # mm


def draw_gcode_layers_3d(layers: LayerExtrusions, title: str, pixels: int = 1000) -> Picture:
    """Draw extrusions of several layers, seen from the front right and above.

    Args:
        layers: the extrusions.
        title: printed above, before the number of layers.
        pixels: longer side of the drawing.

    Raises:
        ValueError: there are no extrusions.
    """
    if not layers.beads.n_beads:
        raise ValueError("the layers have nothing to draw")
    last, count = layers.number + 1, layers.count
    which = f"{count} layers" if last == count else f"layers 1 to {last} of {count}"
    heading = f"{title}: {which}, {layers.top:.4g} mm high"
    kind, kinds = find_kinds(layers)
    facets = _list_facets(layers.beads, np.array([parse_colour(colour) for _, colour in kinds])[kind])
    across, up = measure_rendered_size(facets)
    width, height = (max(round(pixels * size / max(across, up)), 1) for size in (across, up))
    wide = round(max(width, _NARROWEST, estimate_text_width(heading, _LETTERS)) + 2 * _SIDE)
    legend, rows = draw_legend(kinds, wide)
    rendered = render_facets(facets, [(width, height)])[0]
    drawing = Raster((wide - width) / 2, _TITLE + rows, width, height, rendered)
    shapes = (Text(_SIDE, 23, heading, _LETTERS, bold=True), *legend, drawing)
    return Picture(wide, round(_TITLE + rows + height + _SIDE), shapes, heading)


def _list_facets(beads: Extrusions, colour: Float) -> RenderedFacets:
    """Return the facets of extrusions, which have colours (B, 3), 0 to 255."""

    def take(which: slice | Int) -> Float:
        """Return the corners of some facets."""
        if isinstance(which, slice):
            which = np.arange(*which.indices(beads.n_beads * _FACETS_OF_PRISM))
        bead, facet = np.divmod(which, _FACETS_OF_PRISM)
        first = int(bead[0]) if len(bead) else 0
        own = np.arange(first, int(bead[-1]) + 1 if len(bead) else 0)
        if len(own) > 2 * len(bead):  # few facets of many extrusions
            own, bead = np.unique(bead, return_inverse=True)
            first = 0
        corners = _make_prisms(beads, own)
        return np.asarray(corners[(bead - first)[:, None], _CORNERS[facet]])

    def colours(which: Int) -> tuple[Float, Float]:
        lit = colour[which // _FACETS_OF_PRISM]
        return lit, _SHADOW * lit

    return RenderedFacets(beads.n_beads * _FACETS_OF_PRISM, take, colours)


def _make_prisms(beads: Extrusions, which: Int) -> Float:
    """Return the corners (n, 12, 3) of the prisms of extrusions, mm.

    Their cross-section has six corners: the middle of the left side, then over the upper side to the middle of the
    right one, and back over the lower side. The first six are those at the begin.
    """
    begin, end = beads.begin[which], beads.end[which]
    height = np.maximum(np.nan_to_num(beads.height[which], nan=_MIN_HEIGHT), _MIN_HEIGHT)
    width = np.maximum(np.nan_to_num(beads.width[which], nan=_MIN_HEIGHT), height)
    way = end - begin
    along = way / np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    left = np.column_stack([-along[:, 1], along[:, 0]])
    half, flat = width / 2, (width - height) / 2
    across = np.stack([half, flat, -flat, -half, -flat, flat], axis=1)
    reach = _ROUND_END * width[:, None] * along
    top, rise = beads.z_top[which], beads.rise[which]
    corners = np.zeros((len(which), 12, 3))
    for first, place, z in ((0, begin - reach, top - rise), (6, end + reach, top)):
        corners[:, first : first + 6, :2] = place[:, None] + across[:, :, None] * left[:, None]
        corners[:, first : first + 6, 2] = z[:, None] - height[:, None] * _DEPTH
    return corners


_DEPTH: Final = np.array([0.5, 0.0, 0.0, 0.5, 1.0, 1.0])  # of the corners below the top, in heights


def _list_corners() -> Int:
    """Return the corners (F, 3) of the facets of a prism, counter-clockwise seen from outside.

    The lower side is left out: nobody sees it from above.
    """
    sides = [(k, (k + 1) % 6) for k in (5, 0, 1, 2, 3)]
    facets = [one for k, after in sides for one in ((k, after + 6, k + 6), (k, after, after + 6))]
    facets += [(0, k + 1, k) for k in range(1, 5)] + [(6, k + 6, k + 7) for k in range(1, 5)]
    return np.array(facets)


_CORNERS: Final = _list_corners()
_FACETS_OF_PRISM: Final = len(_CORNERS)
