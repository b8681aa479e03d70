"""Contoured G-code, made by moving the extrusions of level layers to an analytically known surface.

Files of the kind "lowered" have sections that reach out to the lowest bead, and are lowered only. Those of the kind
"raised" have usual sections, points every 0.1 mm, raised walls, and lower walls on steep slopes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from math import radians, tan
from re import findall, sub
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_stages
from tests.parts import loft, plain

__all__ = [
    "HEIGHT",
    "KINDS",
    "LEAST",
    "PARTS",
    "RULES",
    "SHALLOW",
    "Line",
    "Part",
    "Rule",
    "contour",
    "dome",
    "example",
    "level",
    "printable",
    "wedge",
]

HEIGHT, WIDTH, LEAST = 0.2, 0.45, 0.05
SHALLOW = (5, 10, 15, 20)
Surface = Callable[[Float], Float]
_BASE = 1.0  # mm of upright walls below the slope
_FOLLOWED = ("External perimeter", "Perimeter", "Top solid infill", "Solid infill")
Line = dict[str, float]


@dataclass(frozen=True)
class Part:
    """A part, its surface (n,) above points (n, 2) on the bed, and its slope (n,) there, as rise per mm."""

    mesh: Mesh
    surface: Surface
    gradient: Surface


def wedge(degrees: float, wide: float = 20.0, deep: float = 12.0) -> Part:
    """A wedge with a level crest of 3 mm and a slope towards +x, with the middle of its box at the origin."""
    rise = tan(radians(degrees))
    high = _BASE + round((wide - 3) * rise / HEIGHT) * HEIGHT
    run = (high - _BASE) / rise
    wide = run + 3

    def ring(x: float) -> Float:
        left, front = -wide / 2, -deep / 2
        return np.array([(left, front), (x, front), (x, -front), (left, -front)])

    mesh = Mesh(
        loft([ring(wide / 2), ring(wide / 2), ring(wide / 2 - run)], [0.0, _BASE, high]), f"wedge {degrees}"
    )

    def surface(xy: Float) -> Float:
        return np.clip(_BASE + (wide / 2 - xy[:, 0]) * rise, _BASE, high)

    return Part(mesh, surface, lambda xy: np.where(surface(xy) < high - 1e-9, rise, 0.0))


def dome(radius: float = 12.0, degrees: float = 53.0, sides: int = 96) -> Part:
    """A spherical cap, from level at the top to a slope at its rim, on an upright base."""
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    tilt = np.radians(np.linspace(degrees, 0.4, 90))
    ball = radius / np.sin(radians(degrees))
    low = ball * np.cos(radians(degrees))
    rings = [np.column_stack([np.cos(angle), np.sin(angle)]) * ball * np.sin(one) for one in (tilt[0], *tilt)]
    mesh = Mesh(loft(rings, [0.0, *(_BASE + ball * np.cos(tilt) - low)]), "dome")

    def surface(xy: Float) -> Float:
        away = np.minimum(np.hypot(*xy.T), radius)
        return np.asarray(_BASE + np.sqrt(ball**2 - away**2) - low)

    def gradient(xy: Float) -> Float:
        away = np.minimum(np.hypot(*xy.T), radius)
        return np.asarray(away / np.sqrt(ball**2 - away**2))

    return Part(mesh, surface, gradient)


PARTS: Final = {"dome": dome} | {f"wedge {one}": partial(wedge, one) for one in SHALLOW}


def level(part: Part, *, widened: bool, height: float = HEIGHT, **changes: object) -> str:
    """Slice a part into level layers; `widened` sections reach down to the least local height on shallow slopes."""
    top = np.arange(1, round(part.mesh.height / height) + 1) * height
    cut = top - height / 2
    if widened:
        cut = np.where(_is_shallow(part, cut, height), top - height + LEAST / 2, cut)
        cut[0] = height / 2
    profile = plain(layer_height=height, **changes)
    program = slice_stages(part.mesh, profile, plan=LayerPlan(top, cut)).program
    return gcode_of(program, profile).decode()


def _is_shallow(part: Part, z: Float, height: float) -> Bool:
    """Whether the slope at heights (L,) is below the rule."""
    x = np.linspace(0, float(part.mesh.bounds[1, 0]), 4000)
    points = np.column_stack([x, np.zeros_like(x)])
    at = np.searchsorted(-part.surface(points), -z)
    gradient = part.gradient(points)[np.clip(at, 0, len(x) - 1)]
    return (gradient * WIDTH <= 1.2 * height) & (z > _BASE)


@cache
def example(name: str, kind: str) -> tuple[Part, str]:
    """A part of `PARTS`, and its G-code, which is "lowered", "raised" as another slicer does, or "level"."""
    part = PARTS[name]()
    text = level(part, widened=kind == "lowered")
    if kind == "level":
        return part, text
    return part, contour(text, part, RULES[kind])


@dataclass(frozen=True)
class Rule:
    """How extrusions are moved to a surface.

    Attributes:
        height: of the layers, mm.
        step: mm between points.
        raised: mm that walls may rise above the top of their layer.
        steep: lower walls on steep slopes, so that their outer side meets the surface.
        change: applied to the end of each extrusion: x, y, z, e, layer, top and wall; None leaves it out.
    """

    height: float = HEIGHT
    step: float = 0.25
    raised: float = 0.0
    steep: bool = False
    change: Callable[[Line], Line | None] = lambda one: one


RULES: Final = {"lowered": Rule(), "raised": Rule(step=0.1, raised=0.05, steep=True)}
KINDS: Final = tuple(RULES)


def contour(text: str, part: Part, rule: Rule = Rule()) -> str:
    """Move the extrusions of a level G-code text with relative E to the surface of its part."""
    result = list[str]()
    at, top, role, layer, now = np.zeros(2), 0.0, "", 0, 0.0
    for row in text.split("\n"):
        if row.startswith(";Z:"):
            top, layer = float(row[3:]), layer + 1
        if row.startswith(";TYPE:"):
            role = row[6:].strip()
        words = {key: float(value) for key, value in findall(r"([XYZEF])(-?[\d.]+)", row.split(";")[0])}
        if not row.startswith(("G0", "G1")) or not words.keys() & {"X", "Y"}:
            now = words.get("Z", now) if row.startswith(("G0", "G1")) else now
            result.append(row)
            continue
        end = np.array([words.get("X", at[0]), words.get("Y", at[1])])
        if words.get("E", 0.0) <= 0:
            is_low = abs(now - top) > 1e-6 and now < top + 0.5 and "Z" not in words
            now = words.get("Z", top if is_low else now)
            result += [*[f"G0 Z{top:.3f}"] * is_low, row]
        else:
            rows, now = _extrude(part, rule, (at, end, now), words, (layer, top, role))
            result += rows
        at = end
    return "\n".join(result)


def _extrude(
    part: Part, rule: Rule, way: tuple[Float, Float, float], words: Line, place: tuple[int, float, str]
) -> tuple[list[str], float]:
    """Lines of an extrusion that follows the surface, and the height at which it ends."""
    (at, end, now), (layer, top, role) = way, place
    follows = layer > 1 and role in _FOLLOWED
    pieces = _points(at, end, words["E"], rule.step if follows else np.inf)
    points = np.array([at, *((one["x"], one["y"]) for one in pieces)])
    before, *local = _local_tops(part, points, top, role, rule) if follows else [top] * len(points)
    rows = [f"G0 Z{before:.3f}"] * (abs(before - now) > 1e-6)
    for one, z in zip(pieces, local, strict=True):
        middle = (before + z) / 2 - (top - rule.height)
        fed = one["e"] * _section(max(middle, LEAST)) / _section(rule.height)
        wall = float("erimeter" in role)
        made = rule.change(one | {"e": fed, "z": z, "layer": layer, "top": top, "wall": wall})
        rows.append(_write(made, words) if made else f"G0 X{one['x']:.3f} Y{one['y']:.3f} Z{z:.3f}")
        before = made["z"] if made else z
    return rows, before


def _points(begin: Float, end: Float, fed: float, step: float) -> list[Line]:
    """Ends of the pieces of an extrusion."""
    count = max(int(np.ceil(np.hypot(*(end - begin)) / step)), 1)
    xy = begin + (np.arange(1, count + 1) / count)[:, None] * (end - begin)
    return [{"x": x, "y": y, "e": fed / count} for x, y in xy.tolist()]


def _local_tops(part: Part, xy: Float, top: float, role: str, rule: Rule) -> list[float]:
    """Height of the nozzle at points (n, 2) of a layer."""
    surface, gradient, least = part.surface(xy), part.gradient(xy), top - rule.height + LEAST
    most = top + (rule.raised if "erimeter" in role else 0.0)
    shallow = gradient * WIDTH <= 1.2 * rule.height
    z = np.clip(np.where(surface > most + 0.2 * rule.height, top, surface), least, most)
    z = np.where(shallow | bool(rule.raised), z, top)
    if rule.steep and role == "External perimeter":
        lowered = np.maximum(top - WIDTH / 2 * np.sin(np.arctan(gradient)), least)
        z = np.where((gradient > tan(radians(35))) & (surface < most), lowered, z)
    return np.round(z, 3).tolist()


def _section(height: float) -> float:
    """Cross-section of a bead."""
    return float(height * (WIDTH - height * (1 - np.pi / 4)))


def _write(one: Line, words: Line) -> str:
    """A line of G-code."""
    feed = f" F{words['F']:.0f}" if "F" in words else ""
    return f"G1 X{one['x']:.3f} Y{one['y']:.3f} Z{one['z']:.3f} E{one['e']:.6f}{feed}"


def printable(text: str, *, middle: float = 110.0) -> bytes:
    """Move G-code around the origin to the middle of a bed, and heat, home and switch off around it."""
    text = sub(r"(?<= [XY])-?[\d.]+", lambda word: f"{float(word[0]) + middle:.3f}", text)
    return f"M104 S210\nG28\nM109 S210\nM83\n{text}\nM104 S0\nM140 S0\n".encode()
