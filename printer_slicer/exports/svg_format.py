"""Write contours as SVG: all layers as groups of one drawing, or one drawing per layer.

The drawing is in mm: `width` and `height` have this unit, and one unit of the view box is one mm. In SVG, y points
down, so a point (X, Y) of the drawing is the point (x0 + X, y1 - Y) of the part. The attributes `data-x` and `data-y`
of the root give x0 and y1, the left and the upper side of the box around all layers. All layers share this box, so
drawings of single layers align.

Each group has the attributes `slic3r:z` (top of the layer), `slic3r:slice-z` (height of the cut) and
`slic3r:layer-height`, as in the layered drawings of Slic3r, which projector software reads. It is also a layer in
Inkscape. Groups are direct children of the root without a transform or a colour. One path holds all contours of a
layer, filled by the even-odd rule.

Source: W3C, Scalable Vector Graphics (SVG) 1.1; the attributes: Slic3r 1.3, SLAPrint.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.errors import UsageError
from printer_slicer.exports.rounding import RoundedRings, round_to_grid
from printer_slicer.model import LayerPlan, Sections

__all__ = ["SVG_DIGITS", "write_svg", "write_svgs"]

SVG_DIGITS: Final = 3
"""Default number of decimals: coordinates are whole micrometres."""

_MAX_DIGITS = 6


def write_svg(sections: Sections, *, digits: int = SVG_DIGITS) -> bytes:
    """Return all layers as one SVG with a group per layer; groups without a path are empty layers.

    Coordinates are rounded to `digits` decimals, heights to at least four; the description in the file says so. Rings
    smaller than one unit of the last decimal are left out, and the description gives their number.

    Raises:
        UsageError: `digits` is less than 0 or more than 6.
    """
    head, drawn = _prepare_drawing(sections, digits)
    groups = [
        _format_group(sections.plan, layer, drawn[layer], digits) for layer in range(sections.plan.n_layers)
    ]
    return "\n".join([head, *groups, "</svg>", ""]).encode("ascii")


def write_svgs(sections: Sections, *, digits: int = SVG_DIGITS) -> Iterator[tuple[str, bytes]]:
    """Yield the file name and the SVG of each layer, from layer0000.svg on, rounded as in `write_svg`.

    Raises:
        UsageError: `digits` is less than 0 or more than 6.
    """
    head, drawn = _prepare_drawing(sections, digits)
    width = max(4, len(str(sections.plan.n_layers - 1)))
    for layer, path in enumerate(drawn):
        group = _format_group(sections.plan, layer, path, digits)
        yield f"layer{layer:0{width}d}.svg", "\n".join([head, group, "</svg>", ""]).encode("ascii")


def _prepare_drawing(sections: Sections, digits: int) -> tuple[str, list[str]]:
    """Return the start of the SVG file and the path data of each layer."""
    if not 0 <= digits <= _MAX_DIGITS:
        raise UsageError(
            f"an SVG cannot have {digits} digits after the decimal point",
            remedy=f"Choose a number between 0 and {_MAX_DIGITS}",
        )
    rounded = round_to_grid(sections.solid, 10.0**-digits)
    box = (
        np.concatenate([rounded.xy.min(axis=0), rounded.xy.max(axis=0)])
        if len(rounded.xy)
        else np.zeros(4, np.int64)
    )
    return _format_head(rounded, box, digits), _format_paths(rounded, box, digits)


def _format_head(rounded: RoundedRings, box: Int, digits: int) -> str:
    """Return the start of the SVG file, from the XML declaration to the description."""
    x0, y0, x1, y1 = (box / 10**digits).tolist()
    places = _count_height_digits(digits)
    wide, high = (f"{size:.{digits}f}" for size in (x1 - x0, y1 - y0))
    left_out = f" {rounded.lost} rings smaller than that are left out." if rounded.lost else ""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:slic3r="http://slic3r.org/namespaces/slic3r"'
        ' xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
        f' width="{wide}mm" height="{high}mm" viewBox="0 0 {wide} {high}"'
        f' data-x="{x0:.{digits}f}" data-y="{y1:.{digits}f}">\n'
        "<desc>Contours by printer-slicer. One unit is 1 mm; coordinates are rounded, at most"
        f" {10.0**-digits / 2:.{digits + 1}f} mm off, heights {10.0**-places / 2:.{places + 1}f} mm.{left_out}"
        " A point X Y of the drawing is x = data-x + X, y = data-y - Y of the part.</desc>"
    )


def _count_height_digits(digits: int) -> int:
    """Return the number of decimals for heights, at least four: layers are planned in finer steps than contours."""
    return max(digits, 4)


def _format_paths(rounded: RoundedRings, box: Int, digits: int) -> list[str]:
    """Return the path data of each layer; empty for an empty layer."""
    place = np.stack([rounded.xy[:, 0] - box[0], box[3] - rounded.xy[:, 1]], axis=1) / 10**digits
    pair = f"%.{digits}f,%.{digits}f"
    points = [pair % (x, y) for x, y in place.tolist()]
    start = rounded.ring_start.tolist()
    return [
        " ".join(f"M {' '.join(points[start[ring] : start[ring + 1]])} Z" for ring in rings)
        for rings in rounded.layers()
    ]


def _format_group(plan: LayerPlan, layer: int, path: str, digits: int) -> str:
    """Return the SVG group of one layer."""
    z, cut, height = (float(values[layer]) for values in (plan.top, plan.cut, plan.height))
    places = _count_height_digits(digits)
    drawn = f'<path fill-rule="evenodd" d="{path}"/>' if path else ""
    return (
        f'<g id="layer{layer}" slic3r:z="{z:.{places}f}" slic3r:slice-z="{cut:.{places}f}"'
        f' slic3r:layer-height="{height:.{places}f}" inkscape:groupmode="layer"'
        f' inkscape:label="layer {layer}, z {z:.{places}f} mm">{drawn}</g>'
    )
