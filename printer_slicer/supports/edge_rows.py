"""Add rows to columns, below edges of overhangs that are far from all other rows.

The rows of a column are chosen by its widest outline. Where an edge of the overhang lies between two
of them, both rows may be too far away to support it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, Lines, hatch, offset
from printer_slicer.model import Overhangs, Supports, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.supports.support_paths import compute_line_widths
from printer_slicer.supports.unsupported_places import UnsupportedPoints, find_unsupported_groups

__all__ = ["add_edge_rows"]

_MIN_AREA: Final = 1.0  # mm² of an unsupported place that gets a row
_ASIDE: Final = (
    0.0,
    0.4,
    -0.4,
    0.8,
    -0.8,
    1.2,
    -1.2,
)  # mm from the middle of an unsupported place to its row
_LONGER_BY: Final = 1.2  # times the length in all layers near the place, by which another row is better
_BELOW: Final = 0.5  # mm below the lowest contact, where a row is near enough
_MIN_LENGTH: Final = 2.0  # widths; shorter rows are left out
_FAR: Final = 1e4  # mm between the rows of a hatch, so that it has only one


def add_edge_rows(supports: Supports, paths: Toolpaths, overhangs: Overhangs, profile: Profile) -> Toolpaths:
    """Return the paths of columns, with rows added below unsupported places of which the column reaches the edge.

    Args:
        supports: the columns.
        paths: their extrusions.
        overhangs: for which they were made.
        profile: gaps and extrusion widths.
    """
    groups = [
        one for one in find_unsupported_groups(overhangs, paths, profile) if one.area.sum() >= _MIN_AREA
    ]
    if not groups or not supports.base.n_rings:
        return paths
    layers = supports.plan.layers
    width = compute_line_widths(layers, profile)
    room = offset(supports.base, -width / 2)
    rows = [_make_row(group, room, supports, _MIN_LENGTH * float(width[-1])) for group in groups]
    ends, layer = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    order = np.argsort(layer, kind="stable")
    made = Toolpaths.gathered(
        layers,
        xy=ends[order].reshape(-1, 2),
        size=np.full(len(layer), 2),
        layer=layer[order],
        role=np.full(len(layer), Role.SUPPORT),
        width=width[layer[order]],
        closed=False,
    )
    return Toolpaths.joined(layers, [paths, made])


def _make_row(
    group: UnsupportedPoints, room: Areas, supports: Supports, shortest: float
) -> tuple[Float, Int]:
    """Return lines (n, 2, 2) of the row below an unsupported place, in all layers of its column, and layers (n,)."""
    (left, low), (right, high) = group.xy.min(axis=0), group.xy.max(axis=0)
    carrier, tops = supports.plan.carrier[group.layer], supports.plan.layers.top
    first = int(np.searchsorted(tops, tops[carrier.min()] - _BELOW))
    last, ends = int(carrier.max()), (float(left), float(right))
    near = room.copy_layers(np.arange(first, last + 1))
    best, longest = 0.0, 0.0
    for aside in _ASIDE:
        y = float(low + high) / 2 + aside
        length = float(_hatch_row(near, y, ends).length().sum())
        if length > _LONGER_BY * longest:
            best, longest = y, length
    row = _hatch_row(room.copy_layers(np.arange(last + 1 if longest else 0)), best, ends)
    row = row.take(np.flatnonzero(row.length() >= shortest))
    return row.ends, row.layer


def _hatch_row(room: Areas, y: float, ends: tuple[float, float]) -> Lines:
    """Return the lines within areas at a position across them, between two ends, mm."""
    lines = hatch(room, angle=0.0, spacing=_FAR, phase=y / _FAR)
    u = np.clip(lines.u, *ends)
    xy = np.stack([u, lines.ends[:, :, 1]], axis=2)
    clipped = Lines(xy, lines.layer, lines.row, u, lines.edge)
    return clipped.take(np.flatnonzero(u[:, 1] > u[:, 0]))
