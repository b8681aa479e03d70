"""Compare a coverage with its limits: diagnostics with their places, the worst first."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.geometry import Areas, difference, intersection, offset, offset_open
from printer_slicer.inspection.coverage.measurement import Coverage
from printer_slicer.inspection.deposition.unsupported import MIN_REPORTED_LENGTH

__all__ = ["CoverageLimits", "excess", "findings", "largest_place", "line_near"]

_LITTLE: Final = 1.0  # mm² in a layer: less is not reported, whatever its share
_DOTS: Final = 2.0  # squares of the extrusion width that may be missing or added at tips, whatever the share
_FAR: Final = np.inf


@dataclass(frozen=True, slots=True)
class CoverageLimits:
    """Limits for each layer.

    Attributes:
        uncovered: largest uncovered share of the shell.
        outside: largest area outside the section, mm².
        overlap: largest overlapping share of the covered area.
        unsupported: largest length of unsupported extrusion, mm.
        underfilled: least material in the shell, as a share of what it needs.
        overfilled: most material in the shell, as a share of what it needs.
        outline: largest 95th percentile of the distance of the outlines, mm.
    """

    uncovered: float = 0.05
    outside: float = 1.0
    overlap: float = 0.10
    unsupported: float = MIN_REPORTED_LENGTH
    underfilled: float = 0.90
    overfilled: float = 1.10
    outline: float = 0.15


def excess(one: Diagnostic) -> float:
    """Return the ratio of amount to limit; for missing material, limit to amount."""
    amount, limit = one.amount or 0.0, one.limit or 0.0
    if one.code == "underfilled":
        amount, limit = limit, amount
    return _FAR if limit <= 0 else amount / limit


@dataclass(frozen=True, slots=True, eq=False)
class _Kind:
    """One measurement: (L,) amounts, (L,) whether they exceed the limit, the limit, text and place by layer."""

    name: str
    amount: Float
    broken: Bool
    limit: float
    say: Callable[[int], str]
    place: Callable[[int], tuple[float, float]]


def findings(coverage: Coverage, limits: CoverageLimits = CoverageLimits()) -> tuple[Diagnostic, ...]:
    """Return a diagnostic for everything beyond the limits, the worst first."""
    found = [one for kind in _kinds(coverage, limits) for one in _of_kind(coverage, kind)]
    return tuple(sorted(found, key=lambda one: -excess(one)))


def _of_kind(coverage: Coverage, kind: _Kind) -> Iterator[Diagnostic]:
    """Yield one diagnostic for each run of consecutive layers."""
    broken = np.flatnonzero(kind.broken & ~coverage.stack.ramps)
    if not len(broken):
        return
    cuts = [0, *(np.flatnonzero(np.diff(broken) > 1) + 1).tolist(), len(broken)]
    for begin, end in pairwise(cuts):
        run = broken[begin:end]
        amount = kind.amount[run]
        layer = int(run[(amount.argmin if kind.name == "underfilled" else amount.argmax)()])
        x, y = kind.place(layer)
        yield Diagnostic(
            kind.name,
            "error",
            kind.say(layer),
            line=line_near(coverage, layer, x, y),
            layer=layer + 1,
            first=int(run[0]) + 1,
            last=int(run[-1]) + 1,
            z=float(coverage.stack.top[layer]),
            place=None if np.isnan(x) else (x, y),
            amount=float(kind.amount[layer]),
            limit=kind.limit,
        )


def _kinds(coverage: Coverage, limits: CoverageLimits) -> Iterator[_Kind]:
    uncovered, shell, covered = coverage.uncovered.area(), coverage.shell.area(), coverage.covered.area()
    share = uncovered / np.maximum(shell, 1e-9)
    yield _Kind(
        "uncovered",
        share,
        (share > limits.uncovered) & (uncovered > _LITTLE),
        limits.uncovered,
        lambda k: f"{uncovered[k]:.1f} mm² ({share[k]:.0%}) of the shell are not covered",
        lambda k: largest_place(coverage.uncovered, k),
    )
    outside = coverage.outside.area()
    yield _Kind(
        "outside",
        outside,
        outside > limits.outside,
        limits.outside,
        lambda k: f"{outside[k]:.1f} mm² are printed outside the outline of the part",
        lambda k: largest_place(coverage.outside, k),
    )
    fill = coverage.fill
    twice = fill.overlap / np.maximum(covered, 1e-9)
    yield _Kind(
        "overlap",
        twice,
        (twice > limits.overlap) & (fill.overlap > _LITTLE),
        limits.overlap,
        lambda k: (
            f"extrusions overlap on {fill.overlap[k]:.1f} mm² ({twice[k]:.0%} of the layer),"
            f" up to {fill.most[k]:.1f} times full"
        ),
        lambda k: (float(fill.place[k, 0]), float(fill.place[k, 1])),
    )
    yield from _of_volume(coverage, limits)
    yield _of_unsupported(coverage, limits)
    outline, size = coverage.outline, np.maximum(coverage.sections.area(), covered)
    yield _Kind(
        "outline",
        outline.p95,
        (outline.p95 > limits.outline) & (size > _LITTLE),
        limits.outline,
        lambda k: (
            f"outline error {outline.p95[k]:.2f} mm (95th percentile), at most {outline.largest[k]:.2f} mm"
        ),
        lambda k: (float(outline.place[k, 0]), float(outline.place[k, 1])),
    )


def _of_volume(coverage: Coverage, limits: CoverageLimits) -> Iterator[_Kind]:
    """Yield missing and surplus material in the shell, beyond the limits and beyond a minimum area."""
    fill, height, shell = coverage.fill.shell, coverage.stack.height, coverage.shell.area()
    width = coverage.stack.beads.take(np.flatnonzero(coverage.of_part)).usual_width
    surplus, missing = (fill - limits.overfilled) * shell, (limits.underfilled - fill) * shell
    least = _DOTS * width**2
    over, under = surplus > least, missing > least
    if over.any():
        over &= surplus - _beside_fins(coverage, over, width) > least
    for name, limit, broken in (
        ("underfilled", limits.underfilled, under),
        ("overfilled", limits.overfilled, over),
    ):
        yield _Kind(
            name,
            fill,
            broken,
            limit,
            lambda k: (
                f"the shell has {fill[k]:.0%} of the material it needs (layer height {height[k]:.3g} mm)"
            ),
            lambda _: (np.nan, np.nan),
        )


def _beside_fins(coverage: Coverage, layers: Bool, width: float) -> Float:
    """Return the area (L,) covered beside fins narrower than a line, mm²; `layers` (L,) selects layers."""
    sections = coverage.sections.of_layers(layers)
    fins = difference(sections, offset_open(sections, width / 2))
    beside = difference(coverage.covered.of_layers(layers), sections)
    return intersection(beside, offset(fins, width)).area()


def _of_unsupported(coverage: Coverage, limits: CoverageLimits) -> _Kind:
    """Return the measurement of unsupported extrusion."""
    length, place = coverage.unsupported_length, np.full((coverage.stack.n_layers, 2), np.nan)
    for one in reversed(coverage.unsupported):
        place[coverage.layer_at(one.z)] = one.x, one.y
    return _Kind(
        "unsupported",
        length,
        length > limits.unsupported,
        limits.unsupported,
        lambda k: f"{length[k]:.0f} mm of unsupported extrusion",
        lambda k: (float(place[k, 0]), float(place[k, 1])),
    )


def largest_place(areas: Areas, layer: int) -> tuple[float, float]:
    """Return the corner of the largest area of a layer that is nearest to its middle, mm; nan without one."""
    rings = list(areas.rings(layer))
    if not rings:
        return np.nan, np.nan
    first, last = np.searchsorted(areas.ring_layer, [layer, layer + 1])
    ring = rings[int(areas.ring_area()[first:last].argmax())]
    middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
    x, y = ring[int(np.hypot(*(ring - middle).T).argmin())].tolist()
    return x, y


def line_near(coverage: Coverage, layer: int, x: float, y: float) -> int:
    """Return the G-code line of the extrusion nearest to a place; of the first in the layer if the place is nan."""
    own = np.flatnonzero((coverage.stack.layer == layer) & coverage.of_part)
    if not len(own):
        return 0
    if np.isnan(x):
        return int(coverage.stack.beads.line[own[0]])
    beads = coverage.stack.beads.take(own)
    from_middle = np.hypot(*((beads.begin + beads.end) / 2 - (x, y)).T) - beads.length / 2
    return int(beads.line[from_middle.argmin()])
