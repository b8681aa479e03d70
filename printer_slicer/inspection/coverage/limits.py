"""Compare the coverage of each layer with limits, and report excesses with their positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.deprecation import accept_former_fields
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.geometry import Areas, difference, intersection, offset, offset_open
from printer_slicer.inspection.coverage.measurement import Coverage
from printer_slicer.inspection.coverage.surface_distance import SurfaceErrors
from printer_slicer.inspection.deposition.unsupported import MIN_REPORTED_LENGTH
from printer_slicer.values import Struct

__all__ = [
    "CoverageLimits",
    "describe_usage",
    "excess_ratio",
    "find_line_near",
    "find_measured_layer",
    "find_nearest_to_limit",
    "findings",
    "place_of_largest_area",
]

_MIN_AREA: Final = 1.0  # mm² in a layer; a smaller area is not reported
_MIN_SQUARES: Final = 2.0  # squares of the extrusion width; at tips, this area may be missing or surplus
_INFINITE: Final = np.inf


@accept_former_fields(air="unsupported", under="underfilled", over="overfilled")
class CoverageLimits(Struct, frozen=True):
    """Limits for the coverage of each layer, beyond which it is reported.

    Attributes:
        uncovered: largest uncovered share of the shell.
        outside: largest area outside the section, mm².
        overlap: largest overlapping share of the covered area.
        unsupported: largest length of unsupported extrusion, mm.
        underfilled: least material in the shell, as a share of the material it needs.
        overfilled: most material in the shell, as a share of the material it needs.
        outline: largest 95th percentile of the distance of the outlines, mm.
        contour: longest piece of a path that is too high or too low in a contoured layer, mm.
    """

    uncovered: float = 0.05
    outside: float = 1.0
    overlap: float = 0.10
    unsupported: float = MIN_REPORTED_LENGTH
    underfilled: float = 0.90
    overfilled: float = 1.10
    outline: float = 0.15
    contour: float = 3.0


def excess_ratio(diagnostic: Diagnostic) -> float:
    """Return how many times the limit is exceeded: amount / limit, or limit / amount for missing material."""
    amount, limit = diagnostic.amount or 0.0, diagnostic.limit or 0.0
    if diagnostic.code == "underfilled":
        amount, limit = limit, amount
    return _INFINITE if limit <= 0 else amount / limit


class _Measure(Struct, frozen=True, eq=False):
    """One measured quantity of all layers, with its limit.

    Attributes:
        name: code of its findings.
        amount: (L,) what was measured.
        exceeds: (L,) mask of the layers beyond the limit.
        nearness: (L,) how much of what the limit allows is used: 0 for a perfect layer, 1 at the limit.
        limit: the limit of `amount`.
        describe: layer index -> message.
        locate: layer index -> position, mm; nan without one.
    """

    name: str
    amount: Float
    exceeds: Bool
    nearness: Float
    limit: float
    describe: Callable[[int], str]
    locate: Callable[[int], tuple[float, float]]

    @classmethod
    def above(
        cls,
        name: str,
        amount: Float,
        limit: float,
        describe: Callable[[int], str],
        locate: Callable[[int], tuple[float, float]],
        *,
        area: Float | None = None,
    ) -> _Measure:
        """Return a quantity that must not exceed its limit; the arguments are attributes.

        With an `area` (L,), mm², layers of which it is at most 1 mm² do not exceed the limit.
        """
        exceeds, nearness = amount > limit, _limit_usage(amount, limit)
        if area is not None:
            exceeds, nearness = exceeds & (area > _MIN_AREA), np.minimum(nearness, area / _MIN_AREA)
        return cls(name, amount, exceeds, nearness, limit, describe, locate)


def findings(coverage: Coverage, limits: CoverageLimits = CoverageLimits()) -> tuple[Diagnostic, ...]:
    """Return a diagnostic for each run of consecutive layers beyond a limit, the worst first."""
    found = [one for measure in _list_measures(coverage, limits) for one in _find_runs(coverage, measure)]
    return tuple(sorted(found, key=lambda one: -excess_ratio(one)))


def find_nearest_to_limit(
    coverage: Coverage, limits: CoverageLimits = CoverageLimits()
) -> tuple[Diagnostic, float]:
    """Return the layer nearest to a limit, as a diagnostic, and the share of the limit that it uses.

    The share is 0 for a perfect layer and 1 at the limit.
    """
    measures = list(_list_measures(coverage, limits))
    nearness = np.nan_to_num([np.where(coverage.stack.is_spiral_end, 0.0, one.nearness) for one in measures])
    row, layer = np.unravel_index(int(nearness.argmax()), nearness.shape)
    return _make_diagnostic(coverage, measures[row], np.array([layer])), float(nearness[row, layer])


def describe_usage(nearest: Diagnostic, share: float) -> str:
    """Describe the layer nearest to a limit: its number and height, and how much of the limit it uses."""
    return f"layer {nearest.layer}, z {nearest.z:.4g} mm, {nearest.code} at {share:.0%} of its limit"


def _limit_usage(amount: Float, limit: float) -> Float:
    """Return amounts (L,) divided by their limit; with a limit of 0, infinity for every positive amount."""
    return np.divide(amount, limit) if limit > 0 else np.where(amount > 0, _INFINITE, 0.0)


def _find_runs(coverage: Coverage, measure: _Measure) -> Iterator[Diagnostic]:
    """Yield a diagnostic for each run of consecutive layers of a group beyond the limit."""
    stack = coverage.stack
    by_group = stack.by_group
    exceeding = np.flatnonzero((measure.exceeds & ~stack.is_spiral_end)[by_group])
    if not len(exceeding):
        return
    is_new = (np.diff(exceeding) > 1) | (np.diff(stack.group[by_group][exceeding]) > 0)
    cuts = [0, *(np.flatnonzero(is_new) + 1).tolist(), len(exceeding)]
    for begin, end in pairwise(cuts):
        yield _make_diagnostic(coverage, measure, by_group[exceeding[begin:end]])


def _make_diagnostic(coverage: Coverage, measure: _Measure, run: Int) -> Diagnostic:
    """Return a diagnostic for a run of consecutive layers, located at its worst layer."""
    amount = measure.amount[run]
    layer = int(run[(amount.argmin if measure.name == "underfilled" else amount.argmax)()])
    x, y = measure.locate(layer)
    number = coverage.stack.number
    return Diagnostic(
        measure.name,
        "error",
        measure.describe(layer),
        line=find_line_near(coverage, layer, x, y),
        layer=int(number[layer]),
        first=int(number[run[0]]),
        last=int(number[run[-1]]),
        z=float(coverage.stack.top[layer]),
        place=None if np.isnan(x) else (x, y),
        amount=float(measure.amount[layer]),
        limit=measure.limit,
    )


def _list_measures(coverage: Coverage, limits: CoverageLimits) -> Iterator[_Measure]:
    """Yield all measured quantities of a coverage, each with its limit."""
    uncovered, shell, covered = coverage.uncovered.area(), coverage.shell.area(), coverage.covered.area()
    share = uncovered / np.maximum(shell, 1e-9)
    yield _Measure.above(
        "uncovered",
        share,
        limits.uncovered,
        lambda k: f"{uncovered[k]:.1f} mm² ({share[k]:.0%}) of the shell are not covered",
        lambda k: place_of_largest_area(coverage.uncovered, k),
        area=uncovered,
    )
    outside = coverage.outside.area()
    yield _Measure.above(
        "outside",
        outside,
        limits.outside,
        lambda k: f"{outside[k]:.1f} mm² are printed outside the outline of the part",
        lambda k: place_of_largest_area(coverage.outside, k),
    )
    fill = coverage.fill
    overlap_share = fill.overlap / np.maximum(covered, 1e-9)
    yield _Measure.above(
        "overlap",
        overlap_share,
        limits.overlap,
        lambda k: (
            f"extrusions overlap on {fill.overlap[k]:.1f} mm² ({overlap_share[k]:.0%} of the layer),"
            f" up to {fill.most[k]:.1f} times full"
        ),
        lambda k: (float(fill.place[k, 0]), float(fill.place[k, 1])),
        area=fill.overlap,
    )
    yield from _volume_measures(coverage, limits)
    yield _unsupported_measure(coverage, limits)
    yield _outline_measure(coverage, limits)
    if coverage.surface is not None:
        yield _contour_measure(coverage.surface, limits)


def _contour_measure(surface: SurfaceErrors, limits: CoverageLimits) -> _Measure:
    """Return the length of extrusion that does not follow the surface, with its limit."""
    length, most = surface.length, surface.most
    return _Measure.above(
        "contour",
        length,
        limits.contour,
        lambda k: (
            f"{length[k]:.0f} mm of a path are up to {abs(most[k]):.2f} mm too {'high' if most[k] > 0 else 'low'}"
            " for the surface"
        ),
        lambda k: (float(surface.place[k, 0]), float(surface.place[k, 1])),
    )


def _outline_measure(coverage: Coverage, limits: CoverageLimits) -> _Measure:
    """Return the distance between printed outline and section outline, with its limit."""
    outline, size = coverage.outline, np.maximum(coverage.sections.area(), coverage.covered.area())
    return _Measure.above(
        "outline",
        outline.p95,
        limits.outline,
        lambda k: (
            f"outline error {outline.p95[k]:.2f} mm (95th percentile), at most {outline.largest[k]:.2f} mm"
        ),
        lambda k: (float(outline.place[k, 0]), float(outline.place[k, 1])),
        area=size,
    )


def _volume_measures(coverage: Coverage, limits: CoverageLimits) -> Iterator[_Measure]:
    """Yield missing material and surplus material in the shell, each with its limit."""
    fill, height, shell = coverage.fill.shell, coverage.stack.height, coverage.shell.area()
    width = coverage.stack.beads.take(np.flatnonzero(coverage.of_part)).usual_width
    surplus, missing = (fill - limits.overfilled) * shell, (limits.underfilled - fill) * shell
    min_area = _MIN_SQUARES * width**2
    overfilled, underfilled = surplus > min_area, missing > min_area
    if overfilled.any():
        overfilled &= surplus - _area_beside_fins(coverage, overfilled, width) > min_area
    # A small shell may deviate by more: the smallest reported area is a larger share of a small shell.
    slack = min_area / np.maximum(shell, 1e-9)
    for name, limit, exceeds, used, allowed in (
        ("underfilled", limits.underfilled, underfilled, 1 - fill, 1 - limits.underfilled),
        ("overfilled", limits.overfilled, overfilled, fill - 1, limits.overfilled - 1),
    ):
        yield _Measure(
            name,
            fill,
            exceeds,
            np.where(exceeds | (used <= allowed + slack), used / np.maximum(allowed + slack, 1e-9), 0.0),
            limit,
            lambda k: (
                f"the shell has {fill[k]:.0%} of the material it needs (layer height {height[k]:.3g} mm)"
            ),
            lambda _: (np.nan, np.nan),
        )


def _area_beside_fins(coverage: Coverage, layers: Bool, width: float) -> Float:
    """Return the area (L,), mm², covered beside fins narrower than a line, in the selected layers (L,)."""
    sections = coverage.sections.of_layers(layers)
    fins = difference(sections, offset_open(sections, width / 2))
    beside = difference(coverage.covered.of_layers(layers), sections)
    return intersection(beside, offset(fins, width)).area()


def _unsupported_measure(coverage: Coverage, limits: CoverageLimits) -> _Measure:
    """Return the length of unsupported extrusion, with its limit."""
    length, place = coverage.unsupported_length, np.full((coverage.stack.n_layers, 2), np.nan)
    for one in reversed(coverage.unsupported):
        place[coverage.layer_of_unsupported(one)] = one.x, one.y
    return _Measure.above(
        "unsupported",
        length,
        limits.unsupported,
        lambda k: f"{length[k]:.0f} mm of unsupported extrusion",
        lambda k: (float(place[k, 0]), float(place[k, 1])),
    )


def find_measured_layer(coverage: Coverage, diagnostic: Diagnostic) -> int:
    """Return the index of the layer of a diagnostic in the stack of its coverage.

    If several groups of objects have a layer with its number, it is the layer of the extrusion in its line.
    """
    stack = coverage.stack
    found = np.flatnonzero(stack.number == diagnostic.layer)
    layers = stack.layer[stack.beads.line == diagnostic.line]
    return int([*found[np.isin(found, layers)], *found][0])


def place_of_largest_area(areas: Areas, layer: int) -> tuple[float, float]:
    """Return the outline point, mm, nearest to the middle of a layer's largest area; nan without area."""
    rings = list(areas.rings(layer))
    if not rings:
        return np.nan, np.nan
    first, last = np.searchsorted(areas.ring_layer, [layer, layer + 1])
    ring = rings[int(areas.ring_area()[first:last].argmax())]
    middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
    x, y = ring[int(np.hypot(*(ring - middle).T).argmin())].tolist()
    return x, y


def find_line_near(coverage: Coverage, layer: int, x: float, y: float) -> int:
    """Return the G-code line of the extrusion nearest to (x, y), or of the layer's first one if x is nan."""
    selected = np.flatnonzero((coverage.stack.layer == layer) & coverage.of_part)
    if not len(selected):
        return 0
    if np.isnan(x):
        return int(coverage.stack.beads.line[selected[0]])
    beads = coverage.stack.beads.take(selected)
    from_middle = np.hypot(*((beads.begin + beads.end) / 2 - (x, y)).T) - beads.length / 2
    return int(beads.line[from_middle.argmin()])
