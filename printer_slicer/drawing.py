"""Pictures as SVG text: a layer plan on the part's silhouette, and the beads of one layer."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from typing import Final

import numpy as np

from printer_slicer.model import Areas, Float, LayerPlan, Program, Role, Sections

__all__ = ["draw_layer", "draw_plan"]

# Thin to thick layers, dark to light; readable for colour-blind people (after the viridis map).
_STOPS: Final = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], np.float64
)
_ROLE_COLOURS: Final = {
    Role.SKIRT: "#999999",
    Role.BRIM: "#777777",
    Role.INNER_PERIMETER: "#e8c20a",
    Role.OUTER_PERIMETER: "#d9622b",
    Role.BRIDGE: "#3b82c4",
    Role.BOTTOM_SKIN: "#6b3fa0",
    Role.SOLID: "#9d4edd",
    Role.TOP_SKIN: "#c0392b",
    Role.SPARSE: "#a33b2e",
}
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_FONT: Final = 'font-family="sans-serif"'


def draw_plan(sections: Sections, title: str) -> str:
    """The part from the front with every layer in the colour of its height, and height over z beside it.

    Args:
        sections: the part's solid areas; their plan gives the layers.
        title: one line over the picture.

    Returns:
        An SVG document, 880 x 640.
    """
    plan, solid = sections.plan, sections.solid
    low, high = solid.xy[:, 0].min(), solid.xy[:, 0].max()
    total = float(plan.top[-1])
    scale = min(420 / max(high - low, 1e-9), 540 / total)
    floor, left = 600.0, 60 + (420 - scale * (high - low)) / 2
    parts = [_text(30, 34, title, 18)]
    for k, (x0, x1) in _spans(solid):
        y = floor - scale * plan.top[k]
        size = scale * plan.height[k]
        colour = _colour(float(plan.height[k]), plan)
        line = ' stroke="#00000030" stroke-width="0.4"' if size > 1.2 else ""
        parts.append(
            f'<rect x="{left + scale * (x0 - low):.2f}" y="{y:.2f}" width="{scale * (x1 - x0):.2f}" '
            f'height="{size + 0.05:.2f}" fill="{colour}"{line}/>'
        )
    parts += _z_axis(total, scale, floor)
    parts += _height_curve(plan, scale, floor)
    parts += _legend(plan)
    return _document(880, 640, parts)


def draw_layer(program: Program, layer: int) -> str:
    """The beads of one layer from above, as wide as they are laid, in the colour of their role; travels dotted.

    Raises:
        ValueError: the program has no such layer.
    """
    if not 0 <= layer < program.plan.n_layers:
        raise ValueError(f"layer {layer} is not in the program, which has {program.plan.n_layers} layers")
    title = f"layer {layer + 1} of {program.plan.n_layers}, z {program.plan.top[layer]:g} mm"
    member = program.layer == layer
    if not member.any():
        return _document(400, 40, [_text(6, 16, f"{title}: no plastic", 13)])
    start, end = program.start[member][:, :2], program.xyz[member][:, :2]
    role, width = program.role[member], program.width[member]
    beads = role != Role.TRAVEL
    corners = np.concatenate([start[beads], end[beads]]) if beads.any() else np.concatenate([start, end])
    low, high = corners.min(axis=0) - 2, corners.max(axis=0) + 2
    scale = 800 / float((high - low).max())
    size = (high - low) * scale
    a, b = (start - low) * scale, (end - low) * scale
    a[:, 1], b[:, 1] = size[1] - a[:, 1], size[1] - b[:, 1]
    parts = []
    for (x0, y0), (x1, y1), why, wide in zip(a, b, role, width, strict=True):
        colour = _ROLE_COLOURS.get(Role(int(why)), "#4477aa")
        stroke = (
            f'stroke-width="{wide * scale * 0.92:.2f}" stroke-linecap="round"'
            if wide
            else 'stroke-dasharray="1 3"'
        )
        parts.append(f'<path d="M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}" stroke="{colour}" {stroke}/>')
    parts.append(_text(6, 16, title, 13))
    return _document(float(size[0]), float(size[1]), parts)


def _spans(solid: Areas) -> Iterator[tuple[int, tuple[float, float]]]:
    """For each layer the stretches of x that its section covers, seen from the front."""
    if solid.n_rings == 0:
        return
    start = solid.ring_start[:-1]
    low = np.minimum.reduceat(solid.xy[:, 0], start)
    high = np.maximum.reduceat(solid.xy[:, 0], start)
    rings_of = solid.layer_start
    for k in range(solid.n_layers):
        reach = -np.inf
        begin = 0.0
        for i in sorted(range(int(rings_of[k]), int(rings_of[k + 1])), key=lambda ring: float(low[ring])):
            if low[i] > reach:
                if reach > -np.inf:
                    yield k, (begin, reach)
                begin = float(low[i])
            reach = max(reach, float(high[i]))
        if reach > -np.inf:
            yield k, (begin, reach)


def _colour(height: float, plan: LayerPlan) -> str:
    """The colour of a layer height within the plan's range."""
    low, high = float(plan.height.min()), float(plan.height.max())
    place = (height - low) / (high - low) * (len(_STOPS) - 1) if high > low else 2.0
    red, green, blue = (np.interp(place, np.arange(len(_STOPS)), _STOPS[:, i]) for i in range(3))
    return f"#{round(red):02x}{round(green):02x}{round(blue):02x}"


def _z_axis(total: float, scale: float, floor: float) -> list[str]:
    """Marks along z at the left of the part."""
    parts = [f'<path d="M50 {floor}V{floor - scale * total:.1f}" stroke="#444"/>']
    for z in _marks(total):
        y = floor - scale * z
        parts.append(f'<path d="M46 {y:.1f}H50" stroke="#444"/>')
        parts.append(_text(42, y + 4, f"{z:g}", 11, "end"))
    parts.append(_text(42, floor + 22, "z mm", 11, "end"))
    return parts


def _height_curve(plan: LayerPlan, scale: float, floor: float) -> list[str]:
    """Layer height (to the right) over z (upward)."""
    left, wide = 540.0, 300.0
    highest = float(plan.height.max())
    points = [
        f"{left + wide * h / highest:.1f},{floor - scale * z:.2f}"
        for h, bottom, top in zip(plan.height, plan.bottom, plan.top, strict=True)
        for z in (bottom, top)
    ]
    parts = [
        f'<path d="M{left} {floor}V{floor - scale * plan.top[-1]:.1f}M{left} {floor}H{left + wide}" stroke="#444"/>'
    ]
    for mark in _marks(highest, 4):
        x = left + wide * mark / highest
        parts.append(
            f'<path d="M{x:.1f} {floor}v4" stroke="#444"/>{_text(x, floor + 18, f"{mark:g}", 11, "middle")}'
        )
    parts.append(f'<polyline points="{" ".join(points)}" fill="none" stroke="#31688e" stroke-width="1.2"/>')
    return [*parts, _text(left + wide, floor + 34, "layer height mm", 11, "end")]


def _legend(plan: LayerPlan) -> list[str]:
    """How many layers of which height, by height; at most eight lines."""
    heights, counts = np.unique(plan.height, return_counts=True)
    most = np.sort(np.argsort(counts)[::-1][:8])
    parts = [_text(560, 62, f"{plan.n_layers} layers, planner {plan.planner}", 13)]
    for row, i in enumerate(most):
        y = 82 + 18 * row
        parts.append(
            f'<rect x="560" y="{y - 10}" width="14" height="12" fill="{_colour(float(heights[i]), plan)}"/>'
        )
        parts.append(_text(580, y, f"{counts[i]} x {heights[i]:g} mm", 12))
    return parts


def _marks(end: float, count: int = 8) -> Float:
    """Round numbers from 0 to `end`."""
    raw = end / count
    power = 10 ** np.floor(np.log10(raw))
    step = power * min(m for m in (1, 2, 5, 10) if m * power >= raw - 1e-12)
    return np.asarray(np.round(np.arange(0, end + step * 1e-6, step), 10))


def _text(x: float, y: float, text: str, size: int, anchor: str = "start") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}"'
    return f"<text {place} {_FONT}>{escape(_visible(text))}</text>"


def _visible(text: str) -> str:
    """The text without control characters, which XML cannot hold."""
    return _NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def _document(width: float, height: float, parts: list[str]) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" fill="none">'
    back = f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>'
    body = "\n".join(part.replace("<text ", '<text fill="#222" ') for part in parts)
    return f"{head}\n{back}\n{body}\n</svg>\n"
